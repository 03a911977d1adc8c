"""Work and precision: the time that each method needs for an error, against the certified reference.

One cell is one method on one scenario, measured alone on the machine; it goes down a ladder of steps or tolerances.
Each rung is warm (one run is not timed where it might load something), and repeated until 10 ms have passed or 30 runs
are done. A fixed-step run is timed inside `simulate`, its diagnostics of every step included; an adaptive solver from
call to return, asked for the end time only. Its errors in the invariants are those of a run that reports 200 times;
where that takes long, another cell, before and not alone, has left it for the timed one (`simulation.shared_runs`),
and where it does not, has compiled what each tolerance needs.
Finer rungs that cost much and tell nothing new are left out (see `enough`); the column left_out of the last rung that
was run says which and why.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ..analysis.timing import solved, timed
from ..integrator import Integrator
from ..reference.certified import gap
from ..simulation import shared_runs
from ..simulation.metrics import evaluations, inner_steps_mean, invariant_errors, newton_iterations
from ..simulation.run import simulate
from ..study import Cells, Row, Study, Tables
from ..systems.scenario import Scenario
from ..table import Column, Table
from .columns import shared
from .convergence import groups
from .cost import HIDES, TARGETS, TO_ACCURACY, reached_error, time_to_accuracy
from .frames import spread, table_of

TOLERANCES = tuple(10.0**-k for k in range(1, 13))
HALVINGS = range(-2, 9)  # steps are the scenario's own, over 2^k
LONGEST = 500.0  # horizons: the last stored reference up to here
UNSTORED = 25.0  # where none is stored: errors of chaotic scenarios would outgrow any reference
SPENT_S = 0.01  # a rung is repeated until this much time has passed
CHEAP_S = 0.02  # after a rung that takes no longer the next is never left out
QUICK_S = 0.002  # solvers whose loosest run takes no longer leave none for the timed cell
SLOW_S = 0.2  # after a run as slow as this the finer rungs are left out
SLOW_FAILURES = 2  # ... or after so many failed ones as slow as this
REACHED = "every accuracy that is asked for is reached"
ROUND_OFF = 3  # rungs without a better energy error, after which it is taken to be round-off
PRODUCED = "error_entropy_produced"
LEAST_PRODUCED = 1e-6  # of entropy, over its size, below which nothing is said of its error
PEERS = {"scipy": "scipy", "peer": "other"}  # tag -> what the tables call it; the first that fits
LAWS = "laws"  # the part that is not timed
WARM = 1e-3  # part of the horizon of a run that only loads and compiles
WORK = Table(
    "work_precision",
    (
        "integrator", "scenario", "control", "value", "status", "error", "error_q", "error_p", "error_s", "error_theta",
        "error_entropy_produced", "energy_error_max", "angular_momentum_error_max",
        Column("entropy_fall_max", "largest fall of S in a step", worse="higher"), "reference_limited",
        "reference_floor",
        Column("wall_time_min_s", "wall time (minimum)", "seconds", "s", "higher", timing=True),
        Column("wall_time_median_s", "wall time (median)", "", "s", "higher", timing=True), "repeats", "steps",
        shared("tolerance", optional=True),
        Column("newton_iterations", "Newton iterations", worse="larger"),
        Column("rhs_evaluations", "right-hand sides evaluated", worse="larger"),
        Column("evaluations", "evaluations of the right-hand side or formula", worse="larger"), "inner_steps_mean", "t",
        "peer", "failure", Column("left_out", compared=False),  # which depends on the time that others take
        Column("error_*", "error of *", worse="larger"), Column("*_error_max", worse="larger"),
    ),
    key=("control", "value"),
    timed=True,
    long=True,
    terminal=("integrator", "control", "value", "status", "error", "energy_error_max", "wall_time_min_s", "steps"),
)  # fmt: skip


def plan(integrators: Sequence[Integrator], scenarios: Sequence[Scenario], options: Mapping[str, Any]) -> Cells:
    """A timed cell of each pair, and one before it of an adaptive solver.

    A `dt` list replaces the ladder. Solvers that lack a package are left out.
    """
    steps = {"dt": list(options["dt"])} if options.get("dt") else {}
    pairs = [(i, s) for s in scenarios for i in integrators if not i.lacks]
    laws = [(i, s, {"part": LAWS}) for i, s in pairs if i.kind == "adaptive"]
    return [*laws, *((i, s, dict(steps)) for i, s in pairs)]


def measure(integrator: Integrator, scenario: Scenario, options: Row) -> Row:
    """The rungs of one method on one scenario, coarse to fine."""
    from ..reference.lookup import reference_for

    t_end = horizon(scenario)
    scenario = scenario.replace(t_end=t_end)
    if options.get("part") == LAWS:
        return {"status": "ok", "made": _make_laws(integrator, scenario)}
    reference = reference_for(scenario, [t_end])
    exact, floor = reference.states[0], HIDES * float(reference.floor[0])
    run_at = _adaptive if integrator.kind == "adaptive" else _fixed
    points: list[Row] = []
    took: list[float] = []
    rungs = ladder(integrator, scenario, options.get("dt"))
    for value in rungs:
        if why := enough(points, took):
            points[-1]["left_out"] = f"{len(rungs) - len(points)} finer ones, to {rungs[-1]:.3g}: {why}"
            break
        begin = time.process_time()  # a busy machine cuts no ladder short
        timing = timed(run_at(integrator, scenario, value), SPENT_S, warm=any(p["repeats"] for p in points))
        point, seconds = timing.row, timing.seconds
        state, first_s = point.pop("state", None), point.pop("first_s", 0.0)
        points.append(
            {"value": value, "repeats": len(seconds)}
            | point
            | errors_of(scenario, state, exact, floor)
            | timing.columns()
        )
        took.append(timing.work if seconds else max(first_s, time.process_time() - begin))
    good = [p["status"] for p in points]
    return {
        "status": "ok" if "ok" in good else good[-1],
        "failure": "" if "ok" in good else points[-1]["failure"],
        "control": "rtol" if integrator.kind == "adaptive" else "dt",
        "t": t_end,
        "reference": reference.source,
        "reference_floor": float(reference.floor[0]),
        "peer": next((kind for tag, kind in PEERS.items() if tag in integrator.tags), ""),
        "points": points,
    }


def enough(points: Sequence[Row], took: Sequence[float]) -> str:
    """Why finer rungs are not worth their time, "" if they are. took : processor seconds of a run of each rung.

    A rung that is slow is the last one, for the next would be slower still; one that is not slow is followed by the
    next as long as an accuracy of the table time_to_accuracy is not reached, or it is cheap.
    """
    if not points or took[-1] <= CHEAP_S:
        return ""
    slow = [point["status"] for point, seconds in zip(points, took, strict=True) if seconds > SLOW_S]
    if "ok" in slow:
        return f"a run took {took[-1]:.2g} s, more than {SLOW_S:g} s"
    if len(slow) >= SLOW_FAILURES:
        return f"{len(slow)} runs that failed took more than {SLOW_S:g} s each"
    errors = [reached_error(point, "error") for point in points]
    losses = [reached_error(point, "energy_error_max") for point in points]
    kept = min(losses) <= min(TARGETS["energy_error_max"])
    if len(points) > ROUND_OFF:
        kept = kept or min(losses[-ROUND_OFF:]) > 0.5 * min(losses[:-ROUND_OFF])
    return REACHED if min(errors) <= min(TARGETS["error"]) and kept else ""


def horizon(scenario: Scenario) -> float:
    """Where errors are measured."""
    from ..reference.lookup import stored_for

    stored = stored_for(scenario)
    times = [t for t in stored.times if t <= min(LONGEST, scenario.t_end)] if stored else []
    return float(max(times, default=min(UNSTORED, scenario.t_end)))


def ladder(integrator: Integrator, scenario: Scenario, steps: Sequence[float] | None) -> list[float]:
    """Tolerances, or steps that divide the horizon; coarse to fine."""
    if integrator.kind == "adaptive":
        return list(TOLERANCES)
    wanted = list(steps) if steps else [scenario.dt / 2**k for k in HALVINGS]
    counts = sorted({max(1, math.ceil(scenario.t_end / h - 1e-9)) for h in wanted})
    return [scenario.t_end / n for n in counts]


def _fixed(integrator: Integrator, scenario: Scenario, dt: float) -> Callable[[bool], tuple[Row, float]]:
    def run(first: bool) -> tuple[Row, float]:
        result = simulate(integrator, scenario, dt=dt, record_every=None)
        row = {
            "status": result.status, "failure": result.failure, "steps": result.steps,
            "newton_iterations": newton_iterations(result), "evaluations": evaluations(result),
            "inner_steps_mean": inner_steps_mean(result),
            "state": result.z[-1] if result.ok else None,
            "energy_error_max": result.summary.energy_error_max,
            **invariant_errors(result),
            "entropy_fall_max": max(0.0, -result.summary.entropy_increment_min),
        }  # fmt: skip
        return row, result.wall_time_s

    return run


def _adaptive(integrator: Integrator, scenario: Scenario, tolerance: float) -> Callable[[bool], tuple[Row, float]]:
    """The first run, which takes no time, gives the invariants at 200 times; the others go straight to the end."""
    ends, z0, model = np.array([0.0, scenario.t_end]), scenario.z0, scenario.model
    start = WARM * ends
    seen: Row = {"status": "ok", "failure": "", "energy_error_max": 0.0}

    def run(first: bool) -> tuple[Row, float]:
        if first:
            reads = shared_runs.reads()
            result = simulate(integrator, scenario, tolerance=tolerance)
            work = shared_runs.work_s()
            if shared_runs.reads() > reads and result.ok:  # nothing has been loaded or compiled
                integrator.adaptive(model, z0.copy(), start, tolerance, tolerance)  # type: ignore[misc]
            seen.update(
                status=result.status, failure=result.failure, energy_error_max=result.summary.energy_error_max,
                entropy_fall_max=max(0.0, -result.summary.entropy_increment_min),
                first_s=work, **invariant_errors(result),
            )  # fmt: skip
            return seen, 0.0
        solution = solved(integrator, scenario, ends, tolerance)
        if solution.failure:
            return seen | {"status": solution.status, "failure": solution.failure}, 0.0
        end, counts = np.asarray(solution.states[-1], dtype=float), {**solution.counts}
        left = abs(model.energy(end) - model.energy(z0)) / scenario.initial_exergy
        if "rhs_evaluations" in counts:
            counts["evaluations"] = counts["rhs_evaluations"]
        ended = {"state": end, "energy_error_max": max(seen["energy_error_max"], left)}
        return seen | counts | ended, solution.seconds

    return run


def _make_laws(integrator: Integrator, scenario: Scenario) -> int:
    """Make the runs that tell the errors in the invariants, and leave them for the timed cell; how many."""
    if not shared_runs.are_shared():
        return 0
    with shared_runs.unshared():  # and whatever that loads
        simulate(integrator, scenario, t_end=WARM * scenario.t_end, tolerance=TOLERANCES[0])
    count, slow = 0, list[bool]()
    while count < len(TOLERANCES) and not any(slow) and len(slow) < SLOW_FAILURES:
        run = simulate(integrator, scenario, tolerance=TOLERANCES[count])
        seconds = shared_runs.work_s()  # however busy the machine is
        if count == 0 and run.ok and seconds < QUICK_S:
            for tolerance in TOLERANCES:  # all that there is to leave is what was compiled
                solved(integrator, scenario, [0.0, WARM * scenario.t_end], tolerance)
            break
        slow += [run.ok] if seconds > SLOW_S else []
        count += 1
    return count


def errors_of(scenario: Scenario, state: Any, exact: Any, floor: float) -> Row:
    """Errors by group of variables; one within 10 times the reference's own uncertainty is NaN, and the row says so."""
    right = groups(scenario.model, exact)
    names = {"error": "all", **{f"error_{name}": name for name in right if name != "all"}}
    if state is None:
        return dict.fromkeys([*names, PRODUCED], math.nan) | {"reference_limited": False}
    parts = groups(scenario.model, state)
    errors = {name: gap(parts[key], right[key]) for name, key in names.items()}
    limited = errors["error"] <= floor
    errors[PRODUCED] = produced_error(scenario, state, exact)
    return {name: e if e > floor else math.nan for name, e in errors.items()} | {"reference_limited": limited}


