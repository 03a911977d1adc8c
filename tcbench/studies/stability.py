"""Stability: the largest step of each method, what stops it, and how sharp its blow-up time is."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from ..analysis import stable_step as stability
from ..integrator import Integrator
from ..study import Cells, Row, Study, Tables
from ..systems.scenario import Scenario
from ..table import Column, Table
from .frames import rows_in, table_of

STABILITY = Table(
    "stability",
    (
        "integrator", "scenario", Column("dt_stable", "largest stable step h", "stable", worse="lower"),
        Column("dt_unstable", "least step h tried that fails", "unstable"),
        Column("dt_half", "step h from which half of the steps tried fail", worse="lower"),
        Column("dt_fold", "least step h at which the branch of solutions folds", "fold", worse="lower"),
        Column("limit", "what ends the steps: physical, branch, solver, or none up to the cap", filter=True),
        Column("non_monotone", "whether steps above the limit are stable again"),
        Column("dt_cap", "largest step h that was tried"),
        Column("dt_stable_plain", "largest stable step h with plain Newton", "stable", worse="lower"),
        Column("limit_plain", "what ends the steps with plain Newton", "plain limit"),
        Column("dt_unstable_plain", "least step h that fails with plain Newton", "unstable"),
        Column("dt_half_plain", "step h from which half of the steps fail with plain Newton"),
        Column("non_monotone_plain", "whether steps above the limit of plain Newton are stable again"),
        Column("certified", "whether runs on the principal branch say the same"), "cause",
        "status", "failure",
    ),
    terminal=(
        "integrator", "limit", "dt_stable", "dt_unstable", "dt_fold", "limit_plain", "dt_stable_plain",
        "dt_unstable_plain",
    ),
)  # fmt: skip
POINTS = Table(
    "stability_points",
    (
        "integrator", "scenario", Column("solver", filter=True), "dt", "status", "blowup_time", "continuation_steps",
        "kind", "energy_error_max", "folds",
    ),
    key=("solver", "dt"),
    long=True,
)  # fmt: skip
SENSITIVITY = Table(
    "blowup_sensitivity",
    (
        "integrator", "scenario", "dt", "factor", "blowup_time", "earliest", "median", "latest", "failed", "runs",
    ),
    key=("dt", "factor"),
)  # fmt: skip


def plan(integrators: Sequence[Integrator], scenarios: Sequence[Scenario], options: Mapping[str, Any]) -> Cells:
    """One cell a pair. Adaptive solvers have no step to look for the limit of."""
    return [(i, s, {}) for s in scenarios for i in integrators if i.kind != "adaptive"]


def measure(integrator: Integrator, scenario: Scenario, options: Row) -> Row:
    search = stability.maximum_step if integrator.kind == "flows" else stability.maximum_own_step
    row, points = search(integrator, scenario)
    own = stability.outcome(integrator, scenario, scenario.dt)
    dt = row["dt_unstable"] if own.ok else scenario.dt  # the scenario's own step where that fails
    blowup = [] if math.isnan(dt) else stability.sensitivity(integrator, scenario, dt)
    return {"status": "ok", **row, "points": points, "sensitivity": blowup}


def tabulate(records: Sequence[Row]) -> Tables:
    import pandas as pd

    flat = [{k: v for k, v in r.items() if k not in ("points", "sensitivity")} for r in records]
    return {
        "stability": table_of(flat, STABILITY),
        "stability_points": pd.DataFrame(rows_in(records, "points"), columns=POINTS.names),
        "blowup_sensitivity": pd.DataFrame(rows_in(records, "sensitivity"), columns=SENSITIVITY.names),
    }


STUDY = Study(
    name="stability",
    place=50,
    description="largest stable step and the kind of its limit",
    tables=(STABILITY, POINTS, SENSITIVITY),
    plan=plan,
    measure=measure,
    tabulate=tabulate,
)
