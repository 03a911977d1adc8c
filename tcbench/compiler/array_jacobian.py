"""Exact sparse Jacobians of graphs on arrays, without a size: a few terms, each an entry for each of a space."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..errors import TraceError
from . import ops, symbols
from .arrays import LINEAR, NO_SLOPE, NUMBER, Map, Path, take, variable
from .derivatives import depends_on, partials, substitute, topological
from .symbols import Symbol, const, is_const


class Term(NamedTuple):
    """Entries of a Jacobian: a slope for each entry of `over`, in row rows(entry) and column columns(entry)."""

    over: str
    rows: Path
    columns: Path
    unknown: Symbol


Terms = dict[Term, Symbol]


WIDE = 6  # terms of a value that several read, from which on it is differentiated once, as a strain of many corners
MOST_OF_PAIRS = 100  # terms over pairs of entries that meet in a sum, above which the sum becomes an unknown


class ManyPairs(Exception):
    """Sums of sums have more terms over pairs than asked for."""


def jacobian_terms(outputs: Sequence[Symbol], unknowns: Sequence[Symbol], most: float = np.inf) -> list[Terms]:
    """Of each output its terms, to be added up where they fall together. most: terms over pairs, else ManyPairs.

    What is marked, or what a curved function of arrays is of, if it depends on several, is differentiated once and its
    slopes inserted at the end: all coordinates of an element act through one length. So is what depends on many and is
    read by several.
    """
    tangents: dict[int, Terms] = {x.number: _identity(x) for x in unknowns}
    seeds: dict[int, Terms] = {}
    nodes = topological(outputs)
    curved = {node.args[0].number for node in nodes if node.space and bends(node)}
    readers = Counter(a.number for node in nodes for a in dict.fromkeys(node.args))
    for node in nodes:
        if node.number in tangents or not any(tangents.get(a.number) for a in node.args):
            continue
        found: Terms = {}
        inner = [tangents.get(a.number, {}) for a in node.args]
        if node.op == "mark":
            found = inner[0]
        elif node.op in LINEAR:
            for k, terms in enumerate(inner):
                for term, slope in terms.items():
                    _add(found, *_through(node, k, term, slope))
        else:
            for a, terms, partial in zip(node.args, inner, partials(node), strict=True):
                for each in terms.items():
                    term, slope = _read_by(node.space, a, *each)
                    _add(found, term, symbols.mul(take(partial, term.rows), slope))
        wide = len(found) >= WIDE and readers[node.number] > 1 and bool(node.space) and node.op not in LINEAR
        if wide or node.op == "mark" or (node.number in curved and len(found) > 1):
            seeds[node.number], found = found, _identity(node)
        tangents[node.number] = found
        if most < np.inf:
            _look(found, most)
    rows = []
    for x in outputs:
        rows.append(_expanded(tangents.get(x.number, {}), seeds, most))
    return rows


def bends(node: Symbol) -> bool:
    """Is it a curved function of one value, a power, or marked?"""
    return node.op in ("pow", "mark") or (node.op in ops.OPERATIONS and node.op != "neg" and len(node.args) == 1)


def _look(terms: Terms, most: float) -> None:
    if sum(term.over.startswith("pairs ") for term in terms) > most:
        raise ManyPairs


def _identity(x: Symbol) -> Terms:
    return {Term(x.space, (), (), x): const(1.0)}


def _all(space: str) -> Map:
    """To the one number that all entries read, or add to."""
    return Map("all", 0, space, NUMBER)


def _into(k: int, space: str) -> Map:
    """From the arrays of number k to their place among joined ones, space "a+b"."""
    return Map("into", k, space.split("+")[k], space)


def _out_of(k: int, space: str) -> Map:
    """Back; those of others lead nowhere."""
    return Map("out of", k, space, space.split("+")[k])


def _add(found: Terms, term: Term, slope: Symbol) -> None:
    found[term] = symbols.add(found[term], slope) if term in found else slope


def _through(node: Symbol, k: int, term: Term, slope: Symbol) -> tuple[Term, Symbol]:
    """A term of argument k, as one of the node."""
    match node.op:
        case "collect":
            term, slope = _read_by(node.value[k][0].source, node.args[k], term, slope)
            return term._replace(rows=(*term.rows, *node.value[k])), slope
        case "total" if node.value[0] == "add":
            return term._replace(rows=(*term.rows, _all(node.value[1]))), slope
        case "take":
            return _met(node.value, term, slope)
        case "join":
            term, slope = _read_by(node.value.split("+")[k], node.args[k], term, slope)
            return term._replace(rows=(*term.rows, _into(k, node.value))), slope
        case "part":
            return term._replace(rows=(*term.rows, _out_of(*node.value))), slope
    raise TraceError(NO_SLOPE)


def _read_by(space: str, x: Symbol, term: Term, slope: Symbol) -> tuple[Term, Symbol]:
    """A term of what arrays over a space read: of a number all entries do."""
    return _met((_all(space),), term, slope) if x.space == NUMBER and space != NUMBER else (term, slope)


def _met(path: Path, term: Term, slope: Symbol) -> tuple[Term, Symbol]:
    """What is at the path's end. Where sums stand there, each entry meets all terms of its sum: a space of pairs."""
    rows = term.rows
    while rows and rows[-1].name == "into":  # of joined arrays: through the table's numbers
        path, rows = (*path, _out_of(rows[-1].column, rows[-1].target)), rows[:-1]
    if not rows:
        return Term(path[0].source, (), (*path, *term.columns), term.unknown), take(slope, path)
    pairs = f"pairs of {path} and {rows}"
    one, other = (Map(("pairs", path, rows, k), 0, pairs, s) for k, s in enumerate((path[0].source, term.over)))
    return Term(pairs, (one,), (other, *term.columns), term.unknown), take(slope, (other,))


