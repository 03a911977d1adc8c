"""How large the round-off of a formula is: from the sizes of its operations, and what they weigh in it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce

from . import derivatives as trace
from .arrays import count, total
from .chain_rule import covectors
from .derivatives import Symbol


def round_off(f: Symbol, x: Sequence[Symbol], least: Sequence[Symbol] | None = None) -> Symbol:
    """The round-off of f, in units of the last place: the sizes of its operations times what they weigh in f; of a
    variable its least size, or the largest of an array, beside its size, for it may begin at 0. Without least sizes
    that of x itself is left out: how large the terms of f are, that may cancel."""
    by, moving = covectors(f, x), trace.depends_on([f], x)
    nodes = [node for node in reversed(trace.topological([f])) if node.number in by and node.number in moving]
    nodes = [node for node in nodes if least is not None or node.op != "var"]
    sizes = dict(zip(x, least or (), strict=False))
    return reduce(trace.add, (_rounded(node, by[node.number], sizes) for node in nodes), abs(f))


def _rounded(node: Symbol, by: Symbol, sizes: dict[Symbol, Symbol]) -> Symbol:
    """Of an operation, or a variable, and df by it. Of an array each entry is rounded by itself: these add up by their
    squares, and what a sum loses grows as the root of their number."""
    if node.op == "total":
        op, space = node.value
        return abs(by) * total(op, abs(node.args[0]), space) * count(space).sqrt()
    if node.op != "var":
        return _in_all(by * node)
    least = total("max", abs(node), node.space) if node.space else sizes[node]
    return _in_all(abs(by) * (least + abs(node)))


def _in_all(size: Symbol) -> Symbol:
    return total("add", size * size, size.space).sqrt() if size.space else abs(size)
