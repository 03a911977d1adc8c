"""The first steps of a multistep method, which another method does."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..integrator import Integrator
from ..systems.scenario import Scenario

NONE = np.zeros(0, np.int64)


class FirstSteps(NamedTuple):
    """z (steps + 1, n): the start and the states that the starter reached; failure: why there are fewer, or ""."""

    z: np.ndarray
    iterations: np.ndarray
    status: str
    failure: str

    @property
    def steps(self) -> int:
        return len(self.z) - 1

    def slopes(self, dt: float) -> np.ndarray:
        """(earlier state - last state)/dt, the nearest first, flat: what the compiled loop keeps of earlier steps."""
        return np.ravel((self.z[-2::-1] - self.z[-1]) / dt)


def first_steps(integrator: Integrator, scenario: Scenario, dt: float, steps: int) -> FirstSteps:
    """The first `memory` steps of a multistep method (fewer if the run has fewer), by its starter; else none."""
    if not integrator.memory:
        return FirstSteps(scenario.z0[None], NONE, "ok", "")
    from .. import plugins
    from .run import simulate

    count = min(integrator.memory, steps)
    run = simulate(plugins.starter_of(integrator), scenario, dt, count * dt)
    failure = "" if run.ok else f"the starter {run.integrator.name}: {run.failure}"
    return FirstSteps(np.ascontiguousarray(run.z), run.newton_iterations, run.status, failure)
