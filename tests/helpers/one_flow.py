"""One flow of a method, for a look at its solvers one by one."""

from tcbench.compiler.library import Library, evaluate
from tcbench.solver.continuation import arc, detour
from tcbench.solver.flow import Tally
from tcbench.solver.implicit_step import Rules, compiled_flows, constants_of, make_flows
from tcbench.solver.newton import NEGLIGIBLE, newton, track

SOLVERS = Library("solvers", newton, track, arc, detour)


class OneFlow:
    """The first flow of a method at the start of a scenario, for a look at its solvers one by one.

    x: unknowns; dz: increments of the state; z: the start; each solver leaves its root there.
    """

    def __init__(self, integrator, scenario, h):
        constants = constants_of(integrator, scenario)
        self.tally = Tally()
        kernels = compiled_flows(integrator.flows, scenario.model.symbolic)
        flows = make_flows(
            integrator, scenario.model, scenario.bound, h, constants, self.tally, Rules(), kernels
        )  # fmt: skip
        self.record = flows[0]
        self.x, self.dz, self.z = self.record.x, self.record.dz, scenario.z0
        self.record.start[:] = self.z
        self.prepare()

    def prepare(self):
        """The flow over its whole step."""
        r = self.record
        r.c[0] = r.h
        evaluate(r.prologue, r.start, r.c, r.w)
        r.scale[:] = r.inverse_sizes

    def newton(self, start):
        """(ACCEPTED or REJECTED, iterations) of the careful Newton from these unknowns."""
        self.x[:] = start
        return SOLVERS.newton(self.record, NEGLIGIBLE, 0.0, True)

    def plain_newton(self, start):
        """The same of Newton as textbooks have it."""
        self.x[:] = start
        return SOLVERS.newton(self.record, NEGLIGIBLE, 0.0, False)

    def track(self):
        """(ACCEPTED or REJECTED, iterations, tries) of natural continuation."""
        return SOLVERS.track(self.record)

    def arc(self):
        """(FOUND, LOST, COLD_ROOT or UNDETERMINED, Jacobians, folds)."""
        return SOLVERS.arc(self.record)

    def detour(self):
        """(FOUND or UNDETERMINED, Jacobians): what follows an arc that is undetermined."""
        return SOLVERS.detour(self.record)
