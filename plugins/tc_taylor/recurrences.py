"""The text of the kernels: Taylor coefficients of a system's solution, of all orders, by recurrences for the operations
of the traced formulas; and the polynomial that they make.

The coefficient n of y needs the coefficients below n of its rate; each is written down when it is first asked for, and
the sums begin with the terms that are known longest, which leaves the processor least to wait for. Source: Jorba and
Zou (2005), section 3; docs/methods.md.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from tcbench import System
from tcbench.compiler import derivatives as trace
from tcbench.compiler.derivatives import Symbol
from tcbench.compiler.kernels import Kernel

from .lanes import WIDTH, Gathering, Pack, Packs, Term, is_square, slots_of
from .rates import rates
from .series import ONE, Series

PARTNERS = {"sin": ("cos", 1.0), "cos": ("sin", -1.0), "sinh": ("cosh", 1.0), "cosh": ("sinh", 1.0)}
THROUGH = 2  # a position comes from a velocity, which comes from a force


class Writer(Gathering):
    """Writes down coefficients when they are first asked for, a pack of series at a time; what is 0 is None."""

    def __init__(self, variables: list[Series], rate: dict[int, Series], first: int = 0) -> None:
        super().__init__(first)
        self.rate, self.packs = rate, Packs(rate, variables)
        self.names: dict[tuple[tuple[int, ...], int, str], str | None] = {}
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
                return getattr(self, f"_{pack[0].kind}")(pack, n)
            if len({self.packs.steps(x) for x in pack}) == 1:  # else some lanes may be wanted before others are known
                for lane, x in enumerate(pack):
                    self.operands.setdefault(id(x), (pack, lane))
            near, far = ([self.terms(x, n, pack, through=way) for x in pack] for way in (0, THROUGH))
            return self.total(far if len(slots_of(far)) <= len(slots_of(near)) else near)

        return self._once(pack, n, "", make)

    def _once(self, pack: Pack, n: int, what: str, make: Callable[[], str | None]) -> str | None:
        key = (tuple(id(x) for x in pack), n, what)
        if key not in self.names:
            self.names[key] = make()
        return self.names[key]

    def terms(self, x: Series, n: int, of: Pack = (), weight: Symbol = ONE, through: int = 0) -> list[Term]:
        """weight times coefficient n of a series, as terms of packs. of: the pack that is being made.

        through: with variables as what they come from, which is known earlier, so many times.
        """
        log = x.parts[0] if x.kind == "D" and x.parts[0].kind == "log" else x
        known = self.packs.home.get(id(log)) or self.operands.get(id(x))
        if through and x.kind == "var" and n:
            return self.terms(self.rate[x.index], n - 1, (), trace.mul(weight, trace.const(1.0 / n)), through - 1)
        if log is not x and known:
            return self._term(self._log_rate(known[0], n + 1), *known, weight)
        if x.kind == "log" and known and n:
            return self._term(self._log_rate(known[0], n), *known, trace.mul(weight, trace.const(1.0 / n)))
        if known and known[0] != of:
            return self._term(self.value(known[0], n), *known, weight)
        if x.kind == "D":
            return self.terms(x.parts[0], n + 1, (), trace.mul(weight, trace.const(n + 1.0)), through)
        found = [term for part, w in zip(x.parts, x.weights, strict=False)
                 for term in self.terms(part, n, (), trace.mul(weight, w), through)]  # fmt: skip
        constant = trace.mul(weight, x.weights[-1])
        return found if n or trace.is_const(constant, 0.0) else [*found, Term(constant)]

    def _term(self, name: str | None, pack: Pack, lane: int, weight: Symbol) -> list[Term]:
        return [] if name is None else [Term(weight, name, len(pack), lane)]

    # ---- sums of products, the factors that are known longest first ----------------------------------------------

    def convolution(self, a: Callable[[int], str | None], b: Callable[[int], str | None], n: int, first: int = 0,
                    last: int | None = None) -> str | None:  # fmt: skip
        """The sum of a(j) b(n - j) for j = first .. last."""
        pairs = [(a(j), b(n - j)) for j in range(first, (n if last is None else last) + 1)]
        return self.sum_of([(left, right) for left, right in pairs if left and right])

    def _of(self, pack: Pack) -> Callable[[int], str | None]:
        return lambda n: self.value(pack, n)

    def _slope(self, pack: Pack) -> Callable[[int], str | None]:
        """n times coefficient n."""

        def slope(n: int) -> str | None:
            name = self.value(pack, n)
            return name if name is None or n == 1 else self.name(f"{float(n)!r} * {name}")

        return slope

    def _divided(self, newest: str | None, known: str | None, below: Pack, n: int = 1) -> str | None:
        """(n newest - known) over the first coefficient of `below`; from `newest` on, one operation."""
        inverse = self.name(f"1.0 / {self.value(below, 0)}")
        known = known and self.name(f"{known} * {inverse}")
        if newest is None:
            return known and self.name(f"-{known}")
        first = f"{newest} * {inverse if n == 1 else self.name(f'{float(n)!r} * {inverse}')}"
        return self.name(f"{first} - {known}" if known else first)

    def _lanewise(self, function: str, pack: Pack, of_size: Sequence[bool] = ()) -> str:
        """A function of the first coefficients, or of the size of some."""
        name = str(self.value(pack, 0))
        lanes = [name] if len(pack) == 1 else [f"{name}[{i}]" for i in range(len(pack))]
        lanes = [f"abs({x})" if size else x for x, size in itertools.zip_longest(lanes, of_size)]
        texts = [f"{function}({x})" for x in lanes]
        return self.name(texts[0] if len(texts) == 1 else f"vector({', '.join(texts)})")

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
            return self._square(self._of(self.packs.parts(pack)[0]), n)
        return self.convolution(*map(self._of, self.packs.parts(pack)), n)

    def _square(self, a: Callable[[int], str | None], n: int) -> str | None:
        """Each product of two different coefficients is in it twice; it is the one known longer that is doubled."""
        pairs = [(a(j), a(n - j)) for j in range((n + 1) // 2)]
        products = [(self.name(f"{left} + {left}"), right) for left, right in pairs if left and right]
        middle = a(n // 2) if n % 2 == 0 else None
        return self.sum_of([*products, (middle, middle)] if middle else products)

    def _quotient(self, pack: Pack, n: int) -> str | None:
        above, below = self.packs.parts(pack)
        newest = self.value(above, n)
        return self._divided(newest, self.convolution(self._of(below), self._of(pack), n, 1), below)

    def _log_rate(self, pack: Pack, n: int) -> str | None:
        """n times coefficient n of log u: (n u_n - sum_(0<j<n) (j l_j) u_(n-j)) / u_0."""

        def make() -> str | None:
            (u,) = self.packs.parts(pack)
            known = self.convolution(lambda j: self._log_rate(pack, j), self._of(u), n, 1, n - 1)
            return self._divided(self.value(u, n), known, u, n)

        return self._once(pack, n, "rate", make)

    def _log(self, pack: Pack, n: int) -> str | None:
        if n == 0:
            return self._lanewise("log", *self.packs.parts(pack), [x.of_size for x in pack])
        rate = self._log_rate(pack, n)
        return rate if rate is None or n == 1 else self.name(f"{1.0 / n!r} * {rate}")

    def _exp(self, pack: Pack, n: int) -> str | None:
        (u,) = self.packs.parts(pack)
        if n == 0:
            return self._lanewise("exp", u)
        text = self.convolution(self._slope(u), self._of(pack), n, 1)
        return None if text is None else self.name(f"{1.0 / n!r} * ({text})")

    def _sqrt(self, pack: Pack, n: int) -> str | None:
        (u,) = self.packs.parts(pack)
        if n == 0:
            return self._lanewise("sqrt", u)
        known = self.convolution(self._of(pack), self._of(pack), n, 1, n - 1)
        twice = self._divided(self.value(u, n), known, pack)
        return twice and self.name(f"0.5 * {twice}")

    def _turned(self, u: Pack, n: int, what: str) -> str | None:
        """Coefficient n of sin u, cos u, sinh u or cosh u: each is its partner's rate."""

        def make() -> str | None:
            if n == 0:
                return self._lanewise(what, u)
            other, sign = PARTNERS[what]
            text = self.convolution(self._slope(u), lambda j: self._turned(u, j, other), n, 1)
            return None if text is None else self.name(f"{sign / n!r} * ({text})")

        return self._once(u, n, what, make)

    def _sin(self, pack: Pack, n: int) -> str | None:
        return self._turned(*self.packs.parts(pack), n, "sin")

    def _cos(self, pack: Pack, n: int) -> str | None:
        return self._turned(*self.packs.parts(pack), n, "cos")

    def _sinh(self, pack: Pack, n: int) -> str | None:
        return self._turned(*self.packs.parts(pack), n, "sinh")

    def _cosh(self, pack: Pack, n: int) -> str | None:
        return self._turned(*self.packs.parts(pack), n, "cosh")

    def _bell(self, pack: Pack, sign: str) -> Callable[[int], str | None]:
        """Coefficients of 1 - x^2 or 1 + x^2."""

        def bell(n: int) -> str | None:
            square = self.convolution(self._of(pack), self._of(pack), n)
            if n == 0:
                return self.name(f"1.0 {sign} {square or '0.0'}")
            return None if square is None else self.name(f"{sign}({square})" if sign == "-" else square)

        return bell

    def _tanh(self, pack: Pack, n: int) -> str | None:
        (u,) = self.packs.parts(pack)
        if n == 0:
            return self._lanewise("tanh", u)
        text = self.convolution(self._slope(u), self._bell(pack, "-"), n, 1)
        return None if text is None else self.name(f"{1.0 / n!r} * ({text})")

    def _atan(self, pack: Pack, n: int) -> str | None:
        (u,) = self.packs.parts(pack)
        if n == 0:
            return self._lanewise("atan", u)
        bell = self._bell(u, "+")
        known = self.convolution(self._slope(pack), bell, n, 1, n - 1)
        newest = self._slope(u)(n) or "0.0"
        return self.name(f"({newest} - ({known})) / ({float(n)!r} * {bell(0)})" if known else f"{newest} / {bell(0)}")

    def _atan2(self, pack: Pack, n: int) -> str | None:
        """From how fast the angle turns."""
        turn, y, x = self.packs.parts(pack)
        if n == 0:
            sides = [self.value(side, 0) for side in (y, x)]
            lanes = [[self.lane(s, len(pack), i) if s else "0.0" for s in sides] for i in range(len(pack))]
            texts = [f"atan2({', '.join(lane)})" for lane in lanes]
            return self.name(texts[0] if len(texts) == 1 else f"vector({', '.join(texts)})")
        rate = self.value(turn, n - 1)
        return rate if rate is None or n == 1 else self.name(f"{1.0 / n!r} * {rate}")


