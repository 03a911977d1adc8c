"""How Python looks at a compiled loop that runs, every so many steps: LLVM code that asks an object's `__bool__`.

The loop has released the interpreter's lock, which the look takes for as long as it lasts. What Python raises there, a
KeyboardInterrupt among others, ends the loop, and is raised again when it has ended.
"""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np

from . import language
from .language import Floats, bits, call, rare
from .machine import addresses
from .once import LOCK

# places in the array that a loop shares with Python: the time that it has reached, steps until the next look, whether
# it is to end, the address of the look, that of the object; and an error that was raised: its type, itself, a traceback
TIME, LEFT, END, LOOK, OBJECT, ERROR, SIZE = 0, 1, 2, 3, 4, 5, 8
PYTHON = ("PyGILState_Ensure", "PyObject_IsTrue", "PyErr_Fetch", "PyGILState_Release")


def to_end(watch: Floats, t: float) -> bool:
    """Is a loop that is at t, and is about to take a step, to end?"""
    watch[LEFT] -= 1.0
    if watch[LEFT] >= 0.0:
        return False
    return asked(watch, t)


@rare
def asked(watch: Floats, t: float) -> bool:
    if watch[END] == 0.0:
        watch[TIME] = t
        call(bits(watch[LOOK]), watch, watch, watch)
    return float(watch[END]) != 0.0


def _look() -> str:
    """LLVM code of a kernel of `watch` alone."""
    lines = [f"@python = global [{len(PYTHON)} x ptr] zeroinitializer"]
    lines.append("define void @look(ptr %watch, ptr %b, ptr %c) {\nentry:")
    for k in range(len(PYTHON)):
        lines.append(f"  %at{k} = getelementptr ptr, ptr @python, i64 {k}\n  %f{k} = load ptr, ptr %at{k}")
    places = (("object", OBJECT), ("end", END), *((f"error{k}", ERROR + k) for k in range(3)))
    lines += [f"  %{name}.at = getelementptr double, ptr %watch, i64 {place}" for name, place in places]
    lines.append("  %object = load ptr, ptr %object.at\n  %state = call i32 %f0()")
    lines.append("  %found = call i32 %f1(ptr %object)\n  %go = icmp eq i32 %found, 0")
    lines.append("  br i1 %go, label %on, label %stop\nstop:\n  store double 1.0, ptr %end.at")
    lines.append(f"  call void %f2({', '.join(f'ptr %error{k}.at' for k in range(3))})\n  br label %on")
    lines.append("on:\n  call void %f3(i32 %state)\n  ret void\n}")
    return "\n".join(lines)


_NATIVE: list[int] = []


def _native() -> int:
    """Address of the look."""
    with LOCK:
        if not _NATIVE:
            look, table = addresses(["look", "python"], _look)
            places = (ctypes.c_size_t * len(PYTHON)).from_address(table)
            places[:] = [ctypes.cast(getattr(ctypes.pythonapi, x), ctypes.c_void_p).value or 0 for x in PYTHON]
            _NATIVE.append(look)
    return _NATIVE[0]


def watch_by(looker: Any, steps: float) -> Floats:
    """The array of a loop at which `bool(looker)` looks, first after so many steps. The caller keeps the object.

    The plain Python functions are not looked at: Python interrupts these by itself."""
    watch = np.zeros(SIZE)
    watch[LEFT] = np.inf if language.PLAIN else steps
    whole = watch.view(np.int64)
    whole[LOOK], whole[OBJECT] = 0 if language.PLAIN else _native(), id(looker)
    return watch


def raise_again(watch: Floats) -> None:
    """What a look has raised; the next run may begin."""
    error = [int(x) or None for x in watch.view(np.int64)[ERROR:SIZE]]
    watch[END], watch[ERROR:SIZE] = 0.0, 0.0
    if error[0]:
        ctypes.PYFUNCTYPE(None, *[ctypes.c_void_p] * 3)(("PyErr_Restore", ctypes.pythonapi))(*error)
