"""A compiled loop polls Python every so many steps: LLVM code calls the `__bool__` of an object.

The loop runs without the interpreter's lock and takes it for a poll. What Python raises in a poll, a KeyboardInterrupt
among others, ends the loop, and is raised again when the loop has ended.
"""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np

from . import language
from .caches import LOCK
from .language import Floats, bits, call, rare
from .machine import addresses

# places in the array that a loop shares with Python: the time that it has reached, steps until the next poll, whether
# it is to end, the address of the poll, that of the object; and an error that was raised: its type, itself, a traceback
TIME, LEFT, END, POLL, OBJECT, ERROR, SIZE = 0, 1, 2, 3, 4, 5, 8
PYTHON = ("PyGILState_Ensure", "PyObject_IsTrue", "PyErr_Fetch", "PyGILState_Release")


def to_end(watch: Floats, t: float) -> bool:
    """Is a loop that is at t, and is about to take a step, to end?"""
    watch[LEFT] -= 1.0
    if watch[LEFT] >= 0.0:
        return False
    return polled(watch, t)


@rare
def polled(watch: Floats, t: float) -> bool:
    """Is the loop to end? Asks Python, unless an earlier poll has ended the loop."""
    if watch[END] == 0.0:
        watch[TIME] = t
        call(bits(watch[POLL]), watch, watch, watch)
    return float(watch[END]) != 0.0


def _code() -> str:
    """LLVM code of a kernel of `watch` alone."""
    lines = [f"@python = global [{len(PYTHON)} x ptr] zeroinitializer"]
    lines.append("define void @poll(ptr %watch, ptr %b, ptr %c) {\nentry:")
    for k in range(len(PYTHON)):
        lines.append(f"  %at{k} = getelementptr ptr, ptr @python, i64 {k}\n  %f{k} = load ptr, ptr %at{k}")
    places = (("object", OBJECT), ("end", END), *((f"error{k}", ERROR + k) for k in range(3)))
    lines += [f"  %{name}.at = getelementptr double, ptr %watch, i64 {place}" for name, place in places]
    lines.append("  %object = load ptr, ptr %object.at\n  %state = call i32 %f0()")
    lines.append("  %value = call i32 %f1(ptr %object)\n  %go = icmp eq i32 %value, 0")
    lines.append("  br i1 %go, label %on, label %stop\nstop:\n  store double 1.0, ptr %end.at")
    lines.append(f"  call void %f2({', '.join(f'ptr %error{k}.at' for k in range(3))})\n  br label %on")
    lines.append("on:\n  call void %f3(i32 %state)\n  ret void\n}")
    return "\n".join(lines)


_NATIVE: list[int] = []


def _native() -> int:
    """Address of the compiled poll."""
    with LOCK:
        if not _NATIVE:
            poll, table = addresses(["poll", "python"], _code)
            places = (ctypes.c_size_t * len(PYTHON)).from_address(table)
            places[:] = [ctypes.cast(getattr(ctypes.pythonapi, x), ctypes.c_void_p).value or 0 for x in PYTHON]
            _NATIVE.append(poll)
    return _NATIVE[0]


def watch_by(polled_object: Any, steps: float) -> Floats:
    """The array, shape (SIZE,), that a loop shares with Python: it polls bool(polled_object), first after `steps`.

    The caller keeps the object alive. Plain Python functions do not poll: Python interrupts these by itself."""
    watch = np.zeros(SIZE)
    watch[LEFT] = np.inf if language.PLAIN else steps
    whole = watch.view(np.int64)
    whole[POLL], whole[OBJECT] = 0 if language.PLAIN else _native(), id(polled_object)
    return watch


def raise_again(watch: Floats) -> None:
    """Raises what a poll has raised, and clears the array for the next run."""
    error = [int(x) or None for x in watch.view(np.int64)[ERROR:SIZE]]
    watch[END], watch[ERROR:SIZE] = 0.0, 0.0
    if error[0]:
        ctypes.PYFUNCTYPE(None, *[ctypes.c_void_p] * 3)(("PyErr_Restore", ctypes.pythonapi))(*error)
