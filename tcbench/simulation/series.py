"""What a run did in time: `Trajectory` -> columns for charts, and the thin part of them that a row keeps."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .metrics import invariant_scale

if TYPE_CHECKING:
    from pandas import DataFrame

    from .trajectory import Trajectory

ELEMENTS = "abcdefghijklmnopqrstuvwxyz"  # of systems with more, positions and elements are not told one by one
POINTS = 180  # states that a row keeps
DIGITS, DIGITS_LOST = 9, 6  # of what a row keeps: of states, and of what a law has lost
ROW = ("series", "opening")  # where a row keeps them, and the names of the tables made of them


def columns(run: Trajectory, keep: Any = slice(None)) -> dict[str, np.ndarray]:
    """What a run did, column -> values at the recorded states `keep` (an index or a slice).

    energy_error |E - E_0|/V_0; entropy_fall (largest S so far) - S; NAME and NAME_error of each invariant (the error
    |I - I_0|/|I_0|, as in the tables); lyapunov_rise: (E - theta_ref S) above its least value so far, over V_0;
    temperature_a, strain_a (log strain) of each element; x_1, y_1, ... of each mass, for systems in the plane, q_1, ...
    for others. "So far" is over every recorded state.
    """
    model, scale, L = run.scenario.model, run.scenario.initial_exergy, run.lyapunov
    found = {
        "t": run.t, "energy": run.energy, "entropy": run.entropy,
        "energy_error": np.abs(run.energy - run.energy[0]) / scale,
        "entropy_fall": np.maximum.accumulate(run.entropy) - run.entropy,
        "lyapunov_rise": (L - np.minimum.accumulate(L)) / scale,
    }  # fmt: skip
    for name, values in run.invariants.items():
        found |= {name: values, f"{name}_error": np.abs(values - values[0]) / invariant_scale(run, name)}
    found = {name: values[keep] for name, values in found.items()}
    if model.n_elements > len(ELEMENTS):
        return found
    for letter, theta in zip(ELEMENTS, run.temperatures[keep].T, strict=False):
        found[f"temperature_{letter}"] = theta
    q = run.z[keep, : model.n_positions]
    log_strain = getattr(model, "log_strain", None)
    if log_strain is None:
        return found | {f"q_{i + 1}": values for i, values in enumerate(q.T)}
    strains = np.array([log_strain(pi) for pi in model.shapes(run.z[keep])])
    found |= {f"strain_{letter}": strain for letter, strain in zip(ELEMENTS, strains.T, strict=False)}
    for mass in range(q.shape[1] // 2):
        found |= {f"x_{mass + 1}": q[:, 2 * mass], f"y_{mass + 1}": q[:, 2 * mass + 1]}
    return found


def kept(run: Trajectory, points: int = POINTS) -> dict[str, dict[str, list[float]]]:
    """What a row keeps of a run of which every state was recorded: some `points` states, and the first ones.

    "series" has the columns of every k-th state and of the last one. "opening", where k > 1, has positions and
    temperatures of the first `points` steps: a path of every twentieth state is no path. Rounded.
    """
    stride = max(1, run.scenario.steps(run.dt) // points) if run.dt > 0 else 1
    last = len(run.t) - 1
    found = {"series": _rounded(columns(run, np.unique([*range(0, last, stride), last])))}
    if stride > 1:
        opening = columns(run, slice(points + 1))
        there = {n: v for n, v in opening.items() if n == "t" or n.startswith(("temperature_", "x_", "y_", "q_"))}
        found["opening"] = _rounded(there)
    return found


def _rounded(found: Mapping[str, np.ndarray]) -> dict[str, list[float]]:
    """Lists of so many digits; columns with values that are no numbers are left out."""
    lost = {name: name.endswith(("_error", "_fall", "_rise")) for name in found}
    return {
        name: [float(f"{v:.{DIGITS_LOST if lost[name] else DIGITS}g}") for v in values]
        for name, values in found.items()
        if np.isfinite(values).all()
    }


def tables(records: Iterable[Mapping[str, Any]]) -> dict[str, DataFrame]:
    """The tables `series` and `opening` of rows that kept them: one row a state."""
    import pandas as pd

    found: dict[str, list[DataFrame]] = {name: [] for name in ROW}
    for record in records:
        whole = record.get("series")
        if whole:
            parts = {"series": whole} | ({"opening": record.get("opening") or whole} if record.get("dt") else {})
            known = {name: record.get(name) for name in ("integrator", "scenario", "dt", "tolerance", "status")}
            known = {name: value for name, value in known.items() if value is not None}
            for name, part in parts.items():
                found[name].append(pd.DataFrame(known | part))
    return {name: pd.concat(frames, ignore_index=True) for name, frames in found.items() if frames}


def trajectory(run: Trajectory) -> DataFrame:
    """One row a recorded state: the columns of `columns`, and which run it is."""
    import pandas as pd

    known = {"integrator": run.integrator.name, "scenario": run.scenario.name, "dt": run.dt, "status": run.status}
    return pd.DataFrame(known | columns(run))


def trajectories(runs: Sequence[Trajectory]) -> DataFrame:
    """The tables of several runs, one below the other."""
    import pandas as pd

    frames = [trajectory(run) for run in runs]
    return pd.concat(frames, ignore_index=True) if frames else pd.DataFrame({"integrator": [], "t": []})
