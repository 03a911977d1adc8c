"""Functions with a kink (where, maximum, minimum, sign) in terms of |x|: they have slopes and divided differences, and
methods that locate kinks, where |x| passes 0, find all of them.

A comparison x > y is 0, 1, or 1/2 where both are equal. A choice is b + (x > y) (a - b): its discrete gradient keeps
the energy exactly from one side to the other, and tends to the gradient where a and b meet at the kink.
"""

from __future__ import annotations

from numbers import Real
from typing import Any

import numpy as np

from .choices import CHOICES, boxed
from .choices import KINKED as KINKED
from .ops import TINY
from .symbols import Symbol, add, const, is_const, make, mul, neg, reciprocal
from .trace_errors import refused


def _symbol(x: Any) -> Any:
    return const(float(x)) if isinstance(x, Real) else x


def sign(x: Any) -> Any:
    """-1, 0 or 1: x/|x|, exactly."""
    x = _symbol(x)
    if not isinstance(x, Symbol):
        return x.sign()
    if is_const(x):
        return const(float(np.sign(x.value)))
    if x.op == "neg":
        return neg(sign(x.args[0]))
    return mul(x, reciprocal(add(make("abs", x), const(TINY))))


def argument_of_sign(node: Symbol) -> Symbol | None:
    """x where the node is sign(x), else None."""
    for x, inverse in (node.args, node.args[::-1]) if node.op == "mul" else ():
        below = inverse.args[0] if inverse.op == "recip" else x
        size = [a for a in below.args if not is_const(a, TINY)] if below.op == "add" else []
        if len(size) == 1 and size[0].op == "abs" and size[0].args[0] is x:
            return x
    return None


def slope_of_sign(start: Symbol, end: Symbol) -> Symbol:
    """(sign(end) - sign(start))/(end - start): 0 on one side."""
    apart = make("abs", sign(end) - sign(start))
    return mul(apart, reciprocal(make("abs", start) + make("abs", end) + TINY))


def greater(x: Any, y: Any) -> Any:
    """x > y, and x >= y: 0 or 1, and 1/2 where they are equal."""
    return _truth(0.5 * (1.0 + sign(_symbol(x) - _symbol(y))))


def less(x: Any, y: Any) -> Any:
    return greater(y, x)


def maximum(x: Any, y: Any) -> Any:
    y = _symbol(y)
    apart = _symbol(x) - y
    return 0.5 * (apart + abs(apart)) + y


def minimum(x: Any, y: Any) -> Any:
    y = _symbol(y)
    apart = _symbol(x) - y
    return 0.5 * (apart - abs(apart)) + y


def _equal(x: Any, y: Any) -> Any:
    raise refused("symbols are asked whether they are equal", "Write x > y or x < y in np.where(x > y, a, b)")


def where(condition: Any, *sides: Any) -> Any:
    """a where the condition, made of comparisons, holds, else b."""
    if len(sides) != 2:
        raise refused("np.where without two values asks for places", "Write np.where(x > 0, a, b)")
    a, b = sides
    return asked(condition) * (a - b) + b


def asked(condition: Any) -> Any:
    """The condition, if it is made of comparisons; TraceError for symbols, which are neither 0 nor not 0."""
    if isinstance(condition, Real | bool | np.ndarray) and np.asarray(condition).dtype != object:
        return np.asarray(condition) != 0
    if not all(map(_is_truth, np.ravel(boxed(getattr(condition, "parts", condition))))):
        raise refused("a condition is a number", "Write a comparison, as in np.where(x > 0, a, b)")
    return condition


def _is_truth(x: Any) -> bool:
    """Is x 0 or 1 (1/2 where both sides are equal): a comparison, or several joined?"""
    if not isinstance(x, Symbol) or is_const(x):
        return not isinstance(x, Symbol | Real) or getattr(x, "value", x) in (0.0, 0.5, 1.0)
    return x.truth or (x.op == "mul" and all(map(_is_truth, x.args)))


def _truth(x: Any) -> Any:
    if isinstance(x, Symbol):
        x.truth = True
    return x


def clip(x: Any, least: Any = None, most: Any = None, **bounds: Any) -> Any:
    least, most = bounds.get("min", least), bounds.get("max", most)
    x = x if least is None else np.maximum(x, least)
    return x if most is None else np.minimum(x, most)


def _both(a: Any, b: Any) -> Any:
    return _truth(asked(a) * asked(b))


def _either(a: Any, b: Any) -> Any:
    return _truth(asked(a) + asked(b) - a * b)


def _other(a: Any) -> Any:
    return _truth(1.0 - asked(a))


KINKED |= {  # of entries, in the place of numpy's
    np.maximum: maximum, np.minimum: minimum, np.fmax: maximum, np.fmin: minimum, np.sign: sign,
    np.greater: greater, np.greater_equal: greater, np.less: less, np.less_equal: less,
    np.equal: _equal, np.not_equal: _equal,
    np.logical_and: _both, np.bitwise_and: _both, np.logical_or: _either, np.bitwise_or: _either,
    np.logical_not: _other, np.invert: _other,
}  # fmt: skip


CHOICES |= {np.where: where, np.clip: clip}


def kinked(ufunc: Any) -> Any:
    """The function in the place of a ufunc, on arrays of symbols."""
    of_entries: Any = np.frompyfunc
    return of_entries(KINKED[ufunc], ufunc.nin, 1)
