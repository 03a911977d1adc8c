"""Arguments of functions that are flat to the last digit: far from a Gaussian exp(-(x/w)^2) or a front tanh(x/w)
neither values nor slopes, of any order, show it. The arguments do.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from .arrays import LINEAR
from .derivatives import depends_on, topological
from .symbols import Symbol, add, const, mul

FLAT = 36.0  # exp(-36) is the round-off of 1
AFFINE = frozenset({"add", "sub", "neg", "mark", *LINEAR})
EXPONENTIALS = ("exp", "expm1", "sinh", "cosh")


class Argument(NamedTuple):
    """u of exp(u), which is flat for u < -FLAT; `both`: flat on both sides, as tanh and 1/(1 + exp(u))."""

    u: Symbol
    both: bool

    def edges(self, level: float = FLAT) -> list[Symbol]:
        """Numbers that pass 0 where u enters or leaves the part that is not flat."""
        return [add(self.u, const(x)) for x in ((level, -level) if self.both else (level,))]

    def edge(self) -> Symbol:
        """A number that is positive in the part that is not flat, and elsewhere shows the distance to it."""
        if not self.both:
            return add(self.u, const(FLAT))
        return const(FLAT) - add(mul(self.u, self.u), const(1.0)).sqrt()


def flat_away(outputs: Sequence[Symbol], variables: Iterable[Symbol]) -> list[Argument]:
    """The arguments, each once, for which outputs may be flat on both sides of a place that the variables can pass.

    An exponential of an affine function, or of one of logarithms (a power), grows behind the place where it begins to,
    and is seen from there; in a sum in a denominator it saturates, and so does what falls on both sides of a place.
    """
    nodes, moving = topological(outputs), depends_on(list(outputs), list(variables))
    bent: set[int] = set()
    for node in nodes:
        args = [a for a in node.args if a.number in moving]
        affine = node.op in AFFINE or (node.op == "mul" and len(args) == 1)
        if args and node.op != "log" and not (affine and all(a.number not in bent for a in args)):
            bent.add(node.number)
    saturating = _saturating(nodes, bent)
    sides: dict[Symbol, bool] = {}
    for node in nodes:
        if node.number not in moving:
            continue
        u = node.args[0] if node.args else node
        if node.op == "pow" and u.number not in moving:
            u = node.args[1] * u.log()
        elif node.op not in (*EXPONENTIALS, "tanh"):
            continue
        u = u + u if node.op == "tanh" else u  # tanh(u) is 1 - 2/(1 + exp(2 u))
        both = node.op in ("tanh", "sinh", "cosh") or node.number in saturating
        if node.op == "tanh" or node.number in saturating or node.args[-1].number in bent:
            sides[u] = sides.get(u, False) or both
    return [Argument(u, both) for u, both in sides.items()]


def _saturating(nodes: Iterable[Symbol], bent: set[int]) -> set[int]:
    """Numbers of the exponentials that saturate in denominators, and of those that are large there on both sides."""
    below = [x.args[0] for x in nodes if x.op == "recip" or (x.op == "pow" and not (x.args[1].value or -1.0) > 0.0)]
    sums, seen = [], set()
    while below:
        x = below.pop()
        if x.number in seen:
            continue
        seen.add(x.number)
        if x.op in ("add", "sub"):
            sums.append(x)
        elif x.op not in EXPONENTIALS:
            below.extend(x.args)
        elif x.op in ("sinh", "cosh") or x.args[0].number in bent:
            sums.append(x)
    return {x.number for x in topological(sums)}
