"""TC staggered: Romero (2009), eqs. (12)-(13). A reversible step, then an irreversible one; order 1."""

import numpy as np

from tcbench import Integrator, hookimpl


def reversible(z0, z1, h, system):
    """Entropies frozen."""
    DE = system.discrete_gradient(z0, z1)
    return z1 - z0 - h * (system.L @ DE)


def irreversible(z0, z1, h, system):
    """Positions and momenta frozen."""
    DE = system.discrete_gradient(z0, np.concatenate([z0.q, z0.p, z1.s]))
    return z1 - z0 - h * system.dissipation(DE.s)


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
