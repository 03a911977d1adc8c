"""Large graphs become loops: equal pieces of a graph are one loop over what they read, whatever the system is.

A graph of thousands of elements, unrolled, is more code than a compiler can take. It is cut into pieces that each
compute one value that others share; equal pieces (the same operations on other places) at the same depth form a group,
and a group is one loop with a table of places. A mesh has a hundred groups, whatever its size.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .derivatives import topological
from .kernels import Kernel, literal, operation
from .symbols import Symbol

LONGEST = 16  # terms of a sum that are written out; a longer one is a loop of its own
CHAINS = ("add", "max", "min")
Place = tuple[str, int]  # array and index


@dataclass(frozen=True)
class _Piece:
    """One value: its class (equal pieces are equal text), the places that it reads in order, and what it is."""

    key: tuple[str, ...]
    leaves: tuple[Symbol, ...]
    root: Symbol


def rolled(inputs: Mapping[Symbol, str], outputs: Sequence[Symbol]) -> Kernel:
    """The kernel that reads `inputs` (symbol -> 'a[0]') and fills out[0], out[1], ..., as loops."""
    return _Roller({s: _place(text) for s, text in inputs.items()}, outputs).kernel()


def _place(text: str) -> Place:
    array, _, index = text.partition("[")
    return array, int(index.removesuffix("]"))


class _Roller:
    def __init__(self, inputs: Mapping[Symbol, Place], outputs: Sequence[Symbol]) -> None:
        self.outputs, self.places = outputs, {s.number: place for s, place in inputs.items()}
        self.inputs = {s.number for s in inputs}
        self.nodes = topological(outputs, self.inputs)
        self.lines: list[str] = []
        self.table: list[int] = []
        self.loops, self.names, self.scratch = 0, 0, 0

    def kernel(self) -> Kernel:
        roots, chains = self._cut()
        groups: dict[tuple[Any, ...], list[_Piece]] = {}
        level = dict.fromkeys(self.inputs, 0)
        self.chains: list[tuple[int, Symbol, list[Symbol]]] = []
        for node in self.nodes:  # arguments first
            if node.number not in roots or node.number in self.inputs or node.op == "const":
                continue
            if node.number in chains:
                terms = chains[node.number]
                depth = 1 + max(level.get(x.number, 0) for x in terms)
                groups[depth, "chain", node.number] = [_Piece((node.op,), tuple(terms), node)]
            else:
                piece = self._piece(node, roots)
                depth = 1 + max((level[x.number] for x in piece.leaves), default=0)
                groups.setdefault((depth, "loop", piece.key), []).append(piece)
            level[node.number] = depth
        wanted: dict[int, int] = {}
        for i, node in enumerate(self.outputs):
            wanted.setdefault(node.number, i)
        for (_, kind, _), pieces in sorted(groups.items(), key=lambda item: item[0][0]):
            pieces.sort(key=lambda piece: wanted.get(piece.root.number, -1))
            self._settle(pieces, wanted)
            (self._chain if kind == "chain" else self._loop)(pieces)
        self._copies(wanted)
        head = f"    s = scratch({max(1, self.scratch)})\n"
        body = "".join(f"    {line}\n" for line in self.lines)
        text = f"def kernel(a, b, out):\n{head}{body}    release(s)\n"
        return Kernel(text, len(self.outputs), np.array([*self.table, 0], dtype=np.int64))

    def _cut(self) -> tuple[set[int], dict[int, list[Symbol]]]:
        """Numbers of the nodes that are values of their own: those that several pieces read; and of long sums the
        terms."""
        users: dict[int, list[Symbol]] = {}
        for node in self.nodes:
            if node.number not in self.inputs:
                for a in node.args:
                    users.setdefault(a.number, []).append(node)
        roots = {node.number for node in self.outputs} | self.inputs
        chains = self._long_chains(users, roots)
        owner: dict[int, int] = {}
        for terms in chains.values():
            roots |= {x.number for x in terms}
        roots |= set(chains)
        for node in reversed(self.nodes):
            owners = {owner[u.number] for u in users.get(node.number, ()) if u.number in owner}
            if node.number in roots or len(owners) != 1:
                roots.add(node.number)
                owner[node.number] = node.number
            else:
                (owner[node.number],) = owners
        return roots, chains

    def _long_chains(self, users: Mapping[int, list[Symbol]], roots: set[int]) -> dict[int, list[Symbol]]:
        """Sums (extremes) of many terms that nothing else reads half-way: number of the last -> terms in order."""
        found: dict[int, list[Symbol]] = {}
        terms: dict[int, list[Symbol]] = {}
        for node in self.nodes:
            if node.op not in CHAINS or node.number in self.inputs:
                continue
            x, y = sorted(node.args, key=lambda a: -len(terms.get(a.number, ())))
            inner = terms.get(x.number)
            if inner and x.op == node.op and len(users[x.number]) == 1 and x.number not in roots:
                terms[node.number] = inner
                inner.append(y)
                found.pop(x.number, None)
            else:
                terms[node.number] = list(node.args)
            if len(terms[node.number]) > LONGEST:
                found[node.number] = terms[node.number]
        return found

    def _piece(self, root: Symbol, roots: set[int]) -> _Piece:
        """The operations under a root down to other roots, in an order that depends on their structure alone."""
        names: dict[int, str] = {}
        leaves: list[Symbol] = []
        key: list[str] = []
        stack = [(root, False)]
        while stack:
            node, ready = stack.pop()
            if node.number in names:
                continue
            if node.op == "const":
                names[node.number] = literal(node)
            elif node is not root and node.number in roots:
                names[node.number] = f"x{len(leaves)}"
                leaves.append(node)
            elif not ready:
                stack.append((node, True))
                stack += [(a, False) for a in reversed(node.args)]
            elif node.op == "mark":
                names[node.number] = names[node.args[0].number]
            else:
                names[node.number] = f"t{len(key)}"
                key.append(operation(node, [names[a.number] for a in node.args]))
        arrays = [self.places.get(x.number, ("s", 0))[0] for x in leaves]
        return _Piece((*key, names[root.number], *arrays), tuple(leaves), root)

    def _settle(self, pieces: Sequence[_Piece], wanted: Mapping[int, int]) -> None:
        """Where the values of a group go: to their places among the outputs, or beside each other."""
        for piece in pieces:
            at = wanted.get(piece.root.number)
            if at is None:
                self.places[piece.root.number] = ("s", self.scratch)
                self.scratch += 1
            else:
                self.places[piece.root.number] = ("out", at)

    def _access(self, places: Iterable[Place], i: str) -> str:
        """The item of entry i: by a formula if there is one, otherwise by the table."""
        found = list(places)
        array, index = found[0][0], np.array([at for _, at in found])
        if len(found) == 1 or np.all(index == index[0]):
            return f"{array}[{index[0]}]"
        if np.all(np.diff(index) == 1):
            return f"{array}[{index[0]} + {i}]"
        start = len(self.table)
        self.table += index.tolist()
        return f"{array}[table[{start} + {i}]]"

    def _loop(self, pieces: Sequence[_Piece]) -> None:
        by_arrays: dict[tuple[str, ...], list[_Piece]] = {}
        for piece in pieces:  # places of what was made since may be in two arrays
            arrays = [self.places[x.number][0] for x in (*piece.leaves, piece.root)]
            by_arrays.setdefault(tuple(arrays), []).append(piece)
        for group in by_arrays.values():
            i = f"i{self.loops}"
            self.loops += 1
            lines, names = [], {}
            for k in range(len(group[0].leaves)):
                names[f"x{k}"] = name = self._name()
                lines.append(f"{name} = {self._access([self.places[p.leaves[k].number] for p in group], i)}")
            *steps, result = group[0].key[: len(group[0].key) - len(group[0].leaves)]
            for k, step in enumerate(steps):
                names[f"t{k}"] = name = self._name()
                lines.append(f"{name} = {_renamed(step, names)}")
            lines.append(f"{self._access([self.places[p.root.number] for p in group], i)} = {_renamed(result, names)}")
            self.lines += [f"for {i} in range({len(group)}):", *(f"    {line}" for line in lines)]

    def _name(self) -> str:
        self.names += 1
        return f"v{self.names}"

    def _chain(self, pieces: Sequence[_Piece]) -> None:
        """A long sum, in the author's order."""
        (piece,) = pieces
        total, runs = self._name(), list[list[Place]]()
        for x in piece.leaves:
            place = self.places.get(x.number) or ("const", 0)
            if runs and runs[-1][0][0] == place[0] != "const":
                runs[-1].append(place)
            else:
                runs.append([place if place[0] != "const" else (literal(x), 0)])
        op = piece.key[0]
        started = False
        for run in runs:
            constant = run[0][0] not in ("a", "b", "s", "out")
            i = f"i{self.loops}"
            self.loops += 1
            item = run[0][0] if constant else self._access(run if started else run[1:] or run, i)
            if not started:
                self.lines.append(f"{total} = {run[0][0] if constant else f'{run[0][0]}[{run[0][1]}]'}")
                started, count = True, 0 if constant else len(run) - 1
            else:
                count = len(run)
            if count:
                joined = f"{total} + {item}" if op == "add" else f"{op}({total}, {item})"
                self.lines += [f"for {i} in range({count}):", f"    {total} = {joined}"]
        array, at = self.places[piece.root.number]
        self.lines.append(f"{array}[{at}] = {total}")

    def _copies(self, wanted: Mapping[int, int]) -> None:
        """Outputs that are constants, inputs, or the same as another output."""
        groups: dict[str, list[tuple[Place, int]]] = {}
        for i, node in enumerate(self.outputs):
            if node.op == "const":
                groups.setdefault(literal(node), []).append((("", 0), i))
            elif self.places[node.number] != ("out", i):
                place = self.places[node.number]
                groups.setdefault(f" {place[0]}", []).append((place, i))
        for value, copies in groups.items():
            name = f"i{self.loops}"
            self.loops += 1
            source = self._access([place for place, _ in copies], name) if value.startswith(" ") else value
            target = self._access([("out", at) for _, at in copies], name)
            self.lines += [f"for {name} in range({len(copies)}):", f"    {target} = {source}"]


def _renamed(text: str, names: Mapping[str, str]) -> str:
    """The text of a piece with its own names."""
    return "".join(names.get(word, word) for word in _words(text))


def _words(text: str) -> list[str]:
    words, word = [], ""
    for c in text:
        if c.isalnum() or c == "_":
            word += c
        else:
            words += [word, c]
            word = ""
    return [*words, word]
