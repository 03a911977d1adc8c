"""How many entries spaces have, and where tables lead: all that a size decides."""

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

MOST_PAIRS = 20_000_000  # entries of a Jacobian that sums of sums may have
ENTRIES = "entries of a Jacobian"
Ints = NDArray[np.int64]


class Block(NamedTuple):
    """A part of an input or output: the components of one entry after the other; None: nothing reads it."""

    space: str
    symbols: tuple[Symbol | None, ...]


def alone(values: Sequence[Any], like: Sequence[Symbol] | None = None) -> list[Block]:
    """Each in a block of its own, over its space or that of its counterpart."""
    return [Block(x.space, (value,)) for value, x in zip(values, like or values, strict=True)]


class Mesh:
    """How many there are of each space, and where each map leads."""

    def __init__(self, sizes: Mapping[str, int], tables: Mapping[str, Ints]) -> None:
        self.sizes = dict(sizes)
        self.tables = {
            n: np.asarray(t, np.int64).reshape(len(t), int(np.prod(np.shape(t)[1:]))) for n, t in tables.items()
        }
        self.pairs = cache(self._pairs)

    def with_entries(self, count: int) -> Mesh:
        """The same beside a Jacobian of so many entries."""
        found = copy(self)
        found.sizes = {**self.sizes, ENTRIES: count}
        return found

    def size(self, space: str) -> int:
        if space == NUMBER:
            return 1
        if space not in self.sizes and "+" in space:
            self.sizes[space] = sum(self.size(part) for part in space.split("+"))
        return self.sizes[space]

    def along(self, path: Path, over: str = NUMBER) -> Ints:
        """Where the path leads, for each entry at its beginning; -1 where it leads out of a part of joined arrays."""
        source = path[0].source if path else over
        if path and isinstance(path[0].name, tuple):
            self.pairs(*path[0].name[1:3], source)
        found = np.arange(self.size(source))
        for m in path:
            if m.name == "all":
                there = np.zeros(len(found), np.int64)
            elif m.name in ("into", "out of"):
                before = sum(map(self.size, (m.target if m.name == "into" else m.source).split("+")[: m.column]))
                there = found + before if m.name == "into" else found - before
                there[(there < 0) | (there >= self.size(m.target))] = -1
            elif isinstance(m.name, tuple):
                there = self.pairs(*m.name[1:3], m.source)[m.name[3]][found]
            else:
                there = self.tables[m.name][found, m.column]
            found = np.where(found < 0, -1, there)
        return found

    def _pairs(self, path: Path, rows: Path, name: str) -> tuple[Ints, Ints]:
        """Each entry at the beginning of one path with each at the beginning of the other that leads to the same."""
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
        return [0, *np.cumsum([self.size(b.space) * len(b.symbols) for b in blocks]).tolist()]


class Scattered(NamedTuple):
    """Rows and columns of the entries that terms of a Jacobian have, and where in these each term has its own; -1: it
    is fixed there."""

    rows: Ints
    columns: Ints
    own: list[Ints]

    def places(self, where: Ints, behind: int) -> list[Ints]:
        """For a kernel, where the entries stand here; what is fixed is written behind."""
        there = np.append(where, behind)
        return [there[own] for own in self.own]


def scattered(mesh: Mesh, blocks: Sequence[Block], terms: Sequence[tuple[int, Any]]) -> Scattered:
    """In the order of the blocks. terms: each with the number of its row among their symbols."""
    starts = mesh.offsets(blocks)
    place = [(starts[k] + c, len(b.symbols)) for k, b in enumerate(blocks) for c in range(len(b.symbols))]
    which = {x.number: i for i, x in enumerate(x for b in blocks for x in b.symbols if x is not None)}
    rows, columns, own, count = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)], [], 0
    for i, term in terms:
        r, c = (mesh.along(path, term.over) for path in (term.rows, term.columns))
        free = (r >= 0) & (c >= 0)
        (first, step), (column, apart) = place[i], place[which[term.unknown.number]]
        rows.append(first + step * r[free])
        columns.append(column + apart * c[free])
        own.append(np.where(free, count - 1 + np.cumsum(free), -1))
        count += len(rows[-1])
    return Scattered(np.concatenate(rows), np.concatenate(columns), own)
