"""Formulas become graphs: symbols that record what numpy does to them, and their exact derivatives.

A formula written in plain numpy is run once on object arrays of `Symbol`. Every operation returns a new
symbol; equal expressions are one object (so nothing is computed twice), and the order of floating-point
operations is the author's, except for rewritings that lose no digits: (a + b) - a is b, x / y is x * (1/y).
"""

from __future__ import annotations

import math
import sys
import weakref
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import TraceError

_INTERN: weakref.WeakValueDictionary[tuple, Symbol] = weakref.WeakValueDictionary()
_COUNTER = iter(range(sys.maxsize))
_REMEDY = (
    "Formulas must be branch-free numpy (arithmetic, sqrt, exp, log, expm1, log1p, sin, cos, tanh, @); "
    "for anything else register the method with step= (a plain Python function) instead of flows="
)


def _where_in_user_code() -> str:
    """File and line of the innermost frame outside tcbench and numpy."""
    frame = sys._getframe(1)
    while frame is not None:
        module = frame.f_globals.get("__name__", "")
        if not module.startswith(("tcbench.", "numpy")) or module.startswith("tcbench.pendulum"):
            return f"{frame.f_code.co_filename}, line {frame.f_lineno}"
        frame = frame.f_back  # type: ignore[assignment]
    return "the formula"


def _refuse(what: str) -> TraceError:
    return TraceError(f"{_where_in_user_code()}: {what}. {_REMEDY}.")


class Symbol:
    """One value of the expression graph; behaves as a number in numpy object arrays."""

    __slots__ = ("op", "args", "value", "number", "__weakref__")

    def __init__(self, op: str, args: tuple[Symbol, ...], value: Any) -> None:
        self.op, self.args, self.value = op, args, value
        self.number = next(_COUNTER)  # order of creation: a topological order

    def __repr__(self) -> str:
        return f"{self.op}#{self.number}" if self.value is None else f"{self.op}:{self.value}"

    def __add__(self, other: Any) -> Any:
        return _lift(other, lambda o: add(self, o))

    def __radd__(self, other: Any) -> Any:
        return _lift(other, lambda o: add(o, self))

    def __sub__(self, other: Any) -> Any:
        return _lift(other, lambda o: sub(self, o))

    def __rsub__(self, other: Any) -> Any:
        return _lift(other, lambda o: sub(o, self))

    def __mul__(self, other: Any) -> Any:
        return _lift(other, lambda o: mul(self, o))

    def __rmul__(self, other: Any) -> Any:
        return _lift(other, lambda o: mul(o, self))

    def __truediv__(self, other: Any) -> Any:
        return _lift(other, lambda o: mul(self, reciprocal(o)))

    def __rtruediv__(self, other: Any) -> Any:
        return _lift(other, lambda o: mul(o, reciprocal(self)))

    def __neg__(self) -> Symbol:
        return neg(self)

    def __pos__(self) -> Symbol:
        return self

    def __abs__(self) -> Symbol:
        return _make("abs", self)

    def __pow__(self, exponent: Any) -> Symbol:
        return power(self, exponent)

    def __bool__(self) -> bool:
        raise _refuse("a branch on the value of a symbol (if, while, and, max, min, ==)")

    def _compare(self, other: object) -> Any:
        raise _refuse("a comparison of symbols")

    __lt__ = __le__ = __gt__ = __ge__ = __eq__ = __ne__ = _compare

    def __hash__(self) -> int:
        return self.number  # unique: a dict never needs __eq__

    def __float__(self) -> float:
        raise _refuse("a symbol cannot become a float (a call into math, SciPy or numpy.linalg?)")

    __int__ = __index__ = __float__  # type: ignore[assignment]

    def sqrt(self) -> Symbol:
        return _make("sqrt", self)

    def exp(self) -> Symbol:
        return _make("exp", self)

    def log(self) -> Symbol:
        return _make("log", self)

    def expm1(self) -> Symbol:
        return _make("expm1", self)

    def log1p(self) -> Symbol:
        return _make("log1p", self)

    def sin(self) -> Symbol:
        return _make("sin", self)

    def cos(self) -> Symbol:
        return _make("cos", self)

    def tanh(self) -> Symbol:
        return _make("tanh", self)

    def conjugate(self) -> Symbol:  # numpy's vdot and norms ask for it
        return self


def _lift(other: Any, operation: Any) -> Any:
    """Apply `operation` when `other` is a number or symbol; let arrays and other classes take over."""
    if isinstance(other, Symbol):
        return operation(other)
    if isinstance(other, int | float | np.floating | np.integer):
        return operation(const(float(other)))
    return NotImplemented


def _intern(op: str, args: tuple[Symbol, ...], value: Any = None) -> Symbol:
    key = (op, tuple(a.number for a in args), value)
    node = _INTERN.get(key)
    if node is None:
        node = _INTERN[key] = Symbol(op, args, value)
    return node


def const(value: float) -> Symbol:
    return _intern("const", (), float(value) + 0.0)  # -0.0 and 0.0 are one constant


