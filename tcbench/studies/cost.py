"""From the rungs of the work_precision study: the time to an accuracy."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..study import Row
from ..table import Column, Table

TARGETS = {"error": (1e-3, 1e-6, 1e-9), "energy_error_max": (1e-6, 1e-12)}
FLOOR = "reference_floor"
HIDES = 10.0  # times the reference's own uncertainty: errors below are hidden
TO_ACCURACY = Table(
    "time_to_accuracy",
    (
        "integrator", "scenario", "measure", "target", "time_s", "best_peer",
        Column("ratio_to_best_peer", short="best peer/this", timing=True), "best_scipy",
        Column("ratio_to_best_scipy", short="best SciPy/this", timing=True),
        Column("steps_to", "steps to the accuracy", worse="larger"),
        Column("evaluations_to", "evaluations to the accuracy", worse="larger"),
    ),
    derived=True,
    terminal=("integrator", "measure", "target", "time_s", "ratio_to_best_peer", "ratio_to_best_scipy"),
)  # fmt: skip


def time_to_accuracy(records: Sequence[Row]) -> list[Row]:
    """One row for each scenario, measure, target and method: seconds to the target (NaN if no rung reached it), and
    the ratio of the best peer's time, of any peer and of SciPy's, to it (above 1: faster than the best peer); steps and
    evaluations to it, which no machine changes."""
    rows: list[Row] = []
    scenarios = sorted({r["scenario"] for r in records})
    for scenario in scenarios:
        here = sorted((r for r in records if r["scenario"] == scenario), key=lambda r: r["integrator"])
        for measure, targets in TARGETS.items():
            for target in targets:
                rungs = {
                    r["integrator"]: [{FLOOR: r.get(FLOOR)} | point for point in r.get("points") or []] for r in here
                }
                times = {name: reach(points, measure, target) for name, points in rungs.items()}
                of_peers = {r["integrator"]: times[r["integrator"]] for r in here if r.get("peer")}
                of_scipy = {r["integrator"]: times[r["integrator"]] for r in here if r.get("peer") == "scipy"}
                peer, best = _best(of_peers)
                scipy, best_scipy = _best(of_scipy)
                rows += [
                    {
                        "integrator": name, "scenario": scenario, "measure": measure, "target": target, "time_s": time,
                        "best_peer": peer, "ratio_to_best_peer": best / time, "best_scipy": scipy,
                        "ratio_to_best_scipy": best_scipy / time,
                        "steps_to": reach(rungs[name], measure, target, "steps"),
                        "evaluations_to": reach(rungs[name], measure, target, "evaluations"),
                    }
                    for name, time in times.items()
                ]  # fmt: skip
    return rows


def reach(points: Sequence[Row], measure: str, target: float, cost: str = "wall_time_min_s") -> float:
    """Least time, or other cost, to an error of `target`: of the rungs at or below it, or between two neighbours by a
    straight line in logarithms. An error hidden by the reference's own counts as what hides it."""
    costs = []
    rungs = [(reached_error(p, measure), as_float(p.get(cost))) for p in points if p.get("status") == "ok"]
    rungs = [(e, t) for e, t in rungs if _is_number(e) and _is_number(t)]
    for e, t in rungs:
        if e <= target:
            costs.append(t)
    for (e0, t0), (e1, t1) in itertools.pairwise(rungs):
        if e0 > target > e1 > 0 and t0 > 0:
            share = math.log(e0 / target) / math.log(e0 / e1)
            costs.append(math.exp(math.log(t0) + share * math.log(t1 / t0)))
    return min(costs, default=math.nan)


def reached_error(point: Row, measure: str) -> float:
    """The error of a rung: where the reference's own hides it what hides it (0 where nobody says), infinite where the
    rung failed or does not tell."""
    if point.get("status") != "ok":
        return math.inf
    error = point.get(measure)
    if measure == "error" and point.get("reference_limited"):
        floor = as_float(point.get(FLOOR))
        error = HIDES * floor if math.isfinite(floor) else 0.0
    return float(error) if error is not None and math.isfinite(error) else math.inf


def as_float(value: Any) -> float:
    return math.nan if value is None else float(value)


def _is_number(value: Any) -> bool:
    return value is not None and math.isfinite(value)


def _best(times: dict[str, float]) -> tuple[str, float]:
    reached = {name: t for name, t in times.items() if _is_number(t)}
    if not reached:
        return "", math.nan
    name = min(reached, key=lambda n: reached[n])
    return name, reached[name]


def exponent(pairs: Sequence[tuple[float, float]]) -> float:
    """a of time ~ work^a by least squares in logarithms; NaN of fewer than three."""
    used = [(w, t) for w, t in pairs if w > 0 and _is_number(t) and t > 0]
    if len({w for w, _ in used}) < 3:
        return math.nan
    work, time = np.log(used).T
    return float(np.polyfit(work, time, 1)[0])
