"""An explicit Taylor method of high order, mended to all laws: where conduction is not stiff.

tc_taylor chooses order and steps by its tolerance; tc_taylor[order=8] takes fixed steps. The series come from the
traced formulas of the system by recurrences (Jorba and Zou 2005). Energy and momenta are mended to round-off, the
energy into heat, and the entropy is held where it would fall: see docs/methods.md.
"""

import math
from functools import cache
from threading import get_ident

import numpy as np

from tcbench import Integrator, family, hookimpl

ORDERS = (8, 10, 12, 14, 16, 18, 20)
EXACT = {"energy", "entropy", "angular_momentum"}
SOURCE = "Taylor series (Jorba and Zou 2005), mended into heat (docs/methods.md)"
SAFETY = 0.05  # what a step may miss, over the tolerance: a run then misses a tenth of what tc_gauss_adaptive does
LEAST, EFFORT = 5.0, 0.38  # the best order is about LEAST - EFFORT ln(tolerance): measured, see docs/methods.md


def method_of(system, order):
    """One set of work arrays for each system, order and thread."""
    from .method import TaylorMethod

    made, key = system.__dict__.setdefault("_taylor_methods", {}), (order, get_ident())
    if key not in made:
        made[key] = TaylorMethod(system, order)
    return made[key]


@cache
def order_of(tolerance):
    best = LEAST - EFFORT * math.log(min(SAFETY * tolerance, 1.0))
    return min(max(2 * round(best / 2), ORDERS[0]), ORDERS[-1])


def adaptive(system, z0, t_eval, rtol, atol):
    z0, times = np.ascontiguousarray(z0, float), np.ascontiguousarray(t_eval, float)
    return method_of(system, order_of(rtol)).adaptive(z0, times, SAFETY * rtol)


def tc_taylor(order="adaptive"):
    common = {"claims": EXACT, "source": SOURCE, "tags": {"explicit", "taylor"}, "name": "tc_taylor"}
    if order == "adaptive":
        return Integrator(adaptive=adaptive, **common)

    def step(z, h, system):
        return march(z, h, 1, system)[0]

    def march(z, h, count, system):
        return method_of(system, int(order)).march(np.ascontiguousarray(z, dtype=float), h, count)

    return Integrator(step=step, march=march, order=int(order), **common)


@hookimpl
def tcbench_integrators():
    return [family(tc_taylor, order=("adaptive", 2, 3, 4, 6, *ORDERS))]
