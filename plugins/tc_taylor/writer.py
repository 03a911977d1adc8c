"""Taylor coefficients as straight-line text, a pack of series at a time (`lanes`).

The sums begin with the terms that are known longest, which leaves the processor least to wait for.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence

from tcbench.compiler import derivatives as trace
from tcbench.compiler.derivatives import Symbol

from .lanes import Gathering, Pack, Packs, Term, slots_of
from .recurrences import Recurrences
from .series import ONE, Series

THROUGH = 2  # a position comes from a velocity, which comes from a force


class Writer(Gathering, Recurrences[Pack]):
    """Writes down coefficients when they are first asked for; a value is the name of a vector."""

    def __init__(self, variables: list[Series], rate: dict[int, Series], first: int = 0) -> None:
        Gathering.__init__(self, first)
        Recurrences.__init__(self)
        self.rate, self.packs = rate, Packs(rate, variables)
        self.operands: dict[int, tuple[Pack, int]] = {}  # packs in which a sum stands

    def key(self, x: Pack, n: int, what: str) -> Hashable:
        return tuple(map(id, x)), n, what

    def parts(self, x: Pack) -> list[Pack]:
        return self.packs.parts(x)

    def scaled(self, weight: float, value: str) -> str:
        return self.name(f"-{value}" if weight == -1.0 else f"{float(weight)!r} * {value}")

    def plus(self, number: float, value: str | None) -> str:
        return self.name(f"{number!r} + {value or '0.0'}")

    def over(self, above: str | float | None, below: str) -> str:
        return self.name(f"{above or '0.0'} / {below}")

    def function(self, name: str, value: str | None, of_size: Pack | None = None) -> str:
        inside = str(value)
        if of_size and any(x.of_size for x in of_size):
            lanes = [self.lane(inside, len(of_size), i) for i in range(len(of_size))]
            inside = packed([f"abs({a})" if x.of_size else a for a, x in zip(lanes, of_size, strict=True)])
        return self.name(f"{name}({inside})")

    def angle(self, y: str | None, x: str | None, of: Pack) -> str:
        lanes = [[self.lane(side, len(of), i) if side else "0.0" for side in (y, x)] for i in range(len(of))]
        return self.name(packed([f"atan2({', '.join(lane)})" for lane in lanes]))

    def coefficient(self, x: Series, n: int) -> str:
        """Coefficient n of one series."""
        pack, lane = self.packs.home[id(x)]
        name = self.value(pack, n)
        return "0.0" if name is None else self.lane(name, len(pack), lane)

    def value(self, pack: Pack, n: int) -> str | None:
        """Name of coefficient n of a pack of any series."""

        def make(n: int) -> str | None:
            if self.packs.home.get(id(pack[0]), ((), 0))[0] == pack:
                return self.of_kind(pack, pack[0].kind, n)
            if len({self.packs.steps(x) for x in pack}) == 1:  # else some lanes may be wanted before others are known
                for lane, x in enumerate(pack):
                    self.operands.setdefault(id(x), (pack, lane))
            near, far = ([self.terms(x, n, pack, through=way) for x in pack] for way in (0, THROUGH))
            return self.total(far if len(slots_of(far)) <= len(slots_of(near)) else near)

        return self.once(pack, n, "", make)

    def _is_begun(self, pack: Pack, n: int) -> bool:
        """Is this coefficient being written? Two packs of sums may each have a sum in which one of the other stands."""
        key = self.key(pack, n, "")
        return key in self.begun and key not in self.made

    def terms(self, x: Series, n: int, of: Pack = (), weight: Symbol = ONE, through: int = 0) -> list[Term]:
        """weight times coefficient n of a series, as terms of packs. of: the pack that is being made, in
        which a sum may stand beside one of its own parts.

        through: with variables as what they come from, which is known earlier, so many times.
        """
        if n and x.constant:
            return []
        log = x.parts[0] if x.kind == "D" and x.parts[0].kind == "log" else x
        known = self.packs.home.get(id(log)) or self.operands.get(id(x))
        if through and x.kind == "var" and n:
            return self.terms(self.rate[x.index], n - 1, (), trace.mul(weight, trace.const(1.0 / n)), through - 1)
        if log is not x and known:
            return self._term(self.log_rate(known[0], n + 1), *known, weight)
        if x.kind == "log" and known and n:
            return self._term(self.log_rate(known[0], n), *known, trace.mul(weight, trace.const(1.0 / n)))
        if known and known[0] != of and not self._is_begun(known[0], n):
            return self._term(self.value(known[0], n), *known, weight)
        if x.kind == "D":
            return self.terms(x.parts[0], n + 1, (), trace.mul(weight, trace.const(n + 1.0)), through)
        found = [term for y, w in zip(x.parts, x.weights, strict=False)
                 for term in self.terms(y, n, of, trace.mul(weight, w), through)]  # fmt: skip
        constant = trace.mul(weight, x.weights[-1])
        return found if n or trace.is_const(constant, 0.0) else [*found, Term(constant)]

    def _term(self, name: str | None, pack: Pack, lane: int, weight: Symbol) -> list[Term]:
        return [] if name is None else [Term(weight, name, len(pack), lane)]

    def _var(self, pack: Pack, n: int) -> str | None:
        if n:
            return self.total([self.terms(self.rate[x.index], n - 1, (), trace.const(1.0 / n)) for x in pack])
        places = [x.index for x in pack]
        if len(pack) == 1:
            return self.name(f"a[{places[0]}]")
        if places == list(range(places[0], places[0] + len(pack))):
            return self.name(f"row(a, {places[0]}, {len(pack)})")
        return self.name(f"vector({', '.join(f'a[{i}]' for i in places)})")


def packed(texts: Sequence[str]) -> str:
    return texts[0] if len(texts) == 1 else f"vector({', '.join(texts)})"
