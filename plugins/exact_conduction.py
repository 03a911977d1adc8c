"""Splittings whose irreversible part is the exact flow of the conduction, for systems that have it in closed form.

tc_strang_exact: half steps of conduction around a reversible discrete-gradient step; in the other order it is eight
times less accurate on short_term. verlet_heat: explicit; half a kick with exact conduction, a drift, half a kick.
verlet_heat4: two such steps of complex lengths gamma h and conj(gamma) h, whose real part is of order four; the
irreversible flow does not allow the negative sub-steps of real compositions.
"""

import numpy as np

from tcbench import Integrator, hookimpl
from tcbench.compiler.complex_symbols import Complex, real

from .tc_staggered import reversible


def conduct(z0, z1, h, system):
    """The exact flow of conduction at fixed positions and momenta."""
    increments, _ = system.conduction_flow(system.temperatures(z0), h)
    return z1 - z0 - np.concatenate([0 * z0.q, 0 * z0.p, increments])


def kick(q, s, h, system):
    """Increments of momenta and entropies at fixed positions: the force is linear in the temperatures, so its mean is
    the force at the mean temperatures."""
    theta = system.temperatures(np.concatenate([q, 0 * q, s]))
    increments, mean = system.conduction_flow(theta, h)
    return h * system.temperature_forces(np.concatenate([q, 0 * q, mean])), increments


def verlet(z, parts, h, system):
    """Increments of explicit steps, one for each part of h. Two kicks at the same positions are one kick: the last of a
    step and the first of the next."""
    dq, (dp, ds) = 0.0, kick(z.q, z.s, parts[0] / 2 * h, system)
    for part, following in zip(parts, [*parts[1:], 0.0], strict=True):
        dq = dq + part * h * (z.p + dp) / system.inertia()
        further = kick(z.q + dq, z.s + ds, (part + following) / 2 * h, system)
        dp, ds = dp + further[0], ds + further[1]
    return np.concatenate([dq, dp, ds])


def verlet_heat(z0, z1, h, system):
    return z1 - z0 - verlet(z0, [1.0], h, system)


GAMMA, CONJUGATE = Complex(1 / 2, np.sqrt(3) / 6), Complex(1 / 2, -np.sqrt(3) / 6)


def verlet_heat4(z0, z1, h, system):
    return z1 - z0 - real(verlet(z0, [CONJUGATE, GAMMA], h, system))


VERLET_HEAT4 = Integrator(
    name="verlet_heat4",
    order=4,
    source="verlet_heat at the complex steps of Hansen & Ostermann (2009), real part",
    flows=verlet_heat4,
    needs=["conduction_flow"],
    elements=True,
    tags={"explicit"},
)


@hookimpl
def tcbench_integrators():
    return [
        Integrator(
            name="tc_strang_exact",
            order=2,
            claims={"energy", "entropy", "angular_momentum"},
            source="remark 3.2 with the exact flow of (22)",
            flows=[(conduct, 1 / 2), (reversible, 1), (conduct, 1 / 2)],
            needs=["conduction_flow"],
            elements=True,
        ),
        Integrator(
            name="verlet_heat",
            order=2,
            claims={"entropy", "angular_momentum"},
            source="Stoermer-Verlet with the exact flow of (22)",
            flows=verlet_heat,
            needs=["conduction_flow"],
            elements=True,
            tags={"explicit"},
        ),
        VERLET_HEAT4,
    ]
