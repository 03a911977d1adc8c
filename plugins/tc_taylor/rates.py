"""The variables of a run and their rates as series: any system's z by its vector field, and (q, p, theta) of elements.

With temperatures instead of entropies as variables no exponential is left of springs and gases. In

    q' = p/m,   p' = -e_pi . dpi/dq,   theta' = theta_pi pi' + theta_s (M DS)

pi' is the derivative of the series of pi, and pi'/pi that of log pi: neither costs a product of its own. That is why
springs have rates of their own: the chain rule through the graph alone gives a pendulum 36 series in the place of 24.
"""

from __future__ import annotations

from typing import Any

from tcbench.compiler import derivatives as trace
from tcbench.compiler.array_states import entries, refilled
from tcbench.compiler.derivatives import Symbol
from tcbench.compiler.flat import flat_away
from tcbench.compiler.kinks import sign
from tcbench.systems.constrained import reduced

from .factored import Factored, products
from .series import ONE, STANDING, ZERO, Linear, Normal, Series, combined

NEARER = 12.0  # exponents: terms of order 8 of e^-36 are within a tolerance to where it is e^40, of e^-12 to e^-8
FEWER = 0.9  # another form has so many of the plain one's products at most: its chains of operations may be longer


def rates(sym: Any, y: Any) -> tuple[list[Series], list[Series]]:
    """The variables and their rates, by a system's `symbolic` or `by_arrays`, y a fresh state; of numbers in the form
    with fewer products."""
    of = of_elements if sym.defines("element_energy") else of_any
    plain = of(sym, y, Normal(entries(y)))
    if sym.by_array:
        return plain
    factored = of(sym, y, Factored(entries(y)))
    return factored if products(factored) < FEWER * products(plain) else plain


def of_any(sym: Any, z: Any, normal: Normal) -> tuple[list[Series], list[Series]]:
    """z and the vector field, which leaves the invariants as they are."""
    normal.hold(normal.of(lifted(sym.momenta(z))))
    rates = lifted(reduced(sym, z, marked=True) if sym.multipliers else sym.vector_field(z))
    return normal.variables, singles(normal, normal.of(with_edges(rates, entries(z))))


def with_edges(rates: list[Symbol], variables: list[Symbol]) -> list[Symbol]:
    """The rates with signs, too small to count, that change where the rates stop being flat: steps end there as at
    kinks, for series at a flat place show nothing of what follows. Those of low order show it from NEARER on only, and
    end there, too."""
    for argument in flat_away(rates, variables):
        for edge in [*argument.edges(), *argument.edges(NEARER)]:
            places = [i for i, x in enumerate(rates) if x.space == edge.space]
            if places:
                rates[places[0]] = rates[places[0]] + STANDING * sign(edge)
    return rates


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
