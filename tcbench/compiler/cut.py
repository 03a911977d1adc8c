"""A formula f(z) written as F(y(z)): each y_b is a polynomial of degree 1 or 2 in z, F contains the rest.

The midpoint rule and Gauss's integrate quadratic y exactly, so only the slopes F_b = dF/dy_b need care; and whatever
numbers stand for these, the gradient sum_b F_b grad y_b(z) keeps the invariants that belong to symmetries of the y,
angular momenta first: Romero (2009), eqs. (14)-(15), with y in the place of the strain measures pi.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from . import derivatives as trace
from .arrays import LINEAR, total, variable
from .chain_rule import discrete_gradient, gradient
from .derivatives import Symbol


class Cut:
    """f(x) as F(y(x)). inner : the y by x. y : symbols for them. outer : F by those."""

    def __init__(self, f: Symbol, x: Sequence[Symbol]) -> None:
        self.x = list(x)
        f = with_squares(f)
        degree = degrees([f], self.x)
        cut = {f.number: f} if degree[f.number] <= 2 else {}
        if not cut:
            for node in trace.topological([f]):
                if degree[node.number] > 2:
                    cut |= {a.number: a for a in node.args if 1 <= degree[a.number] <= 2}
        self.inner = list(cut.values())
        self.y = [variable(f"y{i}", y.space) for i, y in enumerate(self.inner)]
        (self.outer,) = trace.substitute([f], dict(zip(self.inner, self.y, strict=True)))
        self.slopes = gradient(self.outer, self.y)

    def values(self, z: Sequence[Symbol]) -> list[Symbol]:
        """The y at a state z."""
        return trace.substitute(self.inner, dict(zip(self.x, z, strict=True)))

    def moved(self, z: Sequence[Symbol], dz: Sequence[Symbol]) -> list[Symbol]:
        """grad y(z) . dz of each y."""
        steps = [variable("step", x.space) for x in self.x]
        rates = trace.along(self.inner, dict(zip(self.x, steps, strict=True)))
        return trace.substitute(rates, dict(zip([*self.x, *steps], [*z, *dz], strict=True)))

    def outer_slopes(self, y: Sequence[Symbol]) -> list[Symbol]:
        """grad F at these y."""
        return trace.substitute(self.slopes, dict(zip(self.y, y, strict=True)))

    def outer_discrete(self, start: Sequence[Symbol], step: Sequence[Symbol]) -> list[Symbol]:
        """The discrete gradient of F by the chain rule."""
        return discrete_gradient(self.outer, self.y, start, step)

    def joined(self, slopes: Sequence[Symbol], z: Sequence[Symbol]) -> list[Symbol]:
        """sum_b slopes_b grad y_b(z): a gradient by z."""
        held = [variable("slope", y.space) for y in self.inner]
        work = [total("add", w * y, y.space) for w, y in zip(held, self.inner, strict=True)]
        slopes_of_work = gradient(sum(work, trace.const(0.0)), self.x)
        return trace.substitute(slopes_of_work, dict(zip([*self.x, *held], [*z, *slopes], strict=True)))


def with_squares(f: Symbol) -> Symbol:
    """f with sqrt(x^2 + y^2) in the place of each hypot: the sum is an invariant where its terms are not."""
    roots: dict[Symbol, Symbol] = {}
    squares: dict[Symbol, Symbol] = {}
    for node in trace.topological([f]):
        if node.op == "hypot":
            terms = zip(node.args, trace.substitute(node.args, roots), strict=True)
            squares[node] = trace.add(*(squares.get(a, trace.mul(x, x)) for a, x in terms))
            roots[node] = squares[node].sqrt()
    return trace.substitute([f], roots)[0] if roots else f


def degrees(outputs: Sequence[Symbol], x: Sequence[Symbol], given: dict[int, float] | None = None) -> dict[int, float]:
    """A bound of the degree of each node under the outputs, by number, as a polynomial in x; infinity for other nodes.

    given : degrees of other nodes, to which these are added."""
    degree = {} if given is None else given
    degree |= {s.number: 1.0 for s in x}
    for node in trace.topological_beyond(outputs, degree):
        of = [degree[a.number] for a in node.args]
        if node.op in ("add", "sub", "neg", "mark", *LINEAR):
            degree[node.number] = max(of)
        elif node.op == "mul":
            degree[node.number] = sum(of)
        else:
            degree[node.number] = math.inf if any(of) else 0.0
    return degree
