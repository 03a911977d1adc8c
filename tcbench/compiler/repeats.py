"""Is a formula the same whenever it is called? A random number, a clock or a counter would be frozen in a trace."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from numbers import Real
from typing import Any

import numpy as np

from .array_states import entries
from .derivatives import topological
from .symbols import Symbol

REMEDY = (
    "is not the same when it is called again. A formula reads its arguments, constants of self and what does not "
    "change: no random numbers, no clock, no counter. tcbench has no noise: equations are deterministic"
)

SAME_NUMBER = 1e-14  # relative difference of constants that is round-off; two readings of a clock differ by more


def same_again(value: Any, formula: Callable[[], Any]) -> bool:
    """Does the formula, called on the same symbols, give what was found before?

    Equal expressions of one trace are one object; where the order of a sum differs, the numbers in them are compared.
    """
    one, other = _parts(value), _parts(formula())
    return _same(one, other) or _same(other, _parts(formula()))  # the first call may have made what later ones find


def _same(one: list[Any], other: list[Any]) -> bool:
    if len(one) != len(other):
        return False
    return all(a is b for a, b in zip(one, other, strict=True)) or _alike(_numbers(one), _numbers(other))


def _alike(one: set[Any], other: set[Any]) -> bool:
    """Has each number one like it among the others, but for round-off? Constants are added up in either order."""
    a, b = (np.array(sorted(float(x) for x in numbers if x == x)) for numbers in (one, other))
    return one == other or all(_near(x, y) for x, y in ((a, b), (b, a)))


def _near(x: Any, others: Any) -> bool:
    if not len(others):
        return not len(x)
    k = np.searchsorted(others, x)
    gap = np.minimum(abs(x - others[k - 1]), abs(x - others[np.minimum(k, len(others) - 1)]))
    return bool((gap <= SAME_NUMBER * abs(x)).all())


def _parts(value: Any) -> list[Any]:
    if isinstance(value, Mapping):
        value = list(value.values())
    if isinstance(value, list | tuple):
        return [part for item in value for part in _parts(item)]
    return [] if value is None else entries(value)


def _numbers(parts: list[Any]) -> set[Any]:
    symbols = [x for x in parts if isinstance(x, Symbol)]
    return {x for x in parts if isinstance(x, Real)} | {x.value for x in topological(symbols) if x.op == "const"}