def variable(name: str) -> Symbol:
    """A fresh input; two variables are never the same symbol."""
    return Symbol("var", (), name)


def variables(name: str, size: int) -> NDArray[np.object_]:
    """Object array, shape (size,), of fresh inputs."""
    return np.array([variable(f"{name}{i}") for i in range(size)] + [None], dtype=object)[:-1]


def is_const(node: Symbol, value: float | None = None) -> bool:
    return node.op == "const" and (value is None or node.value == value)


_FOLD = {
    "sqrt": math.sqrt,
    "exp": math.exp,
    "log": math.log,
    "expm1": math.expm1,
    "log1p": math.log1p,
    "sin": math.sin,
    "cos": math.cos,
    "tanh": math.tanh,
    "abs": abs,
}


def _make(op: str, x: Symbol) -> Symbol:
    if is_const(x) and op in _FOLD:
        return const(_FOLD[op](x.value))
    if op == "exp" and x.op == "log":
        return x.args[0]
    return _intern(op, (x,))


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
    return _intern("add", (a, b) if a.number <= b.number else (b, a))


def _without(total: Symbol, part: Symbol) -> Symbol | None:
    """The other term when `total` is a sum with the term `part`."""
    if total.op == "add":
        first, second = total.args
        if first is part:
            return second
        if second is part:
            return first
    return None


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
    if b.op == "neg":
        return add(a, b.args[0])
    if a.op == "neg":
        return neg(add(a.args[0], b))
    if a.number > b.number and ("sub", (b.number, a.number), None) in _INTERN:
        return neg(_intern("sub", (b, a)))  # a - b and b - a are one node
    return _intern("sub", (a, b))


def neg(a: Symbol) -> Symbol:
    if is_const(a):
        return const(-a.value)
    if a.op == "neg":
        return a.args[0]
    return _intern("neg", (a,))


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
        if b.op == "mul" and is_const(b.args[0]):
            return mul(const(a.value * b.args[0].value), b.args[1])
        halved = _halve_midpoint(a, b)
        if halved is not None:
            return halved
        if b.op == "neg":
            return mul(const(-a.value), b.args[0])
        return _intern("mul", (a, b))
    if a.op == "neg":
        return neg(mul(a.args[0], b))
    if b.op == "neg":
        return neg(mul(a, b.args[0]))
    for x, y in ((a, b), (b, a)):
        if y.op == "recip":  # (r x) / r
            divisor = y.args[0]
            if divisor is x:
                return const(1.0)
            if x.op == "mul" and (x.args[0] is divisor or x.args[1] is divisor):
                return x.args[1] if x.args[0] is divisor else x.args[0]
    return _intern("mul", (a, b) if a.number <= b.number else (b, a))


def _halve_midpoint(a: Symbol, b: Symbol) -> Symbol | None:
    """(2z + d)/2 is z + d/2, exactly: powers of two do not round."""
    if a.value == 0.5 and b.op == "add":
        for two_z, d in (b.args, b.args[::-1]):
            if two_z.op == "mul" and is_const(two_z.args[0], 2.0):
                return add(two_z.args[1], mul(a, d))
    return None


def maximum(a: Symbol, b: Symbol) -> Symbol:
    """max(a, b); has no derivative, and drops a NaN: `guarded` keeps it."""
    return _intern("max", (a, b))


def minimum(a: Symbol, b: Symbol) -> Symbol:
    """min(a, b); as `maximum`."""
    return _intern("min", (a, b))


def guarded(value: Symbol, terms: Iterable[Symbol]) -> Symbol:
    """The value, or NaN if any of the terms is not finite."""
    total = const(0.0)
    for term in terms:
        total = add(total, term)
    return _intern("guard", (value, total))


def reciprocal(a: Symbol) -> Symbol:
    if is_const(a):
        if a.value == 0.0:
            raise _refuse("division by the constant zero")
        return const(1.0 / a.value)
    if a.op == "recip":
        return a.args[0]
    return _intern("recip", (a,))


def power(base: Symbol, exponent: Any) -> Symbol:
    if isinstance(exponent, Symbol):
        if not is_const(exponent):
            return (exponent * base.log()).exp()
        exponent = exponent.value
    exponent = float(exponent)
    if exponent < 0:
        return reciprocal(power(base, -exponent))
    if exponent == 0.5:
        return base.sqrt()
    if exponent == int(exponent) and exponent <= 64:
        result, square, n = const(1.0), base, int(exponent)
        while n:
            if n & 1:
                result = mul(result, square)
            square, n = mul(square, square), n >> 1
        return result
    return mul(const(exponent), base.log()).exp()


def phi(x: Symbol) -> Symbol:
    """expm1(x)/x, 1 at 0: the divided difference of exp, dimensionless."""
    return const(1.0) if is_const(x, 0.0) else _intern("phi", (x,))


def lam(x: Symbol) -> Symbol:
    """log1p(x)/x, 1 at 0: the divided difference of log, dimensionless."""
    return const(1.0) if is_const(x, 0.0) else _intern("lam", (x,))


