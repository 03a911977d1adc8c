"""The variables of a run and their rates as series: any system's z by its vector field, and (q, p, theta) of elements.

With temperatures instead of entropies as variables no exponential is left of springs and gases. In

    q' = p/m,   p' = -e_pi . dpi/dq,   theta' = theta_pi pi' + theta_s (M DS)

pi' is the derivative of the series of pi, and pi'/pi that of log pi: neither costs a product of its own. That is why
springs have rates of their own: the chain rule through the graph alone gives a pendulum 36 series, or 30 factored, in
the place of 24.
"""

from __future__ import annotations

from collections import Counter
from itertools import combinations
from typing import Any

from tcbench import System
from tcbench.compiler import derivatives as trace
from tcbench.compiler.array_states import entries, refilled
from tcbench.compiler.derivatives import Symbol

from .lanes import Packs, is_square, reachable
from .series import ONE, ZERO, Linear, Monomial, Normal, Series, combined

FEWER = 0.9  # another form has so many of the plain one's operations at most: its chains of operations may be longer


def rates(system: System) -> tuple[list[Series], list[Series]]:
    """The variables and their rates."""
    return shorter(system.symbolic, system.symbolic.state(trace.variables("y", system.size)))


def shorter(sym: Any, y: Any) -> tuple[list[Series], list[Series]]:
    """The same by a system's `symbolic` or `by_arrays`, y a fresh state; in the normal form that takes least."""
    of = of_elements if sym.defines("element_energy") else of_any
    plain, factored = (of(sym, y, form(entries(y))) for form in (Normal, Factored))
    cost = operations if sym.by_array else products
    return factored if cost(factored) < FEWER * cost(plain) else plain


def operations(found: tuple[list[Series], list[Series]]) -> float:
    """How many series there are that cost something."""
    return sum(x.kind not in ("sum", "D") for x in reachable([*found[0], *found[1]]))


def products(found: tuple[list[Series], list[Series]]) -> float:
    """How many Cauchy products a coefficient takes, those of a pack at once."""
    packs = {id(pack): pack for pack, _ in Packs(dict(enumerate(found[1])), found[0]).home.values()}
    kinds = ((pack[0].kind, is_square(pack[0])) for pack in packs.values())
    return sum(0.0 if kind in ("var", "sign", "guard") else 0.5 if square else 1.0 for kind, square in kinds)


def of_any(sym: Any, z: Any, normal: Normal) -> tuple[list[Series], list[Series]]:
    """z and the vector field, which leaves the invariants as they are."""
    normal.hold(normal.of(lifted(sym.momenta(z))))
    return normal.variables, singles(normal, normal.of(lifted(sym.vector_field(z))))


def of_elements(sym: Any, y: Any, normal: Normal) -> tuple[list[Series], list[Series]]:
    """y = (q, p, theta) and its rates; the rates of the shapes are derivatives of series, not formulas."""
    y = sym.named(y, "theta")
    pi, s, rise = (sym.fresh(name, "element") for name in ("pi", "s", "rise"))
    shape, (stress, warmth) = sym.shape(y.q), sym.element_slopes(pi, s)
    moves = (pi, rise), (s, sym.conduction(y.theta))
    warms = [trace.along(entries(warmth), dict(zip(entries(x), entries(dx), strict=True))) for x, dx in moves]
    here = dict(zip(entries(pi, s), entries(shape, sym.entropies(y.q, y.theta)), strict=True))
    stress, *warms = (trace.substitute(x, here) for x in (entries(stress), *warms))
    force = -(refilled(pi, stress) @ sym.shape_gradient(y.q))
    risen = map(normal.derivative, normal.of(lifted(shape)))
    normal.known |= {x.number: form for x, form in zip(entries(rise), risen, strict=True)}
    moving, by_shape, by_heat = map(normal.of, (lifted(y.p / sym.inertia(), force), *warms))
    warming = [combined(a, b, ONE) for a, b in zip(by_shape, by_heat, strict=True)]
    return normal.variables, singles(normal, [*moving, *warming])


def lifted(*arrays: Any) -> list[Symbol]:
    return list(map(trace.lifted, entries(*arrays)))


def singles(normal: Normal, forms: list[Linear]) -> list[Series]:
    return [normal.single(form) if form else normal.series("sum", (), (ZERO,)) for form in forms]


class Factored(Normal):
    """As `Normal`; what several terms of a sum have in common is taken out of them, the commonest first."""

    def _sum(self, form: Linear) -> Series:
        while True:
            common = Counter(x for key in form if degree(key) > 1 for x, _ in key)
            x = max(common, key=lambda x: common[x], default=None)
            if x is None or common[x] < 2:
                return super()._sum(form)
            inside: Linear = {}
            rest: Linear = {}
            for key, weight in form.items():
                if degree(key) > 1 and any(y is x for y, _ in key):
                    inside = combined(inside, {self.merged(((x, -1),), key): weight}, ONE)
                else:
                    rest[key] = weight
            ((key, weight),) = self.as_factor(inside).items()
            form = combined(rest, {self.merged(((x, 1),), key): weight}, ONE)

    def _product(self, key: Monomial) -> Series:
        """Pairs that exist already first, then what is no variable: equations have that in common."""
        factors = [x for x, k in key for _ in range(k)]
        while len(factors) > 1:
            ordered = sorted(factors, key=lambda x: x.kind == "var")
            pairs = [pair for a, b in combinations(ordered, 2) for pair in ((a, b), (b, a))]
            known = (pair for pair in pairs if self.key_of("product", pair) in self.interned)
            pair = next(known, pairs[0])
            for x in pair:
                factors.remove(x)
            factors.append(self.series("product", pair))
        return factors[0]

    def single(self, form: Linear) -> Series:
        """Of one monomial over another: the quotient of what is no variable, times the variables."""
        below = Counter(self.one_key((x, k) for x, k in key if k < 0) for key in form)
        changed: Linear = {}
        for key, weight in form.items():
            under = self.one_key((x, k) for x, k in key if k < 0)
            over = tuple((x, k) for x, k in key if k > 0 and x.kind != "var")
            variables = tuple((x, k) for x, k in key if k > 0 and x.kind == "var")
            if under and over and variables and below[under] == 1:
                whole = self._product(over), self._product(tuple((x, -k) for x, k in under))
                key = self.merged(((self.series("quotient", whole), 1),), variables)
            changed = combined(changed, {key: weight}, ONE)
        return super().single(changed)


def degree(key: Monomial) -> int:
    return sum(abs(k) for _, k in key)
