"""Building blocks of formulas: quotients that are 0/0 where two states are equal, written so that they are not.

    from tcbench.building_blocks import divided_difference

    slope = divided_difference(lambda s: np.exp(s / c), s0, s1)  # (exp(s1/c) - exp(s0/c))/(s1 - s0), also at s1 = s0

All take numbers, symbols (inside a formula that is traced) and arrays of either, entry by entry; all are dimensionless.
They keep their digits at any increment, zero included; so do the derivatives that tcbench takes of them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .compiler.array_states import each, is_array
from .compiler.derivatives import Symbol, array, const, lifted, refused, variables
from .compiler.derivatives import lam as _lam
from .compiler.derivatives import phi as _phi
from .compiler.divided_differences import RULES, Corners, rectangle, symmetrised_slopes
from .compiler.symbols import TINY
from .errors import TraceError

__all__ = ["directional", "divided_difference", "divided_differences", "log1p_ratio", "phi"]


def phi(x: Any) -> Any:
    """(exp(x) - 1)/x, which is 1 at x = 0: exp(b) - exp(a) = exp(a) phi(b - a) (b - a)."""
    return _each(_phi, x)


def log1p_ratio(x: Any) -> Any:
    """log(1 + x)/x, which is 1 at x = 0: log(b) - log(a) = log1p_ratio((b - a)/a) (b - a)/a. x > -1."""
    return _each(_lam, x)


def divided_difference(function: Callable[[Any], Any], a: Any, b: Any) -> Any:
    """(function(b) - function(a))/(b - a), and the derivative where b = a; of the shape of a and b.

    function : of one variable, by +, -, *, /, **, abs, sqrt, exp, log, expm1, log1p, sin, cos, tan, arcsin, arccos,
        arctan, sinh, cosh, tanh and hypot (TraceError names what else it uses).
    """

    def slope(a: Symbol, b: Symbol) -> Symbol:
        x, _ = rectangle(a, b - a, const(0.0), const(0.0))
        return _by_rules(function, x).pi_at_s0

    return _each(slope, a, b)


def divided_differences(function: Callable[[Any, Any], Any], a: Any, b: Any) -> tuple[Any, Any]:
    """The two slopes (D1, D2) of function(x, y) from a = (x0, y0) to b = (x1, y1), with

        D1 (x1 - x0) + D2 (y1 - y0) = function(x1, y1) - function(x0, y0):

    each is the mean of the divided differences along the two opposite edges of the rectangle, Romero (2009), (31)-(32).
    x and y may be arrays, entry by entry. Operations as in `divided_difference`.
    """

    def slopes(x0: Symbol, x1: Symbol, y0: Symbol, y1: Symbol) -> tuple[Symbol, Symbol]:
        return symmetrised_slopes(_by_rules(function, *rectangle(x0, x1 - x0, y0, y1 - y0)))

    (x0, y0), (x1, y1) = a, b
    return (
        _each(lambda *corners: slopes(*corners)[0], x0, x1, y0, y1),
        _each(lambda *corners: slopes(*corners)[1], x0, x1, y0, y1),
    )


def directional(gradient: Any, step: Any, exact: Any, weights: Any = 1.0, axis: int = 0) -> Any:
    """The gradient with the least change after which its product with the step is that of `exact` (Gonzalez 1996).

    gradient + (exact - gradient) . step / (w step . step) w step, and the gradient itself where the step is 0. Of the
    midpoint's gradient this is Gonzalez's discrete gradient: second order, symmetric.

    gradient, step : of one shape.
    exact : slopes whose product with the step is the difference of the function, such as
        `system.discrete_gradient(z0, z1)`; the difference of two energies would lose its digits as the step shrinks.
    weights : w > 0 of the entries, where they have different units. axis : along which products are summed.
    """
    if not is_array(gradient, step, exact):
        gradient, step, exact = (np.asarray(part) for part in (gradient, step, exact))
    missing, length = ((exact - gradient) * step).sum(axis=axis), (weights * step * step).sum(axis=axis) + TINY
    share = missing / length
    if np.ndim(share):
        share = share[:, None] if is_array(share) else np.expand_dims(share, axis)
    return gradient + share * (weights * step)


def _by_rules(function: Callable[..., Corners], *corners: Corners) -> Corners:
    try:
        return corners[0].lifted(function(*corners))  # a constant has slopes, too
    except TypeError as error:  # numpy hides the sentence that says which operation has no rule
        if isinstance(error.__cause__, TraceError):
            raise error.__cause__ from None
        raise


def _each(rule: Callable[..., Symbol], *arguments: Any) -> Any:
    """The rule on every entry; numbers where all entries are numbers."""
    if is_array(*arguments):
        return each(lambda *entry: rule(*map(lifted, entry)), *arguments)
    arrays = np.broadcast_arrays(*(np.asarray(a, dtype=object) for a in arguments))
    if any(isinstance(x, Corners) for a in arrays for x in a.flat):
        raise refused("a building block stands in what a divided difference is taken of, and has no rule there", RULES)
    if any(isinstance(x, Symbol) for a in arrays for x in a.flat):
        found = [rule(*map(lifted, entries)) for entries in zip(*(a.flat for a in arrays), strict=True)]
        return found[0] if arrays[0].ndim == 0 else array(found).reshape(arrays[0].shape)
    values = _numbers(rule, [np.asarray(a, dtype=float).ravel() for a in arrays])
    return float(values[0]) if arrays[0].ndim == 0 else values.reshape(arrays[0].shape)


def _numbers(rule: Callable[..., Symbol], columns: list[np.ndarray]) -> np.ndarray:
    """The rule traced once, and run on numbers row by row."""
    from .compiler.kernels import kernel

    x = variables("x", len(columns))
    found = kernel({s: f"a[{i}]" for i, s in enumerate(x)}, [rule(*x)])
    return np.array([found(row, row)[0] for row in np.ascontiguousarray(np.stack(columns, axis=1))])
