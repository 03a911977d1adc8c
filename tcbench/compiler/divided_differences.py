"""Divided differences, exactly: arithmetic on the four corners of a rectangle.

An element energy e(pi, s) is run once on two `Corners`, which carry its value at (pi0, s0) and its slopes along
the four edges of [pi0, pi1] x [s0, s1]. Every rule below is an algebraic identity, so no quotient ever divides a
difference of nearby numbers: the slopes keep their digits at any increment, zero included.
Romero (2009), eqs. (27)-(33), needs just the averages of opposite edges.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ..errors import TraceError
from .derivatives import Symbol, const, lam, phi

ZERO = const(0.0)
# one rule: (value at A, value at B, slope of the argument, increment along the edge) -> slope of the result
Rule = Callable[[Symbol, Symbol, Symbol, Symbol], Symbol]


@dataclass(frozen=True, eq=False)
class Corners:
    """A function of (pi, s) on a rectangle: value at (0, 0) and slopes along the edges."""

    value: Symbol
    pi_at_s0: Symbol
    pi_at_s1: Symbol
    s_at_pi0: Symbol
    s_at_pi1: Symbol
    dpi: Symbol
    ds: Symbol

    @property
    def value_10(self) -> Symbol:
        return self.value + self.dpi * self.pi_at_s0

    @property
    def value_01(self) -> Symbol:
        return self.value + self.ds * self.s_at_pi0

    @property
    def value_11(self) -> Symbol:
        return self.value_10 + self.ds * self.s_at_pi1

    @property
    def edges(self) -> tuple[tuple[Symbol, Symbol, Symbol, Symbol], ...]:
        """(value at A, value at B, slope, increment) of the four edges."""
        v00, v10, v01, v11 = self.value, self.value_10, self.value_01, self.value_11
        return (
            (v00, v10, self.pi_at_s0, self.dpi),
            (v01, v11, self.pi_at_s1, self.dpi),
            (v00, v01, self.s_at_pi0, self.ds),
            (v10, v11, self.s_at_pi1, self.ds),
        )

    def _with(self, value: Symbol, slopes: list[Symbol]) -> Corners:
        a, b, c, d = slopes
        return Corners(value, a, b, c, d, self.dpi, self.ds)

    def _apply(self, value: Symbol, rule: Rule) -> Corners:
        return self._with(value, [rule(*edge) for edge in self.edges])

    def _lift(self, other: Any) -> Corners:
        if isinstance(other, Corners):
            return other
        value = other if isinstance(other, Symbol) else const(float(other))
        return self._with(value, [ZERO] * 4)

    def __add__(self, other: Any) -> Corners:
        b = self._lift(other)
        return self._with(self.value + b.value, [x[2] + y[2] for x, y in zip(self.edges, b.edges, strict=True)])

    __radd__ = __add__

    def __neg__(self) -> Corners:
        return self._with(-self.value, [-slope for _, _, slope, _ in self.edges])

    def __sub__(self, other: Any) -> Corners:
        return self + (-self._lift(other))

    def __rsub__(self, other: Any) -> Corners:
        return self._lift(other) + (-self)

    def __mul__(self, other: Any) -> Corners:
        if not isinstance(other, Corners):  # a constant factor: no need for the product rule
            factor = other if isinstance(other, Symbol) else const(float(other))
            return self._with(factor * self.value, [factor * slope for _, _, slope, _ in self.edges])
        pairs = zip(self.edges, other.edges, strict=True)
        slopes = [
            0.5 * (a0 + a1) * slope_b + 0.5 * (b0 + b1) * slope_a  # exact for products
            for (a0, a1, slope_a, _), (b0, b1, slope_b, _) in pairs
        ]
        return self._with(self.value * other.value, slopes)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Corners:
        return self * other._reciprocal() if isinstance(other, Corners) else self * (1.0 / other)

    def __rtruediv__(self, other: Any) -> Corners:
        return self._reciprocal() * other

    def _reciprocal(self) -> Corners:
        return self._apply(1.0 / self.value, lambda a, b, slope, _: -slope / (a * b))

    def __pow__(self, exponent: Any) -> Corners:
        if isinstance(exponent, int) and 1 <= exponent <= 8:
            result = self
            for _ in range(exponent - 1):
                result = result * self
            return result
        if isinstance(exponent, Corners):
            return (self.log() * exponent).exp()
        return (
            (self.log() * float(exponent)).exp() if not isinstance(exponent, Symbol) else (self.log() * exponent).exp()
        )

    def sqrt(self) -> Corners:
        return self._apply(self.value.sqrt(), lambda a, b, slope, _: slope / (a.sqrt() + b.sqrt()))

    def log(self) -> Corners:
        return self._apply(self.value.log(), lambda a, _, slope, step: slope / a * lam(step * slope / a))

    def exp(self) -> Corners:
        # the value at each corner follows from the slopes, so that every exponential is one phi away from the first
        e00 = self.value.exp()
        x10, x01 = self.dpi * self.pi_at_s0, self.ds * self.s_at_pi0
        x11_pi, x11_s = self.dpi * self.pi_at_s1, self.ds * self.s_at_pi1
        pi_at_s0 = e00 * phi(x10) * self.pi_at_s0
        s_at_pi0 = e00 * phi(x01) * self.s_at_pi0
        e10, e01 = e00 + self.dpi * pi_at_s0, e00 + self.ds * s_at_pi0
        pi_at_s1 = e01 * phi(x11_pi) * self.pi_at_s1
        s_at_pi1 = e10 * phi(x11_s) * self.s_at_pi1
        return self._with(e00, [pi_at_s0, pi_at_s1, s_at_pi0, s_at_pi1])

    def expm1(self) -> Corners:
        exponential = self.exp()
        return self._with(self.value.expm1(), [slope for _, _, slope, _ in exponential.edges])

    def log1p(self) -> Corners:
        return (self + 1.0).log()

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        raise TraceError(
            f"An element energy uses {name!r}, which has no divided-difference rule. "
            "Use +, -, *, /, **, sqrt, exp, log, expm1 or log1p."
        )


def rectangle(pi0: Symbol, dpi: Symbol, s0: Symbol, ds: Symbol) -> tuple[Corners, Corners]:
    """The two coordinates pi and s on [pi0, pi0 + dpi] x [s0, s0 + ds]."""
    one = const(1.0)
    pi = Corners(pi0, one, one, ZERO, ZERO, dpi, ds)
    s = Corners(s0, ZERO, ZERO, one, one, dpi, ds)
    return pi, s


def symmetrised_slopes(e: Corners) -> tuple[Symbol, Symbol]:
    """(D_pi e, D_s e): averages over opposite edges, eqs. (31)-(32)."""
    return 0.5 * (e.pi_at_s0 + e.pi_at_s1), 0.5 * (e.s_at_pi0 + e.s_at_pi1)


__all__ = ["Corners", "rectangle", "symmetrised_slopes"]
