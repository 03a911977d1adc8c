"""Gradients of a traced number, ordinary and discrete, by one sweep back over its graph: a few operations a node.

The discrete gradient D f(z0, z1) satisfies D f . (z1 - z0) = f(z1) - f(z0), is symmetric in both ends and tends to the
gradient as they meet. It is the chain rule itself, with the slope of every elementary operation replaced by its exact
divided difference: no quotient ever divides a difference of nearby numbers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from . import arrays, ops
from .derivatives import (
    Symbol,
    accumulate,
    add,
    const,
    depends_on,
    is_const,
    mul,
    partials,
    rebuild,
    reciprocal,
    topological,
)  # fmt: skip
from .divided_differences import Corners, rectangle
from .kinks import argument_of_sign, slope_of_sign

ZERO, ONE = const(0.0), const(1.0)


def gradient(output: Symbol, inputs: Sequence[Symbol]) -> list[Symbol]:
    """df/dz, all of it at the cost of a few evaluations of f."""
    by = covectors(output, inputs)
    return [by.get(x.number, ZERO) for x in inputs]


def covectors(output: Symbol, inputs: Sequence[Symbol]) -> dict[int, Symbol]:
    """df by each node under f that depends on the inputs, by its number."""
    return _backwards(output, inputs, lambda node: (ONE,) if node.op == "mark" else partials(node))


def discrete_gradient(
    output: Symbol, inputs: Sequence[Symbol], start: Sequence[Symbol], step: Sequence[Symbol]
) -> list[Symbol]:
    """D f(start, start + step) of a formula in the inputs."""
    moving = depends_on([output], inputs)
    edges = {x.number: Edge(a, d) for x, a, d in zip(inputs, start, step, strict=True)}
    slopes: dict[int, tuple[Symbol, ...]] = {}
    for node in topological([output]):
        if node.number in edges:
            continue
        if node.number not in moving:
            edges[node.number] = Edge(node, ZERO)
            continue
        ends = [edges[a.number] for a in node.args]
        value = rebuild(node.op, tuple(edge.value for edge in ends), node.value)
        if node.op in arrays.LINEAR:
            edges[node.number] = Edge(value, rebuild(node.op, tuple(edge.step for edge in ends), node.value))
            continue
        slopes[node.number] = along = divided_differences(node, ends, value)
        change = ZERO
        for edge, slope in zip(ends, along, strict=True):
            change = change + slope * edge.step
        edges[node.number] = Edge(value, change)
    by = _backwards(output, inputs, lambda node: slopes[node.number])
    return [by.get(x.number, ZERO) for x in inputs]


@dataclass(frozen=True, eq=False)
class Edge:
    """The values of a node at both ends: one of them, and the increment, which keeps its digits."""

    value: Symbol
    step: Symbol

    @property
    def end(self) -> Symbol:
        return self.value + self.step

    @property
    def middle(self) -> Symbol:
        return self.value + 0.5 * self.step


def divided_differences(node: Symbol, edges: Sequence[Edge], value: Symbol) -> tuple[Symbol, ...]:
    """Of an operation by each of its arguments, symmetric in both ends; value: its result at the start."""
    op, x = node.op, edges[0]
    if op in ("add", "sub", "neg", "mark"):
        return partials(node)
    if op == "mul":
        of = argument_of_sign(node)
        if of is None:
            return edges[1].middle, x.middle
        first = node.args[0] is of
        jump = slope_of_sign((own := edges[not first]).value, own.end)
        return (jump, ZERO) if first else (ZERO, jump)
    if op == "recip":
        return (-(value * reciprocal(x.end)),)
    if op == "pow":  # exp(exponent log(base)), or of what may be 0 a root and a whole power
        y = edges[1]
        power = y.value.value if is_const(y.value) else math.inf
        if math.isfinite(power) and (power > 1.0 or power % 1 == 0) and not x.value.positive:
            return (rectangle(x.value, x.step, ZERO, ZERO)[0] ** power).pi_at_s0, ZERO
        of_log = _of_function("log", x)
        log = Edge(x.value.log(), of_log * x.step)
        by_base, by_exponent = y.middle * of_log, log.middle
        outer = value * ONE.make("phi", by_base * x.step + by_exponent * y.step)
        return outer * by_base, outer * by_exponent
    rule = ops.OPERATIONS[op].difference if op in ops.OPERATIONS else None
    if len(edges) == 2 and callable(rule):
        y = edges[1]
        by_both: tuple[Symbol, Symbol] = rule(x.value, x.end, x.step, y.value, y.end, y.step)
        return by_both
    if op == "sqrt" and any(is_const(a, ops.TINY) for a in node.args[0].args):  # of a power above 1, see `power`
        return (rectangle(x.value, x.step, ZERO, ZERO)[0].root().pi_at_s0,)
    return (_of_function(op, x),)


def _of_function(op: str, x: Edge) -> Symbol:
    """Of an elementary function of one argument, by the rules of `divided_differences`."""
    along, _ = rectangle(x.value, x.step, ZERO, ZERO)
    row = ops.OPERATIONS.get(op)
    corners: Corners = getattr(along, row.numpy if row else op)()
    return corners.pi_at_s0


def _backwards(
    output: Symbol, inputs: Sequence[Symbol], slopes: Callable[[Symbol], tuple[Any, ...]]
) -> dict[int, Symbol]:
    moving, ends = depends_on([output], inputs), {x.number for x in inputs}
    by: dict[int, Symbol] = {output.number: ONE}
    for node in reversed(topological([output])):
        if node.number in ends or node.number not in moving or node.number not in by:
            continue
        y = by[node.number]
        of_arrays = node.op in arrays.LINEAR
        for k, slope in enumerate(arrays.transposed(node, y) if of_arrays else slopes(node)):
            argument = node.args[k]
            if argument.number not in moving:
                continue
            if of_arrays or argument.space != node.space:
                part = slope if of_arrays else mul(y, slope)
                if argument.space == arrays.NUMBER and node.op != "total":  # a number that all entries read
                    part = arrays.total("add", part, arrays.reader(node, k))
                by[argument.number] = add(by[argument.number], part) if argument.number in by else part
            else:
                accumulate(by, y, {argument.number: slope})
    return by
