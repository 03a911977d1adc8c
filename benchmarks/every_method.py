"""The rest, for every registered method and scenario: minutes to an hour. `asv run --bench every_method`, or a part
of it, as in `asv run --bench 'every_method.Stability.*tc_strang'`. A new plugin is measured without an edit here.

A pair that cannot be run (a method that is for other systems) has the value nan.
"""

import math
import tempfile

import tcbench
from tcbench.reference import certified
from tcbench.simulation.metrics import newton_iterations_mean

from .every_commit import command, cpu_seconds, error_of

STEPS = 1000
METHODS = [i.name for i in tcbench.integrators().values() if i.kind != "adaptive" and not i.lacks]
SCENARIOS = list(tcbench.scenarios())
CAP = 4.0  # largest step that is tried


def run(integrator, scenario, **settings):
    """The run, or None where the method is not for the scenario or does not get through."""
    if tcbench.integrators()[integrator].suits(scenario.model):
        return None
    found = tcbench.simulate(integrator, scenario, record_every=None, **settings)
    return found if found.ok else None


class EachPair:
    params = (METHODS, SCENARIOS)
    param_names = ("integrator", "scenario")

    def setup(self, integrator, scenario):
        self.scenario = tcbench.scenarios()[scenario]


class Speed(EachPair):
    def track_microseconds(self, integrator, scenario):
        begin = cpu_seconds()
        found = run(integrator, self.scenario, t_end=STEPS * self.scenario.dt)
        return 1e6 * (cpu_seconds() - begin) / found.steps if found else math.nan

    track_microseconds.unit = "us a step"


class Conservation(EachPair):
    def track_energy_error(self, integrator, scenario):
        found = run(integrator, self.scenario)
        return found.summary.energy_error_max if found else math.nan

    track_energy_error.unit = "|E - E0| / V0"

    def track_newton_iterations(self, integrator, scenario):
        found = run(integrator, self.scenario)
        return newton_iterations_mean(found) if found else math.nan

    track_newton_iterations.unit = "iterations a step"


class Accuracy(EachPair):
    """Error at t = 1 and h = 1/64 against the stored reference."""

    def track_error(self, integrator, scenario):
        stored = certified.stored(scenario)
        if stored is None or 1.0 not in stored.times:
            return math.nan
        found = run(integrator, self.scenario, dt=1 / 64, t_end=1.0)
        return error_of(found.z[-1], stored.at(1.0)) if found else math.nan

    track_error.unit = "relative error"


class Stability(EachPair):
    """1 / (largest step of a ladder 2^(k/4) up to which every run completes); asv has no "higher is better"."""

    timeout = 120

    def track_inverse_stable_step(self, integrator, scenario):
        largest = math.nan
        for k in range(-20, 9):
            dt = 2.0 ** (k / 4)
            if dt > min(CAP, self.scenario.t_end) or run(integrator, self.scenario, dt=dt) is None:
                break
            largest = dt
        return 1 / largest

    track_inverse_stable_step.unit = "1 / dt"


class Commands:
    timer = staticmethod(cpu_seconds)
    number = 1
    repeat = (3, 10, 20.0)
    warmup_time = 0
    timeout = 300

    def time_list(self):
        command("-m", "tcbench", "list")

    def time_run_selection(self):
        with tempfile.TemporaryDirectory() as folder:
            command(
                "-m", "tcbench", "run", "-i", "tc_monolithic", "-i", "midpoint_entropy", "-s", "short_term",
                "--study", "conservation", "--quiet", "-o", f"{folder}/run",
            )  # fmt: skip
