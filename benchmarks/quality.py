"""Quality of every registered integrator: numbers that must not get worse. Lower is better for all of them."""

import numpy as np

import tcbench
from tcbench.reference import certified as reference
from tcbench.simulation.metrics import newton_iterations_mean

from .integrators import METHODS, SCENARIOS

CAP = 4.0  # largest step that is tried


class Conservation:
    params = (METHODS, SCENARIOS)
    param_names = ("integrator", "scenario")

    def setup(self, integrator, scenario):
        self.run = tcbench.simulate(integrator, scenario, record_every=None)

    def track_energy_error(self, integrator, scenario):
        return self.run.summary.energy_error_max

    track_energy_error.unit = "|E - E0| / V0"

    def track_newton_iterations(self, integrator, scenario):
        return newton_iterations_mean(self.run)

    track_newton_iterations.unit = "iterations per step"


class Accuracy:
    """Error at t = 1 and h = 1/64 against the certified reference."""

    params = (METHODS, SCENARIOS)
    param_names = ("integrator", "scenario")

    def track_error(self, integrator, scenario):
        stored = reference.stored(scenario)
        if stored is None or 1.0 not in stored.times:
            return float("nan")
        run = tcbench.simulate(integrator, scenario, dt=1 / 64, t_end=1.0, record_every=None)
        exact = stored.at(1.0)
        return float(np.max(np.abs(run.z[-1] - exact) / np.maximum(1.0, np.abs(exact)))) if run.ok else float("nan")

    track_error.unit = "relative error"


class Stability:
    """1 / (largest step of a ladder 2^(k/4) up to which every run completes); asv has no "higher is better"."""

    params = (METHODS, SCENARIOS)
    param_names = ("integrator", "scenario")
    timeout = 120

    def track_inverse_stable_step(self, integrator, scenario):
        scenario = tcbench.scenarios()[scenario]
        largest = float("nan")
        for k in range(-20, 9):
            dt = 2.0 ** (k / 4)
            if dt > min(CAP, scenario.t_end) or not tcbench.simulate(integrator, scenario, dt=dt, record_every=None).ok:
                break
            largest = dt
        return 1 / largest

    track_inverse_stable_step.unit = "1 / dt"
