"""TC monolithic: Romero (2009), eq. (A1). Energy and momenta exact, entropy never decreases, order 2."""

from tcbench import Integrator, hookimpl


def tc_monolithic(z0, z1, h, system):
    DE = system.discrete_gradient(z0, z1)  # (30)-(33)
    return z1 - z0 - h * (system.L @ DE + system.dissipation(DE.s))  # M DS at the algorithmic temperatures (34)-(35)


@hookimpl
def tcbench_integrators():
    return [
        Integrator(
            name="tc_monolithic",
            order=2,
            claims={"energy", "entropy", "angular_momentum"},
            source="Romero (2009), eq. (A1)",
            flows=tc_monolithic,
        )
    ]
