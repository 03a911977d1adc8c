"""Comparisons of what formulas are traced on, and functions of numpy that choose: what each does is in `kinks`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

KINKED: dict[Any, Callable[..., Any]] = {}  # of entries, in the place of numpy's
CHOICES: dict[Any, Callable[..., Any]] = {}  # of numbers and arrays


def _of(ufunc: Any) -> Callable[..., Any]:
    return lambda self, *others: ufunc(self, *others)


class Choosing:
    """A number in formulas, in whose place numpy's functions have a kink that methods locate."""

    __slots__ = ()

    __gt__ = __ge__ = _of(np.greater)
    __lt__ = __le__ = _of(np.less)
    __and__ = __rand__ = _of(np.logical_and)
    __or__ = __ror__ = _of(np.logical_or)
    __invert__ = _of(np.logical_not)

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        """As numpy does with objects, but for choices; arrays of other kinds do it themselves."""
        if any(getattr(type(x), "__array_ufunc__", None) not in _AS_NUMPY for x in inputs):
            return NotImplemented
        operands = [boxed(x) if isinstance(x, Choosing) else x for x in inputs]
        if ufunc in KINKED and method == "__call__" and not options:
            return np.frompyfunc(KINKED[ufunc], ufunc.nin, 1)(*operands)
        return getattr(ufunc, method)(*operands, **options)

    def __array_function__(self, function: Any, types: Any, args: Any, kwargs: Any) -> Any:
        if function not in CHOICES and not all(issubclass(t, Choosing | np.ndarray) for t in types):
            return NotImplemented
        return CHOICES.get(function, function._implementation)(*args, **kwargs)


_AS_NUMPY = (None, np.ndarray.__array_ufunc__, Choosing.__array_ufunc__)


def boxed(x: Any) -> Any:
    """An array; without axes of what is none."""
    if isinstance(x, np.ndarray):
        return x
    box = np.empty((), dtype=object)
    box[()] = x
    return box
