"""Sizes of spaces and entries of tables: all that depends on the size of a system."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import MachineError
from .arrays import NUMBER, Path
from .symbols import Symbol

MOST_PAIRS = 20_000_000  # entries that a sum of sums may contribute to a Jacobian
ENTRIES = "entries of a Jacobian"
Ints = NDArray[np.int64]
Shorts = NDArray[np.int32]


class Block(NamedTuple):
    """A part of an input or output: for each entry of the space its components; None where nothing reads one."""

    space: str
    symbols: tuple[Symbol | None, ...]


def alone(values: Sequence[Any], like: Sequence[Symbol] | None = None) -> list[Block]:
    """One block for each value, over its space or that of its counterpart in `like`."""
    return [Block(x.space, (value,)) for value, x in zip(values, like or values, strict=True)]


class Mesh:
    """Sizes of spaces, and tables by name, shape (source, columns)."""

    def __init__(self, sizes: Mapping[str, int], tables: Mapping[str, Ints]) -> None:
        self.sizes = dict(sizes)
        self.tables = {
            n: np.asarray(t, np.int64).reshape(len(t), int(np.prod(np.shape(t)[1:]))) for n, t in tables.items()
        }
        self.pairs = cache(self._pairs)

    def with_entries(self, count: int) -> Mesh:
        """The mesh with a space of `count` entries of a Jacobian."""
        mesh = copy(self)
        mesh.sizes = {**self.sizes, ENTRIES: count}
        return mesh

    def size(self, space: str) -> int:
        if space == NUMBER:
            return 1
        if space[0] == "#":  # the name is the size
            return int(space[1:])
        if space not in self.sizes and "+" in space:
            self.sizes[space] = sum(self.size(part) for part in space.split("+"))
        return self.sizes[space]

    def along(self, path: Path, over: str = NUMBER) -> Ints:
        """The entry at the end of a path for each at its beginning, (size,); -1 outside of a part of joined arrays."""
        source = path[0].source if path else over
        if path and isinstance(path[0].name, tuple):
            self.pairs(*path[0].name[1:3], source)
        members = np.arange(self.size(source))
        for m in path:
            if m.name == "all":
                targets = np.zeros(len(members), np.int64)
            elif m.name in ("into", "out of"):
                before = sum(map(self.size, (m.target if m.name == "into" else m.source).split("+")[: m.column]))
                targets = members + before if m.name == "into" else members - before
                targets[(targets < 0) | (targets >= self.size(m.target))] = -1
            elif isinstance(m.name, tuple):
                targets = self.pairs(*m.name[1:3], m.source)[m.name[3]][members]
            else:
                targets = self.tables[m.name][members, m.column]
            members = np.where(members < 0, -1, targets)
        return members

    def _pairs(self, path: Path, rows: Path, name: str) -> tuple[Ints, Ints]:
        """The pairs of entries at the beginnings of two paths that lead to one entry: two arrays of shape (pairs,)."""
        one, other = self.along(path), self.along(rows)
        order = np.argsort(other, kind="stable")
        first, last = (np.searchsorted(other[order], one, side) for side in ("left", "right"))
        counts = np.where(one < 0, 0, last - first)
        if counts.sum() > MOST_PAIRS:
            raise MachineError(
                f"A Jacobian has {counts.sum():.2g} entries here, for everything depends on everything through a sum: "
                "take a method that is a formula (tc_monolithic, gauss2), in which the sum is an unknown of its own."
            )
        left = np.repeat(np.arange(len(one)), counts)
        within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        self.sizes[name] = len(left)
        return left, order[np.repeat(first, counts) + within]

    def offsets(self, blocks: Sequence[Block]) -> list[int]:
        """The place of each block, and the length of all."""
        return [0, *np.cumsum([self.size(b.space) * len(b.symbols) for b in blocks]).tolist()]


class Scattered(NamedTuple):
    """Entries of a Jacobian: their rows and columns, shape (entries,), and for each term the entry of each of its
    values; -1 where it has none."""

    rows: Ints
    columns: Ints
    own: list[Shorts]

    def places(self, where: Ints, behind: int) -> list[Shorts]:
        """The places of the terms' values from those of the entries, `where` (entries,); `behind` without an entry."""
        places = np.append(where, behind).astype(np.int32)
        return [places[own] for own in self.own]


