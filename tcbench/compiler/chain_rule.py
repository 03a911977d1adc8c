"""Gradients of a traced number, ordinary and discrete, by one sweep back over its graph: a few operations a node.

The discrete gradient D f(z0, z1) satisfies D f . (z1 - z0) = f(z1) - f(z0), is symmetric in both ends and tends to the
gradient as they meet. It is the chain rule itself, with the slope of every elementary operation replaced by its exact
divided difference: no quotient ever divides a difference of nearby numbers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
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
    substitute,
    topological,
)  # fmt: skip
from .divided_differences import FEW, GROWING, Corners, factors, rectangle
from .kinks import argument_of_sign, slope_of_sign

ZERO, ONE = const(0.0), const(1.0)


def gradient(output: Symbol, inputs: Sequence[Symbol]) -> list[Symbol]:
    """df/d(inputs), shape (len(inputs),), at the cost of a few evaluations of f: reverse mode."""
    by = covectors(output, inputs)
    return [by.get(x.number, ZERO) for x in inputs]


def covectors(output: Symbol, inputs: Sequence[Symbol]) -> dict[int, Symbol]:
    """df/d(node), by number, of each node under f that depends on the inputs."""
    return _backwards(output, inputs, lambda node: (ONE,) if node.op == "mark" else partials(node))


def discrete_gradient(
    output: Symbol, inputs: Sequence[Symbol], start: Sequence[Symbol], step: Sequence[Symbol]
) -> list[Symbol]:
    """D f(start, start + step), shape (len(inputs),), of a formula f of the inputs."""
    moving = depends_on([output], inputs)
    edges = {x.number: Edge(a, d) for x, a, d in zip(inputs, start, step, strict=True)}
    slopes: dict[int, tuple[Symbol, ...]] = {}
    degrees = {x.number: 1.0 for x in inputs}
    for node in topological([output]):
        if node.number in edges:
            continue
        if node.number not in moving:
            edges[node.number] = Edge(node, ZERO)
            continue
        ends = [edges[a.number] for a in node.args]
        if node.op == "exp" and degrees[node.args[0].number] > 1.0:  # from far away it rises by more than a number can
            ends = [replace(ends[0], at_end=ends[0].end)]
        value = rebuild(node.op, tuple(edge.value for edge in ends), node.value)
        degrees[node.number] = _degree(node, [degrees.get(a.number, 0.0) for a in node.args])
        grows = degrees[node.number] > FEW
        at_end = rebuild(node.op, tuple(edge.end for edge in ends), node.value) if grows else None
        if node.op in arrays.LINEAR:
            edges[node.number] = Edge(value, rebuild(node.op, tuple(edge.step for edge in ends), node.value), at_end)
            continue
        of_zero = node.op == "pow" and node.args[1].number not in moving and not is_const(node.args[1])
        if of_zero and not ends[0].value.positive and _never_negative(node.args[0]):  # its logarithm, beside 0
            (end,) = substitute([node.args[0]], {x: a + d for x, a, d in zip(inputs, start, step, strict=True)})
            base = Edge(ends[0].value + ops.TINY, ends[0].step, end + ops.TINY)
            along = divided_differences(node, (base, ends[1]), base.value ** ends[1].value)
        else:
            along = divided_differences(node, ends, value)
        slopes[node.number] = along
        change = ZERO
        for edge, slope in zip(ends, along, strict=True):
            change = change + slope * edge.step
        edges[node.number] = Edge(value, change, at_end)
    by = _backwards(output, inputs, lambda node: slopes[node.number])
    return [by.get(x.number, ZERO) for x in inputs]


def _degree(node: Symbol, of: Sequence[float]) -> float:
    """A bound of the growth of a node with the inputs, as the degree of a polynomial: infinite for exponentials."""
    if node.op == "mul":
        return sum(of)
    if node.op == "pow":
        return abs(node.args[1].value) * of[0] if is_const(node.args[1]) else math.inf
    if node.op in GROWING:
        return math.inf
    if node.op in ("log", "log1p", "sin", "cos", "tanh", "atan", "atan2"):
        return 1.0
    return max(of) / 2.0 if node.op == "sqrt" else max(of)


def _never_negative(node: Symbol) -> bool:
    """Sizes, squares, max(u, 0) = (u + |u|)/2, and sums of such, exactly: round-off does not make them negative."""
    if node.positive or node.op in ("abs", "sqrt", "hypot"):
        return True
    if node.op == "mul" and node.args[0] is not node.args[1]:
        half, rest = node.args if is_const(node.args[0]) else node.args[::-1]
        return half.positive and _never_negative(rest)
    if node.op != "add":
        return node.op == "mul"
    both = any(x.op == "abs" and x.args[0] is y for x, y in (node.args, node.args[::-1]))
    return both or all(map(_never_negative, node.args))


@dataclass(frozen=True, eq=False)
class Edge:
    """The value of a node at the start, and its increment, which keeps its digits. A node that may shrink by orders of
    magnitude has its value at the end, too: start + increment would have lost its digits."""

    value: Symbol
    step: Symbol
    at_end: Symbol | None = None

    @property
    def end(self) -> Symbol:
        return self.value + self.step if self.at_end is None else self.at_end

    @property
    def middle(self) -> Symbol:
        return self.value + 0.5 * self.step

    @property
    def corners(self) -> Corners:
        """The node as the coordinate along an edge, for the rules of `divided_differences`."""
        along, _ = rectangle(self.value, self.step, ZERO, ZERO)
        return along if self.at_end is None else replace(along, ends=(self.at_end, self.value, self.at_end))


def divided_differences(node: Symbol, edges: Sequence[Edge], value: Symbol) -> tuple[Symbol, ...]:
    """Divided differences of an operation by each argument, symmetric in both ends. value : its result at the start."""
    op, x = node.op, edges[0]
    if op in ("add", "sub", "neg", "mark"):
        return partials(node)
    if op == "mul":
        of = argument_of_sign(node)
        if of is None:
            if x.at_end is None or edges[1].at_end is None:
                return edges[1].middle, x.middle
            return factors(x.value, x.at_end, edges[1].value, edges[1].at_end)
        first = node.args[0] is of
        jump = slope_of_sign((own := edges[not first]).value, own.end)
        return (jump, ZERO) if first else (ZERO, jump)
    if op == "recip":
        return (-(value * reciprocal(x.end)),)
    if op == "pow":  # exp(exponent log(base)); of a base that may be 0 a root and an integer power
        y = edges[1]
        power = y.value.value if is_const(y.value) else math.inf
        if math.isfinite(power) and (power > 1.0 or power % 1 == 0) and not x.value.positive:
            return (x.corners**power).pi_at_s0, ZERO
        of_log = _of_function("log", x)
        log = Edge(x.value.log(), of_log * x.step)
        by_base, by_exponent = y.middle * of_log, log.middle
        change = by_base * x.step + by_exponent * y.step
        fixed = is_const(y.step, 0.0)
        outer = value * ONE.make("phi", change) if fixed else ops.exp_slope(value, x.end**y.end, change)
        return outer * by_base, outer * by_exponent
    rule = ops.OPERATIONS[op].difference if op in ops.OPERATIONS else None
    if len(edges) == 2 and callable(rule):
        y = edges[1]
        by_both: tuple[Symbol, Symbol] = rule(x.value, x.end, x.step, y.value, y.end, y.step)
        return by_both
    if op == "sqrt" and any(is_const(a, ops.TINY) for a in node.args[0].args):  # of a power above 1, see `power`
        return (x.corners.root().pi_at_s0,)
    return (_of_function(op, x),)


def _of_function(op: str, x: Edge) -> Symbol:
    """The divided difference of an elementary function of one argument."""
    row = ops.OPERATIONS.get(op)
    corners: Corners = getattr(x.corners, row.numpy if row else op)()
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
                if argument.space == arrays.NUMBER and node.op != "total":  # all entries read this number
                    part = arrays.total("add", part, arrays.reader(node, k))
                by[argument.number] = add(by[argument.number], part) if argument.number in by else part
            else:
                accumulate(by, y, {argument.number: slope})
    return by
