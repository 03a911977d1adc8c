"""Kernels of graphs on arrays (`arrays`): a loop over each space, and another one where it needs sums of the first.

The text knows no sizes: sizes, offsets and index tables stand in the kernel's table. One piece of machine code serves
systems of any size, so that tests of small ones hold for large ones.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import count
from types import MappingProxyType
from typing import Any

import numpy as np

from ..errors import MachineError
from .array_jacobian import Term
from .array_loops import WHOLE, Loop, Place
from .array_mesh import ENTRIES, Block, Mesh, Shorts
from .arrays import LINEAR, NUMBER, Path, collect
from .derivatives import Substitution, topological
from .kernels import Kernel, literal, text_of, written
from .symbols import Symbol

CHEAP = ("add", "sub", "mul", "neg")
LANES = 4  # entries side by side in a record: a short vector of AVX2, half of one of AVX-512
START = {"add": "0.0", "max": "-inf", "min": "inf"}  # initial value of a sum, a maximum, a minimum
Target = tuple[Symbol, Any, str]  # a value that is wanted, its place, the space of that


@dataclass
class ArrayKernel:
    """A kernel for meshes of any size: its text and the layout of its table."""

    text: str
    head: list[tuple[Any, ...]]
    inputs: Mapping[str, Sequence[Block]]
    outputs: Sequence[Block]
    arrays: list[str]  # spaces of the intermediate arrays
    behind: bool  # True: intermediate arrays stand behind the outputs; False: each call allocates them
    rows: Mapping[str, int] = field(default_factory=dict)  # by space, rows of its records behind the arrays

    def kernel(self, mesh: Mesh, places: Sequence[Shorts] = (), extra: int = 0) -> Kernel:
        """The kernel for a mesh. places : of a Jacobian's terms, their entries. extra : doubles behind the outputs."""
        offsets = {letter: mesh.offsets(blocks) for letter, blocks in self.inputs.items()}
        out = offsets["out"] = mesh.offsets(self.outputs)
        size = out[-1] + extra
        records = [rows * _padded(mesh, x) for x, rows in self.rows.items()]
        offsets["s"] = np.cumsum([size * self.behind, *map(mesh.size, self.arrays), *records]).tolist()
        rows: list[Any] = []
        start, numbers = len(self.head), []
        for what, *which in self.head:
            if what == "at":
                numbers.append(offsets[which[0]][which[1]])
            elif what == "size":
                numbers.append(mesh.size(which[0]))
            elif what == "padded":
                numbers.append(_padded(mesh, which[0]))
            elif what == "rows":
                numbers.append(self.rows[which[0]])
            elif what == "record":
                numbers.append(offsets["s"][len(self.arrays) + list(self.rows).index(which[0])])
            else:
                numbers.append(start)
                rows.append(self._row(mesh, places, what, which))
                start += len(rows[-1])
        if max(start, size, *(each[-1] for each in offsets.values())) >= 2**31:
            raise MachineError("A system has more entries than whole numbers of 32 bits can tell: make it smaller.")
        table = np.concatenate([numbers, *rows, [0]], dtype=np.int32, casting="unsafe")
        return Kernel(self.text, size, table, offsets["s"][-1] - size if self.behind else 0)

    def _row(self, mesh: Mesh, places: Sequence[Shorts], what: str, which: Sequence[Any]) -> Any:
        """A row of the table: the ends of a path, as numbers or places in records; or the places of a loop's terms."""
        if what == "places":
            return np.stack([places[k] for k in which], 1).ravel()
        targets = mesh.along(which[0]).clip(0)
        if what == "path":
            return targets
        sizes = np.array([mesh.size(x) for x in which[0][-1].target.split("+")])
        room = np.cumsum(-sizes % LANES) - -sizes % LANES  # empty lanes in the records before each part
        targets += room[np.searchsorted(np.cumsum(sizes), targets, "right")]
        lane = targets % LANES
        return np.pad((targets - lane) * self.rows[which[1]] + lane, (0, -len(targets) % LANES))


def array_kernel(inputs: Mapping[str, Sequence[Block]], outputs: Sequence[Block], behind: bool = False) -> ArrayKernel:
    """The kernel that reads the inputs' blocks and writes the outputs into out, one after the other.

    behind : intermediate arrays stand behind the outputs. Otherwise each call allocates them, and the first touch of
    new pages took a third of the time for a chain of 100,000 masses.
    """
    writer = Writer(stored(inputs), outputs, behind=behind)
    return writer.written(inputs, outputs, writer.lines())


