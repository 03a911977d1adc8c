"""Conservation: what each method keeps and what it loses, on a ladder of steps around the scenario's own."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from .. import plugins
from ..analysis.timing import warm_up
from ..errors import MachineError, blamed
from ..integrator import Integrator
from ..simulation import metrics, series, shared_runs
from ..simulation.against_exact import errors_against_exact
from ..simulation.run import simulate
from ..simulation.trajectory import Trajectory
from ..simulation.views import read_only
from ..study import Cells, Row, Study, Tables
from ..systems.scenario import Scenario
from ..table import Column, Table
from .base import settings
from .columns import shared
from .frames import table_of

CONSERVATION = Table(
    "conservation",
    (
        "integrator", "scenario", "dt", "status", "blowup_time", "energy_error_max",
        Column("energy_error_final", "|E − E₀| / V₀ at the end", worse="larger"),
        Column("energy_round_off", "round-off of E over V₀", compared=False),
        Column("energy_drift", worse="larger"), "entropy_increment_min",
        Column("second_law_violations", "steps on which S fell", worse="larger"), "angular_momentum_error_max",
        Column("lyapunov_increment_max", "largest rise of E − θ_ref S in a step", worse="higher"),
        Column("residual_max", worse="larger"), "newton_iterations_mean", "us_per_step", "t_final", "steps",
        "inner_steps_mean", "error_theta", "error_entropy_produced",
        Column("range_left", "how far temperatures and positive quantities leave their exact range", "beyond",
               worse="larger", optional=True),
        *(Column(f"theta_{end}", digits=6, optional=True) for end in ("min", "min_exact", "max", "max_exact")),
        Column("t_compared", "time up to which a run is compared with the exact one", optional=True), "failure",
        Column("invariants_lost", compared=False, optional=True),  # a sentence on each that a method claims and loses
        Column("constraints_dependent", compared=False, optional=True),  # a sentence, see Trajectory
        Column("*_error_max", worse="larger"),
        *(Column(f"{kind}_supplied", f"{kind} that came in from outside", optional=True) for kind in ("work", "heat")),
        Column("*_constraint_max", "largest g of the multiplier *", worse="larger"),
        Column("*_constraint_speed_max", "largest rate of g of the multiplier *", worse="larger"),
    ),
    key=("dt", "tolerance"),
    terminal=(
        "integrator", "dt", "tolerance", "status", "energy_error_max", "entropy_increment_min",
        "angular_momentum_error_max", "error_entropy_produced", "range_left", "newton_iterations_mean", "us_per_step",
        "blowup_time",
    ),
)  # fmt: skip
STATES = (*(shared(name, digits=6) for name in ("t", "dt", "tolerance")), Column("temperature*", digits=6),
          Column("exact_error", digits=2), Column("*_error", digits=3))  # fmt: skip
SHORT_S = 0.1  # a run as short as this is timed twice
TOLERANCES = (1e-3, 1e-6, 1e-9)  # of adaptive solvers, which have no dt
BESIDE = (*series.ROW, "numbers", "sweep")  # what rows keep beside columns
MANY = 40  # scenarios: of more, a sweep, no course is kept, and rows have constants and initial values as columns
OWN = 1e-6  # the tolerance that stands for the scenario's own step


def plan(integrators: Sequence[Integrator], scenarios: Sequence[Scenario], options: Mapping[str, Any]) -> Cells:
    cells: Cells = []
    extra: Row = {"sweep": True} if len(scenarios) > MANY else {}
    for scenario in scenarios:
        wanted = options.get("dt") or [factor * scenario.dt for factor in scenario.ladder]
        steps = [dt for dt in wanted if dt <= scenario.t_end]
        cells += [(i, scenario, run | extra) for i in integrators for run in settings(i, steps, TOLERANCES)]
    return cells


def measure(integrator: Integrator, scenario: Scenario, options: Row) -> Row:
    adaptive = integrator.kind == "adaptive"
    extra = {"tolerance": options["tolerance"]} if adaptive else {"dt": options["dt"], "residuals": True}
    if integrator.kind != "flows":  # whose compiling is no part of a step
        warm_up(integrator, scenario, [extra])
    run = simulate(integrator, scenario, **extra)
    row = metrics.conservation(run) | errors_against_exact(run)
    if run.wall_time_s < SHORT_S and row["us_per_step"] > 0:  # timed again: all is loaded, and without residuals
        with shared_runs.unshared():
            again = simulate(
                integrator, scenario, **(extra if adaptive else {"dt": options["dt"], "record_every": None})
            )
        row["us_per_step"] = min(row["us_per_step"], metrics.us_per_step(again))
    row |= _of_plugins(run, row)
    if options.get("sweep"):
        return row | {"numbers": scenario.numbers()}
    return row | series.row_parts(run) if _drawn(scenario, options) else row


def _of_plugins(run: Trajectory, row: Row) -> Row:
    """The numbers of plugins' metrics. One that gives none costs its own column; `metric_failure` says why."""
    numbers: Row = {}
    said = []
    seen = read_only(run)  # by the other metrics, too, and by what the row keeps of the course
    for name, metric in plugins.metrics().items():
        if name in row or name in (*CONSERVATION.names, *BESIDE):
            said.append(f"Metric {name!r} of {metric.plugin}: the table has a column of this name; rename the metric")
            continue
        try:
            numbers[name] = as_number(metric.compute(seen))
        except (MachineError, MemoryError):
            raise
        except Exception as error:
            numbers[name] = math.nan
            said.append(f"Metric {name!r} of {metric.plugin}: {blamed(error)}")
    return numbers | ({"metric_failure": "; ".join(said)} if said else {})


def as_number(value: Any) -> float:
    """What a metric gives, or TypeError."""
    if isinstance(value, str) or value is None:
        raise TypeError(f"it gives {value!r}, not a number")
    if getattr(value, "ndim", 0):
        raise TypeError(f"it gives an array of shape {value.shape}, not a number")
    return float(value)


def _drawn(scenario: Scenario, options: Row) -> bool:
    """Is the run's course kept, for charts in time? At the scenario's own step, and at steps that are on no ladder."""
    if "tolerance" in options:
        return bool(options["tolerance"] == OWN)
    others = [factor * scenario.dt for factor in scenario.ladder if factor != 1]
    return not any(math.isclose(options["dt"], step, rel_tol=1e-9) for step in others)


def tabulate(records: Sequence[Row]) -> Tables:
    rows = [(row.get("numbers") or {}) | {k: v for k, v in row.items() if k not in BESIDE} for row in records]
    names = set().union(*rows)
    order = [c for c in ("scenario", "integrator", "dt", "tolerance") if c in (*CONSERVATION.names, *names)]
    return {"conservation": table_of(rows, CONSERVATION, order)} | series.tables(records)


STUDY = Study(
    name="conservation",
    place=10,
    description="energy, entropy and momentum errors, blow-up time and solver effort on a ladder of steps",
    tables=(
        CONSERVATION,
        *(
            Table(name, STATES, digits=digits, derived=True, long=True)
            for name, digits in zip(series.ROW, (5, 4, 4), strict=True)
        ),
    ),
    plan=plan,
    measure=measure,
    tabulate=tabulate,
    metrics=True,
)
