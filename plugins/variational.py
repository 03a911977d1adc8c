"""A variational integrator of thermodynamics: the trapezoidal rule in thermal displacements, with dissipative forces.

Temperatures are rates of thermal displacements a, and entropies the momenta of these (Mata and Lew 2011). With v and
theta constant on the step, and the free energy A(q, theta) = U(q, s) - theta.s, the discrete Lagrangian is

    L_d = h K(v) - h/2 (A(q0, theta) + A(q1, theta)),    v = (q1 - q0)/h,    theta = (a1 - a0)/h.

Friction f and entropy production g are forces, half of each at both ends; both are taken at the middle of the step. The
discrete Lagrange-d'Alembert equations are then

    p_ = p0 - h/2 (U_q(q0, s_a) - f),    q1 = q0 + h K_p(p_),    p1 = p_ - h/2 (U_q(q1, s_b) - f),    s1 = s0 + h g,
    theta = U_s(q0, s_a) = U_s(q1, s_b),    (s_a + s_b)/2 = (s0 + s1)/2,

so that U needs no temperatures as variables. Order 2. Momenta are exact; entropy never falls, for the sum of g is not
negative; where nothing dissipates, the map is symplectic in (q, p) and (a, s); the energy is kept to the order only.
The discrete Lagrangian of the midpoint, in the place of the trapezoid's, gives midpoint_entropy.
"""

import numpy as np

from tcbench import Flow, Integrator, hookimpl
from tcbench.compiler import derivatives as trace
from tcbench.compiler.caches import cached_per_system

from .ybaby import ANOTHER, under
from .ybaby import refuses as not_hamiltonian


@cached_per_system
def entropies(system):
    """The names of the variables of a linear S; None for another S."""
    sym = system.symbolic
    slope = sym.entropy_gradient(sym.state(trace.variables("z", system.size)))
    parts = {name: [trace.lifted(x) for x in np.ravel(getattr(slope, name))] for name in system.variables}
    if not all(trace.is_const(x) for part in parts.values() for x in part):
        return None
    return [name for name, part in parts.items() if not all(trace.is_const(x, 0.0) for x in part)]


def refuses(system):
    if reason := not_hamiltonian(system):
        return reason
    if entropies(system) is None:
        return f"it needs entropies as variables, which {system.name} has not: {ANOTHER}"
    return ""


def with_parts(system, z, **parts):
    return system.state(np.concatenate([np.ravel(parts.get(n, getattr(z, n))) for n in system.variables]))


def trapezoidal(z0, z1, h, system, stages):
    (half,) = stages  # p_ and s_a; z0 elsewhere
    middle = (z0 + z1) / 2
    of_entropies = entropies(system)
    at_a = {n: getattr(half, n) for n in of_entropies}
    at_b = {n: 2 * getattr(middle, n) - s for n, s in at_a.items()}
    a, b = (system.gradient(with_parts(system, z, p=half.p, **s)) for z, s in ((z0, at_a), (z1, at_b)))
    mid, DE, DS = with_parts(system, middle, p=half.p), (a + b) / 2, system.entropy_gradient(z0)
    rate = system.irreversible(mid, DE, DS)

    def as_warm(n):
        """The residual of equal temperatures at both ends; of the midpoint's where they do not depend on entropies."""
        own = np.ravel(getattr(half, n)) - np.ravel(getattr(middle, n))
        gaps = np.ravel(getattr(a, n) - getattr(b, n))
        return [gap if under([gap], list(np.ravel(getattr(half, n)))) else x for gap, x in zip(gaps, own, strict=True)]

    kick = h / 2 * (np.ravel(system.state(rate).p) - np.ravel(a.q))
    rows = with_parts(system, half - z0, p=np.ravel(half.p - z0.p) - kick, **{n: as_warm(n) for n in of_entropies})
    return np.concatenate([z1 - z0 - h * (system.reversible(mid, DE, DS) + rate), rows])


@hookimpl
def tcbench_integrators():
    return [
        Integrator(
            name="variational",
            order=2,
            claims={"entropy", "angular_momentum"},
            source="Mata and Lew (2011); Kern, Romero et al. (2016), arXiv 1610.08666; Gay-Balmaz and Yoshimura (2018)",
            flows=Flow(trapezoidal, stages=1),
            refuses=refuses,
            by_default=False,
        )
    ]
