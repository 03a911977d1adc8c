"""LLVM code that evaluates an expression graph for eight values of its variables at once: nodes, quadrature points.

`kernels` writes scalar kernels, one state at a time. Here each Symbol becomes a vector of WIDTH doubles, which LLVM
maps to whatever the machine has (AVX-512, AVX2, SSE2, NEON), exp and log included. The object code is cached as all is.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .derivatives import Symbol, topological
from .kernels import WIDTH
from .values import FLOAT
from .vector_functions import VectorFunctions

OPERATIONS = {"add", "sub", "mul", "neg", "recip", "sqrt", "exp", "log", "pow", "mark", "const", "var"}


def can_express(outputs: Sequence[Symbol]) -> bool:
    """Whether every operation of these graphs has a form on vectors."""
    return all(node.op in OPERATIONS for node in topological(outputs))


class Lanes(VectorFunctions):
    """One kernel(a, b, out) under construction; values are vectors of WIDTH doubles, offsets count doubles."""

    a, b, out = "%a", "%b", "%out"

    def __init__(self) -> None:
        super().__init__(self._emitted, WIDTH)
        self.lines: list[str] = []
        self.splats: dict[tuple[str, int], str] = {}
        self.numbers: set[str] = set()  # values that are no vectors

    def _emitted(self, code: str) -> str:
        name = f"%v{len(self.lines)}"
        self.lines.append(f"  {name} = {code}")
        return name

    # memory ---------------------------------------------------------------------------------------------------------

    def _load(self, pointer: str, offset: int, kind: str) -> str:
        return self.emit(f"load {kind}, ptr {self._at(pointer, offset)}, align 8")

    def _at(self, pointer: str, offset: int) -> str:
        return self.emit(f"getelementptr {FLOAT}, ptr {pointer}, i64 {offset}")

    def row(self, pointer: str, offset: int) -> str:
        """WIDTH numbers that follow one another."""
        return self._load(pointer, offset, self.kind)

    def number(self, pointer: str, offset: int) -> str:
        """One number in every lane; read once, so store nothing over it before."""
        key = (pointer, offset)
        if key not in self.splats:
            code = f"insertelement {self.kind} undef, {FLOAT} {self._load(pointer, offset, FLOAT)}, i32 0"
            self.splats[key] = self.lane(self.emit(code), 0)
        return self.splats[key]

    def store(self, value: str, offset: int) -> None:
        kind = FLOAT if value in self.numbers else self.kind
        self.lines.append(f"  store {kind} {value}, ptr {self._at(self.out, offset)}, align 8")

    def lane(self, value: str, which: int) -> str:
        """One lane of a value in every lane."""
        return self._shuffled(value, [which] * WIDTH)

    def _shuffled(self, value: str, lanes: Sequence[int]) -> str:
        mask = ", ".join(f"i32 {i}" for i in lanes)
        return self.emit(f"shufflevector {self.kind} {value}, {self.kind} undef, <{WIDTH} x i32> <{mask}>")

    # arithmetic -----------------------------------------------------------------------------------------------------

    def combine(self, weights: Any, values: Sequence[str]) -> str:
        """The sum of weights[:, l] values[l]; numbers of `weights` by lane, values as vectors."""
        columns = [x if isinstance(x, str) else self.constant(x) for x in weights]
        total = self.mul(columns[0], values[0])
        for column, value in zip(columns[1:], values[1:], strict=True):
            total = self.add(total, self.mul(column, value))
        return total

    def smaller(self, x: str, y: str) -> str:
        return self.select("<", x, y, x, y)

    def pow(self, x: str, y: str) -> str:
        """Of a positive x; to a few ulp where the logarithm of the power is of the order of one."""
        return self.exp(self.mul(y, self.log(x)))

    # graphs and reductions ------------------------------------------------------------------------------------------

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
            case "neg":
                return self.emit(f"fneg {self.kind} {args[0]}")
            case "recip":
                return self.divide(self.constant(1.0), args[0])
            case "sqrt":
                return self._intrinsic("sqrt", args[0])
        found: str = getattr(self, node.op)(*args)
        return found

    def _intrinsic(self, name: str, x: str) -> str:
        return self.emit(f"call {self.kind} @llvm.{name}.v{WIDTH}f64({self.kind} {x})")

    def size(self, value: str) -> str:
        return self._intrinsic("fabs", value)

    def first(self, count: int, value: str) -> str:
        """The value in the first lanes, 0 in those that are not used: what a failure left there does not count."""
        used = ", ".join(f"i1 {'true' if i < count else 'false'}" for i in range(WIDTH))
        return self.emit(f"select <{WIDTH} x i1> <{used}>, {self.kind} {value}, {self.kind} {self.constant(0.0)}")

    def largest(self, values: Sequence[str]) -> str:
        """The largest of non-negative numbers, a scalar; NaN if any is."""
        top, total = values[0], values[0]
        for value in values[1:]:
            top, total = self.select(">", value, top, value, top), self.add(total, value)
        top = self.add(top, self.sub(total, total))
        # NaN lanes are above infinity as integers: values are not negative
        scalars = [self.emit(f"extractelement {self.kind} {top}, i32 {i}") for i in range(WIDTH)]
        whole = [self.emit(f"bitcast {FLOAT} {x} to i64") for x in scalars]
        while len(whole) > 1:
            pairs = [(self.emit(f"icmp ugt i64 {x}, {y}"), x, y) for x, y in zip(whole[::2], whole[1::2], strict=True)]
            whole = [self.emit(f"select i1 {test}, i64 {x}, i64 {y}") for test, x, y in pairs]
        return self._number(f"bitcast i64 {whole[0]} to {FLOAT}")

    def sum(self, value: str) -> str:
        """Of the lanes, a scalar; by halves."""
        for shift in (4, 2, 1):
            value = self.add(value, self._shuffled(value, [(i + shift) % WIDTH for i in range(WIDTH)]))
        return self._number(f"extractelement {self.kind} {value}, i32 0")

    def _number(self, code: str) -> str:
        self.numbers.add(found := self.emit(code))
        return found

    def text(self) -> str:
        declared = [f"declare {self.kind} @llvm.{name}.v{WIDTH}f64({self.kind})" for name in ("sqrt", "fabs")]
        head = "define void @kernel(ptr %a, ptr %b, ptr %out) {\nentry:"
        return "\n".join([*declared, head, *self.lines, "  ret void\n}\n"])
