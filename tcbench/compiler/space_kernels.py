"""Kernels of formulas on whole arrays (`spaces`): a loop over the elements, one over the links, one over the positions.

The text does not know how many there are: sizes, offsets and index tables stand in the kernel's table. So one piece of
machine code serves a network of any size, and what works on a small one is what works on a large one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .kernels import PAIRS, Kernel, literal, operation
from .sentences import MixedSpaces
from .spaces import Path, Term
from .symbols import Symbol

SCALAR = ""  # the space of a number
START = {"add": "0.0", "max": "-inf", "min": "inf"}  # of a sum, a maximum, a minimum


class Slot(NamedTuple):
    """A part of an input or output array: one entry, or one for each entry of a space."""

    space: str
    symbol: Symbol | None  # what is read or written there


@dataclass(frozen=True, eq=False)
class Mesh:
    """How many there are of each space, and where each map leads. Indices from sizes["position"] on are anchors."""

    sizes: Mapping[str, int]
    maps: Mapping[str, NDArray[np.int64]]

    def size(self, space: str) -> int:
        return 1 if space == SCALAR else self.sizes[space]

    def along(self, path: Path) -> NDArray[np.int64]:
        """Where the path leads, for each entry at its beginning."""
        found = np.arange(self.sizes[path[0].source]) if path else np.zeros(0, np.int64)
        for m in path:
            found = self.maps[m.name][found, m.column]
        return found

    def offsets(self, slots: Sequence[Slot]) -> list[int]:
        return [0, *np.cumsum([self.size(slot.space) for slot in slots]).tolist()]


@dataclass
class SpaceKernel:
    """A kernel of any size: its text, and what its table says for a mesh."""

    text: str
    head: list[tuple[Any, ...]]
    inputs: Mapping[str, Sequence[Slot]]
    outputs: Sequence[Slot]
    arrays: list[str]  # spaces of the intermediate arrays

    def kernel(self, mesh: Mesh, places: Sequence[NDArray[np.int64]] = (), extra: int = 0) -> Kernel:
        """places: of the terms of a Jacobian, where in its entries they are; extra: room behind the outputs."""
        offsets = {letter: mesh.offsets(slots) for letter, slots in self.inputs.items()}
        out = mesh.offsets(self.outputs)
        offsets["out"] = out
        room = [mesh.size(space) + (mesh.sizes["anchor"] if space == "position" else 0) for space in self.arrays]
        offsets["s"] = [0, *np.cumsum(room).tolist()]
        rows: list[NDArray[np.int64]] = []
        start, head = len(self.head), []
        for what, *which in self.head:
            if what == "size":
                head.append(mesh.sizes[which[0]])
            elif what == "at":
                head.append(offsets[which[0]][which[1]])
            else:
                # those of a loop's terms side by side, as it reads them
                row = mesh.along(which[0]) if what == "path" else np.stack([places[k] for k in which], axis=1).ravel()
                head.append(start)
                rows.append(row)
                start += len(row)
        table = np.concatenate([np.array(head, np.int64), *rows, np.zeros(1, np.int64)])
        return Kernel(self.text, out[-1] + extra, table)


def space_kernel(
    inputs: Mapping[str, Sequence[Slot]], outputs: Sequence[Slot], terms: Sequence[tuple[Term, Symbol]] = (),
    terms_at: int = -1,
) -> SpaceKernel:  # fmt: skip
    """The kernel that reads the inputs' arrays and fills out with the outputs, one after the other.

    terms: of a Jacobian, added up into the entries that begin at output number `terms_at`, a slot without a symbol.
    """
    return _Writer(inputs, outputs, terms, terms_at).written()


class _Writer:
    def __init__(
        self, inputs: Mapping[str, Sequence[Slot]], outputs: Sequence[Slot],
        terms: Sequence[tuple[Term, Symbol]], terms_at: int,
    ) -> None:  # fmt: skip
        self.inputs, self.outputs, self.terms, self.terms_at = inputs, outputs, terms, terms_at
        self.source = {
            slot.symbol.number: (letter, k) for letter, slots in inputs.items() for k, slot in enumerate(slots)
            if slot.symbol is not None
        }  # fmt: skip
        wanted = [slot.symbol for slot in outputs if slot.symbol is not None] + [slope for _, slope in terms]
        self.nodes = self._needed(wanted)
        self.head: list[tuple[Any, ...]] = []
        self.arrays: list[str] = []
        self.stored: dict[int, tuple[str, int]] = dict(self.source)
        self.names: dict[int, str] = {}
        self.scalars: dict[int, list[str]] = {}
        self.count = 0

    def _needed(self, wanted: Sequence[Symbol]) -> list[Symbol]:
        seen: dict[int, Symbol] = {}
        stack = list(wanted)
        while stack:
            node = stack.pop()
            if node.number not in seen:
                seen[node.number] = node
                if node.number not in self.source:
                    stack.extend(node.args)
        return [seen[number] for number in sorted(seen)]

    def slot(self, *what: Any) -> str:
        """Name of the number in the table that says this."""
        if what not in self.head:
            self.head.append(what)
        return f"n{self.head.index(what)}"

    # levels ---------------------------------------------------------------------------------------------------------

    def _levels(self) -> dict[int, int]:
        level: dict[int, int] = {}
        for node in self.nodes:
            if node.number in self.source or not node.args:
                level[node.number] = 0
            elif node.op in ("scatter", "over_all"):
                level[node.number] = 1 + max(level[a.number] for a in node.args)
            elif node.op == "gather":
                source = node.args[0]
                level[node.number] = 0 if source.number in self.source else 1 + level[source.number]
            else:
                level[node.number] = max(level[a.number] for a in node.args)
        return level

    def written(self) -> SpaceKernel:
        level = self._levels()
        self.level = level
        self.stage = {n.number: (level[n.number], n.space.name if n.space else SCALAR) for n in self.nodes}
        for node in self.nodes:  # each representative is its own graph; only the first is written
            if node.space is not None and node.space.which:
                raise MixedSpaces(f"one {node.space.name} differs from the others")
        self._store()
        first: list[str] = []
        for node in self.nodes:
            if node.op == "scatter" and node.number not in self.source:
                array, at = self.stored[node.number]
                i, size = self._fresh("i"), self.slot("size", node.space.name)  # type: ignore[union-attr]
                more = f" + {self.slot('size', 'anchor')}" if node.space.name == "position" else ""  # type: ignore[union-attr]
                first += [f"for {i} in range({size}{more}):", f"    {array}[{self.slot('at', array, at)} + {i}] = 0.0"]
        if self.terms_at >= 0:
            i = self._fresh("i")
            first += [f"for {i} in range({self.slot('size', 'entries')}):",
                      f"    out[{self.slot('at', 'out', self.terms_at)} + {i}] = 0.0"]  # fmt: skip
        for node in self.nodes:
            if node.op == "over_all" and node.number not in self.source:
                self.names[node.number] = name = self._fresh("r")
                first.append(f"{name} = {START[node.value[0]]}")
        body = []
        for depth in range(1 + max(level.values(), default=0)):
            body += self._scalars(depth)
            for space in sorted({s for d, s in self.stage.values() if d == depth and s != SCALAR} | (
                {t.over for t, x in self.terms if x.space is None and level[x.number] == depth}
            )):  # fmt: skip
                body += self._loop(depth, space)
        body += self._last()
        room = self.slot("at", "s", len(self.arrays))
        named = [f"n{k} = table[{k}]" for k in range(len(self.head))]
        lines = [*named, f"s = scratch({room} + 1)", *first, *body, "release(s)"]
        text = "def kernel(a, b, out):\n" + "".join(f"    {line}\n" for line in lines)
        return SpaceKernel(text, self.head, self.inputs, self.outputs, self.arrays)

    def _fresh(self, letter: str) -> str:
        self.count += 1
        return f"{letter}{self.count}"

    def _store(self) -> None:
        """Which values of a loop are read by another loop, and where they stand."""
        for k, slot in enumerate(self.outputs):
            if slot.symbol is not None and slot.symbol.space is not None:
                self.stored.setdefault(slot.symbol.number, ("out", k))
        for node in self.nodes:
            if node.number in self.source:
                continue
            if node.op == "scatter":
                self.stored[node.number] = self._array(node)
            if node.op in ("scatter", "over_all"):
                continue
            for a in node.args:
                elsewhere = node.op == "gather" or self.stage[a.number] != self.stage[node.number]
                if a.space is not None and a.number not in self.stored and elsewhere:
                    self.stored[a.number] = self._array(a)

    def _array(self, node: Symbol) -> tuple[str, int]:
        assert node.space is not None
        self.arrays.append(node.space.name)
        return "s", len(self.arrays) - 1

    # text -----------------------------------------------------------------------------------------------------------

    def _scalars(self, depth: int) -> list[str]:
        lines = []
        for node in self.nodes:
            if self.stage[node.number] != (depth, SCALAR) or (node.op == "over_all" and node.number not in self.source):
                continue
            if node.number in self.source:
                letter, k = self.source[node.number]
                self.names[node.number] = name = self._fresh("c")
                lines.append(f"{name} = {letter}[{self.slot('at', letter, k)}]")
            else:
                lines += self._operation(node, self.names)
        return lines

    def _operation(self, node: Symbol, names: dict[int, str], partner: Symbol | None = None) -> list[str]:
        if node.op == "const":
            names[node.number] = literal(node)
            return []
        if node.op == "mark":
            names[node.number] = names[node.args[0].number]
            return []
        if node.op == "count":
            names[node.number] = name = self._fresh("v")
            return [f"{name} = float({self.slot('size', node.value)})"]
        if node.op == "var":
            raise ValueError(f"the kernel needs {node!r}, which is no input of it")
        names[node.number] = name = self._fresh("v")
        if partner is not None:
            names[partner.number] = f"d{name}"
            return [f"{name}, d{name} = {node.op}_pair({names[node.args[0].number]})"]
        return [f"{name} = {operation(node, [names[a.number] for a in node.args])}"]

    def _loop(self, depth: int, space: str) -> list[str]:
        i, lines = self._fresh("i"), list[str]()
        names = dict(self.names)
        here = [n for n in self.nodes if self.stage[n.number] == (depth, space)]
        slopes = {(n.op, n.args[0].number): n for n in here if n.op in PAIRS.values()}

        def read(x: Symbol) -> str:
            if x.number not in names:
                array, k = self.stored[x.number]
                names[x.number] = name = self._fresh("v")
                lines.append(f"{name} = {array}[{self.slot('at', array, k)} + {i}]")
            return names[x.number]

        wanted = [n for n in here if n.number not in self.source and n.op != "scatter"]
        for node in wanted:
            if node.number in names:
                continue
            if node.op == "gather":
                lines += self._gathered(node, names, i)
                continue
            for a in node.args:
                if a.op == "const":
                    names[a.number] = literal(a)
                else:
                    read(a)
            partner = slopes.get((PAIRS[node.op], node.args[0].number)) if node.op in PAIRS else None
            lines += self._operation(node, names, partner)
        for node in wanted:
            place = self.stored.get(node.number)
            if place:
                lines.append(f"{place[0]}[{self.slot('at', *place)} + {i}] = {names[node.number]}")
        lines += self._summed((depth, space), i, read, names)
        if not lines:
            return []
        return [f"for {i} in range({self.slot('size', space)}):", *(f"    {line}" for line in lines)]

    def _gathered(self, node: Symbol, names: dict[int, str], i: str) -> list[str]:
        source, path = node.args[0], node.value
        array, k = self.stored[source.number]
        j, name = self._fresh("j"), self._fresh("v")
        names[node.number] = name
        lines = [f"{j} = table[{self.slot('path', path)} + {i}]"]
        found = f"{array}[{self.slot('at', array, k)} + {j}]"
        if path[-1].target == "position":
            beyond = "0.0"
            if len(node.args) > 1:
                letter, at = self.stored[node.args[1].number]
                beyond = f"{letter}[{self.slot('at', letter, at)} + {j} - {self.slot('size', 'position')}]"
            found = f"{found} if {j} < {self.slot('size', 'position')} else {beyond}"
        return [*lines, f"{name} = {found}"]

    def _summed(self, stage: tuple[int, str], i: str, read: Any, names: dict[int, str]) -> list[str]:
        """What this loop adds to sums: at the ends of elements, over all, and into a Jacobian."""

        def value(x: Symbol) -> str:
            return literal(x) if x.op == "const" else names[x.number] if x.number in self.names else read(x)

        sums: list[str] = []  # after what they read
        for node in self.nodes:
            if node.number in self.source:
                continue
            if node.op == "scatter":
                array, at = self.stored[node.number]
                for x, m in zip(node.args, node.value, strict=True):
                    if self.stage[x.number] == stage:
                        place = f"{self.slot('at', array, at)} + table[{self.slot('path', (m,))} + {i}]"
                        sums.append(f"{array}[{place}] += {value(x)}")
            elif node.op == "over_all" and self.stage[node.args[0].number] == stage:
                total, item, op = self.names[node.number], value(node.args[0]), node.value[0]
                sums.append(f"{total} = " + (f"{total} + {item}" if op == "add" else f"{op}({total}, {item})"))
        here = [k for k, (term, x) in enumerate(self.terms) if (self.level[x.number], term.over) == stage]
        for m, k in enumerate(here):
            place = f"table[{self.slot('places', *here)} + {len(here)} * {i} + {m}]"
            sums.append(f"out[{self.slot('at', 'out', self.terms_at)} + {place}] += {value(self.terms[k][1])}")
        return sums

    def _last(self) -> list[str]:
        """Outputs that are numbers, inputs, or the same as others."""
        lines = []
        for k, slot in enumerate(self.outputs):
            x = slot.symbol
            if x is None:
                continue
            at = self.slot("at", "out", k)
            if slot.space == SCALAR:
                lines.append(f"out[{at}] = {literal(x) if x.op == 'const' else self.names[x.number]}")
                continue
            if self.stored.get(x.number) == ("out", k) and x.number not in self.source:
                continue
            i = self._fresh("i")
            if x.space is None:
                value = literal(x) if x.op == "const" else self.names[x.number]
            else:
                array, which = self.stored[x.number]
                value = f"{array}[{self.slot('at', array, which)} + {i}]"
            lines += [f"for {i} in range({self.slot('size', slot.space)}):", f"    out[{at} + {i}] = {value}"]
        return lines
