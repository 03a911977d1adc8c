"""An explicit Taylor method of high order, corrected to all laws; for problems in which conduction is not stiff.

tc_taylor chooses order and steps by its tolerance; tc_taylor[order=8] takes fixed steps. The series come from the
traced formulas of the system by recurrences (Jorba and Zou 2005). Energy and momenta are corrected to round-off, and
the entropy is held where it would fall: see docs/methods-explained.md.
"""

import math
from functools import partial

import numpy as np

from tcbench import Integrator, family, hookimpl
from tcbench.compiler.caches import Spares

from .orders import EFFORT, LEAST, LONG_ORDER, MOST_ELEMENTS, MOST_ORDER, MOST_VARIABLES, ORDERS, is_long

EXACT = {"energy", "entropy", "angular_momentum"}
SOURCE = "Taylor series (Jorba and Zou 2005), corrected to the laws (docs/methods-explained.md)"
SAFETY = 0.05  # what a step may miss, over the tolerance: a run then misses a tenth of what tc_gauss_adaptive does


def refuses(system):
    """Why there are no series of a system: those of a large one are loops over its spaces."""
    if system.large or not is_long(system):
        return ""
    return (
        f"it writes the series of {system.size} variables out, which are too many for it (at most {MOST_ELEMENTS} "
        f"elements, or {MOST_VARIABLES} variables of a system without). Declare spaces (docs/add-system.md), or take "
        "tc_gauss or tc_monolithic"
    )


def method_of(system, order):
    """The series of this order, set up for a run."""
    from .method import TaylorMethod  # imported when something runs, not when plugins are listed

    return TaylorMethod(system, order)


def best_of(system, order):
    """The series for a tolerance of which this is the best order; of elements at most the last that is damped, and
    under constraints at most that of long series."""
    most = MOST_ORDER if system.defines("element_energy") else LONG_ORDER if system.multipliers else order
    return method_of(system, min(order, most))


def order_of(tolerance):
    best = LEAST - EFFORT * math.log(min(SAFETY * tolerance, 1.0))
    return min(max(2 * round(best / 2), ORDERS[0]), ORDERS[-1])


SPARES = Spares(best_of, lambda tolerance: (order_of(tolerance),))


def adaptive(system, z0, t_eval, rtol, atol):
    return SPARES.adaptive(system, rtol, z0, t_eval, SAFETY * rtol)


def one_step(z, h, system, method):
    return method.step(np.ascontiguousarray(z, dtype=float), h)


def several_steps(z, h, count, system, method):
    return method.march(np.ascontiguousarray(z, dtype=float), h, count)


def tc_taylor(order="adaptive"):
    tags = {"explicit", "taylor", "constraints"}
    common = {"claims": EXACT, "source": SOURCE, "tags": tags, "name": "tc_taylor", "refuses": refuses}
    if order == "adaptive":
        return Integrator(adaptive=adaptive, **common)

    return Integrator(
        step=one_step, march=several_steps, workspace=partial(method_of, order=int(order)), order=int(order), **common
    )


@hookimpl
def tcbench_integrators():
    return [family(tc_taylor, order=("adaptive", 2, 3, 4, 6, *ORDERS))]
