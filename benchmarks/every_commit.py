"""What `asv run` measures for a commit, in some minutes: the paper's methods, what a user waits for, and laws.

Times are seconds of the processor, children included, so that a machine that does other things spoils little.
"""

import functools
import os
import subprocess
import sys
import tempfile

import numpy as np

import tcbench
from tcbench.reference.lookup import reference_for

METHODS = ["tc_monolithic", "tc_staggered", "tc_strang", "midpoint_entropy", "midpoint_temperature"]
CONSISTENT = METHODS[:3]
SCENARIOS = ["short_term", "stiff_spring", "cold_spring", "bound_equilibrium"]
STEPS = 1000
PART = 0.1  # of the scenario's own step: every method gets through, the midpoint rules too
WORK = 256  # steps of the accuracy at a fixed cost
TOLERANCES = [10.0 ** (-k / 2) for k in range(4, 25)]
RANDOM = 200  # random scenarios of the lost roots


def cpu_seconds():
    """Of this process and of those that it has waited for."""
    try:
        import resource
    except ImportError:  # Windows
        return sum(os.times()[:4])
    usages = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


def command(*arguments, **variables):
    subprocess.run([sys.executable, *arguments], check=True, capture_output=True, env=os.environ | variables)


def error_of(state, exact):
    return float(np.max(np.abs(state - exact) / np.maximum(1.0, np.abs(exact))))


class Step:
    """A thousand steps: milliseconds here are microseconds a step."""

    params = (METHODS, SCENARIOS)
    param_names = ("integrator", "scenario")
    timer = staticmethod(cpu_seconds)
    warmup_time = 0.05

    def setup(self, integrator, scenario):
        self.scenario = tcbench.scenarios()[scenario]
        self.time_thousand_steps(integrator, scenario)

    def time_thousand_steps(self, integrator, scenario):
        dt = PART * self.scenario.dt
        run = tcbench.simulate(integrator, self.scenario, dt, STEPS * dt, record_every=None)
        assert run.ok, run.failure

    time_thousand_steps.pretty_name = "Microseconds a step (a thousand steps, in ms)"


class Call:
    timer = staticmethod(cpu_seconds)

    def setup(self):
        self.time_one_step()

    def time_one_step(self):
        tcbench.simulate("tc_monolithic", "short_term", 0.3, 0.3, record_every=None)

    time_one_step.pretty_name = "A warm call of simulate with one step"


class Wait:
    """Whole processes: what a user waits for."""

    timer = staticmethod(cpu_seconds)
    number = 1
    repeat = (3, 6, 15.0)
    warmup_time = 0
    timeout = 300
    simulate = ("-m", "tcbench", "simulate", "tc_monolithic", "short_term")

    def setup(self):
        self.folder = tempfile.TemporaryDirectory()  # an empty cache for each sample
        command(*self.simulate)  # fills the other one

    def teardown(self):
        self.folder.cleanup()

    def time_cold_start(self):
        command(*self.simulate, TCBENCH_CACHE_DIR=self.folder.name)

    time_cold_start.pretty_name = "Cold start: first result with an empty cache"

    def time_warm_start(self):
        command(*self.simulate)

    time_warm_start.pretty_name = "Warm start: first result of a new process"

    def time_import(self):
        command("-c", "import tcbench")

    def time_help(self):
        command("-m", "tcbench", "--help")


class Memory:
    """Must not grow with the number of steps."""

    params = [1_000, 1_000_000]
    param_names = ("steps",)

    def peakmem_steps(self, steps):
        tcbench.simulate("tc_monolithic", "bound_equilibrium", 0.05, 0.05 * steps, record_every=None)

    peakmem_steps.pretty_name = "Memory of a run that keeps nothing"


class Accuracy:
    """At the same number of steps, that is at about the same cost."""

    params = (METHODS, SCENARIOS)
    param_names = ("integrator", "scenario")

    def track_error(self, integrator, scenario):
        scenario = tcbench.scenarios()[scenario]
        t_end = scenario.t_converge
        run = tcbench.simulate(integrator, scenario, t_end / WORK, t_end, record_every=None)
        return error_of(run.z[-1], reference_for(scenario, [t_end]).states[0]) if run.ok else float("nan")

    track_error.unit = "relative error"
    track_error.pretty_name = f"Error after {WORK} steps"


class Adaptive:
    """tc_gauss_adaptive at the loosest tolerance whose error is at most 1e-6, to t_converge."""

    params = SCENARIOS
    param_names = ("scenario",)
    timer = staticmethod(cpu_seconds)

    def setup(self, scenario):
        scenario = tcbench.scenarios()[scenario]
        times, exact = [0.0, scenario.t_converge], reference_for(scenario, [scenario.t_converge]).states[0]
        solve = functools.partial(tcbench.integrators()["tc_gauss_adaptive"].adaptive, scenario.model)
        for tolerance in TOLERANCES:
            self.run = functools.partial(solve, scenario.z0, np.array(times), tolerance, tolerance)
            found = self.run()
            states = found[0] if isinstance(found, tuple) else found
            if error_of(states[-1], exact) <= 1e-6:
                return
        raise AssertionError("no tolerance gives an error of 1e-6")

    def time_to_1e6(self, scenario):
        self.run()

    time_to_1e6.pretty_name = "Time of tc_gauss_adaptive to 1e-6"


class Laws:
    params = (METHODS, SCENARIOS)
    param_names = ("integrator", "scenario")

    def track_energy_error(self, integrator, scenario):
        scenario = tcbench.scenarios()[scenario]
        run = tcbench.simulate(integrator, scenario, PART * scenario.dt, record_every=None)
        return run.summary.energy_error_max

    track_energy_error.unit = "|E - E0| / V0"
    track_energy_error.pretty_name = "Energy error"


class Roots:
    params = CONSISTENT
    param_names = ("integrator",)

    def track_lost(self, integrator):
        """Runs of random scenarios that end because a root is lost, though one always exists (docs/physics.md, 8)."""
        runs = [tcbench.simulate(integrator, f"random[seed={k}]", 1.0, record_every=None) for k in range(RANDOM)]
        return sum(not run.ok for run in runs)

    track_lost.unit = f"of {RANDOM} runs"
    track_lost.pretty_name = "Lost roots"
