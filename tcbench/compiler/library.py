"""Calls of compiled code from Python: `Library`, and `evaluate` for single kernels.

A library is one module of LLVM: its functions and all that they call, optimised together. They release the
interpreter's lock while they run. With TCBENCH_PLAIN=1 its functions are the Python functions themselves.
"""

from __future__ import annotations

import ctypes
import os
import threading
import time
import traceback
from _thread import interrupt_main
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from types import FunctionType
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import TcbenchError
from . import language
from .caches import LOCK
from .calls import NATIVE, native, run_kernel
from .language import Address, Floats, Matrix, call
from .machine import LIBRARY, addresses
from .records import address_of
from .values import BOOL, FLOAT, INT, NOTHING, NUMPY, Array, Several, kind_of

if TYPE_CHECKING:
    from .kernels import Kernel
    from .translator import Module

CODES = {INT: ctypes.c_int64, FLOAT: ctypes.c_double, BOOL: ctypes.c_int64, NOTHING: None}


_SOURCES: dict[str, str] = {}  # by file, as it was when its library was made: authors edit files


class Library:
    """Functions of the restricted Python, compiled together when the first of them is asked for: `library.march(...)`.

    Arguments are numbers, records and contiguous arrays, as the annotations say. Globals that the functions read are
    constants of the compiled code, with their values at the time of compiling.
    """

    def __init__(self, name: str, *functions: Any) -> None:
        names = [f.__name__ for f in functions]
        taken = [x for x in names if names.count(x) > 1 or hasattr(type(self), x) or x in ("name", "functions")]
        if taken:
            raise TcbenchError(
                f"The library {name!r} cannot have a function {taken[0]!r}: the name is taken. Rename it."
            )
        self.name, self.functions = name, functions
        for file in () if language.PLAIN else {f.__code__.co_filename for f in functions}:
            with suppress(OSError, UnicodeDecodeError):
                _SOURCES[file] = Path(file).read_text(encoding="utf-8")

    def __getattr__(self, name: str) -> Any:
        if not any(f.__name__ == name for f in self.functions):
            raise AttributeError(f"The library {self.name!r} has no function {name!r}.")
        if language.PLAIN:
            self.__dict__ |= {f.__name__: _quiet(f) for f in self.functions}
        else:
            with LOCK:  # the second of two threads reads what the first compiled
                starts = _linked(self._translated(), list(self.entries()))
            self.__dict__ |= {f.__name__: _entry(f, address) for f, address in zip(self.functions, starts, strict=True)}
        return self.__dict__[name]

    def bound(self, name: str, record: Any) -> Callable[[], Any]:
        """The function with this record bound, which the caller keeps alive; a call takes 0.2 microseconds less."""
        entry = getattr(self, name)
        machine = getattr(entry, "machine", None)
        return partial(entry, record) if machine is None else partial(machine, record.address)

    def code(self) -> str:
        """LLVM code of the module."""
        return self._translated().text()

    def _translated(self) -> Module:
        from .translator import Module

        module = Module(_SOURCES)
        for name, function in self.entries().items():
            module.entry(function, name)
        return module

    def entries(self) -> dict[str, Any]:
        """The functions by their names in compiled code: numbers, so that a rename compiles nothing."""
        return {f"entry.{i}": function for i, function in enumerate(self.functions)}


_CALLBACKS: list[Any] = []  # for as long as the process lives
_LATE: dict[FunctionType, int] = {}  # addresses of late functions
_SPENT = [0.0]


def compiled_late() -> float:
    """Seconds that this process has spent on compiling late functions, while compiled code waited."""
    return _SPENT[0]


def _linked(module: Module, entries: list[str]) -> list[int]:
    """Addresses of a module's entries; its late functions are compiled when they are called."""
    from .translator import LATE, MAKER

    late, n = list(module.late), len(entries)
    places = [f"{what}{k}" for k in range(len(late)) for what in (LATE, MAKER)]
    places_and_makers = addresses([*entries, *places], module.text, kind=LIBRARY)
    for function, place, maker in zip(late, places_and_makers[n::2], places_and_makers[n + 1 :: 2], strict=True):
        _later(partial(_compiled, function), place, maker)
    return places_and_makers[:n]


def _later(make: Callable[[], int], place: int, maker: int) -> None:
    """Set `maker`, which compiled code calls, to put the result of `make` at `place`."""
    function = ctypes.CFUNCTYPE(None)(partial(_make_late, make, place))
    _CALLBACKS.append(function)
    ctypes.c_void_p.from_address(maker).value = ctypes.cast(function, ctypes.c_void_p).value


def _compiled(function: FunctionType) -> int:
    """Address of a late function."""
    from .translator import Module

    with LOCK:  # of two threads the second finds what the first has made
        if function not in _LATE:
            module = Module(_SOURCES, root=function)
            name = module.function(function).name.strip('@"')
            (_LATE[function],) = _linked(module, [name])
        return _LATE[function]


def _make_late(make: Callable[[], int], place: int) -> None:
    """Compile a late function and store its address. No exception may leave: compiled code is waiting."""
    address, interrupted, begin = 0, False, time.perf_counter()
    while not address:
        try:
            address = make()
        except KeyboardInterrupt:
            interrupted = True
        except BaseException:
            traceback.print_exc()
            os.abort()
    ctypes.c_void_p.from_address(place).value = address
    _SPENT[0] += time.perf_counter() - begin
    if interrupted:  # raised again when compiled code goes on
        threading.Timer(0.02, interrupt_main).start()