def jacobian_kernel(
    inputs: Mapping[str, Sequence[Block]], before: Sequence[Block], terms: Sequence[tuple[Term, Symbol]],
    last: Sequence[Block], behind: bool = False,
) -> ArrayKernel:  # fmt: skip
    """`array_kernel` with the entries of a Jacobian, the sums of its terms, between other outputs."""
    outputs = [*before, Block(ENTRIES, (None,)), *last]
    writer = Writer(stored(inputs), outputs, terms, len(before), behind)
    return writer.written(inputs, outputs, writer.lines())


def _wanted(outputs: Sequence[Block], terms: Sequence[tuple[Term, Symbol]]) -> list[Symbol]:
    return [x for b in outputs for x in b.symbols if x is not None] + [x for _, x in terms]


def gathered(
    given: Container[int], outputs: Sequence[Block], terms: Sequence[tuple[Term, Symbol]]
) -> tuple[list[Block], list[tuple[Term, Symbol]]]:
    """Outputs and terms in which a sum of collects that nothing else reads is one collect: the force on a node is then
    added up in one array, not in one for each end of a spring. given : numbers of the inputs."""
    wanted, replaced = _wanted(outputs, terms), Substitution({})
    replaced.new |= {x.number: x for x in topological(wanted, given) if x.number in given}
    nodes = topological(wanted, set(replaced.new))
    readers = Counter(x.number for x in [*wanted, *(a for node in nodes for a in node.args)])
    summed: dict[int, list[tuple[Symbol, Path]]] = {}
    for node in nodes:
        if node.number not in replaced.new and node.op == "collect":
            summed[node.number] = list(zip(node.args, node.value, strict=True))
        elif node.op == "add" and all(a.number in summed and readers[a.number] == 1 for a in node.args):
            summed[node.number] = [term for a in node.args for term in summed[a.number]]
            replaced.new[node.number] = collect([(replaced(x), path) for x, path in summed[node.number]])
    new = iter(replaced.all(wanted))
    return (
        [Block(b.space, tuple(x if x is None else next(new) for x in b.symbols)) for b in outputs],
        [(term, next(new)) for term, _ in terms],
    )


