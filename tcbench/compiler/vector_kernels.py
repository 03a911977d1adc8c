"""LLVM code that evaluates an expression graph for eight values of its variables at once: nodes, quadrature points.

`kernels` writes scalar kernels, one state at a time. Here each Symbol becomes a vector of WIDTH doubles, which LLVM
maps to whatever the machine has (AVX-512, AVX2, SSE2, NEON), exp and log included. The object code is cached as all is.
"""

from __future__ import annotations

import math
import struct
import sys
from collections.abc import Sequence
from typing import Any

import llvmlite.binding as llvm
import numpy as np
from llvmlite import ir

from .derivatives import Symbol, topological
from .kernels import WIDTH

DOUBLE, INT = ir.DoubleType(), ir.IntType(64)
POINTER = ir.PointerType(DOUBLE)
FLAGS = ("contract",)  # fused multiply-add
VECTOR, INTEGERS = ir.VectorType(DOUBLE, WIDTH), ir.VectorType(INT, WIDTH)
OPERATIONS = {"add", "sub", "mul", "neg", "recip", "sqrt", "exp", "log", "pow", "mark", "const", "var"}

ROUND = 1.5 * 2.0**52  # adding it rounds to an integer, which then stands in the low bits
LN2_HIGH, LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10  # their sum is ln 2 to 33 more digits
EXP_SERIES = [1.0 / math.factorial(k) for k in range(14)]  # |r| <= ln(2)/2: the first omitted term is 4e-18
LOG_SERIES = [  # log((1 + s)/(1 - s)) = 2s + s R(s^2) for s^2 < 0.0295, error 2^-58 (Sun's fdlibm, e_log.c)
    6.666666666666735130e-01, 3.999999999940941908e-01, 2.857142874366239149e-01, 2.222219843214978396e-01,
    1.818357216161805012e-01, 1.531383769920937332e-01, 1.479819860511658591e-01,
]  # fmt: skip
SMALLEST = sys.float_info.min
LARGEST_EXP, SMALLEST_EXP = math.log(sys.float_info.max), math.log(SMALLEST)


def can_express(outputs: Sequence[Symbol]) -> bool:
    """Whether every operation of these graphs has a form on vectors."""
    return all(node.op in OPERATIONS for node in topological(outputs))


class Lanes:
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

    def add(self, x: Any, y: Any) -> Any:
        return self.build.fadd(x, y, flags=FLAGS)

    def sub(self, x: Any, y: Any) -> Any:
        return self.build.fsub(x, y, flags=FLAGS)

    def mul(self, x: Any, y: Any) -> Any:
        return self.build.fmul(x, y, flags=FLAGS)

    def divide(self, x: Any, y: Any) -> Any:
        return self.build.fdiv(x, y, flags=FLAGS)

    def combine(self, weights: Any, values: Sequence[Any]) -> Any:
        """The sum of weights[:, l] values[l]; numbers of `weights` by lane, values as vectors."""
        columns = [x if isinstance(x, ir.Value) else self.constant(x) for x in weights]
        total = self.mul(columns[0], values[0])
        for column, value in zip(columns[1:], values[1:], strict=True):
            total = self.add(total, self.mul(column, value))
        return total

    def polynomial(self, coefficients: Sequence[float], x: Any) -> Any:
        """In Estrin's order: short chains of operations."""
        terms = [self.constant(c) for c in coefficients]
        while len(terms) > 1:
            pairs = [self.add(low, self.mul(high, x)) for low, high in zip(terms[::2], terms[1::2], strict=False)]
            terms = pairs + terms[len(pairs) * 2 :]
            x = self.mul(x, x)
        return terms[0]

    def select(self, test: str, x: Any, y: Any, yes: Any, no: Any) -> Any:
        return self.build.select(self.build.fcmp_ordered(test, x, y), yes, no)

    def smaller(self, x: Any, y: Any) -> Any:
        return self.select("<", x, y, x, y)

    def exp(self, x: Any) -> Any:
        """Within an ulp; infinite where it overflows, 0 where it is below the smallest normal number, NaN of NaN."""
        given, top, bottom = x, self.constant(LARGEST_EXP), self.constant(SMALLEST_EXP)
        x = self.select(">", x, top, top, x)
        x = self.select("<", x, bottom, bottom, x)
        shifted = self.add(self.mul(x, self.constant(1.0 / math.log(2.0))), self.constant(ROUND))
        n = self.sub(shifted, self.constant(ROUND))
        r = self.sub(self.sub(x, self.mul(n, self.constant(LN2_HIGH))), self.mul(n, self.constant(LN2_LOW)))
        exponent = self.build.shl(self.build.bitcast(shifted, INTEGERS), ir.Constant(INTEGERS, [52] * WIDTH))
        tail = self.add(r, self.mul(self.mul(r, r), self.polynomial(EXP_SERIES[2:], r)))
        bits = self.build.bitcast(self.add(self.constant(1.0), tail), INTEGERS)
        value = self.build.bitcast(self.build.add(bits, exponent), VECTOR)
        value = self.select(">", given, top, self.constant(math.inf), value)
        return self.select("<", given, bottom, self.constant(0.0), value)

    def log(self, x: Any) -> Any:
        """Within an ulp; as numpy's: -infinity of 0, infinity of infinity, NaN where x is negative or NaN."""
        given, least = x, self.constant(SMALLEST)
        x = self.select("<", x, least, self.mul(x, self.constant(2.0**54)), x)  # subnormal numbers
        bits = self.build.bitcast(x, INTEGERS)
        half = ir.Constant(INTEGERS, [_bits(math.sqrt(0.5))] * WIDTH)
        e = self.build.ashr(self.build.sub(bits, half), ir.Constant(INTEGERS, [52] * WIDTH))
        mantissa = self.build.sub(bits, self.build.shl(e, ir.Constant(INTEGERS, [52] * WIDTH)))
        f = self.sub(self.build.bitcast(mantissa, VECTOR), self.constant(1.0))
        whole = self.build.bitcast(self.build.add(e, ir.Constant(INTEGERS, [_bits(ROUND)] * WIDTH)), VECTOR)
        n = self.sub(whole, self.select("<", given, least, self.constant(ROUND + 54.0), self.constant(ROUND)))
        s = self.divide(f, self.add(self.constant(2.0), f))
        z = self.mul(s, s)
        half_square = self.mul(self.constant(0.5), self.mul(f, f))
        tail = self.mul(s, self.add(half_square, self.mul(z, self.polynomial(LOG_SERIES, z))))
        tail = self.sub(half_square, self.add(tail, self.mul(n, self.constant(LN2_LOW))))
        value = self.sub(self.mul(n, self.constant(LN2_HIGH)), self.sub(tail, f))
        of_rest = self.select("==", x, self.constant(0.0), self.constant(-math.inf), self.constant(math.nan))
        value = self.select(">", x, self.constant(0.0), value, of_rest)
        return self.select("==", x, self.constant(math.inf), x, value)

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


def _bits(x: float) -> int:
    return int(struct.unpack("<q", struct.pack("<d", x))[0])
