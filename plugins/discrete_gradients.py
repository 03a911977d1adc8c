"""The paper's monolithic method with other discrete gradients in the same slot; formulas in tcbench/gradients.py.

tc_gonzalez: midpoint slopes with projection. tc_itoh_abe: one ordering, order 1 (the paper's (31)-(32) symmetrise it).
tc_mean_value: averaged slopes; its energy is exact up to a five-point quadrature, so it does not claim it.
"""

from tcbench import Integrator, hookimpl
from tcbench.gradients import gonzalez, itoh_abe, mean_value

EXACT = {"energy", "entropy", "angular_momentum"}


def with_gradient(gradient):
    def monolithic(z0, z1, h, system):
        DE = gradient(system, z0, z1)
        return z1 - z0 - h * (system.L @ DE + system.dissipation(DE.s))

    return monolithic


@hookimpl
def tcbench_integrators():
    methods = [
        ("tc_gonzalez", gonzalez, 2, EXACT, "Gonzalez (1996), in the frame of Romero (2009)"),
        ("tc_itoh_abe", itoh_abe, 1, EXACT, "Itoh and Abe (1988), in the frame of Romero (2009)"),
        ("tc_mean_value", mean_value, 2, EXACT - {"energy"}, "McLachlan, Quispel and Robidoux (1999), likewise"),
    ]
    return [
        Integrator(
            name=name, order=order, claims=claims, source=source, flows=with_gradient(gradient), tags={"gradient"}
        )
        for name, gradient, order, claims, source in methods
    ]
