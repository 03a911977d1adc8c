"""Reachable range: at which steps temperatures and positive quantities leave the range that the exact ones stay in.

Both laws may hold to round-off while a body between 50 and 0 degrees comes to -20. How far a run left the range is told
over the width of the range, on steps up to many times the scenario's own; the largest step is that from which on every
finer one stays within a tenth.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from ..integrator import Integrator
from ..simulation.against_exact import errors_against_exact
from ..simulation.run import simulate
from ..study import Cells, Row, Study, Tables
from ..systems.scenario import Scenario
from ..table import Column, Table
from .base import settings
from .conservation import CONSERVATION, TOLERANCES
from .frames import table_of

FACTORS = tuple(2.0**k for k in range(4, -4, -1))  # of the scenario's own step
WITHIN = 0.1
MEASURED = ("range_left", "theta_min", "theta_min_exact", "theta_max", "theta_max_exact", "error_theta", "t_compared")
RANGES = Table(
    "reachable_range",
    (
        "integrator", "scenario", "dt", "tolerance", "status",
        *(CONSERVATION.column(name) or name for name in MEASURED), "failure",
    ),
    key=("dt", "tolerance"),
    long=True,
)  # fmt: skip
WITHIN_RANGE = Table(
    "within_range",
    (
        "integrator", "scenario",
        Column("dt_within", "largest step up to which the range is kept to a tenth", "within", worse="lower"),
        Column("dt_beyond", "least step h that leaves the range by a tenth or fails", "beyond", worse="lower"),
        Column("range_left_max", "farthest departure from the range", "farthest", worse="higher"),
    ),
    derived=True,
)  # fmt: skip


def plan(integrators: Sequence[Integrator], scenarios: Sequence[Scenario], options: Mapping[str, Any]) -> Cells:
    cells: Cells = []
    for scenario in scenarios:
        steps = [h for h in options.get("dt") or [f * scenario.dt for f in FACTORS] if h <= scenario.t_end]
        cells += [(i, scenario, at) for i in integrators if not i.lacks for at in settings(i, steps, TOLERANCES)]
    return cells


def measure(integrator: Integrator, scenario: Scenario, options: Row) -> Row:
    run = simulate(integrator, scenario, **options)
    errors = errors_against_exact(run)
    return {"status": run.status, "failure": run.failure} | {name: errors[name] for name in MEASURED if name in errors}


def tabulate(records: Sequence[Row]) -> Tables:
    return {"reachable_range": table_of(records, RANGES), "within_range": table_of(within(records), WITHIN_RANGE)}


def within(records: Sequence[Row]) -> list[Row]:
    """One row for each method with steps and scenario that has a range."""
    pairs: dict[tuple[str, str], dict[float, float]] = {}
    for r in records:
        if r.get("dt") is not None and not (r.get("status") == "ok" and r.get("range_left") is None):
            left = r["range_left"] if r.get("status") == "ok" else math.inf
            pairs.setdefault((r["scenario"], r["integrator"]), {})[r["dt"]] = left
    rows = []
    for (scenario, integrator), left in sorted(pairs.items()):
        beyond = min((h for h, x in left.items() if not x <= WITHIN), default=math.nan)
        kept = [h for h in left if not h >= beyond]
        seen = [x for x in left.values() if math.isfinite(x)]
        row = {"integrator": integrator, "scenario": scenario, "dt_within": max(kept, default=math.nan)}
        rows.append(row | {"dt_beyond": beyond, "range_left_max": max(seen, default=math.nan)})
    return rows


STUDY = Study(
    name="reachable_range",
    place=63,
    description="steps at which temperatures and positive quantities leave the range of the exact ones",
    tables=(RANGES, WITHIN_RANGE),
    plan=plan,
    measure=measure,
    tabulate=tabulate,
    by_default=False,
)
