"""TC staggered: Romero (2009), eqs. (12)-(13). A reversible step, then an irreversible one; order 1."""

from tcbench import Integrator, hookimpl


def reversible(z0, z1, h, system):
    """L DE alone: the entropy stays."""
    DE, DS = system.discrete_gradients(z0, z1)
    return z1 - z0 - h * system.reversible((z0 + z1) / 2, DE, DS)


def irreversible(z0, z1, h, system):
    """M DS alone: the energy stays, and of springs positions and momenta."""
    DE, DS = system.discrete_gradients(z0, z1)
    return z1 - z0 - h * system.irreversible((z0 + z1) / 2, DE, DS)


@hookimpl
def tcbench_integrators():
    return [
        Integrator(
            name="tc_staggered",
            order=1,
            claims={"energy", "entropy", "angular_momentum"},
            source="Romero (2009), eqs. (12)-(13)",
            flows=[reversible, irreversible],
        )
    ]
