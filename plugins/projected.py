"""Thermodynamic projection around another method: `projected[method=NAME]` for any registered one-step method.

The default is verlet_heat4: explicit, of order four, and with the projection thermodynamically consistent.
"""

from tcbench import family, hookimpl
from tcbench.plugins import find_integrator
from tcbench.projection import projected

from .exact_conduction import VERLET_HEAT4


def project(method=VERLET_HEAT4.name):
    return projected(VERLET_HEAT4 if method == VERLET_HEAT4.name else find_integrator(method))


def one_step_methods(known):
    """Those that a projection changes: not the ones that keep the energy already, nor those for one system only."""
    others = (
        n
        for n, i in known.items()
        if i.kind != "adaptive" and "energy" not in i.claims and not i.only_for and i.family is not project
    )
    return [VERLET_HEAT4.name, *(name for name in others if name != VERLET_HEAT4.name)]


@hookimpl
def tcbench_integrators():
    return [family(project, method=one_step_methods)]