def scattered(mesh: Mesh, blocks: Sequence[Block], terms: Sequence[tuple[int, Any]]) -> Scattered:
    """The entries of a Jacobian whose rows and columns are the blocks. terms : (number of the row's symbol, term).

    Pairs of entries of two spaces are computed once for all terms along the same two paths: components have hundreds.
    """
    starts = mesh.offsets(blocks)
    place = [(starts[k] + c, len(b.symbols)) for k, b in enumerate(blocks) for c in range(len(b.symbols))]
    which = {x.number: i for i, x in enumerate(x for b in blocks for x in b.symbols if x is not None)}
    spaces = [b.space for b in blocks for _ in b.symbols]
    ways: dict[tuple[str, str], dict[tuple[str, Path, Path], None]] = {}  # by two spaces, the pairs of paths
    parts: dict[tuple[int, int], dict[tuple[str, Path, Path], None]] = {}  # by two components, theirs
    for i, term in terms:
        j, way = which[term.unknown.number], (term.over, term.rows, term.columns)
        ways.setdefault((spaces[i], spaces[j]), {})[way] = None
        parts.setdefault((i, j), {})[way] = None
    keys: dict[tuple[str, str], Ints] = {}
    met_ranks: dict[tuple[str, str], dict[Any, Shorts]] = {}
    for (row, column), listed in ways.items():
        keys[row, column], met_ranks[row, column] = _met(mesh, mesh.size(row), mesh.size(column), list(listed))
    rows, columns, count = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)], 0
    ranks: dict[Any, tuple[Ints, Shorts]] = {}
    at: dict[tuple[int, int], tuple[int, Shorts]] = {}
    for (i, j), listed in parts.items():
        two = spaces[i], spaces[j]
        chosen = (two, frozenset(listed))
        if chosen not in ranks:
            seen = np.zeros(len(keys[two]) + 1, bool)
            for way in listed:
                seen[met_ranks[two][way]] = True
            seen[-1] = False
            ranks[chosen] = keys[two][seen[:-1]], np.where(seen, np.cumsum(seen) - 1, -1).astype(np.int32)
        key, rank = ranks[chosen]
        (first, step), (begin, apart) = place[i], place[j]
        rows.append(first + step * (key // mesh.size(two[1])))
        columns.append(begin + apart * (key % mesh.size(two[1])))
        at[i, j] = count, rank
        count += len(key)
    own = []
    for i, term in terms:
        j = which[term.unknown.number]
        before, rank = at[i, j]
        mine = rank[met_ranks[spaces[i], spaces[j]][term.over, term.rows, term.columns]]
        own.append(np.where(mine >= 0, mine + np.int32(before), np.int32(-1)))
    return Scattered(np.concatenate(rows), np.concatenate(columns), own)


def _met(
    mesh: Mesh, n_rows: int, n_columns: int, ways: Sequence[tuple[str, Path, Path]]
) -> tuple[Ints, dict[tuple[str, Path, Path], Shorts]]:
    """The distinct pairs (row, column) at the ends of pairs of paths, as row * n_columns + column, sorted; and for each
    pair of paths the number of its entries' pairs among them, -1 for none."""
    keys = []
    for over, row, column in ways:
        r, c = mesh.along(row, over), mesh.along(column, over)
        keys.append(np.where((r >= 0) & (c >= 0), r * n_columns + c, -1))
    distinct, inverse = np.unique(np.concatenate(keys), return_inverse=True)
    fixed = len(distinct) > 0 and distinct[0] < 0
    inverse = inverse.astype(np.int32) - fixed
    ends = np.cumsum([len(key) for key in keys])[:-1]
    return distinct[int(fixed) :], dict(zip(ways, np.split(inverse, ends), strict=True))
