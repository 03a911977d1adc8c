"""A run beside the exact motion: entropy produced, temperatures, and the ranges of what must be positive."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..reference.path import TOLERANCE, Path, path_of, watched
from ..systems.scenario import Scenario
from . import shared_runs
from .trajectory import Trajectory

HORIZON = 25.0  # up to which runs are compared: chaotic motions are not longer known
LEAST_PRODUCED = 1e-6  # of entropy, over its size, below which nothing is said of its error


def beside_the_exact(run: Trajectory) -> dict[str, float]:
    """Columns of `conservation`, at the last record up to HORIZON that the exact course reaches; none where there is no
    such course. A run that left the system's states is compared as far as it got.

    error_theta : max |theta - exact| over max |exact|. range_left : how far a temperature or a measure was outside of
    its exact range, over the widest of these ranges of its kind. Dimensionless but for theta_min and the like.
    """
    scenario = run.scenario
    model, exact = scenario.model, _exact(scenario, min(HORIZON, scenario.t_end))
    if exact is None or len(run.t) < 2:
        return {}
    last = int(np.searchsorted(run.t, exact.end * (1 + 1e-12), side="right")) - 1
    if last < 1:
        return {}
    t = min(float(run.t[last]), exact.end)
    there, z0 = exact(t), scenario.z0
    made = float(model.entropy(there)) - float(model.entropy(z0))
    size = max(float(model.least_entropy), abs(float(model.entropy(there))))
    produced = (
        abs(float(run.entropy[last] - run.entropy[0]) - made) / made if made > LEAST_PRODUCED * size else math.nan
    )
    found = {"t_compared": t, "error_entropy_produced": produced}
    count = run.temperatures.shape[1]
    low, high = exact.ranges(t)
    if not len(low):
        return found
    values = watched(model, np.ascontiguousarray(run.z[: last + 1]))
    least, most = values.min(axis=0), values.max(axis=0)
    beyond = np.maximum(np.maximum(low - least, most - high), 0.0)
    shares = []
    for part in (slice(0, count), slice(count, None)):
        if len(low[part]):
            width = float((high[part] - low[part]).max())
            wide = max(width, 1e-6 * float(np.abs(high[part]).max()))
            shares.append(float(beyond[part].max()) / wide)
    found["range_left"] = max(shares)
    if count:
        theta = np.asarray(model.temperatures(there))
        found |= {
            "error_theta": float(np.abs(run.temperatures[last] - theta).max() / np.abs(theta).max()),
            "theta_min": float(least[:count].min()), "theta_min_exact": float(low[:count].min()),
            "theta_max": float(most[:count].max()), "theta_max_exact": float(high[:count].max()),
        }  # fmt: skip
    return found


def distance(run: Trajectory, keep: Any = slice(None)) -> NDArray[np.float64]:
    """How far the recorded states `keep` are from the exact course: max |z_i - exact_i| / max(least size, |exact_i|).

    Shape (kept,), dimensionless; NaN beyond HORIZON and where there is no such course, whose own error is some 1e-8.
    """
    exact, least = _exact(run.scenario, min(HORIZON, run.scenario.t_end)), run.scenario.model.least_each
    t, z = run.t[keep], run.z[keep]
    found = np.full(len(t), math.nan)
    if exact is None:
        return found
    for k in np.flatnonzero(t <= exact.end * (1 + 1e-12)):
        there = exact(min(float(t[k]), exact.end))
        found[k] = np.max(np.abs(z[k] - there) / np.maximum(least, np.abs(there)))
    return found


def _exact(scenario: Scenario, t_end: float) -> Path | None:
    """The exact course; within a run of many cells it is computed once for all methods."""
    until = scenario.replace(t_end=t_end)
    if (found := shared_runs.arrays("exact course", until, TOLERANCE)) is not None:
        return Path(**found)
    path = path_of(scenario, t_end)
    if path is not None:
        shared_runs.keep_arrays("exact course", until, TOLERANCE, vars(path))
    return path