def mark(x: Symbol) -> Symbol:
    """The same value, as an intermediate through which derivatives are accumulated (it saves operations, e.g. when
    everything in an element depends on all positions through one strain measure)."""
    return x if x.op in ("const", "var", "mark") else _intern("mark", (x,))


def _partials(node: Symbol) -> tuple[Symbol, ...]:
    """Derivative of a node by each of its arguments."""
    op, args = node.op, node.args
    one = const(1.0)
    if op == "add":
        return one, one
    if op == "sub":
        return one, const(-1.0)
    if op == "mul":
        return args[1], args[0]
    x = args[0]
    match op:
        case "neg":
            return (const(-1.0),)
        case "recip":
            return (neg(mul(node, node)),)
        case "sqrt":
            return (mul(const(0.5), reciprocal(node)),)
        case "exp":
            return (node,)
        case "log":
            return (reciprocal(x),)
        case "expm1":
            return (add(node, one),)
        case "log1p":
            return (reciprocal(add(x, one)),)
        case "sin":
            return (x.cos(),)
        case "cos":
            return (neg(x.sin()),)
        case "tanh":
            return (sub(one, mul(node, node)),)
        case "phi":
            return (_intern("dphi", (x,)),)
        case "lam":
            return (_intern("dlam", (x,)),)
        case "abs":
            return (mul(x, reciprocal(node)),)
    raise TraceError(f"The operation {op!r} has no derivative here.")


def topological(outputs: Iterable[Symbol]) -> list[Symbol]:
    """Every node that the outputs need, arguments before users."""
    seen: dict[int, Symbol] = {}
    stack = list(outputs)
    while stack:
        node = stack.pop()
        if node.number not in seen:
            seen[node.number] = node
            stack.extend(node.args)
    return [seen[number] for number in sorted(seen)]


def jacobian(outputs: Sequence[Symbol], inputs: Sequence[Symbol]) -> NDArray[np.object_]:
    """Exact derivatives by forward accumulation; object array, shape (len(outputs), len(inputs)).

    Marked nodes are seeds of their own; at the end they are expanded, the last one first.
    """
    zero, one = const(0.0), const(1.0)
    columns = {x.number: j for j, x in enumerate(inputs)}
    tangents: dict[int, dict[int, Symbol]] = {number: {number: one} for number in columns}
    seeds: dict[int, dict[int, Symbol]] = {}  # marked node -> its own tangent
    for node in topological(outputs):
        if node.number in tangents or not any(tangents.get(a.number) for a in node.args):
            continue
        if node.op == "mark":
            seeds[node.number] = tangents[node.args[0].number]
            tangents[node.number] = {node.number: one}
            continue
        tangent: dict[int, Symbol] = {}
        for argument, partial in zip(node.args, _partials(node), strict=True):
            _accumulate(tangent, partial, tangents.get(argument.number, {}))
        tangents[node.number] = tangent
    result = np.full((len(outputs), len(inputs)), zero, dtype=object)
    for i, node in enumerate(outputs):
        tangent = dict(tangents.get(node.number, {}))
        while pending := [number for number in tangent if number in seeds]:
            number = max(pending)
            _accumulate(tangent, tangent.pop(number), seeds[number])
        for number, t in tangent.items():
            result[i, columns[number]] = t
    return result


def _accumulate(tangent: dict[int, Symbol], factor: Symbol, inner: Mapping[int, Symbol]) -> None:
    """tangent += factor * inner."""
    for number, t in inner.items():
        term = mul(factor, t)
        tangent[number] = add(tangent[number], term) if number in tangent else term


def substitute(outputs: Sequence[Symbol], replacement: Mapping[Symbol, Symbol]) -> list[Symbol]:
    """The outputs with some nodes replaced, simplified again on the way."""
    new: dict[int, Symbol] = {node.number: by for node, by in replacement.items()}
    for node in topological(outputs):
        if node.number not in new:
            args = tuple(new[a.number] for a in node.args)
            changed = any(a is not b for a, b in zip(args, node.args, strict=True))
            new[node.number] = rebuild(node.op, args) if changed else node
    return [new[node.number] for node in outputs]


def rebuild(op: str, args: tuple[Symbol, ...]) -> Symbol:
    """The node `op(*args)` through the simplifying constructors."""
    constructors: dict[str, Any] = {
        "add": add, "sub": sub, "mul": mul, "neg": neg, "recip": reciprocal, "phi": phi, "lam": lam,
        "mark": mark, "max": maximum, "min": minimum,
    }  # fmt: skip
    if op == "guard":
        return _intern(op, args)
    return constructors[op](*args) if op in constructors else _make(op, *args)


def depends_on(outputs: Iterable[Symbol], inputs: Iterable[Symbol]) -> set[int]:
    """Numbers of the nodes under `outputs` that depend on any of `inputs`."""
    result = {x.number for x in inputs}
    for node in topological(outputs):
        if any(a.number in result for a in node.args):
            result.add(node.number)
    return result
