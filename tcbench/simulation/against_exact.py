"""Errors of a run against the exact motion: entropy produced, temperatures, ranges of what must be positive."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..reference.path import TOLERANCE, Path, path_of, watched
from ..systems.scenario import Scenario
from . import shared_runs
from .trajectory import Trajectory

HORIZON = 25.0  # time up to which runs are compared: the exact course of chaotic motions is not known for longer
LEAST_PRODUCED = 1e-6  # entropy produced, over the size of S, below which its error is not told
LEAST_WIDTH = 1e-6  # of an exact range, over its largest value: constants have none


def errors_against_exact(run: Trajectory) -> dict[str, float]:
    """Columns of `conservation`, at the last record up to HORIZON that the exact course reaches; {} without a course.

    error_theta : max |theta - exact| over max |exact|. range_left : how far a temperature or a measure was outside of
    its exact range, over the widest of these ranges of its kind. Dimensionless but for theta_min and the like. A run
    that left the system's states is compared as far as it got.
    """
    scenario = run.scenario
    model, exact = scenario.model, _exact(scenario, min(HORIZON, scenario.t_end))
    if exact is None or len(run.t) < 2:
        return {}
    last = int(np.searchsorted(run.t, exact.end * (1 + 1e-12), side="right")) - 1
    if last < 1:
        return {}
    t = min(float(run.t[last]), exact.end)
    z = exact(t)
    entropy = float(model.entropy(z))
    rise, size = entropy - float(model.entropy(scenario.z0)), max(float(model.entropy_magnitude), abs(entropy))
    error = abs(float(run.entropy[last] - run.entropy[0]) - rise) / rise if rise > LEAST_PRODUCED * size else math.nan
    row = {"t_compared": t, "error_entropy_produced": error}
    low, high = exact.ranges(t)
    if not len(low):
        return row
    count = run.temperatures.shape[1]
    values = watched(model, np.ascontiguousarray(run.z[: last + 1]))
    lowest, highest = values.min(axis=0), values.max(axis=0)
    outside = np.maximum(np.maximum(low - lowest, highest - high), 0.0)
    shares = []
    for part in (slice(0, count), slice(count, None)):
        if len(low[part]):
            width = max(float((high - low)[part].max()), LEAST_WIDTH * float(np.abs(high[part]).max()))
            shares.append(float(outside[part].max()) / width)
    row["range_left"] = max(shares)
    if count:
        theta = np.asarray(model.temperatures(z))
        row |= {
            "error_theta": float(np.abs(run.temperatures[last] - theta).max() / np.abs(theta).max()),
            "theta_min": float(lowest[:count].min()), "theta_min_exact": float(low[:count].min()),
            "theta_max": float(highest[:count].max()), "theta_max_exact": float(high[:count].max()),
        }  # fmt: skip
    return row


def distance_to_exact(run: Trajectory, keep: Any = slice(None)) -> NDArray[np.float64]:
    """max_i |z_i - exact_i| / max(magnitude_i, |exact_i|) of the recorded states `keep`.

    Shape (kept,), dimensionless; NaN beyond HORIZON and where there is no exact course, whose own error is some 1e-8.
    """
    exact, magnitudes = _exact(run.scenario, min(HORIZON, run.scenario.t_end)), run.scenario.model.state_magnitudes
    t, z = run.t[keep], run.z[keep]
    errors = np.full(len(t), math.nan)
    if exact is None:
        return errors
    for k in np.flatnonzero(t <= exact.end * (1 + 1e-12)):
        state = exact(min(float(t[k]), exact.end))
        errors[k] = np.max(np.abs(z[k] - state) / np.maximum(magnitudes, np.abs(state)))
    return errors


def _exact(scenario: Scenario, t_end: float) -> Path | None:
    """The exact course; within a run of many cells it is computed once for all methods."""
    until = scenario.replace(t_end=t_end)
    if (arrays := shared_runs.arrays("exact course", until, TOLERANCE)) is not None:
        return Path(**arrays)
    path = path_of(scenario, t_end)
    if path is not None:
        shared_runs.keep_arrays("exact course", until, TOLERANCE, vars(path))
    return path
