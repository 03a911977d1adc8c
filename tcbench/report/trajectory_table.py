"""Trajectory -> table of what it did in time, for charts."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from pandas import DataFrame

    from ..simulation.trajectory import Trajectory

ELEMENTS = "abcdefghijklmnopqrstuvwxyz"


def trajectory(run: Trajectory) -> DataFrame:
    """One row a recorded state: where it is, and what it has lost so far.

    energy_error |E - E_0|/V_0; entropy_fall (largest S so far) - S; angular_momentum_error |J - J_0|/|J_0|;
    lyapunov_rise: (E - theta_ref S) above its least value so far, over V_0; temperature_a, strain_a (log strain) of
    each element; x_1, y_1, ... of each mass, for systems in the plane.
    """
    import pandas as pd

    scale = run.scenario.initial_exergy
    J = run.angular_momentum
    J0 = abs(J[0]) if abs(J[0]) > 0 else 1.0
    L = run.lyapunov
    columns = {
        "integrator": run.integrator.name, "scenario": run.scenario.name, "dt": run.dt, "status": run.status,
        "t": run.t, "energy": run.energy, "entropy": run.entropy, "angular_momentum": J,
        "energy_error": np.abs(run.energy - run.energy[0]) / scale,
        "entropy_fall": np.maximum.accumulate(run.entropy) - run.entropy,
        "angular_momentum_error": np.abs(J - J[0]) / J0,
        "lyapunov_rise": (L - np.minimum.accumulate(L)) / scale,
    }  # fmt: skip
    for letter, theta in zip(ELEMENTS, run.temperatures.T, strict=False):
        columns[f"temperature_{letter}"] = theta
    q = run.z[:, : run.scenario.model.n_positions]
    log_strain = getattr(run.scenario.model, "log_strain", None)
    if log_strain is not None:
        strains = np.array([log_strain(run.scenario.model.shape(x)) for x in q])
        for letter, strain in zip(ELEMENTS, strains.T, strict=False):
            columns[f"strain_{letter}"] = strain
        for mass in range(q.shape[1] // 2):
            columns[f"x_{mass + 1}"], columns[f"y_{mass + 1}"] = q[:, 2 * mass], q[:, 2 * mass + 1]
    return pd.DataFrame(columns)


def trajectories(runs: Iterable[Trajectory]) -> DataFrame:
    """The tables of several runs, one below the other."""
    import pandas as pd

    frames = [trajectory(run) for run in runs]
    return pd.concat(frames, ignore_index=True) if frames else pd.DataFrame({"integrator": [], "t": []})