def produced_error(scenario: Scenario, state: Any, exact: Any) -> float:
    """Error of the entropy that was produced since the start, over what is produced; NaN where that is nothing.

    Both laws may hold to round-off while this is wrong: a consistent method that rings produces too little.
    """
    start, entropy, right = (scenario.model.entropy(z) for z in (scenario.z0, state, exact))
    produced = right - start
    smallest = LEAST_PRODUCED * max(scenario.model.entropy_magnitude, abs(right))
    return abs(entropy - right) / produced if produced > smallest else math.nan


def tabulate(records: Sequence[Row]) -> Tables:
    """`work_precision`: a row a rung; the others: see cost.py. A failed cell keeps one row."""
    import pandas as pd

    records = [record for record in records if "part" not in record]
    if not records:
        return {}
    rows = [
        row | ({"tolerance": row["value"]} if row.get("control") == "rtol" and "value" in row else {})
        for row in spread(records, "points", "dt", failed=lambda record: {})
    ]
    return {
        "work_precision": table_of(rows, WORK),
        "time_to_accuracy": pd.DataFrame(time_to_accuracy(records)),
    }


STUDY = Study(
    name="work_precision",
    place=60,
    description="error against time on ladders of steps and tolerances",
    tables=(WORK, TO_ACCURACY),
    plan=plan,
    measure=measure,
    tabulate=tabulate,
    timed=lambda options: options.get("part") != LAWS,
)
