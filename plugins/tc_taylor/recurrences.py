"""Taylor coefficients of a system's solution, of all orders, by recurrences for the operations of the traced formulas.

The coefficient n of y needs the coefficients below n of its rate; each is written down when it is first asked for, and
the sums begin with the terms that are known longest, which leaves the processor least to wait for. Source: Jorba and
Zou (2005), section 3; docs/methods-explained.md.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from tcbench.compiler import derivatives as trace
from tcbench.compiler.derivatives import Symbol

from .lanes import Gathering, Pack, Packs, Term, is_square, slots_of
from .series import ONE, STANDING, Series

Key = tuple[tuple[int, ...], int, str]  # a pack by its series, the coefficient, what of it
Of = Callable[[int], str | None]
Products = Sequence[tuple[str | None, ...]]
PARTNERS = {"sin": ("cos", 1.0), "cos": ("sin", -1.0), "sinh": ("cosh", 1.0), "cosh": ("sinh", 1.0)}
THROUGH = 2  # a position comes from a velocity, which comes from a force


class Writer(Gathering):
    """Writes down coefficients when they are first asked for, a pack of series at a time; what is 0 is None."""

    def __init__(self, variables: list[Series], rate: dict[int, Series], first: int = 0) -> None:
        super().__init__(first)
        self.rate, self.packs = rate, Packs(rate, variables)
        self.names: dict[Key, str | None] = {}
        self.begun: set[Key] = set()  # those of them that are there or are being written
        self.operands: dict[int, tuple[Pack, int]] = {}  # packs in which a sum stands

    def coefficient(self, x: Series, n: int) -> str:
        """Coefficient n of one series."""
        pack, lane = self.packs.home[id(x)]
        name = self.value(pack, n)
        return "0.0" if name is None else self.lane(name, len(pack), lane)

    def value(self, pack: Pack, n: int) -> str | None:
        """Name of coefficient n of a pack of any series."""

        def make() -> str | None:
            if self.packs.home.get(id(pack[0]), ((), 0))[0] == pack:
                if (kind := pack[0].kind) in PARTNERS:
                    return self._turned(*self.packs.parts(pack), n, kind)
                return getattr(self, f"_{kind}")(pack, n)
            if len({self.packs.steps(x) for x in pack}) == 1:  # else some lanes may be wanted before others are known
                for lane, x in enumerate(pack):
                    self.operands.setdefault(id(x), (pack, lane))
            near, far = ([self.terms(x, n, pack, through=way) for x in pack] for way in (0, THROUGH))
            return self.total(far if len(slots_of(far)) <= len(slots_of(near)) else near)

        return self._once(pack, n, "", make)

    def _once(self, pack: Pack, n: int, what: str, make: Callable[[], str | None]) -> str | None:
        key = (tuple(id(x) for x in pack), n, what)
        if key not in self.names:
            self.begun.add(key)
            self.names[key] = make()
        return self.names[key]

    def _is_begun(self, pack: Pack, n: int) -> bool:
        """Is this coefficient being written? Two packs of sums may each have a sum in which one of the other stands."""
        key = (tuple(id(x) for x in pack), n, "")
        return key in self.begun and key not in self.names

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
            return self._term(self._log_rate(known[0], n + 1), *known, weight)
        if x.kind == "log" and known and n:
            return self._term(self._log_rate(known[0], n), *known, trace.mul(weight, trace.const(1.0 / n)))
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

    # ---- sums of products, the factors that are known longest first ----------------------------------------------

    def summed(self, older: Products, newest: Products, weight: float = 1.0) -> str | None:
        """weight times the sum of older products, and the newest ones."""
        if weight != 1.0 and (known := self.sum_of([x for x in older if all(x)])):
            older = [(self.name(f"{weight!r} * {known}"),)]
        elif weight != 1.0:
            older = []
        return self.sum_of([x for x in [*older, *newest] if all(x)])

    def convolution(self, n: int, a: Of, b: Of, newest: Products, weight: float = 1.0) -> str | None:
        """weight times the sum of a(j) b(n - j) for j = 1 .. n - 1, and the newest products."""
        return self.summed([(a(j), b(n - j)) for j in range(1, n)], newest, weight)

    def _of(self, pack: Pack) -> Of:
        return lambda n: self.value(pack, n)

    def _slope(self, pack: Pack) -> Of:
        """n times coefficient n."""

        def slope(n: int) -> str | None:
            name = self.value(pack, n)
            return name if name is None or n == 1 else self.name(f"{float(n)!r} * {name}")

        return slope

    def _divided(self, newest: str | None, known: str | None, inverse: str, n: int = 1) -> str | None:
        """(n newest - known) times the inverse; from `newest` on, one operation."""
        known = known and self.name(f"{known} * {inverse}")
        if newest is None:
            return known and self.name(f"-{known}")
        first = f"{newest} * {inverse if n == 1 else self.name(f'{float(n)!r} * {inverse}')}"
        return self.name(f"{first} - {known}" if known else first)

    def _inverse(self, pack: Pack, above: float = 1.0) -> str:
        return self.name(f"{above!r} / {self.value(pack, 0)}")

    def _of_first(self, function: str, pack: Pack, of_size: Sequence[bool] = ()) -> str:
        """A function of the first coefficients, or of the size of some."""
        name = str(self.value(pack, 0))
        if any(of_size):
            lanes = [self.lane(name, len(pack), i) for i in range(len(pack))]
            name = packed([f"abs({x})" if size else x for x, size in zip(lanes, of_size, strict=True)])
        return self.name(f"{function}({name})")

    # ---- one recurrence a kind -----------------------------------------------------------------------------

    def _var(self, pack: Pack, n: int) -> str | None:
        if n:
            return self.total([self.terms(self.rate[x.index], n - 1, (), trace.const(1.0 / n)) for x in pack])
        places = [x.index for x in pack]
        if len(pack) == 1:
            return self.name(f"a[{places[0]}]")
        if places == list(range(places[0], places[0] + len(pack))):
            return self.name(f"row(a, {places[0]}, {len(pack)})")
        return self.name(f"vector({', '.join(f'a[{i}]' for i in places)})")

    def _product(self, pack: Pack, n: int) -> str | None:
        if is_square(pack[0]):
            return self._square(self.packs.parts(pack)[0], n)
        a, b = self.packs.parts(pack)
        newest = [(self.value(a, 0), self.value(b, n))]
        if n:
            newest.append((self.value(a, n), self.value(b, 0)))
        return self.convolution(n, self._of(a), self._of(b), newest)

    def _square(self, a: Pack, n: int) -> str | None:
        """Each product of two different coefficients is in it twice; it is the one known longer that is doubled."""

        def twice(j: int) -> str | None:
            name = self.value(a, j)
            return name and self.name(f"{name} + {name}")

        if n == 0:
            return self.sum_of([(str(self.value(a, 0)),) * 2])
        older = [(twice(j), self.value(a, n - j)) for j in range(1, (n + 1) // 2)]
        if n % 2 == 0:
            older.append((self.value(a, n // 2),) * 2)
        return self.summed(older, [(twice(0), self.value(a, n))])

    def _quotient(self, pack: Pack, n: int) -> str | None:
        """(u_n - sum_(0<j<=n) v_j q_(n-j)) / v_0: one operation from the newest of u on, and from that of v."""
        above, below = self.packs.parts(pack)
        inverse, newest = self._inverse(below), self.value(above, n)
        if n == 0:
            return newest and self.name(f"{newest} * {inverse}")
        known = self.convolution(n, self._of(below), self._of(pack), [])
        whole = [(newest, inverse), (known, self.name(f"-{inverse}"))]
        if first := self.value(pack, 0):
            whole.append((self.value(below, n), self.name(f"-{first} * {inverse}")))
        return self.sum_of([x for x in whole if all(x)])

    def _log_rate(self, pack: Pack, n: int) -> str | None:
        """n times coefficient n of log u: (n u_n - sum_(0<j<n) (j l_j) u_(n-j)) / u_0."""

        def make() -> str | None:
            (u,) = self.packs.parts(pack)
            known = self.convolution(n, lambda j: self._log_rate(pack, j), self._of(u), [])
            return self._divided(self.value(u, n), known, self._inverse(u), n)

        return self._once(pack, n, "rate", make)

    def _log(self, pack: Pack, n: int) -> str | None:
        if n == 0:
            return self._of_first("log", *self.packs.parts(pack), [x.of_size for x in pack])
        rate = self._log_rate(pack, n)
        return rate if rate is None or n == 1 else self.name(f"{1.0 / n!r} * {rate}")

    def _risen(self, u: Pack, n: int, by: Of) -> str | None:
        """Coefficient n of f(u), where `by` has those of df/du: the sum of (j u_j) by(n - j), over n."""
        return self.convolution(n, self._slope(u), by, [(self.value(u, n), by(0))], 1.0 / n)

    def _exp(self, pack: Pack, n: int) -> str | None:
        (u,) = self.packs.parts(pack)
        return self._risen(u, n, self._of(pack)) if n else self._of_first("exp", u)

    def _sqrt(self, pack: Pack, n: int) -> str | None:
        (u,) = self.packs.parts(pack)
        if n == 0:
            return self._of_first("sqrt", u)
        known = self.convolution(n, self._of(pack), self._of(pack), [])
        return self._divided(self.value(u, n), known, self._inverse(pack, 0.5))

    def _turned(self, u: Pack, n: int, what: str) -> str | None:
        """Coefficient n of sin u, cos u, sinh u or cosh u: each is its partner's rate."""

        def make() -> str | None:
            if n == 0:
                return self._of_first(what, u)
            other, sign = PARTNERS[what]
            last = self.value(u, n)
            if last and sign < 0.0:
                last = self.name(f"-{last}")
            older = [(self._slope(u)(j), self._turned(u, n - j, other)) for j in range(1, n)]
            return self.summed(older, [(last, self._turned(u, 0, other))], sign / n)

        return self._once(u, n, what, make)

    def _bell(self, pack: Pack, sign: str) -> Of:
        """Coefficients of 1 - x^2 or 1 + x^2."""

        def bell(n: int) -> str | None:
            square = self._square(pack, n)
            if n == 0:
                return self.name(f"1.0 {sign} {square or '0.0'}")
            return None if square is None else self.name(f"{sign}{square}") if sign == "-" else square

        return bell

    def _tanh(self, pack: Pack, n: int) -> str | None:
        (u,) = self.packs.parts(pack)
        return self._risen(u, n, self._bell(pack, "-")) if n else self._of_first("tanh", u)

    def _atan(self, pack: Pack, n: int) -> str | None:
        (u,) = self.packs.parts(pack)
        bell = self._bell(u, "+")
        if n == 0:
            return self._of_first("atan", u)
        known = self.convolution(n, self._slope(pack), bell, [], 1.0 / n)
        return self._divided(self.value(u, n), known, self.name(f"1.0 / {bell(0)}"))

    def _sign(self, pack: Pack, n: int) -> str | None:
        """Of u, at the start: steps end where it changes (`kinks`)."""
        (u,) = self.packs.parts(pack)
        if n:
            return None
        size = self.name(f"{self._of_first('abs', u)} + {STANDING!r}")
        return self.name(f"{self.value(u, 0)} / {size}")

    def _guard(self, pack: Pack, n: int) -> str | None:
        """No number, where the signs of two differ at the start."""
        x, y = (self.value(side, 0) or "0.0" for side in self.packs.parts(pack))
        return None if n else self.name(f"{STANDING!r} * sqrt({x} * {y})")

    def _atan2(self, pack: Pack, n: int) -> str | None:
        """From how fast the angle turns."""
        turn, y, x = self.packs.parts(pack)
        if n == 0:
            sides = [self.value(side, 0) for side in (y, x)]
            lanes = [[self.lane(s, len(pack), i) if s else "0.0" for s in sides] for i in range(len(pack))]
            return self.name(packed([f"atan2({', '.join(lane)})" for lane in lanes]))
        rate = self.value(turn, n - 1)
        return rate if rate is None or n == 1 else self.name(f"{1.0 / n!r} * {rate}")


def packed(texts: Sequence[str]) -> str:
    return texts[0] if len(texts) == 1 else f"vector({', '.join(texts)})"
