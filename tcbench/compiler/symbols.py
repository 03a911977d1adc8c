"""Symbols record what numpy does to them: formulas become graphs.

A formula written in plain numpy is run once on object arrays of `Symbol`. Every operation returns a new
symbol; equal expressions are one object (so nothing is computed twice), and the order of floating-point
operations is the author's, except for rewritings that lose no digits: (a + b) - a is b, x / y is x * (1/y). They keep
the domain: exp(log x) is x, and x y / y is x, for positive numbers only. They do not keep what is not finite: 0 x and
x - x are 0, so that terms that are switched off cost nothing.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterable
from functools import reduce
from numbers import Real
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..errors import TraceError
from . import ops
from .choices import Choosing
from .interned import INTERNED
from .interned import expressions as expressions
from .interned import in_trace as in_trace
from .interned import tracing as tracing
from .ops import TINY
from .trace_errors import refused, where_in_user_code

T = TypeVar("T")
Other = TypeVar("Other")
Number: TypeAlias = "Symbol | float | np.floating[Any] | np.integer[Any]"


# exponents, and half exponents, up to which powers are products by squaring
MOST_WHOLE, MOST_HALVES = 1024, 64
TAKE = "Take it along a table first: x[self.table], self.table.sums(x)"
_COUNTER = iter(range(sys.maxsize))


def _is_positive(op: str, args: tuple[Symbol, ...], value: Any) -> bool:
    if op == "const":
        return bool(value > 0)
    row = ops.OPERATIONS.get(op)
    return row is not None and row.positive >= 0 and all(a.positive for a in args[: row.positive])


def positive(values: Iterable[Any]) -> None:
    """Declare that these symbols are positive numbers, such as temperatures and masses."""
    for x in values:
        if isinstance(x, Symbol):
            x.positive = True


def operators(
    lifted: Callable[[T, Other], T], operation: Callable[[T, T], T]
) -> tuple[Callable[[T, Other], T], Callable[[T, Other], T]]:
    """The methods for x + y and y + x, say, of a class. lifted(x, y) : y as one of it; NotImplemented for arrays."""

    def forward(self: T, other: Other) -> T:
        y = lifted(self, other)
        return y if y is NotImplemented else operation(self, y)

    def backward(self: T, other: Other) -> T:
        y = lifted(self, other)
        return y if y is NotImplemented else operation(y, self)

    return forward, backward


def _lifted(_: Symbol, other: Number) -> Symbol:
    symbol: Symbol = NotImplemented
    if isinstance(other, Symbol):
        symbol = other
    elif isinstance(other, int | float | np.floating | np.integer):
        symbol = const(float(other))
    return symbol


class Symbol(Choosing):
    """One value of the expression graph; behaves as a number in numpy object arrays."""

    __slots__ = ("__weakref__", "args", "number", "op", "positive", "space", "truth", "value")
    positive: bool  # declared so, or made of positive symbols so that it is
    truth: bool  # a comparison, or several joined
    space: str  # whose entries it stands for, see `arrays`; "" of a number

    def __init__(self, op: str, args: tuple[Symbol, ...], value: Any) -> None:
        self.op, self.args, self.value = op, args, value
        self.number = next(_COUNTER)  # order of creation: a topological order
        self.space, self.truth = "", False
        self.positive = _is_positive(op, args, value)

    def __repr__(self) -> str:
        return f"{self.op}#{self.number}" if self.value is None else f"{self.op}:{self.value}"

    # the arithmetic itself is below
    __add__, __radd__ = operators(_lifted, lambda a, b: add(a, b))
    __sub__, __rsub__ = operators(_lifted, lambda a, b: sub(a, b))
    __mul__, __rmul__ = operators(_lifted, lambda a, b: mul(a, b))
    __truediv__, __rtruediv__ = operators(_lifted, lambda a, b: mul(a, reciprocal(b)))
    __pow__, __rpow__ = operators(_lifted, lambda a, b: power(a, b))

    def __neg__(self) -> Symbol:
        return neg(self)

    def __pos__(self) -> Symbol:
        return self

    def __abs__(self) -> Symbol:
        return make("abs", self)

    def __bool__(self) -> bool:
        raise refused("a branch on the value of a symbol (if, while, and, max, min, ==)")

    def _compare(self, other: object) -> Any:
        raise refused("symbols are asked whether they are equal: np.where takes x > y and x < y")

    def _rounded(self, *_: object) -> Any:
        raise refused("a whole number made of a symbol (//, %, round)")

    __floordiv__ = __rfloordiv__ = __mod__ = __rmod__ = __divmod__ = __rdivmod__ = __round__ = __trunc__ = _rounded

    __eq__ = __ne__ = _compare

    def __hash__(self) -> int:
        return self.number  # unique: a dict never needs __eq__

    def __float__(self) -> float:
        raise refused(
            "a symbol cannot become a float (a call into math, SciPy or numpy.linalg? an array without dtype=object?)"
        )

    __int__ = __index__ = __float__

    def __getattr__(self, name: str) -> Callable[..., Symbol]:
        """The methods that numpy's functions call on objects."""
        row = ops.by_numpy(name)
        if row is None:
            raise AttributeError(f"a symbol has no {name!r}")
        return lambda *others: make(row.name, self, *others)

    @staticmethod
    def make(op: str, *args: Number) -> Symbol:
        """An operation on symbols and numbers: see `ops`."""
        return make(op, *args)

    def conjugate(self) -> Symbol:  # for numpy's vdot and norms
        return self


