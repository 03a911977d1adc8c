"""The restricted Python of compiled loops: the functions that it may call. See `translator`.

The same functions run as plain Python, slowly, on numpy arrays: tests compare compiled code with them. With
TCBENCH_PLAIN=1 in the environment all runs as plain Python, kernels included, and nothing is compiled.
"""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Callable
from functools import cache
from typing import Annotated, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

PLAIN = os.environ.get("TCBENCH_PLAIN", "0") not in ("", "0")

# annotations of arguments and of a record's fields: contiguous arrays with 1, 2 and 3 axes, and a kernel's address; the
# names beside them are for files without `from __future__ import annotations`
Floats = Annotated[NDArray[np.float64], "Floats"]
Matrix = Annotated[NDArray[np.float64], "Matrix"]
Cube = Annotated[NDArray[np.float64], "Cube"]
Ints = Annotated[NDArray[np.int64], "Ints"]
# 32 bits in memory, half the traffic of large systems; read as an int or a float
ShortInts = Annotated[NDArray[np.int32], "ShortInts"]
ShortFloats = Annotated[NDArray[np.float32], "ShortFloats"]
Eight = Annotated[NDArray[np.float64], "Eight"]  # a short vector of eight numbers
Address = int

SPLIT = 2.0**27 + 1
PYTHON_KERNELS: dict[int, Callable[[Any, Any, Any], None]] = {}  # made-up address -> function in plain Python
_ADDRESSES = itertools.count(1)
F = TypeVar("F", bound=Callable[..., Any])


def rare(function: F) -> F:
    """Mark a function that few steps call: its code is kept out of the loop."""
    function.rare = True  # type: ignore[attr-defined]
    return function


def late(function: F) -> F:
    """Mark a function that most runs do not call: its first call compiles it."""
    function.late = True  # type: ignore[attr-defined]
    return function


def exact(function: F) -> F:
    """Mark a function whose operations are never fused: each is rounded, on every processor alike."""
    function.exact = True  # type: ignore[attr-defined]
    return function


def made_up_address(function: Callable[[Any, Any, Any], None]) -> int:
    """A unique address at which `call` finds this function."""
    address = next(_ADDRESSES)
    PYTHON_KERNELS[address] = function
    return address


def call(kernel: Address, a: Any, b: Any, out: Any) -> None:
    """Run the kernel at this address on three float64 arrays of any shape: kernel(a, b, out)."""
    if kernel in PYTHON_KERNELS:
        PYTHON_KERNELS[kernel](a, b, out)
    else:
        from .calls import run_kernel

        run_kernel(kernel, a, b, out)


def scratch(size: int) -> Floats:
    """Memory for `size` numbers while a kernel runs; `release` it at the end."""
    return np.empty(size)


def release(array: Floats) -> None:
    """Free the memory of `scratch`."""


def vector(*numbers: float) -> Floats:
    """A short vector of these numbers, on which arithmetic is done at once."""
    return np.array(numbers)


def row(array: Floats, start: int, count: int) -> Floats:
    """`count` numbers of an array, from `start` on, as a vector."""
    return np.array(array[start : start + count])


def pick(x: Floats, y: Floats, *lanes: int) -> Floats:
    """Some of the numbers of two vectors of one length, those of y counted after those of x."""
    return np.concatenate([x, y])[list(lanes)]


def put(array: Floats, start: int, x: Floats) -> None:
    """Store a vector in an array, from `start` on."""
    array[start : start + len(x)] = x


def two_product(x: Any, y: Any) -> tuple[Any, Any]:
    """(product, error) with product + error = x y exactly, of numbers or short vectors: Dekker (1971).

    Neither may overflow or come near the smallest numbers."""
    product, (x1, x2), (y1, y2) = x * y, _halves(x), _halves(y)
    return product, x2 * y2 - (((product - x1 * y1) - x2 * y1) - x1 * y2)


def _halves(x: Any) -> tuple[Any, Any]:
    """x as a sum of two numbers of 26 bits."""
    scaled = SPLIT * x
    high = scaled - (scaled - x)
    return high, x - high


def bits(x: float) -> int:
    """The 64 bits of a positive number: a whole number that grows as its logarithm does, 2^52 for a factor of two."""
    return int(np.float64(x).view(np.int64))


def from_bits(whole: int) -> float:
    """The number with these bits."""
    return np.int64(whole).view(np.float64)


def copy_into(target: Floats, source: Floats) -> None:
    """target[:] = source."""
    for i in range(len(source)):
        target[i] = source[i]


def fill(target: Floats, value: float) -> None:
    """target[:] = value."""
    for i in range(len(target)):
        target[i] = value


@cache
def of_c(name: str) -> Callable[..., float]:
    """A function of C: that of `math`, with numpy's infinity or NaN where that raises an error."""
    exact, limit = getattr(math, name), getattr(np, name)

    def function(*x: Any) -> Any:
        if isinstance(x[0], np.ndarray):  # a short vector
            return np.array([function(*numbers) for numbers in zip(*x, strict=True)])
        try:
            return np.float64(exact(*x))
        except (ValueError, OverflowError):
            with np.errstate(all="ignore"):
                value: float = limit(*map(np.float64, x))
                np.positive(0.0)  # clears the processor's flags, of which numpy would warn its caller
                return value

    function.__name__ = name
    return function
