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
from . import arrays, ops
from .ops import INFINITE, TINY
from .sentences import refused
from .symbols import (
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


def mark(x: Symbol) -> Symbol:
    """The same value, as an intermediate through which derivatives are accumulated (it saves operations, e.g. when
    everything in an element depends on all positions through one strain measure)."""
    return x if x.op in ("const", "var", "mark") else intern("mark", (x,))


# derivatives ----------------------------------------------------------------------------------------------------------


def partials(node: Symbol) -> tuple[Symbol, ...]:
    """Derivative of a node by each of its arguments."""
    found = ops.partials(node.op, node, *node.args)
    if not found:
        raise refused(f"the operation {node.op!r} has no derivative here")
    return tuple(map(lifted, found))


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
    from .array_jacobian import jacobian_terms

    place = {x.number: j for j, x in enumerate(inputs)}
    rows = jacobian_terms([lifted(x) for x in outputs], inputs)
    return [{place[term.unknown.number]: slope for term, slope in row.items()} for row in rows]


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
        "add": add, "sub": sub, "mul": mul, "neg": neg, "recip": reciprocal,
        "mark": mark, "max": maximum, "min": minimum, "pow": power,
    }  # fmt: skip
    if not all(isinstance(x, Symbol) for x in args):  # complex numbers: by their own arithmetic
        unary = {"neg": operator.neg, "recip": lambda x: 1.0 / x, "mark": lambda x: x}
        binary = {"add": operator.add, "sub": operator.sub, "mul": operator.mul, "pow": operator.pow}
        chosen: Any = unary.get(op) or binary.get(op)
        if chosen is None:
            return operator.methodcaller(ops.OPERATIONS[op].numpy, *args[1:])(args[0])
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
