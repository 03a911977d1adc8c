"""Text of kernels on arrays that keep rows of numbers in records, with loops over LANES entries at once.

A record has LANES entries of a space side by side, one row after the other; each of joined spaces has its own records.
A row of the entries from i on, i a multiple of LANES, is a short vector.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from types import MappingProxyType
from typing import Any, NamedTuple

from .array_kernels import LANES, Shared, Target, Writer
from .array_loops import WHOLE, Loop, Place
from .array_mesh import Block
from .arrays import Path
from .derivatives import lifted
from .symbols import Symbol

AT_ONCE = 8  # convolutions in one inner loop: their vectors and factors fit into registers


class Slot(NamedTuple):
    """A row of the records of a space, `order` rows further. before : the joined spaces that precede it."""

    space: str
    row: int
    order: str = ""
    before: str = ""

    def part(self, space: str, k: int) -> Slot:
        """The k-th of joined arrays over space "a+b"."""
        return self._replace(before="+".join(space.split("+")[:k]))


class Output(NamedTuple):
    """A component of a block of `out`, or of the block `order` times as far behind it as `second` is."""

    first: int
    second: int
    component: int
    of: int
    order: str


class Part(Writer):
    """A part of a text that reads records, in loops over single entries."""

    def __init__(self, shared: Shared, given: Mapping[int, Any], wanted: Sequence[Target]) -> None:
        super().__init__(given, [Block(space, (x,)) for x, _, space in wanted], shared=shared)
        self.wanted = [place for _, place, _ in wanted]

    def targets(self) -> Iterator[Target]:
        for block, place in zip(self.outputs, self.wanted, strict=True):
            yield lifted(block.symbols[0]), place, block.space

    def item(self, place: Any, i: str) -> str:
        if isinstance(place, Place):
            return super().item(place, i)
        if isinstance(place, Output):
            first, second = (self.slot("at", "out", k) for k in place[:2])
            return f"out[{first} + {place.order} * ({second} - {first}) + {place.of} * ({i}) + {place.component}]"
        offset = "" if i == "0" else f" + {i}o"
        return f"s[{self.record(place)}{offset} + {LANES * place.row}]"

    def _loop(self, depth: int, space: str) -> list[str]:
        return self._loop_over(space, lambda i: Single(self, depth, space, i).lines)

    def _loop_over(self, space: str, body: Callable[[str], list[str]]) -> list[str]:
        def with_offset(i: str) -> list[str]:
            lines, lane = body(i), f"{i} % {LANES}"
            if not any(f"{i}o" in x for x in lines):
                return lines
            return [f"{i}o = ({i} - {lane}) * {self.slot('rows', space)} + {lane}", *lines]

        return super()._loop_over(space, with_offset)

    def record(self, place: Slot) -> str:
        """The text of the place of the first record, at the slot's order."""
        text = self.slot("record", place.space) + (f" + {LANES} * {place.order}" if place.order else "")
        if place.before:
            text += f" + {self.slot('padded', place.before)} * {self.slot('rows', place.space)}"
        return text

    def lanes(self, place: Slot, path: Path) -> str:
        """The table's number that begins the ends of a path, as places in the slot's records."""
        return self.slot("lanes", path, place.space)


class Single(Loop):
    """The lines of one loop of a `Part`, for entry i."""

    def taken(self, place: Any, path: Path) -> str:
        if not isinstance(place, Slot):
            return super().taken(place, path)
        key = path, place.space
        if key not in self.indices:
            self.indices[key] = j = self.w.fresh("j")
            self.lines.append(f"{j} = table[{self.w.lanes(place, path)} + {self.i}]")
        return f"s[{self.w.record(place)} + {self.indices[key]} + {LANES * place.row}]"


