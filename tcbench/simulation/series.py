"""A run in time: `Trajectory` -> columns for charts, and the part of them that a row keeps."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import takewhile
from typing import TYPE_CHECKING, Any

import numpy as np

from ..systems.plane import drawn
from ..systems.state import LETTERS
from . import fields
from .against_exact import distance_to_exact
from .metrics import invariant_scale

if TYPE_CHECKING:
    from pandas import DataFrame

    from .trajectory import Trajectory

POINTS = 180  # states that a row keeps
DIGITS, DIGITS_LOST, DIGITS_FAR = 9, 6, 3  # that a row keeps of states, of errors of laws, of distances to the exact
LOST = ("_error", "_fall", "_rise")  # endings of the columns of errors of laws
RUN = ("integrator", "scenario", "dt", "tolerance", "status")  # which run a state is of
ENDS: dict[str, Any] = {
    "low": np.min,
    "mean": np.mean,
    "high": np.max,
}  # of temperatures, where there are more than letters
ROW = ("series", "opening", "fields")  # keys of a row, and names of the tables


def columns(run: Trajectory, keep: Any = slice(None)) -> dict[str, np.ndarray]:
    """Column -> values at the recorded states `keep` (an index or a slice), each of shape (kept,).

    energy_error |E - E_0|/V_0; entropy_fall (largest S so far) - S; NAME and NAME_error of each invariant (the error
    |I - I_0|/|I_0|, as in the tables); lyapunov_rise: (E - theta_ref S) above its least value so far, over V_0;
    temperature_a, ... (of many only temperature_low, temperature_mean and temperature_high); then the variables, each
    number by its name (m0, m1, ...), or those of elements:
    strain_a (log strain) of each, x_1, y_1, ... of each mass in the plane, q_1, ... of other positions; and at_x_1,
    at_y_1, ... of each joint of a picture that points() gives. "So far" is over every recorded state.
    """
    model, scale, L = run.scenario.model, run.scenario.initial_exergy, run.lyapunov
    table = {
        "t": run.t, "energy": run.energy, "entropy": run.entropy,
        "energy_error": np.abs(run.energy - run.energy[0]) / scale,
        "entropy_fall": np.maximum.accumulate(run.entropy) - run.entropy,
        "lyapunov_rise": (L - np.minimum.accumulate(L)) / scale,
    }  # fmt: skip
    for name, values in run.invariants.items():
        table |= {name: values, f"{name}_error": np.abs(values - values[0]) / invariant_scale(run, name)}
    table = {name: values[keep] for name, values in table.items()}
    if model.n_temperatures > len(LETTERS):
        theta = run.temperatures[keep]
        return table | {f"temperature_{end}": of(theta, axis=1) for end, of in ENDS.items()}
    for letter, theta in zip(LETTERS, run.temperatures[keep].T, strict=False):
        table[f"temperature_{letter}"] = theta
    return table | model.columns_in_time(run.z[keep]) | drawn(model, run.z[0], run.z[keep])


def row_parts(run: Trajectory, points: int = POINTS) -> dict[str, dict[str, list[Any]]]:
    """What a row keeps of a run that recorded every state: some `points` states, and the first ones, rounded.

    "series" has the columns of every k-th state and of the last one, and `distance_to_exact` as exact_error. "opening",
    where k > 1, has positions and temperatures of the first `points` steps: every twentieth state draws no path.
    "fields" is that of `fields.mesh_columns`, of systems with a mesh.
    """
    stride = max(1, run.scenario.steps(run.dt) // points) if run.dt > 0 else 1
    last = len(run.t) - 1
    keep = np.unique([*range(0, last, stride), last])
    parts: dict[str, dict[str, list[Any]]] = {"series": _rounded(columns(run, keep))}
    if np.isfinite(far := distance_to_exact(run, keep)).any():
        parts["series"]["exact_error"] = [float(f"{v:.{DIGITS_FAR}g}") for v in far]
    if stride > 1:
        opening = columns(run, slice(points + 1))
        laws = {"energy", "entropy", *run.invariants}
        states = {n: v for n, v in opening.items() if n not in laws and not n.endswith(LOST)}
        parts["opening"] = _rounded(states)
    if mesh := fields.mesh_columns(run):  # which is drawn in the place of the system's own picture
        parts = {part: {n: v for n, v in of.items() if not n.startswith("at_")} for part, of in parts.items()}
        parts["fields"] = mesh
    return parts


def variables(names: Iterable[str]) -> list[str]:
    """The columns of a table of states that are variables of the system, or stand for them."""
    texts = [str(name) for name in names]
    basic = {"integrator", "scenario", "status", "dt", "tolerance", "t", "energy", "entropy"}
    laws = {name.removesuffix("_error") for name in texts if name.endswith("_error")}
    for stem in ("temperature", "strain"):  # of the elements one after the other: a variable may be called so, too
        basic |= set(takewhile(texts.__contains__, (f"{stem}_{letter}" for letter in LETTERS)))
    return [n for n in texts if n not in basic | laws and not n.endswith(LOST) and not n.startswith(("at_x_", "at_y_"))]


def _rounded(arrays: Mapping[str, np.ndarray]) -> dict[str, list[Any]]:
    """Columns as lists of DIGITS digits; columns with values that are not finite are left out."""
    lost = {name: name.endswith(LOST) for name in arrays}
    return {
        name: [float(f"{v:.{DIGITS_LOST if lost[name] else DIGITS}g}") for v in values]
        for name, values in arrays.items()
        if np.isfinite(values).all()
    }


def tables(records: Iterable[Mapping[str, Any]]) -> dict[str, DataFrame]:
    """The tables `ROW` of the rows that have them: one row a state (of `fields` a state and number)."""
    import pandas as pd

    frames: dict[str, list[DataFrame]] = {name: [] for name in ROW}
    for record in records:
        run = {name: record[name] for name in RUN if record.get(name) is not None}
        opening = record.get("dt") and (record.get("opening") or record.get("series"))
        parts = (record.get("series"), opening, record.get("fields"))
        for name, part in zip(ROW, parts, strict=True):
            if part:
                frames[name].append(pd.DataFrame(run | dict(part)))
    return {name: pd.concat(parts, ignore_index=True) for name, parts in frames.items() if parts}


def trajectory(run: Trajectory) -> DataFrame:
    """The table of one run: its labels and the `columns`, one row a recorded state."""
    import pandas as pd

    labels = {"integrator": run.integrator.name, "scenario": run.scenario.name, "dt": run.dt, "status": run.status}
    return pd.DataFrame(labels | columns(run))


def trajectories(runs: Sequence[Trajectory]) -> DataFrame:
    """The tables of several runs, one below the other."""
    import pandas as pd

    frames = [trajectory(run) for run in runs]
    return pd.concat(frames, ignore_index=True) if frames else pd.DataFrame({"integrator": [], "t": []})
