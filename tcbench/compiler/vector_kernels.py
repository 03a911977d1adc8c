"""LLVM code that evaluates an expression graph for eight values of its variables at once: nodes, quadrature points.

`kernels` writes scalar kernels, one state at a time. Here each Symbol becomes a vector of WIDTH doubles, which LLVM
maps to whatever the machine has (AVX-512, AVX2, SSE2, NEON), exp and log included. The object code is cached as all is.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import llvmlite.binding as llvm
import numpy as np
from llvmlite import ir

from .derivatives import Symbol, topological
from .kernels import WIDTH
from .vector_functions import VectorFunctions

DOUBLE, INT = ir.DoubleType(), ir.IntType(64)
POINTER = ir.PointerType(DOUBLE)
FLAGS = ("contract",)  # fused multiply-add
VECTOR, INTEGERS = ir.VectorType(DOUBLE, WIDTH), ir.VectorType(INT, WIDTH)
OPERATIONS = {"add", "sub", "mul", "neg", "recip", "sqrt", "exp", "log", "pow", "mark", "const", "var"}


def can_express(outputs: Sequence[Symbol]) -> bool:
    """Whether every operation of these graphs has a form on vectors."""
    return all(node.op in OPERATIONS for node in topological(outputs))


class Lanes(VectorFunctions):
    """One kernel(a, b, out) under construction; values are vectors of WIDTH doubles, offsets count doubles."""

    def __init__(self) -> None:
        self.module = ir.Module(name="lanes")
        self.module.triple = llvm.get_default_triple()
        function = ir.Function(self.module, ir.FunctionType(ir.VoidType(), [POINTER] * 3), name="kernel")
        self.build = ir.IRBuilder(function.append_basic_block())
        self.a, self.b, self.out = function.args
        self.splats: dict[tuple[int, int], Any] = {}

    # memory ---------------------------------------------------------------------------------------------------------

    def _at(self, pointer: Any, offset: int, kind: Any) -> Any:
        place = self.build.gep(pointer, [ir.Constant(INT, offset)], source_etype=DOUBLE)
        return self.build.bitcast(place, ir.PointerType(kind))

    def row(self, pointer: Any, offset: int) -> Any:
        """WIDTH numbers that follow one another."""
        return self.build.load(self._at(pointer, offset, VECTOR), align=8, typ=VECTOR)

    def number(self, pointer: Any, offset: int) -> Any:
        """One number in every lane; read once, so store nothing over it before."""
        key = (id(pointer), offset)
        if key not in self.splats:
            self.splats[key] = self._everywhere(self.build.load(self._at(pointer, offset, DOUBLE), align=8, typ=DOUBLE))
        return self.splats[key]

    def store(self, value: Any, offset: int) -> None:
        self.build.store(value, self._at(self.out, offset, value.type), align=8)

    def _everywhere(self, scalar: Any) -> Any:
        first = self.build.insert_element(ir.Constant(VECTOR, ir.Undefined), scalar, ir.Constant(ir.IntType(32), 0))
        return self.lane(first, 0)

    def lane(self, value: Any, which: int) -> Any:
        """One lane of a value in every lane."""
        mask = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [which] * WIDTH)
        return self.build.shuffle_vector(value, ir.Constant(VECTOR, ir.Undefined), mask)

    # arithmetic -----------------------------------------------------------------------------------------------------

    def constant(self, value: Any) -> Any:
        """A number in every lane, or up to WIDTH numbers, the first repeated in the lanes that are left."""
        values = [float(value)] * WIDTH if np.ndim(value) == 0 else [float(x) for x in value]
        return ir.Constant(VECTOR, [*values, *[values[0]] * (WIDTH - len(values))])

    def real(self, operation: str, x: Any, y: Any) -> Any:
        return getattr(self.build, operation)(x, y, flags=FLAGS)

    def whole(self, operation: str, x: Any, y: Any) -> Any:
        return getattr(self.build, operation)(x, y)

    def everywhere(self, value: int) -> Any:
        return ir.Constant(INTEGERS, [value] * WIDTH)

    def as_bits(self, x: Any) -> Any:
        return self.build.bitcast(x, INTEGERS)

    def from_bits(self, x: Any) -> Any:
        return self.build.bitcast(x, VECTOR)

    def combine(self, weights: Any, values: Sequence[Any]) -> Any:
        """The sum of weights[:, l] values[l]; numbers of `weights` by lane, values as vectors."""
        columns = [x if isinstance(x, ir.Value) else self.constant(x) for x in weights]
        total = self.mul(columns[0], values[0])
        for column, value in zip(columns[1:], values[1:], strict=True):
            total = self.add(total, self.mul(column, value))
        return total

    def select(self, test: str, x: Any, y: Any, yes: Any, no: Any) -> Any:
        return self.build.select(self.build.fcmp_ordered(test, x, y), yes, no)

    def smaller(self, x: Any, y: Any) -> Any:
        return self.select("<", x, y, x, y)

    def pow(self, x: Any, y: Any) -> Any:
        """Of a positive x; to a few ulp where the logarithm of the power is of the order of one."""
        return self.exp(self.mul(y, self.log(x)))

    # graphs and reductions ------------------------------------------------------------------------------------------

    def graph(self, known: dict[Symbol, Any], outputs: Sequence[Any]) -> list[Any]:
        """Values of the graphs; `known` has the inputs and keeps every node's value for the next call."""
        symbols = [x for x in outputs if isinstance(x, Symbol)]
        for node in topological(symbols, {x.number for x in known}):
            if node not in known:
                known[node] = self._value(node, [known[x] for x in node.args])
        return [known[x] if isinstance(x, Symbol) else self.constant(x) for x in outputs]

    def _value(self, node: Symbol, args: list[Any]) -> Any:
        if node.op == "const":
            return self.constant(node.value)
        if node.op == "mark":
            return args[0]
        if node.op == "neg":
            return self.build.fneg(args[0])
        if node.op == "recip":
            return self.divide(self.constant(1.0), args[0])
        if node.op == "sqrt":
            return self._intrinsic("sqrt", VECTOR, args)
        return getattr(self, node.op)(*args)

    def _intrinsic(self, name: str, result: Any, args: Sequence[Any]) -> Any:
        full = f"llvm.{name}.v{WIDTH}f64"
        known = self.module.globals.get(full)
        if known is None:
            known = ir.Function(self.module, ir.FunctionType(result, [x.type for x in args]), name=full)
        return self.build.call(known, args)

    def size(self, value: Any) -> Any:
        return self._intrinsic("fabs", VECTOR, [value])

    def first(self, count: int, value: Any) -> Any:
        """The value in the first lanes, 0 in those that are not used: what a failure left there does not count."""
        used = ir.Constant(ir.VectorType(ir.IntType(1), WIDTH), [i < count for i in range(WIDTH)])
        return self.build.select(used, value, self.constant(0.0))

    def largest(self, values: Sequence[Any]) -> Any:
        """The largest of non-negative numbers, a scalar; NaN if any is."""
        top, total = values[0], values[0]
        for value in values[1:]:
            top, total = self.select(">", value, top, value, top), self.add(total, value)
        top = self.add(top, self.sub(total, total))
        # NaN lanes are above infinity as integers: values are not negative
        scalars = [self.build.extract_element(top, ir.Constant(ir.IntType(32), i)) for i in range(WIDTH)]
        integers = [self.build.bitcast(x, INT) for x in scalars]
        while len(integers) > 1:
            pairs = zip(integers[::2], integers[1::2], strict=True)
            integers = [self.build.select(self.build.icmp_unsigned(">", x, y), x, y) for x, y in pairs]
        return self.build.bitcast(integers[0], DOUBLE)

    def sum(self, value: Any) -> Any:
        """Of the lanes, a scalar; by halves."""
        for shift in (4, 2, 1):
            mask = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [(i + shift) % WIDTH for i in range(WIDTH)])
            value = self.add(value, self.build.shuffle_vector(value, ir.Constant(VECTOR, ir.Undefined), mask))
        return self.build.extract_element(value, ir.Constant(ir.IntType(32), 0))

    def text(self) -> str:
        self.build.ret_void()
        return str(self.module)