class Middle(Part):
    """The body of the loop over orders, for LANES entries at once."""

    def _array(self, node: Symbol) -> Any:
        return Slot(node.space, self.shared.new(node.space))

    def _store(self) -> None:
        self.places: dict[int, list[Any]] = {}  # the places of a value that a loop computes
        for x, place, _ in self.targets():
            if x.space and x.number not in self.given:
                self.places.setdefault(x.number, []).append(place)
                if isinstance(place, Slot) and x.op != "part":
                    self.stored.setdefault(x.number, place)
        kept = self._read_elsewhere() | set(self.places)
        computed = [x for x in self.nodes if x.number not in self.given]
        for node in computed:
            if node.op in ("collect", "total", *WHOLE):
                kept |= {node.number, *(a.number for a in node.args)}
        for node in (x for x in computed if x.op == "join"):
            whole = self.stored.setdefault(node.number, self._array(node))
            for k, x in enumerate(node.args):
                if x.space and x.number not in self.given:
                    self.places.setdefault(x.number, []).append(whole.part(node.value, k))
                    self.stored.setdefault(x.number, whole.part(node.value, k))
        for node in computed:
            if node.op == "part":
                k, space = node.value
                self.stored[node.number] = self.stored[node.args[0].number].part(space, k)
            elif node.number in kept and node.space and node.number not in self.stored:
                self.stored[node.number] = self._array(node)

    def _copies(self, targets: Iterable[Target]) -> list[str]:
        lines = []
        for x, place, space in targets:
            if not space:
                lines.append(f"{self.item(place, '0')} = {self._number(x)}")
            elif not x.space or x.number in self.given or x.op in WHOLE:  # a loop writes others to all their places
                lines += self._lanes_copied(place, x, space)
        return lines

    def _lanes_copied(self, place: Any, x: Symbol, space: str) -> list[str]:
        def body(i: str) -> list[str]:
            source = self.row(self.stored[x.number], i) if x.space else ""
            if isinstance(place, Slot):
                value = f"row(s, {source}, {LANES})" if source else everywhere(self._number(x))
                return [f"put(s, {self.row(place, i)}, {value})"]
            lane = self.fresh("l")
            item, value = self.item(place, f"{i} + {lane}"), f"s[{source} + {lane}]" if source else self._number(x)
            return self.one_by_one(lane, space, i, [f"{item} = {value}"])

        return [] if self.stored.get(x.number) == place else self._in_lanes(space, body)

    def one_by_one(self, lane: str, space: str, i: str, lines: Sequence[str]) -> list[str]:
        """The lines for each lane from i on that has an entry."""
        left = f"min({LANES}, {self.slot('size', space)} - {i})"
        return [f"for {lane} in range({left}):", *(f"    {line}" for line in lines)] if lines else []

    def _zero(self, space: str, place: Any) -> list[str]:
        return self._in_lanes(space, lambda i: [f"put(s, {self.row(place, i)}, {everywhere('0.0')})"])

    def _loop(self, depth: int, space: str) -> list[str]:
        return self._in_lanes(space, lambda i: Lanes(self, depth, space, i).lines)

    def _in_lanes(self, space: str, body: Callable[[str], list[str]]) -> list[str]:
        i = self.fresh("i")
        lines, size = body(i), self.slot("size", space)
        return [f"for {i} in range(0, {size}, {LANES}):", *(f"    {line}" for line in lines)] if lines else []

    def row(self, place: Slot, i: str) -> str:
        """The text of the place of a row of the LANES entries from i on."""
        return f"{self.record(place)} + {i} * {self.slot('rows', place.space)} + {LANES * place.row}"

    def operation(
        self, node: Symbol, names: dict[int, str], derivatives: Mapping[int, Symbol] = MappingProxyType({})
    ) -> list[str]:
        if node.op != "convolved":
            return super().operation(node, names, derivatives)
        return self.convolutions([node], names, {})

    def convolutions(self, nodes: Sequence[Symbol], names: dict[int, str], records: Mapping[str, str]) -> list[str]:
        """An inner loop for convolutions of one n. records : by space, the place of the lanes' record."""
        first, lines, name_of, (n,) = list[str](), list[str](), dict[Any, str](), {x.value[2] for x in nodes}
        j = self.fresh("j")

        def factor(kept: Any, order: str) -> str:
            begin, key = (kept.space, order), (kept, order)
            if begin not in name_of:
                name_of[begin] = self.fresh("u")
                at = records.get(kept.space) or self.slot("record", kept.space)
                lines.append(f"{name_of[begin]} = {at} + {LANES} * {order}")
            if key not in name_of:
                name_of[key], at = self.fresh("v"), f"{name_of[begin]} + {LANES * kept.row}"
                lines.append(f"{name_of[key]} = {f'row(s, {at}, {LANES})' if kept.space else f's[{at}]'}")
            return name_of[key]

        for node in nodes:
            names[node.number] = name = self.fresh("v")
            first.append(f"{name} = {everywhere('0.0') if node.space else '0.0'}")
            a, b = factor(node.value[0], j), factor(node.value[1], f"(k + {n} - {j})")
            lines.append(f"{name} = {name} + {a} * {b}")
        return [*first, f"for {j} in range(1, k + {n}):", *(f"    {line}" for line in lines)]


