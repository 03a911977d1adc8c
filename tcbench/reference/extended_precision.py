"""A system's own equations in extended precision, whoever wrote the system.

The vector field is derived from the author's formulas as a graph (`trace`); printed as straight-line Python and
run on extended numbers (see precision.py) instead of being compiled, it keeps all their digits.
"""

from __future__ import annotations

import hashlib
import itertools
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiler.ops import functions
from ..systems.right_hand_side import as_python
from ..systems.scenario import Scenario
from .precision import EPS, LONG

Longs = NDArray[Any]


@dataclass(frozen=True)
class ExtendedFunction:
    """One of a system's derived functions in extended precision: z (n,) or (n, k), k states at once -> (m,) or (m, k).

    text : the code that runs. constants : doubles, taken as they are.
    """

    text: str
    size: int
    run: Callable[..., None]
    constants: Longs

    def __call__(self, z: Longs) -> Longs:
        out = np.empty((self.size, *z.shape[1:]), LONG)
        self.run(z, self.constants, out)
        return out

    def fingerprint(self, z0: Longs) -> str:
        """Hash of everything that a solution from `z0` depends on."""
        digest = hashlib.sha256(f"{EPS}{self.text}".encode())
        for array in (self.constants, z0):
            digest.update(",".join(map(str, array)).encode() + b";")
        return digest.hexdigest()[:32]


def extended(scenario: Scenario, name: str) -> ExtendedFunction:
    """`vector_field`, `energy`, ... of a scenario's system with its constants."""
    model = scenario.model
    text, shape = model.formula(name)
    kernel = as_python(text, _FUNCTIONS)
    return ExtendedFunction(text, int(np.prod(shape)), kernel, model.constant_values.astype(LONG))


def _ratio(function: Callable[[Longs], Longs]) -> Callable[[Longs], Longs]:
    """function(x)/x, 1 at 0."""
    return lambda x: np.where(x == 0, 1, function(x) / np.where(x == 0, 1, x))


def _by_parts(value: Longs, order: float, x: Longs, rates: Iterable[Longs]) -> Longs:
    """Derivative number `order` of value = f(x)/x, from those of f; for x away from 0."""
    for k, rate in zip(range(1, int(order) + 1), rates, strict=False):
        value = (rate - k * value) / x
    return value


def _phi_slope(order: float, x: Longs) -> Longs:
    """The integral of t^order exp(x t) from 0 to 1: sums of terms of one sign, as in compiler.special."""
    a, k = np.abs(x), order + 1
    power, above = np.ones_like(a), np.zeros_like(a)
    term = power / k
    below = term
    for j in range(1, int(60 + 4 * np.max(a, initial=0))):
        above = above + power / (j - 1 + k)
        power, term = power * a / j, term * a / (k + j)
        below = below + term
    return np.where(x < 0, np.exp(-a) * below, above)


def _lam_slope(order: float, x: Longs) -> Longs:
    """The integral of (-1)^order order! t^order/(1 + x t)^(order + 1) from 0 to 1."""
    near = np.where(np.abs(x) < 0.5, x, 0.25 + 0 * x)
    front = (-1) ** int(order) * math.factorial(int(order)) + 0 * near
    falls, w = near < 0, near / (1 + near)
    power, total = np.ones_like(near), np.zeros_like(near)
    for j in range(1, 40 * int(order + 5)):
        total = total + power / (order + j)
        power = power * np.where(falls, -near * (order + j) / j, w)
    series = front * total * np.where(falls, 1, (1 + near) ** -(order + 1))
    away = np.where(np.abs(x) < 0.5, 1 + 0 * x, x)
    rates = ((-1) ** (k - 1) * math.factorial(k - 1) / (1 + away) ** k for k in itertools.count(1))
    return np.where(np.abs(x) < 0.5, series, _by_parts(np.log1p(away) / away, order, away, rates))


def _tanh_slope(a: Longs, d: Longs) -> Longs:
    """As in compiler.special."""
    b = a + d
    below = (1 + np.exp(-2 * np.abs(a))) * (1 + np.exp(-2 * np.abs(b)))
    found: Longs = 4 * np.exp(np.abs(d) - np.abs(a) - np.abs(b)) * _ratio(np.expm1)(-2 * np.abs(d)) / below
    return found


def _abs_slope(a: Longs, d: Longs) -> Longs:
    """As in compiler.special."""
    b = a + d
    size = np.abs(a) + np.abs(b)
    one_side = np.minimum(a, b) * np.maximum(a, b) >= 0
    found: Longs = np.where(one_side, np.sign(a + b), (a + b) / np.where(size == 0, 1, size))
    return found


def _langevin(x: Longs) -> Longs:
    """coth(x) - 1/x, as in compiler.special."""
    near, below = np.abs(x) < 8, 101 + 0 * x
    for k in range(99, 1, -2):
        below = k + x * x / below
    away = np.where(near, 8 + 0 * x, x)
    return np.where(near, x / below, 1 / np.tanh(away) - 1 / away)


_FUNCTIONS: dict[str, Any] = {x: getattr(np, x) for x in functions() if hasattr(np, x)} | {
    "phi": _ratio(np.expm1), "dphi": lambda x: _phi_slope(1, x), "phi_slope": _phi_slope,
    "lam": _ratio(np.log1p), "dlam": lambda x: _lam_slope(1, x), "lam_slope": _lam_slope,
    "tanh_slope": _tanh_slope, "langevin": _langevin, "abs_slope": _abs_slope,
    "phi_pair": lambda x: (_ratio(np.expm1)(x), _phi_slope(1, x)),
    "lam_pair": lambda x: (_ratio(np.log1p)(x), _lam_slope(1, x)),
}  # fmt: skip
