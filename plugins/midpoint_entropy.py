"""Midpoint rule on z, of elements in entropy variables: Romero (2009), eqs. (A2)-(A3). Order 2; energy is not exact.

Where S is a sum of variables it cannot decrease, at any step: the conduction at the midpoint temperatures produces
kappa (theta_b/theta_a + theta_a/theta_b - 2) >= 0. Where S is another function it may fall.
"""

from tcbench import Integrator, hookimpl


def midpoint_entropy(z0, z1, h, system):
    return z1 - z0 - h * system.vector_field((z0 + z1) / 2)


@hookimpl
def tcbench_integrators():
    return [
        Integrator(
            name="midpoint_entropy",
            order=2,
            claims={"angular_momentum"},  # entropy only where it is a sum of variables, see above
            source="Romero (2009), eqs. (A2)-(A3)",
            flows=midpoint_entropy,
        )
    ]
