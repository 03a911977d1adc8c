"""The size of a formula's round-off, from the sizes of its operations and its derivatives by them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce

from . import derivatives as trace
from .arrays import total
from .chain_rule import covectors
from .derivatives import Symbol


def round_off(f: Symbol, x: Sequence[Symbol], magnitudes: Sequence[Symbol] | None = None) -> Symbol:
    """The round-off of f, over the unit round-off: the sum of |df/dn| |n| over the operations n that f is made of.

    A variable counts with its magnitude beside its size, for it may begin at 0, and an array with its largest entry.
    Without magnitudes the variables themselves are left out: what is left is the size of the terms of f.
    """
    by, moving = covectors(f, x), trace.depends_on([f], x)
    nodes = [node for node in reversed(trace.topological([f])) if node.number in by and node.number in moving]
    nodes = [node for node in nodes if magnitudes is not None or node.op != "var"]
    sizes = dict(zip(x, magnitudes or (), strict=False))
    return reduce(trace.add, (_rounded(node, by[node.number], sizes) for node in nodes), abs(f))


def _rounded(node: Symbol, by: Symbol, sizes: dict[Symbol, Symbol]) -> Symbol:
    """|df/dn| |n| of one node n, by = df/dn. Entries of an array are rounded independently: they add up by squares. A
    sum over all is compensated: what it loses goes with the sizes of its terms, not with how many these are."""
    if node.op == "total":
        op, space = node.value
        return abs(by) * total(op, abs(node.args[0]), space)
    if node.op != "var":
        return _in_all(by * node)
    magnitude = total("max", abs(node), node.space) if node.space else sizes[node]
    return _in_all(abs(by) * (magnitude + abs(node)))


def _in_all(size: Symbol) -> Symbol:
    return total("add", size * size, size.space).sqrt() if size.space else abs(size)
