"""TC monolithic: Romero (2009), eqs. (6), (A1). Energy and invariants exact, entropy never decreases, order 2."""

from tcbench import Integrator, hookimpl


def tc_monolithic(z0, z1, h, system):
    DE, DS = system.discrete_gradients(z0, z1)  # (8); of springs (30)-(33)
    mid = (z0 + z1) / 2
    return z1 - z0 - h * (system.reversible(mid, DE, DS) + system.irreversible(mid, DE, DS))


@hookimpl
def tcbench_integrators():
    return [
        Integrator(
            name="tc_monolithic",
            order=2,
            claims={"energy", "entropy", "angular_momentum"},
            source="Romero (2009), eqs. (6), (A1)",
            flows=tc_monolithic,
        )
    ]
