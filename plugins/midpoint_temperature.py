"""Midpoint rule in temperature variables: Romero (2009), eqs. (A4)-(A5). Momenta exact, energy not; order 2.

y = (q, p, theta). Forces and conduction at the midpoint of y; the entropies are balanced at both ends of the step.
Two other readings of (A5) exist: `rate`, the midpoint rule on d theta/dt (it violates the second law), and
`a5_literal`, s1 - s0 = 2 (s(y_mid) - s(y0)) (only of order 1).
"""

import numpy as np

from tcbench import Integrator, family, hookimpl


def balance(y0, y1, h, system):
    z0, z1, z_mid = (system.entropy_variables(y) for y in (y0, y1, (y0 + y1) / 2))
    return z1 - z0 - h * system.vector_field(z_mid)


def rate(y0, y1, h, system):
    return y1 - y0 - h * system.temperature_field((y0 + y1) / 2)


def a5_literal(y0, y1, h, system):
    z0, z_mid = (system.entropy_variables(y) for y in (y0, (y0 + y1) / 2))
    dz = np.concatenate([y1.q - y0.q, y1.p - y0.p, 2 * (z_mid.s - z0.s)])
    return dz - h * system.vector_field(z_mid)


def midpoint_temperature(reading="balance"):
    return Integrator(
        name="midpoint_temperature",
        order=1 if reading == "a5_literal" else 2,
        claims={"angular_momentum", "entropy"} if reading == "balance" else {"angular_momentum"},
        source="Romero (2009), eqs. (A4)-(A5)",
        flows={"balance": balance, "rate": rate, "a5_literal": a5_literal}[reading],
        variables="temperature",
    )


@hookimpl
def tcbench_integrators():
    return [family(midpoint_temperature, reading=("balance", "rate", "a5_literal"))]
