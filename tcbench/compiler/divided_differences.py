"""Divided differences, exactly: arithmetic on the four corners of a rectangle.

An element energy e(pi, s) is run once on two `Corners`, which carry its value at (pi0, s0) and its slopes along
the four edges of [pi0, pi1] x [s0, s1]. Every rule below is an algebraic identity, so no quotient ever divides a
difference of nearby numbers: the slopes keep their digits at any increment, zero included.
Romero (2009), eqs. (27)-(33), needs just the averages of opposite edges.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial, reduce
from typing import Any

from . import ops
from .choices import Choosing
from .derivatives import Symbol, const, lifted, refused
from .flat import EXPONENTIALS
from .kinks import sign, slope_of_sign
from .ops import TINY

ZERO = const(0.0)
FEW = 4.0  # degree above which a node may be so much smaller at its end that start + increment loses its digits
GROWING = (*EXPONENTIALS, "tan")  # and so may these, whatever they are taken of
HIGH = 6  # repeated square roots after which even the smallest number is above a tenth: see `TINY`
_RULED = ", ".join(row.numpy for row in ops.OPERATIONS.values() if row.difference).replace("fabs", "abs")
RULES = (
    f"There are rules for +, -, *, /, **, {_RULED}; "
    "methods without discrete gradients (tc_gauss, midpoint_entropy) take every formula"
)
ALONE = "Entry i of what it gives is of entry i of its arguments alone"
# one rule: (value at A, value at B, slope of the argument, increment along the edge) -> slope of the result
Rule = Callable[[Symbol, Symbol, Symbol, Symbol], Symbol]


@dataclass(frozen=True, eq=False)
class Corners(Choosing):
    """A function of (pi, s) on a rectangle: value at (0, 0) and slopes along the edges. Of what may grow or shrink by
    orders of magnitude, whose increments leave nothing of the end, ends are the values at (1, 0), (0, 1), (1, 1)."""

    value: Symbol
    pi_at_s0: Symbol
    pi_at_s1: Symbol
    s_at_pi0: Symbol
    s_at_pi1: Symbol
    dpi: Symbol
    ds: Symbol
    ends: tuple[Symbol, ...] | None = None

    @property
    def corners(self) -> tuple[Symbol, ...]:
        """The values at (1, 0), (0, 1) and (1, 1)."""
        if self.ends is not None:
            return self.ends
        v10 = self.value + self.dpi * self.pi_at_s0
        return v10, self.value + self.ds * self.s_at_pi0, v10 + self.ds * self.s_at_pi1

    @property
    def edges(self) -> tuple[tuple[Symbol, Symbol, Symbol, Symbol], ...]:
        """(value at A, value at B, slope, increment) of the four edges."""
        v00, (v10, v01, v11) = self.value, self.corners
        return (
            (v00, v10, self.pi_at_s0, self.dpi),
            (v01, v11, self.pi_at_s1, self.dpi),
            (v00, v01, self.s_at_pi0, self.ds),
            (v10, v11, self.s_at_pi1, self.ds),
        )

    def _with(self, value: Symbol, slopes: list[Symbol], at: Any = None, *x: Corners) -> Corners:
        """at: the value where it grows, if one of the arguments self, x, ... does."""
        a, b, c, d = slopes
        result = Corners(value, a, b, c, d, self.dpi, self.ds)
        if at is None or all(y.ends is None for y in (self, *x)):
            return result
        return replace(result, ends=tuple(map(at, self.corners, *(y.corners for y in x))))

    def _apply(self, value: Symbol, rule: Rule, at: Callable[..., Symbol] | None = None) -> Corners:
        return self._with(value, [rule(*edge) for edge in self.edges], at)

    def lifted(self, other: Any) -> Corners:
        if isinstance(other, Corners):
            if other.dpi is not self.dpi or other.ds is not self.ds:
                raise refused("a divided difference is taken of a function that mixes entries", ALONE)
            return other
        value = other if isinstance(other, Symbol) else const(float(other))
        return self._with(value, [ZERO] * 4)

    def __add__(self, other: Any) -> Corners:
        b = self.lifted(other)
        slopes = [x[2] + y[2] for x, y in zip(self.edges, b.edges, strict=True)]
        return self._with(self.value + b.value, slopes, operator.add, b)

    __radd__ = __add__

    def __pos__(self) -> Corners:
        return self

    def __neg__(self) -> Corners:
        return self._with(-self.value, [-slope for _, _, slope, _ in self.edges], operator.neg)

    def __sub__(self, other: Any) -> Corners:
        return self + (-self.lifted(other))

    def __rsub__(self, other: Any) -> Corners:
        return self.lifted(other) + (-self)

    def __mul__(self, other: Any) -> Corners:
        if not isinstance(other, Corners):  # a constant factor: no need for the product rule
            factor = other if isinstance(other, Symbol) else const(float(other))
            slopes = [factor * slope for _, _, slope, _ in self.edges]
            return self._with(factor * self.value, slopes, lambda x: factor * x)
        b, slopes = self.lifted(other), []
        grown = self.ends is not None and b.ends is not None
        for (a0, a1, slope_a, _), (b0, b1, slope_b, _) in zip(self.edges, b.edges, strict=True):
            by_a, by_b = factors(a0, a1, b0, b1) if grown else (0.5 * (b0 + b1), 0.5 * (a0 + a1))
            slopes.append(by_b * slope_b + by_a * slope_a)  # exact for products
        return self._with(self.value * b.value, slopes, operator.mul, b)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Corners:
        return self * other._reciprocal() if isinstance(other, Corners) else self * (1.0 / other)

    def __rtruediv__(self, other: Any) -> Corners:
        quotient: Corners = self._reciprocal() * other
        return quotient

    def _reciprocal(self) -> Corners:
        return self._apply(1.0 / self.value, lambda a, b, slope, _: -slope / (a * b), lambda x: 1.0 / x)

    def __pow__(self, exponent: Any) -> Corners:
        if isinstance(exponent, Corners | Symbol):
            return self._by_logarithm(exponent)
        if rest := float(exponent) % 1.0:
            if self.value.positive or (exponent < 1.0 and exponent != 0.5):
                return self._by_logarithm(exponent)
            # of what may be 0, where the power above 1 has a slope and its root has none
            whole, root = exponent - rest, self + TINY if exponent > 1.0 else self
            if rest != 0.5:  # of a root so high that the two ends are of one size, whose logarithms keep their digits
                root = reduce(lambda x, _: x.root(), range(HIGH), root)._by_logarithm(2**HIGH * rest)
            else:
                root = root.root()
            return self**whole * root if whole else root
        result = one = self.lifted(1.0)
        # of 1/x, not 1 over the power, whose end is what is left of its start: nothing, if that is many times larger
        square, n = self if exponent >= 0 else self._reciprocal(), abs(int(exponent))
        if square.ends is None and n > FEW:
            square = replace(square, ends=square.corners)
        while n:
            if n & 1:
                result = square if result is one else result * square
            square, n = square * square if n > 1 else square, n >> 1
        return result

    def root(self) -> Corners:
        """The square root; an end that should be 0 may be negative by round-off."""
        slope = lambda a, b, slope, _: slope / (abs(a).sqrt() + abs(b).sqrt())  # noqa: E731
        return self._apply(self.value.sqrt(), slope, lambda x: x.sqrt())

    def _by_logarithm(self, exponent: Any) -> Corners:
        power: Corners = (self.log() * exponent).exp()
        few = self.ends is None and not isinstance(exponent, Corners | Symbol) and abs(exponent) <= FEW
        return replace(power, ends=None) if few else power

    def __rpow__(self, base: Any) -> Corners:
        return (self * lifted(base).log()).exp()

    def exp(self) -> Corners:
        # the value at each corner follows from the slopes, so that every exponential is one phi away from the first
        e00, ends = self.value.exp(), tuple(x.exp() for x in self.corners)
        phi = partial(Symbol.make, "phi")
        slope = ops.exp_slope if self.ends is not None else lambda start, end, d: start * phi(d)
        x10, x01 = self.dpi * self.pi_at_s0, self.ds * self.s_at_pi0
        x11_pi, x11_s = self.dpi * self.pi_at_s1, self.ds * self.s_at_pi1
        pi_at_s0 = slope(e00, ends[0], x10) * self.pi_at_s0
        s_at_pi0 = slope(e00, ends[1], x01) * self.s_at_pi0
        e10, e01 = e00 + self.dpi * pi_at_s0, e00 + self.ds * s_at_pi0
        pi_at_s1 = slope(e01, ends[2], x11_pi) * self.pi_at_s1
        s_at_pi1 = slope(e10, ends[2], x11_s) * self.s_at_pi1
        return replace(self._with(e00, [pi_at_s0, pi_at_s1, s_at_pi0, s_at_pi1]), ends=ends)

    def __abs__(self) -> Corners:
        return self._function(ops.OPERATIONS["abs"])

    def sign(self) -> Corners:
        return self._apply(sign(self.value), lambda a, b, slope, _: slope * slope_of_sign(a, b))

    def _function(self, row: ops.Operation, *others: Any) -> Corners:
        """By the operation's own rule, or by those of the formula that it equals."""
        x = [self, *map(self.lifted, others)]
        value = Symbol.make(row.name, *(each.value for each in x))
        rule = row.difference
        if callable(rule) and others:
            slopes = []
            for (a, b, slope, step), (a2, b2, slope2, _) in zip(self.edges, x[1].edges, strict=True):
                by, by2 = rule(a, b, step * slope, a2, b2, step * slope2)
                slopes.append(by * slope + by2 * slope2)
            return self._with(value, slopes)
        at = partial(Symbol.make, row.name)
        if row.name == "log" and self.ends is not None:
            return self._apply(value, lambda a, b, slope, _: slope * log_slope(a, b), at)
        if callable(rule):
            result = self._apply(value, lambda a, b, slope, step: slope * rule(a, b, step * slope), at)
            return replace(result, ends=tuple(map(at, self.corners))) if row.name in GROWING else result
        same: Corners = ops.evaluated(row.same, ops.as_methods(), *x)
        return replace(same, value=value)

    def _no_rule(self, *_: object) -> Any:
        raise refused("a branch, a whole number or a float is made of what a divided difference is taken of", RULES)

    __bool__ = __float__ = __int__ = __index__ = __round__ = __trunc__ = _no_rule
    __eq__ = __ne__ = _no_rule
    __floordiv__ = __rfloordiv__ = __mod__ = __rmod__ = __divmod__ = __rdivmod__ = _no_rule
    __hash__ = object.__hash__

    def __getattr__(self, name: str) -> Any:
        row = ops.by_numpy(name)
        if row is not None and row.difference is not None:
            return partial(self._function, row)
        if name.startswith("__"):
            raise AttributeError(name)
        raise refused(f"{name!r} has no divided-difference rule, which discrete gradients need of an energy", RULES)


