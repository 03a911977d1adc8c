"""What can be done with a traced formula: exact derivatives, substitution, order of evaluation.

`symbols` has the nodes and the constructors, which are named here too: `trace.variable`, `trace.jacobian`, ...
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import TraceError
from . import arrays
from .language import NUMPY_NAMES
from .sentences import refused
from .symbols import (
    TINY,
    Symbol,
    add,
    array,
    as_symbol,
    const,
    intern,
    is_const,
    lifted,
    make,
    mul,
    neg,
    positive,
    power,
    reciprocal,
    sub,
    tracing,
    variable,
    variables,
)

# operations that numpy lacks --------------------------------------------------------------------------------------


def maximum(a: Symbol, b: Symbol) -> Symbol:
    """max(a, b); has no derivative, and drops a NaN: `guarded` keeps it."""
    return intern("max", (a, b))


def minimum(a: Symbol, b: Symbol) -> Symbol:
    """min(a, b); as `maximum`."""
    return intern("min", (a, b))


def guarded(value: Symbol, terms: Iterable[Symbol]) -> Symbol:
    """The value, or NaN if any of the terms is not finite."""
    total = const(0.0)
    for term in terms:
        total = add(total, term)
    return intern("guard", (value, total))


def phi(x: Symbol) -> Symbol:
    """expm1(x)/x, 1 at 0: the divided difference of exp, dimensionless."""
    return const(1.0) if is_const(x, 0.0) else intern("phi", (x,))


def lam(x: Symbol) -> Symbol:
    """log1p(x)/x, 1 at 0: the divided difference of log, dimensionless."""
    return const(1.0) if is_const(x, 0.0) else intern("lam", (x,))


def sinc(x: Symbol) -> Symbol:
    """sin(x)/x, 1 at 0: what the divided differences of sin and cos are made of."""
    return const(1.0) if is_const(x, 0.0) else intern("sinc", (x,))


def mark(x: Symbol) -> Symbol:
    """The same value, as an intermediate through which derivatives are accumulated (it saves operations, e.g. when
    everything in an element depends on all positions through one strain measure)."""
    return x if x.op in ("const", "var", "mark") else intern("mark", (x,))


# derivatives ----------------------------------------------------------------------------------------------------------


def partials(node: Symbol) -> tuple[Symbol, ...]:
    """Derivative of a node by each of its arguments."""
    op, args = node.op, node.args
    if op == "mul":
        return args[1], args[0]
    if op in LINEAR:
        return tuple(map(const, LINEAR[op]))
    if op in SLOPES:
        return (SLOPES[op](node, args[0]),)
    if op in SLOPES_OF_TWO:
        return SLOPES_OF_TWO[op](node, *args)
    raise refused(f"the operation {op!r} has no derivative here")


def one() -> Symbol:
    return const(1.0)  # of this trace


def _of_power(node: Symbol, base: Symbol, exponent: Symbol) -> tuple[Symbol, Symbol]:
    if is_const(exponent) and exponent.value > 1.0:  # the slope is finite at 0
        by_base = mul(exponent, power(base, sub(exponent, one())))
    elif base.positive or (is_const(exponent) and exponent.value < 0.0):
        by_base = mul(mul(exponent, node), reciprocal(base))
    elif is_const(exponent):
        by_base = mul(mul(exponent, add(node, const(TINY))), reciprocal(add(base, const(TINIER))))
    else:  # of 0, 1, 2, ... or none: at 0 the slope may be any
        by_base = mul(exponent, make("pow", add(base, const(TINIER)), sub(exponent, one())))
    return by_base, const(0.0) if is_const(exponent) else mul(node, make("log", base))


def _of_angle(node: Symbol, y: Symbol, x: Symbol) -> tuple[Symbol, Symbol]:
    inverse = reciprocal(add(mul(x, x), mul(y, y)))
    return mul(x, inverse), neg(mul(y, inverse))


def _of_atan_slope(node: Symbol, a: Symbol, d: Symbol) -> tuple[Symbol, Symbol]:
    """d/da of (atan(a + d) - atan(a))/d is -(a + b)/((1 + a^2)(1 + b^2)), b = a + d."""
    b = add(a, d)
    below = mul(add(one(), mul(a, a)), add(one(), mul(b, b)))
    return neg(mul(add(a, b), reciprocal(below))), make("atan_bend", a, d)


def _of_tanh_slope(node: Symbol, a: Symbol, d: Symbol) -> tuple[Symbol, Symbol]:
    top = make("tanh", add(a, d))
    return neg(mul(node, add(make("tanh", a), top))), mul(node, sub(make("langevin", d), top))


def _of_abs_slope(node: Symbol, a: Symbol, d: Symbol) -> tuple[Symbol, Symbol]:
    """Of (a + b)/(|a| + |b|), b = a + d."""
    b = add(a, d)
    size = add(make("abs", a), make("abs", b))
    below = reciprocal(add(mul(size, size), const(TINY)))
    by_a, by_b = (mul(sub(size, mul(add(a, b), make("abs_slope", x, const(0.0)))), below) for x in (a, b))
    return add(by_a, by_b), by_b


def _of_slope(node: Symbol, order: Symbol, x: Symbol) -> tuple[Symbol, Symbol]:
    return const(0.0), make(node.op, add(order, one()), x)


# An infinite slope is one of 1e180 or more, so that 0 times it, as in v sqrt(|v|) at rest, is 0; whoever squares it, or
# asks whether it is as large (INFINITE), has an infinite one.
TINIER, INFINITE = 1e-240, 1e150
LINEAR = {"add": (1.0, 1.0), "sub": (1.0, -1.0), "neg": (-1.0,)}
SLOPES: dict[str, Callable[[Symbol, Symbol], Symbol]] = {  # of a function of x whose value is the node y
    "recip": lambda y, x: neg(mul(y, y)),
    "sqrt": lambda y, x: mul(const(0.5), reciprocal(y if x.positive else add(y, const(TINIER)))),
    "exp": lambda y, x: y,
    "log": lambda y, x: reciprocal(x),
    "expm1": lambda y, x: add(y, one()),
    "log1p": lambda y, x: reciprocal(add(x, one())),
    "sin": lambda y, x: make("cos", x),
    "cos": lambda y, x: neg(make("sin", x)),
    "tan": lambda y, x: add(one(), mul(y, y)),
    "sinh": lambda y, x: make("cosh", x),
    "cosh": lambda y, x: make("sinh", x),
    "tanh": lambda y, x: sub(one(), mul(y, y)),
    "asin": lambda y, x: reciprocal(make("sqrt", mul(sub(one(), x), add(one(), x)))),
    "acos": lambda y, x: neg(reciprocal(make("sqrt", mul(sub(one(), x), add(one(), x))))),
    "atan": lambda y, x: reciprocal(add(one(), mul(x, x))),
    "abs": lambda y, x: mul(x, reciprocal(add(y, const(TINY)))),  # at 0 the mean of those beside it
    "phi": lambda y, x: intern("dphi", (x,)),
    "lam": lambda y, x: intern("dlam", (x,)),
    "sinc": lambda y, x: intern("dsinc", (x,)),
    "dphi": lambda y, x: make("phi_slope", const(2.0), x),
    "dlam": lambda y, x: make("lam_slope", const(2.0), x),
    "dsinc": lambda y, x: make("sinc_slope", const(2.0), x),
}
SLOPES_OF_TWO: dict[str, Callable[[Symbol, Symbol, Symbol], tuple[Symbol, Symbol]]] = {
    "hypot": lambda y, a, b: (mul(a, r := reciprocal(add(y, const(TINIER)))), mul(b, r)),  # at 0 as of abs
    "pow": _of_power,
    "atan2": _of_angle,
    "atan_slope": _of_atan_slope,
    "tanh_slope": _of_tanh_slope,
    "abs_slope": _of_abs_slope,
    "phi_slope": _of_slope,
    "lam_slope": _of_slope,
    "sinc_slope": _of_slope,
}


def topological(outputs: Iterable[Symbol], given: Container[int] = ()) -> list[Symbol]:
    """Every node that the outputs need, arguments before users; without what stands beneath given ones (by number)."""
    seen: dict[int, Symbol] = {}
    stack = list(outputs)
    while stack:
        node = stack.pop()
        if node.number not in seen:
            seen[node.number] = node
            if node.number not in given:
                stack.extend(node.args)
    return [seen[number] for number in sorted(seen)]


def jacobian(outputs: Sequence[Symbol], inputs: Sequence[Symbol]) -> NDArray[np.object_]:
    """Exact derivatives; object array, shape (len(outputs), len(inputs))."""
    result = np.full((len(outputs), len(inputs)), const(0.0), dtype=object)
    for i, row in enumerate(sparse_jacobian(outputs, inputs)):
        for j, slope in row.items():
            result[i, j] = slope
    return result


def sparse_jacobian(outputs: Sequence[Symbol], inputs: Sequence[Symbol]) -> list[dict[int, Symbol]]:
    """Exact derivatives by forward accumulation: of each output a row, position of the input -> slope, zeros left out.

    Marked nodes are seeds of their own; at the end they are expanded, the last one first.
    """
    one = const(1.0)
    outputs = [lifted(x) for x in outputs]
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
        for argument, partial in zip(node.args, partials(node), strict=True):
            accumulate(tangent, partial, tangents.get(argument.number, {}))
        tangents[node.number] = tangent
    rows = []
    for node in outputs:
        tangent = dict(tangents.get(node.number, {}))
        while pending := [number for number in tangent if number in seeds]:
            number = max(pending)
            accumulate(tangent, tangent.pop(number), seeds[number])
        rows.append({columns[number]: t for number, t in tangent.items() if not is_const(t, 0.0)})
    return rows


def along(outputs: Sequence[Symbol], directions: Mapping[Symbol, Symbol]) -> list[Symbol]:
    """Derivatives of the outputs along the directions that some variables move in."""
    zero = const(0.0)
    tangent = {x.number: t for x, t in directions.items()}
    for node in topological(outputs):
        parts = [tangent.get(a.number, zero) for a in node.args]
        if node.number in tangent or all(is_const(t, 0.0) for t in parts):
            continue
        if node.op == "mark":
            tangent[node.number] = parts[0]
        elif node.op in arrays.LINEAR:
            if node.op == "total" and node.value[0] != "add":
                raise TraceError(arrays.NO_SLOPE)
            tangent[node.number] = arrays.rebuilt(node.op, parts, node.value)
        else:
            found = zero
            for part, partial in zip(parts, partials(node), strict=True):
                if not is_const(part, 0.0):
                    found = add(found, mul(partial, part))
            tangent[node.number] = found
    return [tangent.get(x.number, zero) for x in outputs]


def accumulate(tangent: dict[int, Symbol], factor: Symbol, inner: Mapping[int, Symbol]) -> None:
    """tangent += factor * inner."""
    for number, t in inner.items():
        term = mul(factor, t)
        tangent[number] = add(tangent[number], term) if number in tangent else term


def topological_beyond(outputs: Iterable[Symbol], known: Mapping[int, Any]) -> list[Symbol]:
    """The same without the known ones themselves."""
    return [node for node in topological(outputs, known) if node.number not in known]


class Substitution:
    """Nodes replaced in one formula after the other, simplified again on the way; work is done once."""

    def __init__(self, replacement: Mapping[Symbol, Symbol]) -> None:
        self.new: dict[int, Symbol] = {node.number: by for node, by in replacement.items()}

    def __call__(self, output: Symbol) -> Symbol:
        new = self.new
        for node in topological_beyond([output], new):
            args = tuple(new[a.number] for a in node.args)
            changed = any(a is not b for a, b in zip(args, node.args, strict=True))
            new[node.number] = rebuild(node.op, args, node.value) if changed else node
        return new[output.number]


def substitute(outputs: Sequence[Symbol], replacement: Mapping[Symbol, Symbol]) -> list[Symbol]:
    """The outputs with some nodes replaced, simplified again on the way."""
    changed = Substitution(replacement)
    for node in topological_beyond(outputs, changed.new):
        changed(node)
    return [changed(node) for node in outputs]


def rebuild(op: str, args: tuple[Any, ...], value: Any = None) -> Any:
    """The node `op(*args)` through the simplifying constructors; value: what it carries beside its arguments."""
    if value is not None:
        return arrays.rebuilt(op, args, value)
    constructors: dict[str, Any] = {
        "add": add, "sub": sub, "mul": mul, "neg": neg, "recip": reciprocal, "phi": phi, "lam": lam,
        "mark": mark, "max": maximum, "min": minimum, "pow": power, "sinc": sinc,
    }  # fmt: skip
    if not all(isinstance(x, Symbol) for x in args):  # complex numbers: by their own arithmetic
        unary = {"neg": operator.neg, "recip": lambda x: 1.0 / x, "mark": lambda x: x}
        binary = {"add": operator.add, "sub": operator.sub, "mul": operator.mul, "pow": operator.pow}
        chosen: Any = unary.get(op) or binary.get(op)
        if chosen is None:
            return operator.methodcaller(NUMPY_NAMES.get(op, op), *args[1:])(args[0])
        return chosen(*args)
    if op == "guard":
        return intern(op, args)
    return constructors[op](*args) if op in constructors else make(op, *args)


def depends_on(outputs: Iterable[Symbol], inputs: Iterable[Symbol]) -> set[int]:
    """Numbers of the nodes under `outputs` that depend on any of `inputs`."""
    result = {x.number for x in inputs}
    for node in topological(outputs):
        if any(a.number in result for a in node.args):
            result.add(node.number)
    return result
