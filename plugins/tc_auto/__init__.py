"""Taylor series where conduction is not stiff, Gauss collocation where it is: both mended to all laws.

tc_auto goes over from tc_taylor to tc_gauss_adaptive and back during a run, by the stiffness that it measures: steps
over the decay time of the conduction. See march.py and docs/methods.md.
"""

from functools import cache

import numpy as np

from tcbench import Integrator, hookimpl

from ..tc_gauss import stages_of
from ..tc_gauss.method import GaussMethod
from ..tc_taylor import SAFETY, order_of
from ..tc_taylor import method_of as taylor_method
from ..tc_taylor.method import MOST_ELEMENTS

EXACT = {"energy", "entropy", "angular_momentum"}
FINER = 0.03  # of the tolerance, for tc_gauss: at equal ones it misses ten times what tc_taylor does (docs/methods.md)
SOURCE = "Taylor series or Gauss collocation, whichever costs less where the run is (docs/methods.md)"


@cache
def loops():
    """The compiled functions; LLVM is loaded when something runs, not when plugins are listed."""
    from .march import LOOPS

    return LOOPS


def methods_of(system, tolerance):
    """The implicit one, and the explicit one of the order for this tolerance; none where it is not for the system."""
    explicit = taylor_method(system, order_of(tolerance)) if system.n_elements <= MOST_ELEMENTS else None
    return GaussMethod(system, stages_of(tolerance)), explicit


def adaptive(system, z0, t_eval, rtol, atol):
    z0, times = np.ascontiguousarray(z0, float), np.ascontiguousarray(t_eval, float)
    gauss, taylor = methods_of(system, rtol)
    return gauss.adaptive(z0, times, rtol) if taylor is None else both(gauss, taylor, z0, times, rtol)


def both(gauss, taylor, z0, times, tolerance):
    """States at `times`, and what they cost; ArithmeticError where the steps of both become too short."""
    states = np.empty((len(times), len(z0)))
    done = loops().steps(taylor.work, gauss.work, z0, times, SAFETY * tolerance, *gauss.held(FINER * tolerance), states)
    if done < len(times):
        raise ArithmeticError(f"the step became too short before t = {times[done]:g}")
    implicit, explicit = gauss.cost(), taylor.cost()
    return states, implicit | {name: explicit[name] + implicit[name] for name in explicit}


@hookimpl
def tcbench_integrators():
    return [
        Integrator(
            name="tc_auto",
            claims=EXACT,
            source=SOURCE,
            adaptive=adaptive,
            elements=True,
            tags={"collocation", "explicit", "taylor"},
        )
    ]