def log_slope(a: Symbol, b: Symbol) -> Symbol:
    """(log b - log a)/(b - a) of numbers that may differ by orders of magnitude; of equal ones with all digits, too."""
    return 1.0 / (a * Symbol.make("phi", b.log() - a.log()))


def factors(a: Symbol, a1: Symbol, b: Symbol, b1: Symbol) -> tuple[Symbol, Symbol]:
    """(slope by a, slope by b) of a b, of which one may grow as the other shrinks: midpoints would leave the difference
    of large numbers. With b of one sign 2 b b1/(b + b1) and (a b + a1 b1)/(b + b1) are as exact and no larger than it.
    """
    for x, x1, y, y1 in ((a, a1, b, b1), (b, b1, a, a1)):
        if y.positive or y.op == "recip":
            below = 1.0 / (y + y1 + 1.0 / ops.INFINITE)  # whose square, in the Jacobian, is a number, too
            by_x, by_y = 2.0 * y * (y1 * below), (x * y + x1 * y1) * below
            return (by_x, by_y) if y is b else (by_y, by_x)
    return 0.5 * (b + b1), 0.5 * (a + a1)


def rectangle(pi0: Symbol, dpi: Symbol, s0: Symbol, ds: Symbol) -> tuple[Corners, Corners]:
    """The two coordinates pi and s on [pi0, pi0 + dpi] x [s0, s0 + ds]."""
    one = const(1.0)
    pi = Corners(pi0, one, one, ZERO, ZERO, dpi, ds)
    s = Corners(s0, ZERO, ZERO, one, one, dpi, ds)
    return pi, s


def symmetrised_slopes(e: Corners) -> tuple[Symbol, Symbol]:
    """(D_pi e, D_s e): averages over opposite edges, eqs. (31)-(32)."""
    return 0.5 * (e.pi_at_s0 + e.pi_at_s1), 0.5 * (e.s_at_pi0 + e.s_at_pi1)


__all__ = ["Corners", "factors", "rectangle", "symmetrised_slopes"]
