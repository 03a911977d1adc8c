"""Convergence: the measured order of each method in each variable, against the order that it declares."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..analysis.order_fit import OrderFit, fit_order
from ..integrator import Integrator
from ..reference.certified import gap
from ..simulation.run import simulate
from ..study import Cells, Row, Study, Tables
from ..systems.scenario import Scenario
from ..systems.system import System
from ..table import Column, Table
from .frames import rows_in, spread, table_of

HALVINGS = range(1, 16)  # dt = t_converge / 2^k: exact, and from far outside the asymptotic range to round-off
PYTHON_HALVINGS = range(1, 12)  # a step of a plain Python method may cost a hundred times as much
# Rounding drifts by up to 5e-16 a step (midpoint_temperature); a 2000th part of an error bends its slope visibly.
ROUNDOFF = 1e-12
STILL = 1e-13  # relative: what keeps its value, to round-off
CONVERGENCE = Table(
    "convergence",
    (
        "integrator", "scenario", "variable", Column("order", worse="lower"),
        Column("order_low", short="low", worse="lower", narrow=4), Column("order_high", short="high", narrow=5),
        Column("points_used", short="points", narrow=3), "dt_min", "dt_max", "declared", "verdict", "status", "note",
    ),
    key=("variable",),
    terminal=("integrator", "variable", "order", "order_low", "order_high", "points_used", "verdict"),
)  # fmt: skip
POINTS = Table(
    "convergence_points",
    ("integrator", "scenario", "variable", "dt", "status", "error", "local_order", "used", "reason", "failure"),
    key=("variable", "dt"),
    long=True,
)


def plan(integrators: Sequence[Integrator], scenarios: Sequence[Scenario], options: Mapping[str, Any]) -> Cells:
    """One cell a pair. Adaptive solvers have no dt, and a ladder of tolerances shows no order."""
    steps = {"dt": list(options["dt"])} if options.get("dt") else {}
    methods = [integrator for integrator in integrators if integrator.kind != "adaptive"]
    return [(integrator, scenario, dict(steps)) for scenario in scenarios for integrator in methods]


def step_counts(integrator: Integrator, scenario: Scenario, steps: Sequence[float] | None) -> list[int]:
    """Numbers of steps to t_converge, increasing. A dt that does not divide it is rounded to one that does."""
    if steps is None:
        return [2**k for k in (HALVINGS if integrator.kind == "flows" else PYTHON_HALVINGS)]
    return sorted({max(1, round(scenario.t_converge / dt)) for dt in steps})


def measure(integrator: Integrator, scenario: Scenario, options: Row) -> Row:
    """Errors at t_converge over the ladder and the fitted order of each group of variables."""
    from ..reference.lookup import reference_for

    reference = reference_for(scenario, [scenario.t_converge])
    exact = groups(scenario.model, reference.states[0])
    counts = step_counts(integrator, scenario, options.get("dt"))
    dt, ends, floors, states = zip(*(_end_state(integrator, scenario, n) for n in counts), strict=True)
    parts = [None if z is None else groups(scenario.model, z) for z in states]
    errors = {x: [np.nan if of is None else gap(of[x], exact[x]) for of in parts] for x in exact}
    roundoff = [max(1e-9, ROUNDOFF * scenario.t_converge / h) for h in dt]
    fits = {
        name: fit_order(dt, errors[name], reference.floor[0], solver_floor=floors, roundoff=roundoff) for name in exact
    }
    start = groups(scenario.model, scenario.z0)
    still = {x for x in exact if _is_still([gap(exact[x], start[x]), *errors[x]])}
    return {
        "status": "ok" if "ok" in dict(ends) else ends[-1][0],
        "t": scenario.t_converge,
        "reference": reference.source,
        "orders": [_order_row(name, fits[name], integrator.order, name in still) for name in exact],
        "points": [row for name in exact for row in _point_rows(name, fits[name], dt, ends, errors[name])],
    }


def _end_state(integrator: Integrator, scenario: Scenario, n: int) -> tuple[float, tuple[str, str], float, Any]:
    """(dt, status and sentence, error that the solver leaves, state at t_converge or None) of a run of n steps."""
    dt, t_end = scenario.t_converge / n, scenario.t_converge
    extra = {"residuals": True} if integrator.kind == "flows" else {}
    run = simulate(integrator, scenario, dt=dt, t_end=t_end, record_every=None, **extra)
    left = run.summary.residual_max  # NaN for explicit methods, which solve nothing
    arrived = run.ok and run.steps == n
    return dt, (run.status, run.failure), n * left if left == left else 0.0, run.z[-1] if arrived else None


def groups(model: System, z: Any) -> dict[str, Any]:
    """The state by its variables, and the temperatures, over their magnitudes; "all" is z, for theta is a function of
    it."""
    theta_size, scaled = model.energy_magnitude / model.entropy_magnitude, np.asarray(z, float) / model.state_magnitudes
    state = model.state(scaled)
    parts = {name: np.ravel(getattr(state, name)) for name in model.variables}
    theta = {"theta": model.temperatures(z) / theta_size} if model.n_temperatures else {}
    return {**parts, **theta, "all": scaled}


def _is_still(misses: Sequence[float]) -> bool:
    """Has a variable, exactly and in every run that arrived, the value with which it began?"""
    return not any(miss > STILL for miss in misses) and any(miss <= STILL for miss in misses[1:])


def _order_row(name: str, fit: OrderFit, declared: int | None, still: bool) -> Row:
    verdict, note = fit.verdict(declared), fit.note
    if still:
        verdict, note = "stands still", "It keeps the value with which it began, as it should: there is no order."
    elif verdict == "undetermined" and fit.points_used:
        note = f"The slope lies between {fit.order_low:.2f} and {fit.order_high:.2f}, which says too little: {note}"
    numbers = {name: float(getattr(fit, name)) for name in ("order", "order_low", "order_high", "dt_min", "dt_max")}
    entries = {"points_used": int(fit.points_used), "declared": declared, "verdict": verdict, "note": note}
    return {"variable": name} | numbers | entries


def _point_rows(
    name: str, fit: OrderFit, dt: Sequence[float], ends: Sequence[tuple[str, str]], errors: Sequence[float]
) -> list[Row]:
    columns = zip(dt, ends, errors, fit.local_order, fit.used, fit.reason, strict=True)
    return [
        {
            "variable": name, "dt": h, "status": status, "error": error, "local_order": float(slope),
            "used": bool(used), "reason": str(reason), "failure": failure,
        }
        for h, (status, failure), error, slope, used, reason in columns
    ]  # fmt: skip


def tabulate(records: Sequence[Row]) -> Tables:
    """`convergence`: one row a variable; `convergence_points`: one row a step size. A failed cell keeps one row."""

    def failed(record: Mapping[str, Any]) -> Row:
        return {"variable": "all", "verdict": "undetermined", "note": record.get("failure", "")}

    orders = spread(records, "orders", "points", "dt", "failure", failed=failed)
    return {
        "convergence": table_of(orders, CONVERGENCE),
        "convergence_points": table_of(rows_in(records, "points"), POINTS),
    }


STUDY = Study(
    name="convergence",
    place=20,
    description="order of convergence by group of variables, from the asymptotic window of a ladder of steps",
    tables=(CONVERGENCE, POINTS),
    plan=plan,
    measure=measure,
    tabulate=tabulate,
)