def series_kernels(system: System, order: int, first: int) -> tuple[Kernel, Kernel, list[Symbol]]:
    """(series, polynomial, constants) of one structure of system; nothing is compiled yet.

    series(y, given) -> coefficients 0 .. order of y, each of the size of y, then the squared sizes of the last two: see
        `squared_size`. The constants of the list stand in `given` from `first` on.
    polynomial(coefficients, (h,)) -> y after h
    """
    variables, rate = rates(system)
    size = system.size
    writer = Writer(variables, dict(enumerate(rate)), first)
    stored = [line for k in range(order + 1) for line in stores(writer, variables, k)]
    for at, k in enumerate((order - 1, order)):
        stored.append(f"out[{(order + 1) * size + at}] = {squared_size(writer, system, variables, k)}")
    series = written([*writer.lines, *stored], (order + 1) * size + 2)
    return series, polynomial_kernel(order, size), writer.given


def squared_size(writer: Writer, system: System, variables: list[Series], k: int) -> str:
    """Of coefficient k: the sum of its squares over 1 + y^2; of elements those of velocities and c0 theta/theta_0."""
    squares: dict[int, list[tuple[str, ...]]] = {}  # by the number of lanes
    for pack, weights, whole in weighted(writer, system, variables):
        if value := writer.value(pack, k):
            weighed = writer.name(f"{value} * {weights}")
            squares.setdefault(len(pack), []).append((weighed, value if whole else weighed))
    sums = [writer.lane(str(writer.sum_of(x)), width, lane) for width, x in squares.items() for lane in range(width)]
    while len(sums) > 1:
        sums = [writer.name(" + ".join(sums[i : i + 2])) for i in range(0, len(sums), 2)]
    return sums[0] if sums else "0.0"


