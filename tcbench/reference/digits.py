"""A system's own formulas with 32 digits, whoever wrote the system: in double-doubles, in plain Python."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..compiler.symbols import operators
from ..systems.right_hand_side import as_python
from ..systems.scenario import Scenario
from . import double_double as dd
from .tape import LANES


class Digits:
    """Eight numbers h + l, as formulas in Python take them."""

    def __init__(self, h: ArrayLike, l: ArrayLike = 0.0) -> None:
        self.h, self.l = (np.broadcast_to(np.asarray(x, float), LANES) for x in (h, l))

    def _by(operation: Callable[..., Any]) -> Any:  # type: ignore[misc]
        return operators(
            lambda _, x: x if isinstance(x, Digits) else Digits(x),
            lambda a, b: Digits(*operation(a.h, a.l, b.h, b.l)),
        )

    __add__, __radd__ = _by(dd.add)
    __sub__, __rsub__ = _by(lambda xh, xl, yh, yl: dd.add(xh, xl, -yh, -yl))
    __mul__, __rmul__ = _by(dd.mul)
    __truediv__, __rtruediv__ = _by(dd.div)

    def __neg__(self) -> Digits:
        return Digits(-self.h, -self.l)

    def __abs__(self) -> Digits:
        return Digits(np.abs(self.h), np.where(self.h < 0, -self.l, self.l))


def _function(operation: Callable[..., Any], first: int = 0) -> Callable[[Any], Digits]:
    def called(x: Any) -> Digits:
        x = x if isinstance(x, Digits) else Digits(x)
        return Digits(*operation(x.h, x.l)[first : first + 2])

    return called


FUNCTIONS = {
    "abs": abs, "exp": _function(dd.exp), "log": _function(dd.log), "sqrt": _function(dd.sqrt),
    "atan": _function(dd.atan), "cos": _function(dd.cos_sin), "sin": _function(dd.cos_sin, 2),
}  # fmt: skip


def exactly(scenario: Scenario, name: str, states: ArrayLike) -> list[list[Fraction]]:
    """`energy`, `vector_field`, ... of a scenario's system at states (k, n), eight at a time: k rows of m values, right
    to some 30 digits."""
    text, shape = scenario.model.formula(name)
    constants = [Digits(x) for x in scenario.model.constant_values]
    formula, rows, found = as_python(text, FUNCTIONS), np.asarray(states, float), list[list[Fraction]]()
    for first in range(0, len(rows), LANES):
        count = min(LANES, len(rows) - first)
        lanes, out = rows[first + np.minimum(np.arange(LANES), count - 1)], dict[int, Any]()
        formula([Digits(column) for column in lanes.T], constants, out)
        values = [out[i] if isinstance(out[i], Digits) else Digits(out[i]) for i in range(int(np.prod(shape)))]
        found += [[Fraction(float(x.h[k])) + Fraction(float(x.l[k])) for x in values] for k in range(count)]
    return found
