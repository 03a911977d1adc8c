"""Taylor kernels of large systems: the recurrences of `recurrences` as loops over all entries of a space.

Sums over all, sums along tables and what tables name are linear: they go coefficient by coefficient.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from typing import Any

import numpy as np

from tcbench.compiler import derivatives as trace
from tcbench.compiler.array_kernels import ArrayKernel
from tcbench.compiler.array_states import entries, refilled
from tcbench.compiler.arrays import LINEAR, rebuilt
from tcbench.compiler.derivatives import Symbol, const
from tcbench.compiler.kernels import Kernel, of_lines

from .lanes import kinks
from .rates import rates
from .recurrences import Recurrences
from .series import Series
from .texts import BESIDE

ZERO = const(0.0)


class Coefficients(Recurrences[Series]):
    """Coefficients of series as symbols."""

    def __init__(self, y: Sequence[Symbol], rate: Sequence[Series]) -> None:
        super().__init__()
        self.y, self.rate = y, rate

    def of(self, x: Series, n: int) -> Symbol:
        """Coefficient n of a series."""
        found = self.value(x, n)
        return ZERO if found is None else found

    def value(self, x: Series, n: int) -> Any:
        return None if n and x.constant else self.once(x, n, "", lambda: self._made(x, n))

    def _made(self, x: Series, n: int) -> Any:
        if x.kind in LINEAR:
            return rebuilt(x.kind, [self.of(part, n) for part in x.parts], x.index)
        return self.of_kind(x, x.kind, n)

    def parts(self, x: Series) -> list[Series]:
        return list(x.parts)

    def sum_of(self, products: list[tuple[Any, ...]]) -> Any:
        return reduce(trace.add, (reduce(trace.mul, product) for product in products)) if products else None

    def scaled(self, weight: float, value: Symbol) -> Symbol:
        return weight * value

    def plus(self, number: float, value: Symbol | None) -> Symbol:
        return number + (ZERO if value is None else value)

    def over(self, above: Any, below: Symbol) -> Symbol:
        return (ZERO if above is None else trace.lifted(above)) / below

    def function(self, name: str, value: Symbol | None, of_size: Series | None = None) -> Symbol:
        inside = ZERO if value is None else value
        return trace.make(name, abs(inside) if of_size and of_size.of_size else inside)

    def angle(self, y: Any, x: Any, of: Series) -> Symbol:
        return (ZERO if y is None else y).arctan2(ZERO if x is None else x)

    def _var(self, x: Series, n: int) -> Any:
        return self.times(1.0 / n, self.value(self.rate[x.index], n - 1)) if n else self.y[x.index]

    def _sum(self, x: Series, n: int) -> Any:
        *weights, constant = x.weights
        terms = [(w, self.value(part, n)) for part, w in zip(x.parts, weights, strict=True)]
        return self.summed([], terms if n else [*terms, (constant,)])

    def _D(self, x: Series, n: int) -> Any:
        return self.times(n + 1.0, self.value(x.parts[0], n + 1))


def series_kernel(net: Any, order: int) -> ArrayKernel:
    """As `texts.series_kernels`, of systems of any size, by their `by_arrays`; given: `constant_values` alone."""
    y = net.fresh_state("y")
    variables, rate = rates(net, y)
    found = Coefficients(entries(y), rate)
    rows = [[found.of(x, n) for x in variables] for n in range(order + 1)]
    outputs = [refilled(y, row) for row in rows] + [squared_size(net, y, refilled(y, row)) for row in rows[-2:]]
    turns = [found.of(u, n) for n in range(order + 1) for u in kinks(rate)]
    made: ArrayKernel = net.compiled([y], [*outputs, *turns])
    return made


def rates_kernel(net: Any) -> ArrayKernel:
    """As `texts.rates_kernel`."""
    y = net.fresh_state("y")
    variables, rate = rates(net, y)
    found = Coefficients(entries(y), rate)
    made: ArrayKernel = net.compiled([y], [refilled(y, [found.of(x, n) for x in variables]) for n in range(2)])
    return made


def squared_size(net: Any, y: Any, found: Any) -> Symbol:
    """As `texts.squared_size`."""
    least = net.magnitudes_of(y)
    return trace.lifted((found * found / (least * least + y * y)).sum())


def polynomial_kernel(order: int, size: int) -> Kernel:
    """As `texts.polynomial_kernel`, in a loop."""
    lines = ["n = table[0]", "h = b[0]", "for i in range(n):", f"    t{order} = a[{order} * n + i]"]
    lines += [f"    t{k} = a[{k} * n + i] + h * t{k + 1}" for k in reversed(range(order))]
    return of_lines([*lines, "    out[i] = t0"], size, np.array([size], np.int32))


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
    lines += ["    out[i] = t0", f"    out[n + {BESIDE} + i] = d0"]
    return of_lines(lines, 2 * size + BESIDE, np.array([size], np.int32))