def weighted(writer: Writer, system: System, variables: list[Series]) -> Iterator[tuple[Pack, str, bool]]:
    """The variables whose coefficients are measured, as packs; weights of the coefficients, or (True) of squares."""
    sym, size = system.symbolic, system.size
    if not system.defines("element_energy"):
        for pack in dict.fromkeys(writer.packs.home[id(x)][0] for x in variables):
            y = writer.value(pack, 0)
            yield pack, writer.name(f"1.0 / (1.0 + {y} * {y})"), True
        return
    n = system.n_positions
    scale = [trace.reciprocal(m) for m in lifted(sym.inertia(), n)] + lifted(sym.entropy_scale(), system.n_elements)
    for begin, end in ((n, 2 * n), (2 * n, size)):
        for i in range(begin, end, WIDTH):
            pack = tuple(variables[i : min(i + WIDTH, end)])
            weights = writer.weights(scale[i - n : i - n + len(pack)])
            if begin == 2 * n:
                weights = writer.name(f"{weights} / {writer.value(pack, 0)}")
            yield pack, weights, False


def stores(writer: Writer, variables: list[Series], k: int) -> list[str]:
    """Coefficient k of the variables into its place."""
    size, lines = len(variables), []
    for pack in dict.fromkeys(writer.packs.home[id(x)][0] for x in variables):
        places, name = [k * size + x.index for x in pack], writer.value(pack, k)
        if name and len(pack) > 1 and places == list(range(places[0], places[0] + len(pack))):
            lines.append(f"put(out, {places[0]}, {name})")
        else:
            lines += [f"out[{place}] = {writer.coefficient(x, k)}" for place, x in zip(places, pack, strict=True)]
    return lines


