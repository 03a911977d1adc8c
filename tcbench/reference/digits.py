"""A system's own formulas with 40 digits, whoever wrote the system: in the numbers of mpmath, in plain Python."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..systems.right_hand_side import as_python
from ..systems.scenario import Scenario

DIGITS = 40
FUNCTIONS = ("exp", "log", "sqrt", "atan", "cos", "sin")


def exactly(scenario: Scenario, name: str, states: ArrayLike) -> list[list[Fraction]]:
    """`energy`, `vector_field`, ... of a scenario's system at states (k, n): k rows of m values, right to some 30
    digits. ValueError or OverflowError where one is not finite."""
    import mpmath

    text, shape = scenario.model.formula(name)
    with mpmath.workdps(DIGITS):
        function = as_python(text, {"abs": abs} | {name: getattr(mpmath, name) for name in FUNCTIONS})
        constants = [mpmath.mpf(float(x)) for x in scenario.model.constant_values]
        values = []
        for state in np.asarray(states, float):
            out: dict[int, Any] = {}
            function([mpmath.mpf(float(x)) for x in state], constants, out)
            values.append([_fraction(mpmath.mpf(out[i])) for i in range(int(np.prod(shape)))])
    return values


def _fraction(x: Any) -> Fraction:
    if not abs(x) < float("inf"):
        return Fraction(float(x))  # raises the error for NaN and infinity
    mantissa, exponent = x.man_exp  # of |x|
    return (-1 if x < 0 else 1) * Fraction(int(mantissa)) * Fraction(2) ** int(exponent)
