"""Kernels of series on arrays with a loop over orders, whose text is that of one order.

Coefficients that other orders read stand in records (`array_records`); convolutions (`convolved`) are inner loops.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from .array_kernels import ArrayKernel, Shared, Target, stored
from .array_mesh import Block
from .array_records import Middle, Output, Part, Slot
from .arrays import NUMBER, variable
from .derivatives import lifted, topological
from .kernels import fixed_values
from .symbols import Symbol, intern


@dataclass(eq=False)
class Kept:
    """A quantity whose coefficients are all kept; the loop at order k computes that of order k + ahead.

    first : by order, coefficients from before the loop. next : that of order k + ahead. past : by n, the symbol of that
    of order k + n. row : the row of coefficient 0.
    """

    space: str
    ahead: int = 0
    first: dict[int, Symbol] = field(default_factory=dict)
    next: Symbol | None = None
    past: dict[int, Symbol] = field(default_factory=dict)
    row: int = 0

    def at(self, n: int) -> Symbol:
        """The coefficient of order k + n."""
        if n not in self.past:
            self.past[n] = variable(f"past{n}", self.space)
        return self.past[n]


def convolved(a: Kept, b: Kept, n: int) -> Symbol:
    """The sum over j = 1 .. m - 1 of a_j b_(m - j), where m = k + n."""
    return intern("convolved", (), (a, b, n), space=a.space or b.space)


@dataclass
class Orders:
    """The outputs of a kernel of series: coefficients 0 .. order of series, in blocks like these, then the numbers
    `last`, then coefficients 0 .. order of the series `beside`.

    values : coefficients 0, 1 and k + 1 of all series, one after the other; k is the order of the loop, from 1 to
    order - 1. ends : the symbols in `last` of coefficients order - 1 and order.
    """

    order: int
    k: Symbol
    kept: Sequence[Kept]
    series: list[Block]
    beside: list[Block]
    values: tuple[list[Symbol], list[Symbol], list[Symbol]]
    last: list[Symbol]
    ends: tuple[list[Symbol], list[Symbol]]

    @property
    def outputs(self) -> list[Block]:
        times = self.order + 1
        return [*self.series * times, *(Block(NUMBER, (x,)) for x in self.last), *self.beside * times]

    def placed(self, values: Sequence[Symbol], order: str) -> list[Target]:
        """The coefficients of one order, each with its place."""
        behind = len(self.series) * (self.order + 1) + len(self.last)
        blocks = [(first + k, len(group), b) for first, group in ((0, self.series), (behind, self.beside))
                  for k, b in enumerate(group)]  # fmt: skip
        parts = [(Output(k, k + far, c, len(b.symbols), order), b.space) for k, far, b in blocks
                 for c in range(len(b.symbols))]  # fmt: skip
        return [(x, place, space) for x, (place, space) in zip(values, parts, strict=False)]


def orders_kernel(inputs: Mapping[str, Sequence[Block]], what: Orders) -> ArrayKernel:
    """The kernel that reads the inputs' blocks and writes all orders into out: the first orders, the loop, and values
    of the last orders."""
    shared, kept, here = Shared(), what.kept, stored(inputs)
    for x in kept:
        x.row = shared.new(x.space, what.order + x.ahead)
    first: list[Target] = [(value, Slot(x.space, x.row + n), x.space) for x in kept for n, value in x.first.items()]
    repeated: list[Target] = [(lifted(x.next), Slot(x.space, x.row + x.ahead, "k"), x.space) for x in kept]
    repeated += what.placed(what.values[2], "(k + 1)")
    given = {x.number: place for x, place, space in reversed(first) if x.space == space and x.op != "const"}
    given |= {value.number: Slot(x.space, x.row + n, "k") for x in kept for n, value in x.past.items()}
    given[what.k.number] = Slot(NUMBER, shared.new(NUMBER))
    wanted = [x for x, *_ in repeated]
    sums = [x for x in topological(wanted) if x.op == "convolved"]
    for value in fixed_values(wanted, [what.k, *sums, *(value for x in kept for value in x.past.values())]):
        if value.number not in given:
            given[value.number] = Slot(value.space, shared.new(value.space))
            first.append((value, given[value.number], value.space))
    start = Part(shared, here, [*first, *what.placed(what.values[0], "0"), *what.placed(what.values[1], "1")])
    loop = Middle(shared, given, repeated)
    ends = [target for n, row in enumerate(what.ends) for target in what.placed(row, str(what.order - 1 + n))]
    at = len(what.series) * (what.order + 1)
    last: list[Target] = [(x, Output(at + n, at + n, 0, 1, "0"), NUMBER) for n, x in enumerate(what.last)]
    end = Part(shared, {**here, **{x.number: place for x, place, _ in ends}}, last)
    body = [f"{loop.item(given[what.k.number], '0')} = float(k)", *loop.lines()]
    lines = [*start.lines(), f"for k in range(1, {what.order}):", *(f"    {x}" for x in body), *end.lines()]
    return start.written(inputs, what.outputs, lines)