def polynomial_kernel(order: int, size: int) -> Kernel:
    """The polynomials of all numbers, some at a time; in Estrin's order: short chains of operations."""
    lines = ["h1 = b[0]"] + [f"h{2 * k} = h{k} * h{k}" for k in (2**i for i in range(order.bit_length() - 1))]
    for i in range(0, size, WIDTH):
        count = min(WIDTH, size - i)
        texts = [f"row(a, {k * size + i}, {count})" if count > 1 else f"a[{k * size + i}]" for k in range(order + 1)]
        power = 1
        while len(texts) > 1:
            pairs = [f"({low} + {high} * h{power})" for low, high in zip(texts[::2], texts[1::2], strict=False)]
            texts, power = pairs + texts[len(pairs) * 2 :], 2 * power
        lines += [f"t{i} = {texts[0]}", f"put(out, {i}, t{i})" if count > 1 else f"out[{i}] = t{i}"]
    return written(lines, size)


def lifted(value: Any, count: int) -> list[Symbol]:
    """A number, a symbol or an array of them, as so many symbols."""
    return [
        x if isinstance(x, Symbol) else trace.const(float(x)) for x in np.asarray(value, dtype=object) * np.ones(count)
    ]


def written(lines: list[str], count: int) -> Kernel:
    return Kernel("def kernel(a, b, out):\n" + "".join(f"    {line}\n" for line in lines), count)
