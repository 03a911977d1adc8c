"""What a tolerance buys, and what a step: errors of the state on ladders of both, without timing.

Of a solver that is given a tolerance, the error over it is 1 where it is what was asked for. Of steps, the largest is
told from which on every error is at most 1 %. Errors are those of work_precision: at its horizon, against the
reference, each number over the larger of its size and its magnitude.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from typing import Any

from ..integrator import Integrator
from ..simulation.run import simulate
from ..study import Cells, Row, Study, Tables
from ..systems.scenario import Scenario
from ..table import Column, Table
from .cost import FLOOR, HIDES, as_float, reached_error
from .frames import spread, table_of
from .work_precision import errors_of, horizon, ladder

SLOW_S = 1.0  # of the processor: finer rungs than one as slow as this are left out
TOLERANCE = Table(
    "tolerance",
    (
        "integrator", "scenario", "control", "value", "status", "error",
        Column("over_tolerance", "error of the state over the tolerance", "error/tol", worse="higher"),
        "energy_error_max", "reference_limited", "reference_floor", "steps", "t", "failure",
    ),
    key=("control", "value"),
    long=True,
)  # fmt: skip
BOUGHT = Table(
    "bought",
    (
        "integrator", "scenario",
        Column("dt_1_percent", "largest step h from which on every error of the state is at most 1 %", "h for 1 %",
               worse="lower", optional=True),
        Column("steps_1_percent", "steps to an error of 1 %", "steps for 1 %", worse="higher", optional=True),
        Column("over_*", "error of the state over the tolerance asked for, *", "error/*",
               worse="higher", optional=True),
    ),
    derived=True,
)  # fmt: skip
ONE_PERCENT, TOLERANCES_BOUGHT = 0.01, (1e-3, 1e-6, 1e-9)


def bought(records: Sequence[Row]) -> list[Row]:
    """One row for each method and scenario: the largest step (dimensionless) from which on every finer rung has an
    error of the state of at most 1 %, and its steps; of a solver with a tolerance its error over three of them (1: it
    is what was asked for; NaN where the run failed, or the reference hides it)."""
    rows = []
    for r in sorted(records, key=lambda r: (r["scenario"], r["integrator"])):
        row = {"integrator": r["integrator"], "scenario": r["scenario"]}
        points = [{FLOOR: r.get(FLOOR)} | p for p in r.get("points") or []]  # coarse to fine
        if r.get("control") == "rtol":
            error_of = {p["value"]: p.get("error") for p in points if p.get("status") == "ok"}
            near = {t: next((as_float(e) for v, e in error_of.items() if math.isclose(v, t)), math.nan)
                    for t in TOLERANCES_BOUGHT}  # fmt: skip
            row |= {f"over_{t:.0e}".replace("-0", "-"): e / t for t, e in near.items()}
        elif points and r.get("control") == "dt":
            row |= _one_percent(points)
        rows.append(row)
    return rows


def _one_percent(points: Sequence[Row]) -> Row:
    errors = [reached_error(p, "error") for p in points]
    good = len(points)
    while good and errors[good - 1] <= ONE_PERCENT:
        good -= 1
    if good == len(points):  # not even the finest
        return {"dt_1_percent": math.nan, "steps_1_percent": math.nan}
    row = {"dt_1_percent": float(points[good]["value"]), "steps_1_percent": as_float(points[good].get("steps"))}
    if good and math.isfinite(errors[good - 1]) and errors[good] > 0:  # between two rungs
        share = math.log(ONE_PERCENT / errors[good]) / math.log(errors[good - 1] / errors[good])
        longer = (points[good - 1]["value"] / points[good]["value"]) ** share
        row = {"dt_1_percent": row["dt_1_percent"] * longer, "steps_1_percent": row["steps_1_percent"] / longer}
    return row


def plan(integrators: Sequence[Integrator], scenarios: Sequence[Scenario], options: Mapping[str, Any]) -> Cells:
    steps = {"dt": list(options["dt"])} if options.get("dt") else {}
    return [(i, s, dict(steps)) for s in scenarios for i in integrators if not i.lacks]


def measure(integrator: Integrator, scenario: Scenario, options: Row) -> Row:
    """The rungs of one method on one scenario, coarse to fine."""
    from ..reference.lookup import reference_for

    t_end = horizon(scenario)
    scenario = scenario.replace(t_end=t_end)
    reference = reference_for(scenario, [t_end])
    exact, floor = reference.states[0], float(reference.floor[0])
    adaptive, points = integrator.kind == "adaptive", list[Row]()
    for value in ladder(integrator, scenario, options.get("dt")):
        begin = time.process_time()
        how: Row = {"tolerance": value, "times": [0.0, t_end]} if adaptive else {"dt": value, "record_every": None}
        run = simulate(integrator, scenario, **how)
        errors = errors_of(scenario, run.z[-1] if run.ok else None, exact, HIDES * floor)
        points.append({
            "value": value, "status": run.status, "failure": run.failure, "error": errors["error"],
            "over_tolerance": errors["error"] / value if adaptive else math.nan,
            "energy_error_max": run.summary.energy_error_max, "reference_limited": errors["reference_limited"],
            "steps": run.steps,
        })  # fmt: skip
        if len(points) > 1 and time.process_time() - begin > SLOW_S:  # the first one compiles
            break
    ended = next((p for p in points if p["status"] == "ok"), points[-1])
    return {"status": ended["status"], "failure": ended["failure"], "control": "rtol" if adaptive else "dt", "t": t_end,
            FLOOR: floor, "points": points}  # fmt: skip


def tabulate(records: Sequence[Row]) -> Tables:
    rows = spread(records, "points", "dt", failed=lambda record: {})
    return {"tolerance": table_of(rows, TOLERANCE), "bought": table_of(bought(records), BOUGHT)}


STUDY = Study(
    name="tolerance",
    place=62,
    description="what a tolerance buys, and a step: errors on ladders of both, and the step for an error of 1 %",
    tables=(TOLERANCE, BOUGHT),
    plan=plan,
    measure=measure,
    tabulate=tabulate,
    by_default=False,
)