_THREE = "ptr %a, ptr %b, ptr %out"
LATE_KERNEL = f"""
@place = global ptr @first
@maker = global ptr null
define internal void @first({_THREE}) noinline {{
  %make = load ptr, ptr @maker
  call void %make()
  %made = load ptr, ptr @place
  call void %made({_THREE})
  ret void
}}
define void @kernel({_THREE}) {{
  %made = load ptr, ptr @place
  call void %made({_THREE})
  ret void
}}
"""


def late_address(kernel: Kernel) -> Address:
    """The address of a kernel that its first call compiles: many runs never call it."""
    if language.PLAIN:
        return kernel.address
    address, place, maker = addresses(["kernel", "place", "maker"], lambda: LATE_KERNEL)
    _later(lambda: kernel.address, place, maker)
    return address


def callback(function: Callable[[Any, Any, Any], None], sizes: tuple[int, int, int]) -> Address:
    """The address of a Python function of three arrays of these sizes, which compiled code calls as a kernel."""
    if language.PLAIN:
        return language.made_up_address(
            lambda *arrays: function(*(np.ravel(x)[:size] for x, size in zip(arrays, sizes, strict=True)))
        )

    kept = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 3)(
        lambda *places: function(*(_numbers(at, size) for at, size in zip(places, sizes, strict=True)))
    )
    _CALLBACKS.append(kept)
    return ctypes.cast(kept, ctypes.c_void_p).value or 0


def _numbers(place: int, size: int) -> np.ndarray:
    return np.ctypeslib.as_array((ctypes.c_double * size).from_address(place))


def _quiet(function: Callable[..., Any]) -> Callable[..., Any]:
    """The Python function without numpy's warnings, as compiled code gives none."""

    def plain(*arguments: Any) -> Any:
        with np.errstate(all="ignore"):
            return function(*arguments)

    return plain


def _entry(function: Callable[..., Any], address: int) -> Callable[..., Any]:
    """A Python function that calls the compiled one: by address for records, by address and lengths for arrays."""
    kinds = dict(function.__annotations__)
    result = kind_of(kinds.pop("return"), function.__globals__)
    types: list[Any] = []
    passed = []
    for name, annotation in kinds.items():
        kind = kind_of(annotation, function.__globals__)
        if isinstance(kind, Array):
            types += [ctypes.c_int64] * (1 + kind.rank)
            passed.append(f"*__place({name}, {kind.rank}, __numpy[{kind.item!r}])")
        elif isinstance(kind, str):
            types.append(CODES[kind])
            passed.append(name)
        else:
            types.append(ctypes.c_void_p)  # which ctypes converts in half the time of a number
            passed.append(f"{name}.address")
    scope: dict[str, Any] = {"__place": _place, "__numpy": NUMPY, "__byref": ctypes.byref}
    if several := isinstance(result, Several):
        fields = [(f"part{i}", CODES[kind]) for i, kind in enumerate(result.kinds)]
        scope["__results"] = type("Results", (ctypes.Structure,), {"_fields_": fields})
        types.append(ctypes.c_void_p)
        passed.append("__byref(results := __results())")
    scope["__machine"] = machine = ctypes.CFUNCTYPE(None if several else CODES[result], *types)(address)
    text = f"__machine({', '.join(passed)})"
    if several:
        text = f"({text}, ({''.join(f'results.{name}, ' for name, _ in fields)}))[1]"
    entry: Callable[..., Any] = eval(f"lambda {', '.join(kinds)}: {text}", scope)
    if not several:
        vars(entry)["machine"] = machine
    return entry


def _place(array: np.ndarray, rank: int, kind: np.dtype[Any]) -> tuple[int, ...]:
    """The address and the lengths of an array; TypeError for another kind or rank, or gaps in memory."""
    same_type = array.dtype is kind or array.dtype == kind  # identity is the common case, and takes a tenth of the time
    if not same_type or array.ndim != rank or not array.flags.c_contiguous:
        raise TypeError(f"a contiguous array of {kind} with {rank} axes is needed, not {array!r}")
    return address_of(array), *array.shape


# kernels ------------------------------------------------------------------------------------------------------------


def evaluate_rows(kernel: Address, a: Matrix, b: Floats, out: Matrix) -> None:
    """Run one kernel on each row of `a`, into the rows of `out`."""
    for i in range(len(a)):
        call(kernel, a[i], b, out[i])


ROWS = Library("rows", evaluate_rows)


def evaluate(kernel: int, a: Any, b: Any, out: Any) -> None:
    """Run one kernel, by its address, on three float64 arrays; out must be contiguous. (0.7 microseconds.)"""
    if language.PLAIN:
        with np.errstate(all="ignore"):
            call(kernel, a, b, out)
    elif (NATIVE or native())[0](kernel, id(a), id(b), id(out)):
        if not (out.flags.c_contiguous and out.flags.writeable and out.dtype == np.float64):
            raise TcbenchError(
                "The array for a kernel's results must be contiguous, of float64, and not read-only: give np.empty(n)."
            )
        run_kernel(kernel, np.ascontiguousarray(a, np.float64), np.ascontiguousarray(b, np.float64), out)
