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
TOLERANCES = Table(
    "stable_tolerances",
    (
        "integrator", "scenario", "tolerance_stable", "tolerance_unstable", "confirmed", "limit", "cause", "status",
        "failure",
    ),
)  # fmt: skip
SENSITIVITY = Table(
    "blowup_sensitivity",
    (
        "integrator", "scenario", "dt", "factor", "blowup_time", "earliest", "median", "latest", "failed", "runs",
    ),
    key=("dt", "factor"),
)  # fmt: skip


def plan(integrators: Sequence[Integrator], scenarios: Sequence[Scenario], options: Mapping[str, Any]) -> Cells:
    return [(i, s, {}) for s in scenarios for i in integrators]


def measure(integrator: Integrator, scenario: Scenario, options: Row) -> Row:
    if integrator.kind == "adaptive":
        return {"status": "ok", **stability.loosest_tolerance(integrator, scenario)}
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
        "stability": table_of((r for r in flat if "tolerance_stable" not in r), STABILITY),
        "stability_points": pd.DataFrame(rows_in(records, "points"), columns=POINTS.names),
        "blowup_sensitivity": pd.DataFrame(rows_in(records, "sensitivity"), columns=SENSITIVITY.names),
        "stable_tolerances": table_of((r for r in flat if "tolerance_stable" in r), TOLERANCES),
    }


STUDY = Study(
    name="stability",
    place=50,
    description="largest stable step and the kind of its limit; of adaptive solvers the loosest tolerance that holds",
    tables=(STABILITY, POINTS, SENSITIVITY, TOLERANCES),
    plan=plan,
    measure=measure,
    tabulate=tabulate,
)
