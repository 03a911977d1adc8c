"""What can be done with a traced formula: exact derivatives, substitution, order of evaluation.

`symbols` has the nodes and the constructors, which are named here too: `trace.variable`, `trace.jacobian`, ...
"""

from __future__ import annotations

import operator
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import TraceError
from .symbols import (
    Symbol,
    add,
    array,
    const,
    guarded,
    intern,
    is_const,
    lam,
    lifted,
    make,
    mark,
    maximum,
    minimum,
    mul,
    neg,
    phi,
    power,
    reciprocal,
    sub,
    tracing,
    variable,
    variables,
)

__all__ = [
    "Substitution",
    "Symbol",
    "add",
    "array",
    "const",
    "depends_on",
    "guarded",
    "is_const",
    "jacobian",
    "lam",
    "lifted",
    "mark",
    "maximum",
    "minimum",
    "mul",
    "neg",
    "phi",
    "power",
    "rebuild",
    "reciprocal",
    "sparse_jacobian",
    "sub",
    "substitute",
    "topological",
    "topological_beyond",
    "tracing",
    "variable",
    "variables",
]  # fmt: skip


def partials(node: Symbol) -> tuple[Symbol, ...]:
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
        case "atan":
            return (reciprocal(add(one, mul(x, x))),)
        case "phi":
            return (intern("dphi", (x,)),)
        case "lam":
            return (intern("dlam", (x,)),)
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
            _accumulate(tangent, partial, tangents.get(argument.number, {}))
        tangents[node.number] = tangent
    rows = []
    for node in outputs:
        tangent = dict(tangents.get(node.number, {}))
        while pending := [number for number in tangent if number in seeds]:
            number = max(pending)
            _accumulate(tangent, tangent.pop(number), seeds[number])
        rows.append({columns[number]: t for number, t in tangent.items() if not is_const(t, 0.0)})
    return rows


def _accumulate(tangent: dict[int, Symbol], factor: Symbol, inner: Mapping[int, Symbol]) -> None:
    """tangent += factor * inner."""
    for number, t in inner.items():
        term = mul(factor, t)
        tangent[number] = add(tangent[number], term) if number in tangent else term


def topological_beyond(outputs: Iterable[Symbol], known: Mapping[int, Any]) -> list[Symbol]:
    """Nodes that the outputs need and that are not among the known ones (by number), arguments before users."""
    seen: dict[int, Symbol] = {}
    stack = list(outputs)
    while stack:
        node = stack.pop()
        if node.number not in seen and node.number not in known:
            seen[node.number] = node
            stack.extend(node.args)
    return [seen[number] for number in sorted(seen)]


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
        from . import spaces

        return spaces.rebuilt(op, args, value)
    constructors: dict[str, Any] = {
        "add": add, "sub": sub, "mul": mul, "neg": neg, "recip": reciprocal, "phi": phi, "lam": lam,
        "mark": mark, "max": maximum, "min": minimum,
    }  # fmt: skip
    if not all(isinstance(x, Symbol) for x in args):  # complex numbers: by their own arithmetic
        unary = {"neg": operator.neg, "recip": lambda x: 1.0 / x, "mark": lambda x: x, "atan": lambda x: x.arctan()}
        binary = {"add": operator.add, "sub": operator.sub, "mul": operator.mul}
        chosen: Any = unary.get(op) or binary.get(op) or operator.methodcaller(op)
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