def everywhere(value: str) -> str:
    """A number in every lane."""
    return f"vector({', '.join([value] * LANES)})"


class Lanes(Loop):
    """The lines of one loop of `Middle`, for LANES entries from i on."""

    def __init__(self, writer: Middle, depth: int, space: str, i: str) -> None:
        self.start(writer, depth, space, i)
        self.now, self.at_k = writer.fresh("p"), writer.fresh("p")  # places of their record, and of its rows of order k
        self.ways: dict[Any, list[str]] = {}  # by path, the places of the records at its end
        sums = sorted((x for x in self.here if x.op == "convolved"), key=lambda x: (x.value[2], x.number))
        for _, group in groupby(sums, lambda x: x.value[2]):
            alike = list(group)
            for k in range(0, len(alike), AT_ONCE):
                self.lines += writer.convolutions(alike[k : k + AT_ONCE], self.names, {space: self.now})
        self._make(self.here)
        outputs = []
        for x in (x for x in self.here if x.number in writer.stored and x.op not in WHOLE):
            for place in dict.fromkeys([writer.stored[x.number], *writer.places.get(x.number, ())]):
                if isinstance(place, Slot):
                    self.lines.append(f"put(s, {self.at(place)}, {self.value(x)})")
                else:
                    outputs.append((x, place))
        self._one_by_one(outputs, list(self._summed((depth, space))))
        if self.lines:
            begin = f"{writer.slot('record', space)} + {i} * {writer.slot('rows', space)}"
            self.lines = [f"{self.now} = {begin}", f"{self.at_k} = {self.now} + {LANES} * k", *self.lines]

    def at(self, place: Slot) -> str:
        """The text of the place of a slot's row."""
        if place.space != self.space:
            text: str = self.w.row(place, self.i)
            return text
        return f"{self.at_k if place.order else self.now} + {LANES * place.row}"

    def read(self, place: Slot) -> str:
        return f"row(s, {self.at(place)}, {LANES})"

    def taken(self, place: Slot, path: Path) -> str:
        key = path, place._replace(row=0)
        if key not in self.ways:
            self.ways[key] = [self.w.fresh("j") for _ in range(LANES)]
            address = f"{self.w.record(place)} + table[{self.w.lanes(place, path)} + {self.i}"
            self.lines += [f"{j} = {address} + {lane}]" for lane, j in enumerate(self.ways[key])]
        return f"vector({', '.join(f's[{j} + {LANES * place.row}]' for j in self.ways[key])})"

    def _one_by_one(
        self, outputs: Sequence[tuple[Symbol, Output]], sums: Sequence[tuple[Symbol, Symbol, Path]]
    ) -> None:
        """The lines that write outputs and add to sums, lane by lane."""
        w, lane, ways = self.w, self.w.fresh("l"), dict[Any, str]()

        def value(x: Symbol) -> str:
            return f"s[{self.at(w.stored[x.number])} + {lane}]" if x.space else self.value(x)

        lines = [f"{w.item(place, f'{self.i} + {lane}')} = {value(x)}" for x, place in outputs]
        for node, x, path in sums:
            if not path:
                lines += self.totalled(node, value(x))
                continue
            target = w.stored[node.number]
            key = path, target._replace(row=0)
            if key not in ways:
                ways[key] = w.fresh("j")
                lines.append(f"{ways[key]} = {w.record(target)} + table[{w.lanes(target, path)} + {self.i} + {lane}]")
            lines.append(f"s[{ways[key]} + {LANES * target.row}] += {value(x)}")
        self.lines += w.one_by_one(lane, self.space, self.i, lines)
