"""Complex numbers whose parts are symbols: for methods that step through complex time and keep the real part.

A formula that is branch-free numpy runs on object arrays of `Complex` as it does on symbols; its two parts stay real
graphs, and compiled steps need no complex arithmetic. Functions are the principal branches; `log` and `sqrt` need a
positive real part, which shapes and temperatures have in the sub-steps of a convergent step.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from . import ops
from .symbols import Symbol, array, const, operators
from .trace_errors import refused


def _lifted(_: Complex, other: Any) -> Complex:
    if isinstance(other, Complex):
        return other
    if isinstance(other, Symbol | int | float | np.floating | np.integer):
        return Complex(other)
    if isinstance(other, complex):
        return Complex(other.real, other.imag)
    theirs: Complex = NotImplemented
    return theirs


def _quotient(a: Complex, b: Complex) -> Complex:
    return a * b.reciprocal()


class Complex:
    """re + i im; dimensionless functions as numpy calls them on object arrays."""

    __slots__ = ("im", "re")

    def __init__(self, re: Any, im: Any = 0.0) -> None:
        self.re, self.im = (x if isinstance(x, Symbol) else const(float(x)) for x in (re, im))

    def __repr__(self) -> str:
        return f"Complex({self.re!r}, {self.im!r})"

    __add__, __radd__ = operators(_lifted, lambda a, b: Complex(a.re + b.re, a.im + b.im))
    __sub__, __rsub__ = operators(_lifted, lambda a, b: Complex(a.re - b.re, a.im - b.im))
    __mul__, __rmul__ = operators(_lifted, lambda a, b: Complex(a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re))
    __truediv__, __rtruediv__ = operators(_lifted, _quotient)

    def __neg__(self) -> Complex:
        return Complex(-self.re, -self.im)

    def reciprocal(self) -> Complex:
        inverse = 1.0 / (self.re * self.re + self.im * self.im)
        return Complex(self.re * inverse, -self.im * inverse)

    def __pow__(self, exponent: Any) -> Complex:
        if isinstance(exponent, int) and exponent >= 0:
            return self * self ** (exponent - 1) if exponent else Complex(1.0)
        logarithm: Complex = self.log() * exponent
        return logarithm.exp()

    def exp(self) -> Complex:
        size = self.re.exp()
        return Complex(size * self.im.cos(), size * self.im.sin())

    def expm1(self) -> Complex:
        """exp(x) cos y - 1 = expm1(x) - 2 sin(y/2)^2 exp(x): digits are kept near 0."""
        half, size = (0.5 * self.im).sin(), self.re.exp()
        return Complex(self.re.expm1() - 2.0 * half * half * size, size * self.im.sin())

    def log(self) -> Complex:
        return Complex(0.5 * (self.re * self.re + self.im * self.im).log(), self._angle())

    def log1p(self) -> Complex:
        excess = self.re * (2.0 + self.re) + self.im * self.im  # |1 + z|^2 - 1
        return Complex(0.5 * excess.log1p(), (self + 1.0)._angle())

    def sqrt(self) -> Complex:
        return (0.5 * self.log()).exp()

    def sin(self) -> Complex:
        return Complex(self.re.sin() * self.im.cosh(), self.re.cos() * self.im.sinh())

    def cos(self) -> Complex:
        return Complex(self.re.cos() * self.im.cosh(), -(self.re.sin() * self.im.sinh()))

    def sinh(self) -> Complex:
        return Complex(self.re.sinh() * self.im.cos(), self.re.cosh() * self.im.sin())

    def cosh(self) -> Complex:
        return Complex(self.re.cosh() * self.im.cos(), self.re.sinh() * self.im.sin())

    def __getattr__(self, name: str) -> Any:
        row = ops.by_numpy(name)
        if row is None or not row.same:
            error = refused(f"{name!r} of a complex number is not known here")
            raise AttributeError(name) if name.startswith("__") else error
        return partial(ops.evaluated, row.same, ops.as_methods(), self)

    def _angle(self) -> Symbol:
        """arg z for Re z > 0: atan(im/re)."""
        return (self.im / self.re).arctan()


def real(values: Any) -> Any:
    """The real parts of an array of Complex and real numbers."""
    flat = [x.re if isinstance(x, Complex) else x for x in np.ravel(values)]
    return array(flat).reshape(np.shape(values))