def intern(op: str, args: tuple[Symbol, ...], value: Any = None, space: str | None = None) -> Symbol:
    """The node of this operation. space : of its value, by default that of its arguments."""
    key = (op, tuple(a.number for a in args), value)
    table = INTERNED.table
    node = table.get(key)
    if node is None:
        if space is None:
            space = ""
            for a in args:
                if a.space != space and a.space:
                    if space:
                        raise refused(f"an array of {space}s meets one of {a.space}s", TAKE)
                    space = a.space
        node = table[key] = Symbol(op, args, value)
        node.space = space
    return node


def const(value: float) -> Symbol:
    if math.isnan(value):
        raise TraceError(f"{where_in_user_code()}: the formula contains NaN.")
    return intern("const", (), float(value) + 0.0)  # -0.0 and 0.0 are one constant


def lifted(value: Any) -> Symbol:
    """The value as a symbol: numbers become constants."""
    return value if isinstance(value, Symbol) else const(float(value))


def as_symbol(value: Any) -> Any:
    """The value of a formula with numbers as symbols: they are constants where it does not read the state."""
    if type(value) is np.ndarray:
        return np.frompyfunc(as_symbol, 1, 1)(value) if value.size else value
    return const(float(value)) if isinstance(value, Real) else value


def variable(name: str) -> Symbol:
    """A new input; two variables are never the same symbol."""
    return Symbol("var", (), name)


def variables(name: str, size: int) -> NDArray[np.object_]:
    """An object array of new inputs, shape (size,)."""
    return array(variable(f"{name}{i}") for i in range(size))


def array(items: Iterable[Any]) -> NDArray[np.object_]:
    """An object array of these items, shape (count,); `np.array` would convert items that are arrays."""
    return np.fromiter(items, dtype=object)


def is_const(node: Symbol, value: float | None = None) -> bool:
    return node.op == "const" and (value is None or node.value == value)


def make(op: str, *args: Any) -> Symbol:
    """An elementary function of these arguments; of constants its value."""
    row, x = ops.OPERATIONS.get(op), tuple(map(lifted, args))
    if row is not None and row.value is not None and all(map(is_const, x)):
        with np.errstate(all="ignore"):
            return const(row.value(*(a.value for a in x)))
    if op == "exp" and x[0].op == "log" and x[0].args[0].positive:
        return x[0].args[0]
    return intern(op, x)


def add(a: Symbol, b: Symbol) -> Symbol:
    if is_const(a) and is_const(b):
        return const(a.value + b.value)
    if is_const(a, 0.0):
        return b
    if is_const(b, 0.0):
        return a
    if b.op == "neg":
        return sub(a, b.args[0])
    if a.op == "neg":
        return sub(b, a.args[0])
    for x, y in ((a, b), (b, a)):  # x + (x + d) is 2x + d: midpoints keep the digits of increments
        rest = _without(y, x)
        if rest is not None:
            return add(mul(const(2.0), x), rest)
    return intern("add", (a, b) if a.number <= b.number else (b, a))


def _without(total: Symbol, part: Symbol) -> Symbol | None:
    """The other term when `total` is a sum with the term `part`."""
    first, second = total.args if total.op == "add" else (None, None)
    return second if first is part else first if second is part else None


def sub(a: Symbol, b: Symbol) -> Symbol:
    if is_const(a) and is_const(b):
        return const(a.value - b.value)
    if is_const(b, 0.0):
        return a
    if is_const(a, 0.0):
        return neg(b)
    if a is b:
        return const(0.0)
    increment = _without(a, b)
    if increment is not None:  # (b + d) - b is d: increments keep their digits
        return increment
    increment = _without(b, a)
    if increment is not None:
        return neg(increment)
    if b.op == "neg":
        return add(a, b.args[0])
    if a.op == "neg":
        return neg(add(a.args[0], b))
    if a.number > b.number and ("sub", (b.number, a.number), None) in INTERNED.table:
        return neg(intern("sub", (b, a)))  # a - b and b - a are one node
    return intern("sub", (a, b))


def neg(a: Symbol) -> Symbol:
    if is_const(a):
        return const(-a.value)
    if a.op == "neg":
        return a.args[0]
    return intern("neg", (a,))


