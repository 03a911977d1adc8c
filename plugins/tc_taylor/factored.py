"""Sums of products in fewer products: rigid_body takes 3.5 Cauchy products for 5.5, heavy_top 8.5 for 9.5."""

from __future__ import annotations

from collections import Counter
from itertools import combinations

from .lanes import Packs, is_square
from .series import ONE, Linear, Monomial, Normal, Series, combined


def products(found: tuple[list[Series], list[Series]]) -> float:
    """How many Cauchy products a coefficient takes, those of a pack at once."""
    packs = {id(pack): pack for pack, _ in Packs(dict(enumerate(found[1])), found[0]).home.values()}
    kinds = ((pack[0].kind, is_square(pack[0])) for pack in packs.values())
    return sum(0.0 if kind in ("var", "sign") else 0.5 if square else 1.0 for kind, square in kinds)


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
            known = (pair for pair in pairs if self.key("product", pair) in self.interned)
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
