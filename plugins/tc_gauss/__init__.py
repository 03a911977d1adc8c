"""Thermodynamically consistent Gauss collocation with k stages: order 2k, energy and momenta exact, S never decreases.

Gauss collocation in which the slopes of E and S are projected so that both laws are exact. Quantities y that are at
most quadratic in the state have collocation polynomials of their own, which Gauss quadrature integrates exactly. For
springs the y are the strain measures, and the projected slopes are stresses and temperatures. With k = 1 it is a
variant of the paper's method with mean slopes.
"""

from functools import cache, partial

import numpy as np

from tcbench import Integrator, family, hookimpl
from tcbench.compiler.caches import Spares

EXACT = {"energy", "entropy", "angular_momentum"}
SOURCE = "Gauss collocation with projected stress and temperature (docs/methods-explained.md)"
STAGES = (3, 1, 2, 4, 5, 6, 7, 8)  # the first is the default
BY_TOLERANCE = ((1e-4, 4), (1e-6, 6), (0.0, 7))  # (down to, k): what costs least, measured on five scenarios


@cache
def stages_of(tolerance):
    """The number of stages that costs least at this tolerance."""
    return next(k for lowest, k in BY_TOLERANCE if tolerance >= lowest)


def method_of(system, stages):
    """The collocation with so many stages, set up for a run."""
    from .method import GaussMethod  # imported when something runs, not when plugins are listed

    return GaussMethod(system, stages)


SPARES = Spares(method_of, lambda stages: (stages,))


def increments(z, h, system, method):
    return method.increments(np.asarray(z), h)


def several(z, h, count, system, method):
    return method.march(np.asarray(z), h, count)


def tc_gauss(k="3"):
    return Integrator(
        name="tc_gauss", order=2 * int(k), claims=EXACT, source=SOURCE, step=increments, increments=True, march=several,
        workspace=partial(method_of, stages=int(k)), tags={"collocation", "constraints"},
    )  # fmt: skip


def tc_gauss_adaptive(k="by tolerance"):
    def adaptive(system, z0, t_eval, rtol, atol):
        chosen = stages_of(rtol) if k == "by tolerance" else int(k)
        return SPARES.adaptive(system, chosen, z0, t_eval, rtol)

    common = {"claims": EXACT, "source": SOURCE, "tags": {"collocation", "constraints"}}
    return Integrator(name="tc_gauss_adaptive", adaptive=adaptive, **common)


@hookimpl
def tcbench_integrators():
    return [family(tc_gauss, k=STAGES), family(tc_gauss_adaptive, k=("by tolerance", *sorted(STAGES)))]
