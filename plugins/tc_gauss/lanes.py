"""Text of kernels on vectors of eight numbers: all nodes, quadrature points or eigenvalues side by side."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partialmethod
from typing import Any

import numpy as np

from tcbench.compiler.derivatives import Symbol, topological
from tcbench.compiler.kernels import WIDTH, Kernel, of_lines, operation

# of which LLVM makes operations on vectors; it calls other functions lane by lane
OPERATIONS = {"add", "sub", "mul", "neg", "recip", "sqrt", "exp", "log", "pow", "mark", "const", "var"}


def can_express(outputs: Sequence[Symbol]) -> bool:
    """Whether every operation of these graphs is one on vectors."""
    return all(node.op in OPERATIONS and (node.op != "pow" or node.args[0].positive) for node in topological(outputs))


class Lanes:
    """One kernel(a, b, out) under construction. A value is a name, of a vector or of a number that counts in all lanes;
    equal texts have one, so store nothing over what is read later."""

    a, b, out = "a", "b", "out"

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.names: dict[str, str] = {}
        self.numbers: set[str] = set()

    def made(self, text: str, number: bool) -> str:
        """The name of this text's value, which is a number or a vector."""
        if text not in self.names:
            name = self.names[text] = f"t{len(self.names)}"
            self.lines.append(f"{name} = {text}")
            self.numbers |= {name} if number else set()
        return self.names[text]

    def of(self, text: str, *operands: str) -> str:
        """The same of operations with these, lane by lane."""
        return self.made(text, all(x in self.numbers for x in operands))

    def constant(self, value: Any) -> str:
        """A number, or a number for each lane, the first repeated in the lanes that are left."""
        if np.ndim(value) == 0:
            return self.made(repr(float(value)), True)
        values = [*map(float, value), *[float(value[0])] * (WIDTH - len(value))]
        return self.made(f"vector({', '.join(map(repr, values))})", False)

    # memory ---------------------------------------------------------------------------------------------------------

    def row(self, array: str, at: int) -> str:
        """WIDTH numbers that follow one another."""
        return self.made(f"row({array}, {at}, {WIDTH})", False)

    def number(self, array: str, at: int) -> str:
        return self.made(f"{array}[{at}]", True)

    def store(self, value: str, at: int) -> None:
        """In all lanes."""
        self.lines.append(f"put(out, {at}, {self.wide(value)})")

    def store_number(self, value: str, at: int) -> None:
        self.lines.append(f"out[{at}] = {value}")

    def wide(self, value: str) -> str:
        """A number as a vector."""
        return self.made(f"vector({', '.join([value] * WIDTH)})", False) if value in self.numbers else value

    def lane(self, value: str, which: int) -> str:
        return value if value in self.numbers else self.made(f"{value}[{which}]", True)

    # arithmetic -----------------------------------------------------------------------------------------------------

    def _joined(self, sign: str, x: str, y: str) -> str:
        return self.of(f"{x} {sign} {y}", x, y)

    add, sub = partialmethod(_joined, "+"), partialmethod(_joined, "-")
    mul, divide = partialmethod(_joined, "*"), partialmethod(_joined, "/")

    def size(self, x: str) -> str:
        return self.of(f"abs({x})", x)

    def combine(self, weights: Any, values: Sequence[str]) -> str:
        """The sum of weights[:, l] values[l]; numbers of `weights` by lane."""
        columns = [x if isinstance(x, str) else self.constant(x) for x in weights]
        text = " + ".join(f"{x} * {y}" for x, y in zip(columns, values, strict=True))
        return self.of(text, *columns, *values)

    def graph(self, known: dict[Symbol, str], outputs: Sequence[Any]) -> list[str]:
        """Values of the graphs; `known` has the inputs and keeps every node's value for the next call."""
        symbols = [x for x in outputs if isinstance(x, Symbol)]
        for node in topological(symbols, {x.number for x in known}):
            if node not in known:
                known[node] = self._value(node, [known[x] for x in node.args])
        return [known[x] if isinstance(x, Symbol) else self.constant(x) for x in outputs]

    def _value(self, node: Symbol, args: list[str]) -> str:
        match node.op:
            case "const":
                return self.constant(node.value)
            case "mark":
                return args[0]
            case "pow":  # of a positive number; to a few ulp where the logarithm of the power is of the order of one
                return self.of(f"exp({args[1]} * log({args[0]}))", *args)
        return self.of(operation(node, args), *args)

    # reductions -----------------------------------------------------------------------------------------------------

    def first(self, count: int, value: str) -> str:
        """The value in the first lanes, 0 in those that are not used: what a failure left there does not count."""
        lanes = ", ".join(str(i if i < count else WIDTH + i) for i in range(WIDTH))
        return self.made(f"pick({self.wide(value)}, {self.constant([0.0])}, {lanes})", False)

    def larger(self, x: str, y: str) -> str:
        """To round-off; NaN if one is."""
        return self.of(f"0.5 * ({x} + {y} + abs({x} - {y}))", x, y)

    def largest(self, values: Sequence[str]) -> str:
        """The largest of all lanes, a number; NaN if any is."""
        top = values[0]
        for value in values[1:]:
            top = self.larger(top, value)
        return self._folded(top, self.larger)

    def sum(self, value: str) -> str:
        """Of the lanes, a number."""
        return self._folded(value, self.add)

    def _folded(self, value: str, join: Callable[[str, str], str]) -> str:
        value = self.wide(value)
        for shift in (4, 2, 1):
            lanes = ", ".join(str((i + shift) % WIDTH) for i in range(WIDTH))
            value = join(value, self.made(f"pick({value}, {value}, {lanes})", False))
        return self.lane(value, 0)

    def kernel(self) -> Kernel:
        return of_lines(self.lines, 0)
