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
    others = (
        name for name, i in known.items() if i.kind != "adaptive" and name not in ("projected", VERLET_HEAT4.name)
    )
    return [VERLET_HEAT4.name, *others]


@hookimpl
def tcbench_integrators():
    return [family(project, method=one_step_methods)]
