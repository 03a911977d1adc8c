"""Taylor series where dissipation is not stiff, Gauss collocation where it is; both corrected to all laws.

tc_auto changes between tc_taylor and tc_gauss_adaptive during a run, by the stiffness that it measures: the step length
over the time of the fastest motion. See march.py and docs/methods-explained.md.
"""

from tcbench import Integrator, hookimpl
from tcbench.compiler.caches import Spares

from ..tc_gauss import stages_of
from ..tc_taylor import SAFETY, best_of, order_of, refuses

EXACT = {"energy", "entropy", "angular_momentum"}
FINER = 0.03  # of the tolerance, for tc_gauss: at equal ones its error is ten times that of tc_taylor
COST, COST_OF_ORDER = 0.33, 0.062  # of large systems: iterations that an explicit step of order p takes the time of
# Microseconds on one machine, of which the ratio counts: of an explicit step and of an operation of its series; of a
# node in an iteration and the square of the number of variables; of an iteration on vectors and the square of the
# number of those that it solves for.
STEP, STEP_OF_SERIES, NODE, NODE_OF_SQUARE = 0.06, 0.00065, 0.1, 0.0022
VECTORS, VECTORS_OF_SQUARE = 0.18, 0.0018
SOURCE = "Taylor series or Gauss collocation, whichever is cheaper (docs/methods-explained.md)"


class BothMethods:
    """Both methods, set up for a system; the explicit one is None where it is not for the system."""

    def __init__(self, system, order, stages):
        from ..tc_gauss.method import GaussMethod  # imported when something runs, not when plugins are listed

        self.gauss, self.taylor = GaussMethod(system, stages), None if refuses(system) else best_of(system, order)
        self.tolerance = None  # that `work` is set to
        if self.taylor:
            from .march import LOOPS, SHORT, Both, Counts  # LLVM is loaded when something runs, not with plugins

            worth = step_in_iterations(self.gauss, self.taylor)
            self.counts, self.taylor.work.few = Counts(), SHORT / worth
            self.gauss.work.lend("watch", self.taylor.work.watch)
            both = {"explicit": self.taylor.work, "implicit": self.gauss.work}
            self.work = Both(counts=self.counts, worth=worth, **both)
            self.run = LOOPS.bound("run", self.work)
        else:
            self.adaptive = self.gauss.adaptive

    def adaptive(self, z0, times, tolerance):
        """States at `times`, and what they cost; ArithmeticError where the steps of both become too short."""
        gauss, taylor, work = self.gauss, self.taylor, self.work
        if self.tolerance != tolerance:
            from ..tc_gauss.method import held  # a microsecond, of runs that take three

            self.tolerance, work.tolerance = tolerance, SAFETY * tolerance
            work.defect, work.residual = held(gauss.stages, FINER * tolerance)
        taylor.begin(z0, times)
        try:
            states = taylor.ended(self.run() == len(times), gauss.work.budget)
        finally:
            steps, rejected, iterations, implicit = self.counts.table.tolist()
            if implicit:
                gauss.work.clear()  # as it was before
        return states, {"steps": steps, "rejected": rejected, "newton_iterations": iterations}


def step_in_iterations(gauss, taylor):
    """Iterations that take the time of an explicit step, by what both do."""
    if gauss.work.large:  # of large systems the time of both goes with the size
        return COST + COST_OF_ORDER * taylor.work.order
    n, own = taylor.size, gauss.work.n_own
    on_vectors = VECTORS + VECTORS_OF_SQUARE * own * own
    iteration = on_vectors if gauss.work.n_lanes > 0 else gauss.stages * (NODE + NODE_OF_SQUARE * n * n)
    return (STEP + STEP_OF_SERIES * taylor.series_time) / iteration


def chosen(tolerance):
    """(order, stages) for a tolerance."""
    return order_of(tolerance), stages_of(tolerance)


SPARES = Spares(BothMethods, chosen)


def adaptive(system, z0, t_eval, rtol, atol):
    return SPARES.adaptive(system, rtol, z0, t_eval, rtol)


@hookimpl
def tcbench_integrators():
    return [
        Integrator(
            name="tc_auto",
            claims=EXACT,
            source=SOURCE,
            adaptive=adaptive,
            tags={"collocation", "constraints", "explicit", "taylor"},
        )
    ]
