"""The variables of a run and their rates as series: any system's z by its vector field, and (q, p, theta) of elements.

With temperatures instead of entropies as variables no exponential is left of springs and gases. In

    q' = p/m,   p' = -e_pi . dpi/dq,   theta' = theta_pi pi' + theta_s (M DS)

pi' is the derivative of the series of pi, and pi'/pi that of log pi: neither costs a product of its own.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tcbench import System
from tcbench.compiler import derivatives as trace
from tcbench.compiler.array_states import entries
from tcbench.compiler.derivatives import Symbol

from .factored import Factored
from .lanes import reachable
from .series import ONE, ZERO, Linear, Normal, Series, combined

FEWER = 0.9  # factored, a system has so many of its series at most; else the longer chains of operations cost more


def rates(system: System) -> tuple[list[Series], list[Series]]:
    """The variables and their rates."""
    if system.defines("element_energy"):
        return of_elements(system)
    plain, factored = of_any(system, Normal), of_any(system, Factored)
    return factored if operations(factored) < FEWER * operations(plain) else plain


def rates_of_arrays(net: Any, y: Any) -> tuple[list[Series], list[Series]]:
    """The same of a system of any size, by its `by_arrays`; y: a fresh state in the same variables."""
    field = net.temperature_field(y) if net.defines("element_energy") else net.vector_field(y)
    laws = [] if net.defines("element_energy") else [trace.lifted(x) for x in net.momenta(y)]
    plain, factored = (of_field(form(entries(y)), laws, entries(field)) for form in (Normal, Factored))
    return factored if operations(factored) < FEWER * operations(plain) else plain


def operations(found: tuple[list[Series], list[Series]]) -> int:
    """How many series there are that cost something."""
    return sum(x.kind not in ("sum", "D") for x in reachable([*found[0], *found[1]]))


def of_any(system: System, form: type[Normal]) -> tuple[list[Series], list[Series]]:
    """z and the vector field, in a normal form of this kind; the field leaves the invariants as they are."""
    z, sym = trace.variables("z", system.size), system.symbolic
    return of_field(form(z), [trace.lifted(x) for x in sym.momenta(z)], list(sym.vector_field(z)))


def of_field(normal: Normal, laws: list[Symbol], field: list[Symbol]) -> tuple[list[Series], list[Series]]:
    """Variables and rates; laws: what stays constant."""
    normal.hold(normal.of(laws))
    forms = normal.of(field)
    return normal.variables, [normal.single(form) if form else normal.series("sum", (), (ZERO,)) for form in forms]


def of_elements(system: System) -> tuple[list[Series], list[Series]]:
    """y = (q, p, theta) and its rates."""
    sym, n, m = system.symbolic, system.n_positions, system.n_elements
    y = trace.variables("y", 2 * n + m)
    normal = Normal(y)
    q, p, theta = y[:n], y[n : 2 * n], y[2 * n :]
    pi, s = trace.variables("pi", m), trace.variables("s", m)
    energy = trace.jacobian(list(sym.element_energy(pi, s)), [*pi, *s])
    stress, warmth = [energy[i, i] for i in range(m)], [energy[i, m + i] for i in range(m)]
    by_pi = [trace.jacobian([warmth[i]], [pi[i]])[0, 0] for i in range(m)]
    by_s = [trace.jacobian([warmth[i]], [s[i]])[0, 0] for i in range(m)]
    shape = list(sym.shape(q))
    here = dict(zip([*pi, *s], [*shape, *sym.entropies(q, theta)], strict=True))
    stress, by_pi, by_s = (trace.substitute(x, here) for x in (stress, by_pi, by_s))
    slope = trace.jacobian(shape, list(q))
    conduction = list(sym.conduction(theta))
    inertia = sym.inertia() * np.ones(n)
    moved = normal.of(
        [*stress, *by_pi, *by_s, *shape, *conduction, *slope.ravel(), *(x / i for x, i in zip(p, inertia, strict=True))]
    )
    stress_, by_pi_, by_s_, shape_, heat_ = (moved[k * m : (k + 1) * m] for k in range(5))
    slope_ = np.array([*moved[5 * m : 5 * m + m * n], None], dtype=object)[:-1].reshape(m, n)
    forms: list[Linear] = list(moved[5 * m + m * n :])
    for j in range(n):
        force: Linear = {}
        for i in range(m):
            force = combined(force, normal.times(stress_[i], slope_[i, j]), trace.const(-1.0))
        forms.append(force)
    for i in range(m):
        rise = normal.times(by_s_[i], heat_[i])
        forms.append(combined(normal.times(by_pi_[i], normal.derivative(shape_[i])), rise, ONE))
    return normal.variables, [normal.single(form) for form in forms]
