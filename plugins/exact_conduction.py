"""Splittings whose irreversible part is the exact flow of the conduction, for systems that have it in closed form.

tc_strang_exact: conduction outside, the reversible discrete-gradient step inside; with the reversible half last it is
eight times less accurate on short_term. verlet_heat: explicit; half a kick with exact conduction, a drift, half a kick.
"""

import numpy as np

from tcbench import Integrator, hookimpl

from .tc_staggered import reversible

CLOSED_FORM = "closed-form conduction"  # tag: the system must define conduction_flow


def conduct(z0, z1, h, system):
    """Positions and momenta frozen, exactly."""
    increments, _ = system.conduction_flow(system.temperatures(z0), h)
    return z1 - z0 - np.concatenate([np.zeros(2 * len(z0.q)), increments])


def kick(q, s, h, system):
    """Increments of momenta and entropies at fixed positions: the force is linear in the temperatures, so its mean is
    the force at the mean temperatures."""
    theta = system.temperatures(np.concatenate([q, 0 * q, s]))
    increments, mean = system.conduction_flow(theta, h)
    force = -np.asarray(system.gradient(np.concatenate([q, 0 * q, system.entropies(q, mean)])))[: len(q)]
    return h * force, increments


def verlet_heat(z0, z1, h, system):
    dp0, ds0 = kick(z0.q, z0.s, h / 2, system)
    drift = h * (z0.p + dp0) / system.inertia()
    dp1, ds1 = kick(z0.q + drift, z0.s + ds0, h / 2, system)
    return z1 - z0 - np.concatenate([drift, dp0 + dp1, ds0 + ds1])


@hookimpl
def tcbench_integrators():
    return [
        Integrator(
            name="tc_strang_exact",
            order=2,
            claims={"energy", "entropy", "angular_momentum"},
            source="remark 3.2 with the exact flow of (22)",
            flows=[(conduct, 1 / 2), (reversible, 1), (conduct, 1 / 2)],
            tags={CLOSED_FORM},
        ),
        Integrator(
            name="verlet_heat",
            order=2,
            claims={"entropy", "angular_momentum"},
            source="Stoermer-Verlet with the exact flow of (22)",
            flows=verlet_heat,
            tags={CLOSED_FORM, "explicit"},
        ),
    ]
