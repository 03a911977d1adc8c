"""Arithmetic of vectors as LLVM code, exp and log included: for `short_vectors`."""

from __future__ import annotations

import math
import struct
import sys
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from .values import FLOAT, FUSED, INT, constant

ROUND = 1.5 * 2.0**52  # adding it rounds to an integer, in the low bits
LN2_HIGH, LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10  # their sum is ln 2 to 33 more digits
EXP_SERIES = [1.0 / math.factorial(k) for k in range(14)]  # |r| <= ln(2)/2: the first omitted term is 4e-18
LOG_SERIES = [  # log((1 + s)/(1 - s)) = 2s + s R(s^2) for s^2 < 0.0295, error 2^-58 (Sun's fdlibm, e_log.c)
    6.666666666666735130e-01, 3.999999999940941908e-01, 2.857142874366239149e-01, 2.222219843214978396e-01,
    1.818357216161805012e-01, 1.531383769920937332e-01, 1.479819860511658591e-01,
]  # fmt: skip
SMALLEST = sys.float_info.min
LARGEST_EXP, SMALLEST_EXP = math.log(sys.float_info.max), math.log(SMALLEST)
COMPARISONS = {"<": "olt", ">": "ogt", "==": "oeq"}
EXPONENT = 52  # bits of a double behind its exponent


class VectorFunctions:
    """Operations and functions on vectors of `width` doubles. emit : writes an operation of LLVM, returns its name."""

    def __init__(self, emit: Callable[[str], str], width: int) -> None:
        self.emit, self.width = emit, width
        self.kind, self.bits = f"<{width} x {FLOAT}>", f"<{width} x {INT}>"

    def real(self, operation: str, x: str, y: str) -> str:
        """fadd, fsub, fmul or fdiv."""
        return self.emit(f"{operation} {FUSED} {self.kind} {x}, {y}")

    def whole(self, operation: str, x: str, y: str) -> str:
        """add, sub, shl or ashr of vectors of whole numbers."""
        return self.emit(f"{operation} {self.bits} {x}, {y}")

    def constant(self, value: Any) -> str:
        """A number in every lane, or one for each; further lanes have the first."""
        values = [float(value)] if np.ndim(value) == 0 else [float(x) for x in value]
        values += [values[0]] * (self.width - len(values))
        return f"<{', '.join(f'{FLOAT} {constant(x)}' for x in values)}>"

    def everywhere(self, value: int) -> str:
        """A whole number in every lane."""
        return f"<{', '.join([f'{INT} {value}'] * self.width)}>"

    def as_bits(self, x: str) -> str:
        """The bits of numbers as whole numbers."""
        return self.emit(f"bitcast {self.kind} {x} to {self.bits}")

    def from_bits(self, x: str) -> str:
        """The numbers with these bits."""
        return self.emit(f"bitcast {self.bits} {x} to {self.kind}")

    def select(self, test: str, x: str, y: str, yes: str, no: str) -> str:
        """`yes` where x < y, x > y or x == y, and neither is NaN."""
        truth = self.emit(f"fcmp {COMPARISONS[test]} {self.kind} {x}, {y}")
        return self.emit(f"select <{self.width} x i1> {truth}, {self.kind} {yes}, {self.kind} {no}")

    def add(self, x: str, y: str) -> str:
        return self.real("fadd", x, y)

    def sub(self, x: str, y: str) -> str:
        return self.real("fsub", x, y)

    def mul(self, x: str, y: str) -> str:
        return self.real("fmul", x, y)

    def divide(self, x: str, y: str) -> str:
        return self.real("fdiv", x, y)

    def polynomial(self, coefficients: Sequence[float], x: str) -> str:
        """A polynomial in Estrin's order: short chains of operations."""
        terms = [self.constant(c) for c in coefficients]
        while len(terms) > 1:
            pairs = [self.add(low, self.mul(high, x)) for low, high in zip(terms[::2], terms[1::2], strict=False)]
            terms = pairs + terms[len(pairs) * 2 :]
            x = self.mul(x, x) if len(terms) > 1 else x
        return terms[0]

    def exp(self, x: str) -> str:
        """exp(x) within an ulp; infinite where it overflows, 0 below the smallest normal number, NaN of NaN."""
        argument, top, bottom = x, self.constant(LARGEST_EXP), self.constant(SMALLEST_EXP)
        x = self.select(">", x, top, top, x)
        x = self.select("<", x, bottom, bottom, x)
        shifted = self.add(self.mul(x, self.constant(1.0 / math.log(2.0))), self.constant(ROUND))
        n = self.sub(shifted, self.constant(ROUND))
        r = self.sub(self.sub(x, self.mul(n, self.constant(LN2_HIGH))), self.mul(n, self.constant(LN2_LOW)))
        exponent = self.whole("shl", self.as_bits(shifted), self.everywhere(EXPONENT))
        tail = self.add(r, self.mul(self.mul(r, r), self.polynomial(EXP_SERIES[2:], r)))
        bits = self.as_bits(self.add(self.constant(1.0), tail))
        value = self.from_bits(self.whole("add", bits, exponent))
        value = self.select(">", argument, top, self.constant(math.inf), value)
        return self.select("<", argument, bottom, self.constant(0.0), value)

    def log(self, x: str) -> str:
        """log(x) within an ulp; as numpy's: -infinity at 0, infinity at infinity, NaN where x is negative or NaN."""
        argument, least = x, self.constant(SMALLEST)
        x = self.select("<", x, least, self.mul(x, self.constant(2.0**54)), x)  # subnormal numbers
        bits, shift = self.as_bits(x), self.everywhere(EXPONENT)
        e = self.whole("ashr", self.whole("sub", bits, self.everywhere(_bits(math.sqrt(0.5)))), shift)
        mantissa = self.whole("sub", bits, self.whole("shl", e, shift))
        f = self.sub(self.from_bits(mantissa), self.constant(1.0))
        whole = self.from_bits(self.whole("add", e, self.everywhere(_bits(ROUND))))
        n = self.sub(whole, self.select("<", argument, least, self.constant(ROUND + 54.0), self.constant(ROUND)))
        s = self.divide(f, self.add(self.constant(2.0), f))
        z = self.mul(s, s)
        half_square = self.mul(self.constant(0.5), self.mul(f, f))
        tail = self.mul(s, self.add(half_square, self.mul(z, self.polynomial(LOG_SERIES, z))))
        tail = self.sub(half_square, self.add(tail, self.mul(n, self.constant(LN2_LOW))))
        value = self.sub(self.mul(n, self.constant(LN2_HIGH)), self.sub(tail, f))
        of_rest = self.select("==", x, self.constant(0.0), self.constant(-math.inf), self.constant(math.nan))
        value = self.select(">", x, self.constant(0.0), value, of_rest)
        return self.select("==", x, self.constant(math.inf), x, value)


def _bits(x: float) -> int:
    return int(struct.unpack("<q", struct.pack("<d", x))[0])