def _expanded(terms: Terms, seeds: Mapping[int, Terms], most: float = np.inf) -> Terms:
    """With what seeds depend on in place of seeds, the last one first."""
    terms = dict(terms)
    while pending := [term for term in terms if term.unknown.number in seeds]:
        if most < np.inf:
            _look(terms, most)
        last = max(pending, key=lambda term: term.unknown.number)
        outer = terms.pop(last)
        for term, slope in seeds[last.unknown.number].items():
            if not last.columns:
                _add(terms, Term(term.over, (*term.rows, *last.rows), term.columns, term.unknown),
                     symbols.mul(take(outer, term.rows), slope))  # fmt: skip
                continue
            met, moved = _met(last.columns, term, slope)
            _add(terms, met._replace(rows=(*met.rows, *last.rows)), symbols.mul(take(outer, met.rows), moved))
    return {term: slope for term, slope in terms.items() if not is_const(slope, 0.0)}


def shared_as_unknowns(
    rows: Sequence[Symbol], unknowns: Sequence[Symbol]
) -> tuple[list[Symbol], list[Symbol], dict[Symbol, Symbol]]:
    """Numbers that depend on the unknowns and that all entries of an array read, such as means, become unknowns of
    their own, each with a row: the Jacobian stays sparse.

    So do sums along tables that are read along tables again, as temperatures of nodes that elements make of the strains
    around them, where their slopes would be many: each row sees its neighbours, and not those of its neighbours.

    Returns all rows, all unknowns, and these numbers in terms of the unknowns that were given.
    """
    rows, unknowns, shared = list(rows), list(unknowns), dict[Symbol, Symbol]()
    more: list[Symbol] = []
    sums_too: bool | None = None  # not known yet
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
    """The first array that has sums along tables in it and is read along a table: the sums themselves, or what is made
    of several of them before it is read, whichever are fewer."""
    sums: dict[int, frozenset[int]] = {}  # of what has sums in it, which
    known = {x.number: x for x in nodes}
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
            found = frozenset().union(*(sums.get(a.number, frozenset()) for a in node.args))
            if found:
                sums[node.number] = found
    if not read:
        return None
    first = min(read)
    together = [n for n in read if sums[n] & sums[first]]
    among = frozenset().union(*(sums[n] for n in together))
    return known[min(among) if len(among) <= len(together) else first]
