"""The text of one loop over the entries of a space, for kernels of graphs on arrays (`array_kernels`)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from .arrays import Path
from .derivatives import topological
from .kernels import derivatives_of, literal
from .symbols import Symbol

WHOLE = ("collect", "join", "part")  # operations whose results are complete before the loops of their round
GROUP = 64  # slopes in one piece of straight-line code: LLVM takes the square of its length


class Place(NamedTuple):
    """The place of an array: argument of the kernel, block of it, component and number of components."""

    letter: str
    block: int
    component: int = 0
    of: int = 1
    behind: tuple[str, ...] = ()  # spaces of the joined arrays that precede it

    def part(self, space: str, k: int) -> Place:
        """The k-th of joined arrays over space "a+b"."""
        return self._replace(behind=(*self.behind, *space.split("+")[:k]))


class Loop:
    """The lines of one loop, for entry i."""

    def __init__(self, writer: Any, depth: int, space: str, i: str) -> None:
        self.start(writer, depth, space, i)
        terms = [k for k, (term, x) in enumerate(writer.terms) if writer.stage_of(x, term.over) == (depth, space)]
        kept = [(x, writer.stored[x.number]) for x in self.here if x.number in writer.stored and x.op not in WHOLE]
        sums = list(self._summed((depth, space)))
        groups = [range(k, min(k + GROUP, len(terms))) for k in range(0, len(terms), GROUP)]
        self._make([x for x, _ in kept] + [x for _, x, _ in sums] if len(groups) > 1 else self.here)
        self.lines += [f"{writer.item(place, i)} = {self.names[x.number]}" for x, place in kept]
        for each in sums:
            self._sum(*each)
        for group in groups:
            of_terms = [writer.terms[terms[m]][1] for m in group]
            if len(groups) == 1:
                places = zip(group, of_terms, strict=True)
                self.lines += [
                    f"{self._entry(terms, str(m))} += {value}" for m, x in places for value in [self.value(x)]
                ]
            else:
                self._make(of_terms)
                self._entries(terms, group, [self.value(x) for x in of_terms])

    def start(self, writer: Any, depth: int, space: str, i: str) -> None:
        """Set the fields of every kind of loop."""
        self.w, self.i, self.space, self.lines = writer, i, space, list[str]()
        self.names: dict[int, str] = dict(writer.names)
        self.indices: dict[Any, str] = {}
        self.here = [
            x for x in writer.nodes if writer.stage[x.number] == (depth, space) and x.number not in writer.given
        ]
        self.derivatives = derivatives_of(self.here)

    def _summed(self, stage: tuple[int, str]) -> Iterator[tuple[Symbol, Symbol, Path]]:
        """The sums to which this loop adds: (sum, term, path); the path of a sum over all entries is ()."""
        for node in self.w.nodes:
            if node.number in self.w.given:
                continue
            if node.op == "collect":
                parts = zip(node.args, node.value, strict=True)
                yield from ((node, x, path) for x, path in parts if self.w.stage_of(x, path[0].source) == stage)
            elif node.op == "total" and self.w.stage_of(node.args[0], node.value[1]) == stage:
                yield node, node.args[0], ()

    def _make(self, wanted: Sequence[Symbol]) -> None:
        """Compute the values of this loop that the wanted ones need."""
        writer, needed = self.w, {x.number for x in topological(wanted, set(self.names))}
        for node in self.here:
            if node.number not in needed or node.number in self.names or node.op in WHOLE:
                continue
            if node.op == "take":
                taken = self.taken(writer.stored[node.args[0].number], node.value)
                self.names[node.number] = name = writer.fresh("v")
                self.lines.append(f"{name} = {taken}")
                continue
            for a in node.args:
                self.value(a)
            self.lines += writer.operation(node, self.names, self.derivatives)

    def _entry(self, terms: Sequence[int], which: str) -> str:
        """The entry of the Jacobian to which a term adds."""
        place = f"table[{self.w.slot('places', *terms)} + {len(terms)} * {self.i} + {which}]"
        item: str = self.w.item(Place("out", self.w.terms_at), place)
        return item

    def _entries(self, terms: Sequence[int], group: range, values: Sequence[str]) -> None:
        """Add the slopes of a group of terms to the Jacobian, in an inner loop."""
        w = self.w
        if w.buffer is None:
            w.buffer = w.shared.array(f"#{GROUP}")
        self.lines += [f"{w.item(w.buffer, str(m))} = {value}" for m, value in enumerate(values)]
        each = w.fresh("i")
        self.lines.append(f"for {each} in range({w.slot('size', f'#{len(group)}')}):")
        entry = self._entry(terms, f"{group.start} + {each}")
        self.lines.append(f"    {entry} += {w.item(w.buffer, each)}")

    def index(self, path: Path) -> str:
        if path not in self.indices:
            self.indices[path] = j = self.w.fresh("j")
            self.lines.append(f"{j} = table[{self.w.slot('path', path)} + {self.i}]")
        return self.indices[path]

    def read(self, place: Any) -> str:
        """The text of a place at this entry."""
        text: str = self.w.item(place, self.i)
        return text

    def taken(self, place: Any, path: Path) -> str:
        """The text of a place at the entry at a path's end."""
        text: str = self.w.item(place, self.index(path))
        return text

    def value(self, x: Symbol) -> str:
        if x.number not in self.names:
            if x.op == "const":
                self.names[x.number] = literal(x)
            elif x.number not in self.w.stored:
                for a in x.args:
                    self.value(a)
                self.lines += self.w.operation(x, self.names)
            else:
                self.names[x.number] = name = self.w.fresh("v")
                self.lines.append(f"{name} = {self.read(self.w.stored[x.number])}")
        return self.names[x.number]

    def _sum(self, node: Symbol, x: Symbol, path: Path) -> None:
        """Add a term to a sum along a table or over all entries."""
        item = self.value(x)
        if path:
            self.lines.append(f"{self.taken(self.w.stored[node.number], path)} += {item}")
        else:
            self.lines += self.totalled(node, item)

    def totalled(self, node: Symbol, item: str) -> list[str]:
        """The lines that add an item to a sum, or a maximum, over all entries."""
        w, name, op = self.w, self.w.names[node.number], node.value[0]
        if op != "add":
            return [f"{name} = {op}({name}, {item})"]
        y, t = w.fresh("y"), w.fresh("t")  # compensated (Kahan 1965): of terms that are alike round-off has one sign
        return [
            f"{y} = {item} - {name}c", f"{t} = {name} + {y}", f"{name}c = ({t} - {name}) - {y}", f"{name} = {t}",
            f"{name}c = {name}c if abs({t}) < inf else 0.0",  # infinity has no compensation
        ]  # fmt: skip