def mul(a: Symbol, b: Symbol) -> Symbol:
    if is_const(a) and is_const(b):
        return const(a.value * b.value)
    if is_const(b):
        a, b = b, a
    if is_const(a):
        if a.value == 0.0:
            return a
        if a.value == 1.0:
            return b
        if a.value == -1.0:
            return neg(b)
        if b.op == "mul" and is_const(b.args[0]) and _is_normal(a.value * b.args[0].value):
            return mul(const(a.value * b.args[0].value), b.args[1])
        if b.op == "add" and b.args[0] is b.args[1] and _is_normal(2.0 * a.value):  # c (x + x) is (2c) x, exactly
            return mul(const(2.0 * a.value), b.args[0])
        halved = _halve_midpoint(a, b)
        if halved is not None:
            return halved
        if b.op == "neg":
            return mul(const(-a.value), b.args[0])
        return intern("mul", (a, b))
    if a.op == "neg":
        return neg(mul(a.args[0], b))
    if b.op == "neg":
        return neg(mul(a, b.args[0]))
    for x, y in ((a, b), (b, a)):
        if y.op == "recip" and y.args[0].positive:  # (r x) / r; of r = 0 it is 0/0
            divisor = y.args[0]
            if divisor is x:
                return const(1.0)
            if x.op == "mul" and (x.args[0] is divisor or x.args[1] is divisor):
                return x.args[1] if x.args[0] is divisor else x.args[0]
    return intern("mul", (a, b) if a.number <= b.number else (b, a))


def _is_normal(value: float) -> bool:
    """Does a product of two constants, none of them 0, have all its digits?"""
    return sys.float_info.min <= abs(value) < math.inf


def _halve_midpoint(a: Symbol, b: Symbol) -> Symbol | None:
    """(2z + d)/2 is z + d/2, exactly: powers of two do not round."""
    if a.value == 0.5 and b.op == "add":
        for two_z, d in (b.args, b.args[::-1]):
            if two_z.op == "mul" and is_const(two_z.args[0], 2.0):
                return add(two_z.args[1], mul(a, d))
    return None


def reciprocal(a: Symbol) -> Symbol:
    if is_const(a):
        if a.value == 0.0:
            raise refused("division by the constant zero")
        return const(1.0 / a.value)
    if a.op == "mul" and _is_power(a):  # whose end is what is left of its start: nothing, if that is many times larger
        return mul(reciprocal(a.args[0]), reciprocal(a.args[1]))
    if a.op == "recip":
        return a.args[0]
    return intern("recip", (a,))


def _is_power(product: Symbol) -> bool:
    """Are all factors of the product one symbol?"""
    factors, bases = [product], set[int]()
    while factors and len(bases) < 2:
        x = factors.pop()
        if x.op == "mul":
            factors += x.args if x.args[0] is not x.args[1] else x.args[:1]
        else:
            bases.add(x.number)
    return len(bases) == 1


def power(base: Symbol, exponent: Any) -> Symbol:
    """base ** exponent: integers up to 1024 by products, for any base; half-integers up to 32 by a root; others of a
    product with an exponential in it by one exponential: (exp(s) / v)^c is exp(c (s - log v))."""
    exponent = lifted(exponent)
    wanted = exponent.value if is_const(exponent) else math.inf
    if wanted > 0 and 2 * wanted <= MOST_HALVES and wanted % 1 == 0.5:
        shifted = add(base, const(TINY)) if wanted > 1 and not base.positive else base  # x^1.5 has a slope at 0
        return mul(make("sqrt", shifted), power(base, wanted - 0.5))
    if not abs(wanted) <= MOST_WHOLE or wanted != int(wanted):
        logarithm = _logarithm(base) if math.isfinite(wanted) and wanted % 1 else None  # of a root the base is positive
        return make("pow", base, exponent) if logarithm is None else mul(exponent, logarithm).exp()
    result, square, n = const(1.0), base if wanted >= 0 else reciprocal(base), abs(int(wanted))
    while n:
        if n & 1:
            result = mul(result, square)
        square, n = mul(square, square), n >> 1
    return result


def _logarithm(product: Symbol) -> Symbol | None:
    """The logarithm of a product with exponentials in it, without these; None of other products."""
    factors, exponents, rest = [product], list[Symbol](), list[Symbol]()
    while factors:
        x = factors.pop()
        if x.op == "mul":
            factors += x.args
        else:
            (exponents if x.op == "exp" else rest).append(x)
    if not exponents:
        return None
    exponent: Symbol = reduce(add, (x.args[0] for x in exponents))
    if not rest:
        return exponent
    whole: Symbol = reduce(mul, rest)
    logarithm: Symbol = -whole.args[0].log() if whole.op == "recip" else whole.log()
    return add(exponent, logarithm)
