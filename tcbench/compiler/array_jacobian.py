"""Makes numbers that all entries read, and sums that are read again, unknowns: Jacobians stay sparse."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from . import symbols
from .arrays import NUMBER, variable
from .derivatives import ManyPairs, Term, depends_on, jacobian_terms, substitute, topological
from .symbols import Symbol

MOST_OF_PAIRS = 100  # terms of a Jacobian over pairs of entries that meet in a sum, above which it becomes an unknown

__all__ = ["Term", "jacobian_terms", "shared_as_unknowns"]


def shared_as_unknowns(
    rows: Sequence[Symbol], unknowns: Sequence[Symbol]
) -> tuple[list[Symbol], list[Symbol], dict[Symbol, Symbol]]:
    """(rows, unknowns, expressions): numbers that depend on the unknowns and that all entries of an array read, such as
    means, become unknowns of their own, each with an equation.

    So do sums along tables that are read along tables again, such as nodal temperatures made of the strains around a
    node, where their slopes would be many: a row then depends on its neighbours, not on theirs. The expressions are
    these numbers by the unknowns that were passed.
    """
    rows, unknowns, shared = list(rows), list(unknowns), dict[Symbol, Symbol]()
    more: list[Symbol] = []
    sums_too: bool | None = None  # None: not decided yet
    while True:
        nodes = topological([*rows, *more])
        moving = depends_on([*rows, *more], unknowns) - {x.number for x in unknowns}
        read = [a for x in nodes if x.space for a in x.args if a.space == NUMBER and a.number in moving]
        if not read and sums_too is None:
            sums_too = _many_pairs([*rows, *more], unknowns)
        if not read and not sums_too:
            break
        if not read:
            first = _sum_read_again(nodes, moving)
            if first is None:
                break
        else:
            first = min(read, key=lambda x: x.number)
        sigma = variable("shared", first.space)
        unknowns.append(sigma)
        (shared[sigma],) = substitute([first], shared)
        rows, more = substitute(rows, {first: sigma}), substitute(more, {first: sigma})
        more.append(symbols.sub(sigma, first))
    return [*rows, *more], unknowns, shared


def _many_pairs(rows: Sequence[Symbol], unknowns: Sequence[Symbol]) -> bool:
    try:
        jacobian_terms(rows, unknowns, MOST_OF_PAIRS)
    except ManyPairs:
        return True
    return False


def _sum_read_again(nodes: Sequence[Symbol], moving: Collection[int]) -> Symbol | None:
    """The first array that contains sums along tables and is read along a table: such sums, or expressions of several
    of them, whichever are fewer."""
    sums: dict[int, frozenset[int]] = {}  # by node, the sums that it contains
    node_of = {x.number: x for x in nodes}
    read: dict[int, Symbol] = {}
    for node in nodes:
        if node.number not in moving or not node.space:
            continue
        if node.op == "collect":
            sums[node.number] = frozenset([node.number])
        elif node.op == "take":
            if node.args[0].number in sums:
                read[node.args[0].number] = node.args[0]
        else:
            inner_sums = frozenset().union(*(sums.get(a.number, frozenset()) for a in node.args))
            if inner_sums:
                sums[node.number] = inner_sums
    if not read:
        return None
    first = min(read)
    together = [n for n in read if sums[n] & sums[first]]
    among = frozenset().union(*(sums[n] for n in together))
    return node_of[min(among) if len(among) <= len(together) else first]
