"""Integrators with one unknown, whose roots are known: they move one momentum and leave the rest of the state alone."""

from collections.abc import Callable
from typing import Any

import numpy as np

from tcbench import Integrator

MOVED = 4  # the first momentum


def scalar(name: str, equation: Callable[[Any, Any], Any]) -> Integrator:
    """The integrator that solves equation(d, h) = 0 for the increment d of one momentum."""

    def residual(z0, z1, h, system):
        d = np.asarray(z1 - z0)
        return np.array([equation(d[i], h) if i == MOVED else d[i] for i in range(len(d))])

    return Integrator(name=name, order=1, flows=residual)


def parabola(d, h):
    """Roots h = d / (1 + d^2): they merge at d = 1, h = 1/2, and beyond there is none; the lost one has d ~ 1/h."""
    return d - h * (1 + d * d)


CUBIC = (1.0, -3.0, 2.5)  # h = d^3 - 3 d^2 + 2.5 d folds at d = 1 -+ 0.408, where h = 0.636 and 0.364


def cubic(d, h):
    return d * (CUBIC[2] + d * (CUBIC[1] + d * CUBIC[0])) - h


def logarithm(d, h):
    """log(1 + d) + d = 2 h: not finite for d <= -1."""
    return np.log(1 + d) + d - 2 * h
