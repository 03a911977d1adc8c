"""Taylor kernels of large systems: the recurrences of `recurrences` as loops over all entries of a space.

Sums over all, sums along tables and what tables name are linear: they go coefficient by coefficient.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any

import numpy as np

from tcbench.compiler import derivatives as trace
from tcbench.compiler.array_kernels import ArrayKernel
from tcbench.compiler.array_mesh import Block
from tcbench.compiler.array_orders import Kept, Orders, convolved, orders_kernel
from tcbench.compiler.array_states import entries, refilled
from tcbench.compiler.arrays import LINEAR, rebuilt, space_of, variable
from tcbench.compiler.derivatives import Symbol, const
from tcbench.compiler.kernels import Kernel, of_lines

from .lanes import kinks
from .rates import rates
from .recurrences import Of, Products, Recurrences
from .series import Series
from .texts import BESIDE

ZERO = const(0.0)


@dataclass(frozen=True)
class Order:
    """The order k + offset of a coefficient in a loop over orders k, or the weight over/(k + offset).

    role : of a factor in a convolution: "j", or "left" for what is left of the order.
    """

    k: Symbol
    offset: int = 0
    over: float | None = None
    role: str = ""

    def __add__(self, n: int) -> Order:
        return replace(self, offset=self.offset + n)

    def __sub__(self, n: Any) -> Order:
        return replace(self, role="left") if isinstance(n, Order) else self + -n

    def __rtruediv__(self, over: float) -> Order:
        return replace(self, over=over)

    @property
    def number(self) -> Symbol:
        n = self.k + float(self.offset)
        return n if self.over is None else self.over / n


class Coefficients(Recurrences[Series]):
    """Coefficients of series as symbols: of orders that are numbers, and of all k + n at once.

    Series that convolutions read are `Kept`. Some have to be ahead of the loop: the variables, whose coefficient k + 1
    comes from their rates, and what is made of these. ahead : by how much, by series.
    """

    def __init__(self, y: Sequence[Symbol], rate: Sequence[Series]) -> None:
        super().__init__()
        self.y, self.rate = y, rate
        self.k = variable("k", "")
        self.ahead: dict[Any, int] = {}
        self.kept: dict[Any, tuple[Kept, Series, Callable[[Any], Any]]] = {}
        self.at_k: dict[Any, Any] = {}  # coefficients k + n
        self.spaces: dict[int, str] = {}

    def of(self, x: Series, n: Any) -> Symbol:
        """Coefficient n of a series."""
        return self._symbol(self.value(x, n))

    def looped(self, wanted: Sequence[Series]) -> tuple[list[Symbol], list[Kept]]:
        """Coefficients k + 1 of these series, and the series whose coefficients of other orders they read."""
        following, size = [], -1
        while size < (size := sum(self.ahead.values())):  # how far ahead series have to be is known when all are made
            self.at_k, self.kept = {}, {}
            following = [self.of(x, Order(self.k, 1)) for x in wanted]
            done: set[Any] = set()
            while waiting := [key for key in self.kept if key not in done]:
                for key in waiting:
                    kept, _, make = self.kept[key]
                    kept.ahead = self.ahead.get(key, 0)
                    kept.next = self._symbol(self._made_at(key, Order(self.k, kept.ahead), make))
                    done.add(key)
        for (_, what), (kept, x, make) in self.kept.items():
            orders = range(bool(what), kept.ahead + 1)
            kept.first = {n: self._symbol(super(Coefficients, self).once(x, n, what, make)) for n in orders}
        return following, [kept for kept, _, _ in self.kept.values()]

    @staticmethod
    def _symbol(value: Any) -> Symbol:
        return ZERO if value is None else trace.lifted(value)

    def once(self, x: Series, n: Any, what: str, make: Callable[[Any], Any]) -> Any:
        if not isinstance(n, Order):
            return super().once(x, n, what, make)
        key, is_variable = (id(x), what), x.kind == "var" and not what
        ahead = self.ahead.setdefault(key, int(is_variable))
        if n.role or n.offset < ahead:
            kept, *_ = self.kept.setdefault(key, (Kept(self.space(x), ahead), x, make))
            return kept if n.role else kept.at(n.offset)
        if not is_variable:
            self.ahead[key] = n.offset
        return self._made_at(key, n, make)

    def _made_at(self, key: Any, n: Order, make: Callable[[Any], Any]) -> Any:
        if (key, n.offset) not in self.at_k:
            self.at_k[key, n.offset] = make(n)
        return self.at_k[key, n.offset]

    def space(self, x: Series) -> str:
        """The space of a series."""
        if id(x) not in self.spaces:
            if x.kind == "var":
                space = self.y[x.index].space
            elif x.kind in LINEAR:
                space = space_of(x.kind, x.index)
            else:
                space = next(filter(None, [*map(self.space, x.parts), *(w.space for w in x.weights)]), "")
            self.spaces[id(x)] = space
        return self.spaces[id(x)]

    def value(self, x: Series, n: Any) -> Any:
        return None if n and x.constant else self.once(x, n, "", lambda n: self._made(x, n))

    def _made(self, x: Series, n: Any) -> Any:
        if x.kind in LINEAR:
            return rebuilt(x.kind, [self.of(part, n) for part in x.parts], x.index)
        return self.of_kind(x, x.kind, n)

    def convolution(self, n: Any, a: Of, b: Of, newest: Products, weight: Any = 1.0) -> Any:
        if not isinstance(n, Order):
            return super().convolution(n, a, b, newest, weight)
        j = replace(n, role="j")
        factors = a(j), b(n - j)
        older = [] if None in factors else [(convolved(*factors, n.offset),)]
        return self.summed(older, newest, weight)

    def squared(self, n: Any, a: Of) -> list[tuple[Any, ...]]:
        if not isinstance(n, Order):
            return super().squared(n, a)
        factor = a(replace(n, role="j"))
        return [] if factor is None else [(convolved(factor, factor, n.offset),)]

    def parts(self, x: Series) -> list[Series]:
        return list(x.parts)

    def sum_of(self, products: list[tuple[Any, ...]]) -> Any:
        return reduce(trace.add, (reduce(trace.mul, product) for product in products)) if products else None

    def scaled(self, weight: Any, value: Symbol) -> Symbol:
        return trace.lifted(weight.number if isinstance(weight, Order) else float(weight)) * value

    def plus(self, number: float, value: Symbol | None) -> Symbol:
        return number + (ZERO if value is None else value)

    def over(self, above: Any, below: Symbol) -> Symbol:
        return (ZERO if above is None else trace.lifted(above)) / below

    def function(self, name: str, value: Symbol | None, of_size: Series | None = None) -> Symbol:
        inside = ZERO if value is None else value
        return trace.make(name, abs(inside) if of_size and of_size.of_size else inside)

    def angle(self, y: Any, x: Any, of: Series) -> Symbol:
        return (ZERO if y is None else y).arctan2(ZERO if x is None else x)

    def _var(self, x: Series, n: Any) -> Any:
        return self.times(1.0 / n, self.value(self.rate[x.index], n - 1)) if n else self.y[x.index]

    def _sum(self, x: Series, n: Any) -> Any:
        *weights, constant = x.weights
        terms = [(w, self.value(part, n)) for part, w in zip(x.parts, weights, strict=True)]
        return self.summed([], terms if n else [*terms, (constant,)])

    def _D(self, x: Series, n: Any) -> Any:
        return self.times(n + 1, self.value(x.parts[0], n + 1))


def series_kernel(net: Any, order: int) -> ArrayKernel:
    """As `texts.series_kernels`, of systems of any size, by their `by_arrays`; given: `constant_values` alone."""
    y = net.fresh_state("y")
    variables, rate = rates(net, y)
    coefficients, turns = Coefficients(entries(y), rate), kinks(rate)
    following, kept = coefficients.looped([*variables, *turns])
    before, first = ([coefficients.of(x, n) for x in (*variables, *turns)] for n in range(2))
    beside = [Block(coefficients.space(x), (None,)) for x in turns]
    ends = net.fresh_state("y_before"), net.fresh_state("y_last")
    last = [squared_size(net, y, end) for end in ends]
    values, parts = (before, first, following), (entries(ends[0]), entries(ends[1]))
    orders = Orders(order, coefficients.k, kept, net.blocks([y]), beside, values, last, parts)
    return orders_kernel({"a": net.blocks([y]), "b": net.constant_blocks()}, orders)


def rates_kernel(net: Any) -> ArrayKernel:
    """As `texts.rates_kernel`."""
    y = net.fresh_state("y")
    variables, rate = rates(net, y)
    coefficients = Coefficients(entries(y), rate)
    orders = [refilled(y, [coefficients.of(x, n) for x in variables]) for n in range(2)]
    kernel: ArrayKernel = net.compiled([y], orders)
    return kernel


def squared_size(net: Any, y: Any, coefficient: Any) -> Symbol:
    """As `texts.squared_size`."""
    least = net.magnitudes_of(y)
    return trace.lifted((coefficient * coefficient / (least * least + y * y)).sum())


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
