"""Taylor kernels of large systems: the recurrences of `recurrences` as loops over all entries of a space.

Sums over all, sums along tables and what tables name are linear: they go coefficient by coefficient.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import reduce
from typing import Any

import numpy as np

from tcbench.compiler import derivatives as trace
from tcbench.compiler.array_kernels import ArrayKernel
from tcbench.compiler.array_states import entries, refilled
from tcbench.compiler.arrays import LINEAR, rebuilt
from tcbench.compiler.derivatives import Symbol, const
from tcbench.compiler.kernels import Kernel

from .lanes import kinks
from .rates import shorter
from .recurrences import PARTNERS
from .series import STANDING, Series
from .texts import BESIDE

ZERO = const(0.0)
Of = Callable[[int], Symbol]


class Coefficients:
    """Coefficients of series as symbols, each made when it is first asked for."""

    def __init__(self, y: Sequence[Symbol], rate: Sequence[Series]) -> None:
        self.y, self.rate = y, rate
        self.known: dict[tuple[int, int, str], Symbol] = {}

    def of(self, x: Series, n: int) -> Symbol:
        """Coefficient n of a series."""
        if n and x.constant:
            return ZERO
        if x.kind in PARTNERS:
            return self.turned(x.parts[0], n, x.kind)
        key = (id(x), n, "")
        if key not in self.known:
            self.known[key] = (self._linear if x.kind in LINEAR else getattr(self, f"_{x.kind}"))(x, n)
        return self.known[key]

    def turned(self, u: Series, n: int, name: str) -> Symbol:
        """Coefficient n of sin u, cos u, sinh u or cosh u: each is its partner's rate."""
        key = (id(u), n, name)
        if key not in self.known:
            other, sign = PARTNERS[name]
            rise = self._risen(u, n, lambda k: self.turned(u, k, other)) if n else getattr(self.of(u, 0), name)()
            self.known[key] = sign * rise if n else rise
        return self.known[key]

    def _all(self, x: Series) -> Of:
        return lambda n: self.of(x, n)

    def _slopes(self, x: Series) -> Of:
        return lambda n: float(n) * self.of(x, n)

    def _linear(self, x: Series, n: int) -> Symbol:
        return rebuilt(x.kind, [self.of(part, n) for part in x.parts], x.index)

    def _var(self, x: Series, n: int) -> Symbol:
        return self.of(self.rate[x.index], n - 1) * (1.0 / n) if n else self.y[x.index]

    def _sum(self, x: Series, n: int) -> Symbol:
        *weights, constant = x.weights
        terms = [w * self.of(part, n) for part, w in zip(x.parts, weights, strict=True)]
        return reduce(trace.add, terms, ZERO if n else constant)

    def _D(self, x: Series, n: int) -> Symbol:
        return (n + 1.0) * self.of(x.parts[0], n + 1)

    def _product(self, x: Series, n: int) -> Symbol:
        a, b = x.parts
        return self._square_of(a, n) if a is b else products(self._all(a), self._all(b), range(n + 1), n)

    def _square_of(self, a: Series, n: int) -> Symbol:
        """Each product of two different coefficients is in it twice."""
        half = products(self._all(a), self._all(a), range((n + 1) // 2), n)
        return half + half + self.of(a, n // 2) * self.of(a, n // 2) if n % 2 == 0 else half + half

    def _quotient(self, x: Series, n: int) -> Symbol:
        above, below = x.parts
        known = products(self._all(below), self._all(x), range(1, n + 1), n)
        return (self.of(above, n) - known) / self.of(below, 0)

    def _log(self, x: Series, n: int) -> Symbol:
        """n l_n = (n u_n - sum_(0<j<n) (j l_j) u_(n-j)) / u_0."""
        (u,) = x.parts
        if n == 0:
            return (abs(self.of(u, 0)) if x.of_size else self.of(u, 0)).log()
        known = products(self._slopes(x), self._all(u), range(1, n), n)
        return (float(n) * self.of(u, n) - known) / self.of(u, 0) * (1.0 / n)

    def _risen(self, u: Series, n: int, by: Of) -> Symbol:
        """Coefficient n of f(u), where `by` has those of df/du: the sum of (j u_j) by(n - j), over n."""
        return products(self._slopes(u), by, range(1, n + 1), n) * (1.0 / n)

    def _exp(self, x: Series, n: int) -> Symbol:
        (u,) = x.parts
        return self._risen(u, n, self._all(x)) if n else self.of(u, 0).exp()

    def _sqrt(self, x: Series, n: int) -> Symbol:
        (u,) = x.parts
        if n == 0:
            return self.of(u, 0).sqrt()
        return (self.of(u, n) - products(self._all(x), self._all(x), range(1, n), n)) / (2.0 * self.of(x, 0))

    def _bell(self, u: Series, sign: float) -> Of:
        """Coefficients of 1 + u^2 or 1 - u^2."""
        return lambda n: sign * self._square_of(u, n) + (0.0 if n else 1.0)

    def _tanh(self, x: Series, n: int) -> Symbol:
        (u,) = x.parts
        return self._risen(u, n, self._bell(x, -1.0)) if n else self.of(u, 0).tanh()

    def _atan(self, x: Series, n: int) -> Symbol:
        (u,) = x.parts
        if n == 0:
            return self.of(u, 0).arctan()
        bell = self._bell(u, 1.0)
        return (self.of(u, n) - products(self._slopes(x), bell, range(1, n), n) * (1.0 / n)) / bell(0)

    def _sign(self, x: Series, _: int) -> Symbol:
        u = self.of(x.parts[0], 0)
        return u / (abs(u) + STANDING)

    def _guard(self, x: Series, _: int) -> Symbol:
        a, b = (self.of(part, 0) for part in x.parts)
        return STANDING * (a * b).sqrt()

    def _atan2(self, x: Series, n: int) -> Symbol:
        """From how fast the angle turns."""
        turn, above, below = x.parts
        return self.of(turn, n - 1) * (1.0 / n) if n else self.of(above, 0).arctan2(self.of(below, 0))


def products(a: Of, b: Of, places: range, n: int) -> Symbol:
    """The sum of a(j) b(n - j) over some j."""
    return reduce(trace.add, (a(j) * b(n - j) for j in places), ZERO)


def series_kernel(net: Any, order: int) -> ArrayKernel:
    """As `texts.series_kernels`, of systems of any size, by their `by_arrays`; given: `constant_values` alone."""
    y = net.fresh_state("y")
    variables, rate = shorter(net, y)
    found = Coefficients(entries(y), rate)
    rows = [[found.of(x, n) for x in variables] for n in range(order + 1)]
    outputs = [refilled(y, row) for row in rows] + [squared_size(net, y, refilled(y, row)) for row in rows[-2:]]
    turns = [found.of(u, n) for n in range(order + 1) for u in kinks(rate)]
    made: ArrayKernel = net.compiled([y], [*outputs, *turns])
    return made


def rates_kernel(net: Any) -> ArrayKernel:
    """As `texts.rates_kernel`."""
    y = net.fresh_state("y")
    variables, rate = shorter(net, y)
    found = Coefficients(entries(y), rate)
    made: ArrayKernel = net.compiled([y], [refilled(y, [found.of(x, n) for x in variables]) for n in range(2)])
    return made


def squared_size(net: Any, y: Any, found: Any) -> Symbol:
    """As `texts.squared_size`."""
    if not net.defines("element_energy"):
        least = net.least_of(y)
        return trace.lifted((found * found / (least * least + y * y)).sum())
    moved, warmed = found.p / net.inertia() / net.least_speed, found.s * net.entropy_scale() / net.least[2] / y.s
    return trace.lifted((moved * moved).sum() + (warmed * warmed).sum())


def polynomial_kernel(order: int, size: int) -> Kernel:
    """As `texts.polynomial_kernel`, in a loop."""
    lines = ["n = table[0]", "h = b[0]", "for i in range(n):", f"    t{order} = a[{order} * n + i]"]
    lines += [f"    t{k} = a[{k} * n + i] + h * t{k + 1}" for k in reversed(range(order))]
    text = "".join(f"    {line}\n" for line in [*lines, "    out[i] = t0"])
    return Kernel(f"def kernel(a, b, out):\n{text}", size, np.array([size], np.int32))


def slopes_kernel(order: int, size: int) -> Kernel:
    """As `texts.slopes_kernel`, in a loop."""
    lines = [
        "n = table[0]",
        "h = b[0]",
        "for i in range(n):",
        f"    t{order} = a[{order} * n + i]",
        f"    d{order} = 0.0",
    ]
    for k in reversed(range(order)):
        lines += [f"    d{k} = t{k + 1} + h * d{k + 1}", f"    t{k} = a[{k} * n + i] + h * t{k + 1}"]
    text = "".join(f"    {line}\n" for line in [*lines, "    out[i] = t0", f"    out[n + {BESIDE} + i] = d0"])
    return Kernel(f"def kernel(a, b, out):\n{text}", 2 * size + BESIDE, np.array([size], np.int32))
