"""Grouping of Taylor series into vectors: series of the same operation that do not depend on each other share one.

Equal elements of a system have equal series, and so have the directions of space: a Cauchy product of four of them
costs what one does. What is not alike is brought together by shuffling lanes (`Gathering`).
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

from tcbench.compiler import derivatives as trace
from tcbench.compiler.derivatives import Symbol

from .series import Series

WIDTH = 4  # lanes at most
DERIVATIVES = 3  # how far ahead of the order that is written a series may be asked for: rates of rates
Pack = tuple[Series, ...]


def reachable(starts: Iterable[Series]) -> list[Series]:
    """The series that these are made of, in the order in which they are found."""
    seen: dict[int, Series] = {}
    waiting = list(starts)
    while waiting:
        x = waiting.pop(0)
        if id(x) not in seen:
            seen[id(x)] = x
            waiting += x.parts
    return list(seen.values())


def kinks(rate: Iterable[Series]) -> list[Series]:
    """What keeps its sign in a step: what rates have the sign of, or the size, and roots, unlike their series."""
    found = (x for x in reachable(rate) if x.kind in ("sign", "sqrt"))
    return list(dict.fromkeys(x if x.kind == "sqrt" else x.parts[0] for x in found))


def is_square(x: Series) -> bool:
    return x.kind == "product" and x.parts[0] is x.parts[1]


class Packs:
    """Every series but sums and derivatives in a pack of its kind: `home` has the pack and the lane of each."""

    def __init__(self, rate: dict[int, Series], variables: list[Series]) -> None:
        self.rate = rate
        self.waits: dict[tuple[int, int], int] = {}
        self.home: dict[int, tuple[Pack, int]] = {}
        self.rank: dict[int, int] = {}
        alike: dict[tuple[object, ...], list[Series]] = {}
        every = reachable([*variables, *rate.values()])
        place = {id(part): i for x in reversed(every) for i, part in enumerate(x.parts)}  # in what uses it first
        for x in every:
            if x.kind not in ("sum", "D"):
                alike.setdefault((*self.steps(x), x.kind, is_square(x)), []).append(x)
        for _, members in sorted(alike.items(), key=lambda item: item[0]):
            parts = self.parts(tuple(members))
            parts.sort(key=lambda part: -len(set(part)))  # first those in which the members differ most
            keys = [(x.index, *(self.rank.get(id(part[i]), len(self.rank)) for part in parts), place.get(id(x), 0), i)
                    for i, x in enumerate(members)]  # fmt: skip
            members = [members[key[-1]] for key in sorted(keys)]
            wide = math.ceil(len(members) / math.ceil(len(members) / WIDTH))  # six as three and three: space has three
            for i in range(0, len(members), wide):
                pack = tuple(members[i : i + wide])
                self.home |= {id(x): (pack, lane) for lane, x in enumerate(pack)}
            operands = [x for part in self.parts(tuple(members)) for x in part]
            for x in operands + [x for x in members if x.kind != "var"]:
                self.rank.setdefault(id(x), len(self.rank))

    def parts(self, pack: Pack) -> list[Pack]:
        """The first parts of its series, the second ones, ...: of products, first the factor that is known first."""
        rows = (sorted(x.parts, key=self.steps) if x.kind == "product" else x.parts for x in pack)
        return list(zip(*rows, strict=True))

    def steps(self, x: Series) -> tuple[int, ...]:
        """How many operations coefficients n, n + 1, ... wait for that no coefficient below n has: alike in a pack."""
        return tuple(self._steps(x, ahead) for ahead in range(DERIVATIVES))

    def _steps(self, x: Series, ahead: int) -> int:
        key = (id(x), ahead)
        if key not in self.waits:
            if x.kind == "sign":  # of first coefficients: one sign may be made of another
                found = 1 + self._steps(x.parts[0], 0)
            elif x.constant:
                found = 0
            elif x.kind == "var":
                found = 0 if ahead == 0 else self._steps(self.rate[x.index], ahead - 1)
            elif x.kind == "D":
                found = self._steps(x.parts[0], ahead + 1)
            elif x.kind == "atan2":  # from the turn before
                turn, *sides = x.parts
                found = 1 + max([self._steps(y, 0) for y in sides] + [self._steps(turn, k) for k in range(ahead)])
            else:
                parts = [self._steps(part, k) for part in x.parts for k in range(ahead + 1)]
                found = max(parts, default=0) + (x.kind != "sum")
            self.waits[key] = found
        return self.waits[key]


class Term(NamedTuple):
    """weight times a lane of a vector that has a name; without one, the weight alone."""

    weight: Symbol
    name: str = ""
    width: int = 0
    lane: int = 0


@dataclass
class Slot:
    """At most one term for each lane, from vectors of one width."""

    terms: dict[int, Term]

    @property
    def names(self) -> list[str]:
        return list(dict.fromkeys(term.name for term in self.terms.values()))

    @property
    def width(self) -> int:
        return next(iter(self.terms.values())).width

    def takes(self, lane: int, term: Term) -> bool:
        return lane not in self.terms and self.names == [term.name]

    def joins(self, other: Slot) -> bool:
        few = self.width == 1 or len({*self.names, *other.names}) <= 2
        return self.width == other.width and few and not set(self.terms) & set(other.terms)


class Gathering:
    """Sums of terms, lane by lane, as text."""

    def __init__(self, first: int) -> None:
        self.first = first  # place in `b` of the constants that are not numbers
        self.given: list[Symbol] = []  # these constants, those of a vector one after the other
        self.lines: list[str] = []
        self.written: dict[str, str] = {}
        self.ready: dict[str, int] = {}
        self.rows: dict[tuple[int, ...], str] = {}

    def name(self, text: str, ready: int = 0) -> str:
        """The name of this text's value: equal texts have one. ready: when it is known, in operations."""
        if text in self.ready:
            return text
        if text not in self.written:
            name = self.written[text] = f"t{len(self.lines)}"
            self.lines.append(f"{name} = {text}")
            self.ready[name] = ready or 1 + self.known(text)
        return self.written[text]

    def known(self, text: str) -> int:
        """When all that stands in a text is known."""
        return max((self.ready[x] for x in re.findall(r"\bt\d+", text)), default=0)

    def sum_of(self, products: list[tuple[str, ...]]) -> str | None:
        """The sum of products of names, those that are known longest first, which leaves the least to wait for."""
        if not products:
            return None
        when = {product: max(map(self.known, product)) for product in products}
        ordered = sorted(products, key=lambda product: when[product])

        def chains(count: int) -> tuple[int, list[list[str]]]:
            """So many sums, each term in the one that is known first; and when their sum is."""
            sums, known = [[] for _ in range(count)], [0] * count
            for product in ordered:
                i = min(range(count), key=lambda i: known[i])
                known[i] = max(known[i], when[product]) + 1
                sums[i].append(" * ".join(product))
            return max(known) + count - 1, sums

        ready, sums = chains(1)
        if len(ordered) > 2 and (other := chains(2))[0] < ready - 1:
            ready, sums = other
        texts = [" + ".join(x) for x in sums]
        return self.name(texts[0] if len(texts) == 1 else " + ".join(f"({x})" for x in texts), ready)

    def lane(self, name: str, width: int, lane: int) -> str:
        return name if width == 1 else f"{name}[{lane}]"

    def weights(self, symbols: list[Symbol]) -> str:
        """Constants as a vector; one number for all, where they are equal."""
        if len({x.number for x in symbols}) == 1 and symbols[0].op == "const":
            return repr(symbols[0].value)
        if all(x.op == "const" for x in symbols):
            return f"vector({', '.join(repr(x.value) for x in symbols)})"
        key = tuple(x.number for x in symbols)
        if key not in self.rows:
            at, count = self.first + len(self.given), len(symbols)
            self.given += symbols
            if count == 3:  # of three numbers a processor loads two and one
                self.given.append(trace.const(0.0))
                whole = self.name(f"row(b, {at}, 4)")
                self.rows[key] = self.name(f"pick({whole}, {whole}, 0, 1, 2)")
            else:
                self.rows[key] = self.name(f"b[{at}]" if count == 1 else f"row(b, {at}, {count})")
        return self.rows[key]

    def total(self, lanes: list[list[Term]]) -> str | None:
        """A vector of sums; None if nothing is in them."""
        return self.sum_of([self._slot(slot, len(lanes)) for slot in slots_of(lanes)])

    def _slot(self, slot: Slot, count: int) -> tuple[str, ...]:
        """The factors of a slot's part of the sum."""
        weights = [slot.terms[i].weight if i in slot.terms else trace.const(0.0) for i in range(count)]
        if not slot.width:
            text = self.weights(weights)
            one = count == 1 or text[0] in "tv"  # a number for all lanes is no vector by itself
            return (text if one else f"vector({', '.join([text] * count)})",)
        mixed = self._mixed(slot, count)
        return (mixed,) if all(trace.is_const(w, 1.0) for w in weights) else (self.weights(weights), mixed)

    def _mixed(self, slot: Slot, count: int) -> str:
        """The lanes of a slot as one vector; what stands in those that it lacks does not matter."""
        terms, width, names = slot.terms, slot.width, slot.names
        if count == 1:
            return self.lane(names[0], width, terms[0].lane)
        if width == 1:
            return self.name(f"vector({', '.join(terms[i].name if i in terms else '0.0' for i in range(count))})")
        if width == count and len(names) == 1 and all(term.lane == i for i, term in terms.items()):
            return names[0]
        places = [terms[i].lane + width * names.index(terms[i].name) if i in terms else i % width for i in range(count)]
        return self.name(f"pick({names[0]}, {names[-1]}, {', '.join(map(str, places))})")


def _collected(terms: list[Term]) -> list[Term]:
    """Terms of one lane: what is there twice has the sum of its weights."""
    found: dict[tuple[str, int], Term] = {}
    for term in terms:
        key = (term.name, term.lane)
        found[key] = term._replace(weight=trace.add(found[key].weight, term.weight)) if key in found else term
    return list(found.values())


def slots_of(lanes: list[list[Term]]) -> list[Slot]:
    """The terms in as few slots as it takes, simply: those that need no mixing first."""
    slots: list[Slot] = []
    for lane, terms in enumerate(_collected(terms) for terms in lanes):
        for term in sorted(terms, key=lambda term: term.lane != lane):
            for slot in slots:
                if slot.takes(lane, term):
                    slot.terms[lane] = term
                    break
            else:
                slots.append(Slot({lane: term}))
    joined: list[Slot] = []
    for slot in slots:
        for other in joined:
            if other.joins(slot):
                other.terms |= slot.terms
                break
        else:
            joined.append(slot)
    return joined