def _padded(mesh: Mesh, space: str) -> int:
    """The number of lanes in the records of a space, empty ones included; joined spaces have records each."""
    return sum(-(-mesh.size(x) // LANES) * LANES for x in space.split("+"))


def stored(inputs: Mapping[str, Sequence[Block]]) -> dict[int, Place]:
    """The places of the inputs' symbols, by number."""
    return {
        x.number: Place(letter, k, c, len(block.symbols)) for letter, blocks in inputs.items()
        for k, block in enumerate(blocks) for c, x in enumerate(block.symbols) if x is not None
    }  # fmt: skip


@dataclass
class Shared:
    """What the parts of one text share: its table, its intermediate arrays, the rows of its records, its names."""

    head: dict[tuple[Any, ...], int] = field(default_factory=dict)
    arrays: list[str] = field(default_factory=list)
    rows: dict[str, int] = field(default_factory=dict)
    counter: Iterator[int] = field(default_factory=count)

    def array(self, space: str) -> Place:
        """Add an intermediate array over a space."""
        self.arrays.append(space)
        return Place("s", len(self.arrays) - 1)

    def new(self, space: str, rows: int = 1) -> int:
        """Add rows to the records of a space; returns the first one."""
        row = self.rows.get(space, 0)
        self.rows[space] = row + rows
        return row


class Writer:
    """The text of a kernel, or of a part of one, in loops over single entries.

    placed : by number, the place of each symbol that is given. terms_at : the output that is the Jacobian, or -1.
    """

    def __init__(
        self, placed: Mapping[int, Any], outputs: Sequence[Block], terms: Sequence[tuple[Term, Symbol]] = (),
        terms_at: int = -1, behind: bool = False, shared: Shared | None = None,
    ) -> None:  # fmt: skip
        self.shared, self.behind, self.terms_at = shared or Shared(), behind, terms_at
        self.outputs, self.terms = gathered(placed, outputs, terms)
        self.buffer: Place | None = None  # for the slopes of a group of terms
        self.stored, self.given = dict(placed), set(placed)
        self.names: dict[int, str] = {}
        self.nodes = topological(_wanted(self.outputs, self.terms), self.given)
        self.level = self._levels()
        self.stage = {x.number: (self.level[x.number], x.space) for x in self.nodes}

    def _levels(self) -> dict[int, int]:
        """The round of loops that computes each value: sums, joined arrays and values read elsewhere end a round."""
        level: dict[int, int] = {}
        for node in self.nodes:
            if node.number in self.given or not node.args:
                level[node.number] = 0
            else:
                last = max(level[a.number] for a in node.args)
                waits = node.op in ("collect", "total") or (
                    node.op in ("take", "join", "part")
                    and any(a.number not in self.given and a.args and a.op not in WHOLE for a in node.args)
                )
                level[node.number] = last + waits
        readers: dict[int, list[Symbol]] = {}
        for node in reversed(self.nodes):  # a value that only later loops over its space read is computed there
            here = readers.get(node.number, [])
            computed = node.space and here and node.number not in self.given and node.op not in ("total", *WHOLE)
            if computed and all(x.space == node.space and x.op not in LINEAR for x in here):
                level[node.number] = min(level[x.number] for x in here)
            for a in node.args:
                readers.setdefault(a.number, []).append(node)
        return level

    def slot(self, *what: Any) -> str:
        """The name of the table's number that is `what`."""
        head = self.shared.head
        return f"n{head.setdefault(what, len(head))}"

    def item(self, place: Place, i: str) -> str:
        start = self.slot("at", place.letter, place.block)
        i = " + ".join([i, *(self.slot("size", x) for x in place.behind)])
        array = "out" if place.letter == "s" and self.behind else place.letter
        if place.of == 1:
            return f"{array}[{start} + {i}]"
        return f"{array}[{start} + {place.of} * ({i}) + {place.component}]"

    def fresh(self, letter: str) -> str:
        return f"{letter}{next(self.shared.counter)}"

    def _array(self, node: Symbol) -> Any:
        return self.shared.array(node.space)

    def written(self, inputs: Mapping[str, Sequence[Block]], outputs: Sequence[Block], lines: list[str]) -> ArrayKernel:
        """The kernel of these lines."""
        shared = self.shared
        if (shared.arrays or shared.rows) and not self.behind:
            lines = [f"s = scratch({self.slot('at', 's', -1)})", *lines, "release(s)"]
        text = text_of([*(f"n{k} = table[{k}]" for k in range(len(shared.head))), *lines])
        return ArrayKernel(text, list(shared.head), inputs, outputs, shared.arrays, self.behind, shared.rows)

    def lines(self) -> list[str]:
        """The lines of the kernel: sums are set to 0, then the loops."""
        self._store()
        first: list[str] = []
        computed = [x for x in self.nodes if x.number not in self.given]
        for node in computed:
            if node.op == "collect":
                first += self._zero(node.space, self.stored[node.number])
            elif node.op == "total":
                self.names[node.number] = name = self.fresh("r")
                first.append(f"{name} = {START[node.value[0]]}")
                first += [f"{name}c = 0.0"] if node.value[0] == "add" else []
        if self.terms_at >= 0:
            first += self._zero(ENTRIES, Place("out", self.terms_at))
        stages = {stage for stage in self.stage.values() if stage[1] != NUMBER}
        stages |= {self.stage_of(x, term.over) for term, x in self.terms}
        stages |= {self.stage_of(x, p[0].source) for node in computed if node.op == "collect"
                   for x, p in zip(node.args, node.value, strict=True)}  # fmt: skip
        body = []
        for depth in range(1 + max(self.level.values(), default=0)):
            body += self._numbers(depth)
            for node in computed:
                if node.op == "join" and self.level[node.number] == depth:
                    body += self._joined(node)
            for space in sorted(s for d, s in stages if d == depth):
                body += self._loop(depth, space)
        return [*first, *body, *self._copies(self.targets())]

    def targets(self) -> Iterator[Target]:
        for k, block in enumerate(self.outputs):
            for c, x in enumerate(block.symbols):
                if x is not None:
                    yield x, Place("out", k, c, len(block.symbols)), block.space

    def stage_of(self, x: Symbol, space: str) -> tuple[int, str]:
        return self.level[x.number], space

    def _store(self) -> None:
        """Give a place to each output and to each value that another loop reads."""
        for x, place, _ in self.targets():
            if x.space and x.op not in ("part", "join"):
                self.stored.setdefault(x.number, place)
        kept = self._read_elsewhere()
        for node in (x for x in self.nodes if x.op == "join" and x.number not in self.given):
            whole = self.stored[node.number] = self._array(node)
            for k, x in enumerate(node.args):  # computed into its part of the whole
                if x.space and x.op not in ("join", "part"):
                    self.stored.setdefault(x.number, whole.part(node.value, k))
        for node in self.nodes:
            if node.number in kept and node.number not in self.stored:
                self.stored[node.number] = self._array(node)
            if node.op == "part" and node.number not in self.given:
                k, space = node.value
                self.stored[node.number] = self.stored[node.args[0].number].part(space, k)

    def _read_elsewhere(self) -> set[int]:
        """Values that another loop reads, but for those that it computes again by one cheap operation on such."""
        kept, whole = dict[int, Symbol](), set[int]()
        for node in (x for x in self.nodes if x.number not in self.given):
            moves = node.op in ("take", "join", "part")
            if node.op in ("collect", "join"):
                kept[node.number] = node
            for a in node.args if node.op not in ("collect", "total") else ():
                if a.space and a.op != "part" and (moves or self.stage[a.number] != self.stage[node.number]):
                    kept[a.number] = a
                    whole |= {a.number} if moves else set()
        stored = set(self.stored)
        for number, node in sorted(kept.items()):
            args = (a.number in stored or not a.space for a in node.args)
            if number in whole or node.op not in CHEAP or not all(args):
                stored.add(number)
        return stored

    # text -----------------------------------------------------------------------------------------------------------

    def _loop_over(self, space: str, body: Callable[[str], list[str]]) -> list[str]:
        i = self.fresh("i")
        lines = body(i)
        return [f"for {i} in range({self.slot('size', space)}):", *(f"    {line}" for line in lines)] if lines else []

    def _numbers(self, depth: int) -> list[str]:
        lines = []
        for node in self.nodes:
            if self.stage[node.number] != (depth, NUMBER):
                continue
            if node.number in self.given:
                self.names[node.number] = name = self.fresh("c")
                lines.append(f"{name} = {self.item(self.stored[node.number], '0')}")
            elif node.op != "total":
                lines += self.operation(node, self.names)
        return lines

    def operation(
        self, node: Symbol, names: dict[int, str], derivatives: Mapping[int, Symbol] = MappingProxyType({})
    ) -> list[str]:
        if node.op != "count":
            return written(node, names, self.fresh("v"), derivatives)
        names[node.number] = name = self.fresh("v")
        return [f"{name} = float({self.slot('size', node.value)})"]

    def _joined(self, node: Symbol) -> list[str]:
        places = (self.stored[node.number].part(node.value, k) for k in range(len(node.args)))
        return self._copies(zip(node.args, places, node.value.split("+"), strict=True))

    def _copies(self, targets: Iterable[Target]) -> list[str]:
        """Write values to places where no loop has: numbers, inputs, parts of others, and repeated ones."""
        copied: dict[str, list[tuple[Any, Symbol]]] = {}
        for x, place, space in targets:
            if self.stored.get(x.number) != place or x.number in self.given:
                copied.setdefault(space, []).append((place, x))
        return [line for space in copied for line in self._copied(space, copied[space])]

    def _copied(self, space: str, copied: Sequence[tuple[Any, Symbol]]) -> list[str]:
        def body(i: str) -> list[str]:
            values = (self.item(self.stored[x.number], i) if x.space else self._number(x) for _, x in copied)
            return [f"{self.item(place, i)} = {value}" for (place, _), value in zip(copied, values, strict=True)]

        return self._loop_over(space, body) if space else body("0")

    def _zero(self, space: str, place: Place) -> list[str]:
        return self._loop_over(space, lambda i: [f"{self.item(place, i)} = 0.0"])

    def _number(self, x: Symbol) -> str:
        return literal(x) if x.op == "const" else self.names[x.number]

    def _loop(self, depth: int, space: str) -> list[str]:
        return self._loop_over(space, lambda i: Loop(self, depth, space, i).lines)
