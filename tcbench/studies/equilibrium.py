"""Equilibrium: how far a trajectory is from the state of largest entropy that its energy and invariants allow.

`maximum_entropy` climbs to it. Of the double pendulum that is the relative equilibrium, a rigid rotation with one
temperature, whose masses lie on a line through the origin (Romero (2009), section 4): there strains and the rate of
rotation are compared as well.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import plugins
from ..analysis.maximum_entropy import FAR, MAX_NUMBERS, Equilibrium, maximum_entropy
from ..integrator import Integrator
from ..simulation.run import simulate
from ..simulation.trajectory import Trajectory
from ..study import Cells, Row, Study
from ..systems.pendulum import Pendulum
from ..systems.scenario import Scenario
from ..table import Column, Table
from .base import settings
from .frames import rows_in, table_of

if TYPE_CHECKING:
    from pandas import DataFrame

LONG_HORIZON = 1000.0  # a run of everything studies only scenarios at least this long: shorter ones show no approach
TIMES = 60  # rows a run, equally spaced in ln t
TOLERANCE = 1e-9  # of adaptive solvers, which have no dt
APPROACHED = 0.01  # part of the initial entropy gap that may be left, and must still be falling
SLOW = 0.01  # part of the gap that would be closed in the time of the run, at the rate of its end
DISTANT = math.log(100.0)  # strain of a spring of so many natural lengths: no horizon shows such an equilibrium
ORDER = ("scenario", "integrator", "dt")  # of rows
ABOVE = 1e-9  # entropy cannot exceed that of the equilibrium by more than round-off, unless energy is not conserved
GAPS = (
    Column("entropy_gap", "entropy: S* − S", "entropy gap", worse="larger"),
    Column("strain_gap", "log strains: max |L − L*|", worse="larger", optional=True),
    Column("temperature_gap", "temperatures: max |θ − θ*|", worse="larger", optional=True),
    Column("rotation_gap", "rate of rotation: |ω − ω*|", worse="larger", optional=True),
)
_of_some = partial(Column, optional=True)  # what elements have, or a pendulum
EQUILIBRIUM = Table(
    "equilibrium",
    (
        "integrator", "scenario", "dt", "t", *GAPS, "entropy",
        *map(_of_some, ("strain_a", "strain_b", "temperature_a", "temperature_b", "rate")),
    ),
    key=("dt", "t"),
    long=True,
)  # fmt: skip
SUMMARY = Table(
    "equilibrium_summary",
    (
        "integrator", "scenario", "dt", "status", "t_final", "equilibrium", GAPS[0], "entropy_gap_falls", *GAPS[1:],
        _of_some("growth_a", short="growth a"), _of_some("growth_b", short="growth b"),
        *map(_of_some, ("exact_strain_a", "exact_strain_b", "exact_temperature", "exact_rate")), "exact_entropy",
        "note",
    ),
    key=("dt",),
    terminal=("integrator", "equilibrium", "entropy_gap", "temperature_gap", "growth_a", "growth_b"),
)  # fmt: skip


def plan(integrators: Sequence[Integrator], scenarios: Sequence[Scenario], options: Mapping[str, Any]) -> Cells:
    """One cell a pair: scenarios with a long horizon when every scenario is selected, otherwise those asked for.

    Systems of so many variables that second derivatives are not written out are left out.
    """
    chosen = [scenario for scenario in scenarios if scenario.model.size <= MAX_NUMBERS]
    if {scenario.name for scenario in scenarios} >= set(plugins.scenarios()):
        chosen = [scenario for scenario in chosen if scenario.t_end >= LONG_HORIZON]
    cells: Cells = []
    for scenario in chosen:
        steps = [float(dt) for dt in options.get("dt") or [scenario.dt] if dt <= scenario.t_end]
        cells += [(i, scenario, run) for i in integrators for run in settings(i, steps, [TOLERANCE])]
    return cells


def measure(integrator: Integrator, scenario: Scenario, options: Row) -> Row:
    """Gaps along one run, at log-spaced recorded times, and what they amount to."""
    run = simulate(integrator, scenario, **options)
    rows, exact = log_spaced(run.t), exact_equilibrium(scenario)
    theta, entropy = run.temperatures[rows], run.entropy[rows]
    columns: Row = {"t": run.t[rows], "entropy_gap": exact.entropy - entropy, "entropy": entropy}
    exact_values: Row = {"exact_entropy": exact.entropy}
    if theta.shape[1]:
        columns["temperature_gap"] = np.abs(theta - exact.temperatures).max(axis=1)
        exact_values["exact_temperature"] = float(np.mean(exact.temperatures))
    if scenario.system is Pendulum:
        columns, more = _of_springs(run, rows, exact, columns)
        exact_values |= more
    table = [dict(zip(columns, map(float, line), strict=True)) for line in zip(*columns.values(), strict=True)]
    summary = summarise(run, exact, columns, exact_values)
    return {"status": run.status, "failure": run.failure, "rows": table, "summary": summary}


def _of_springs(run: Trajectory, rows: Sequence[int], exact: Equilibrium, columns: Row) -> tuple[Row, Row]:
    """The columns with those of a pendulum's strains and rotation, and their values at the equilibrium."""
    model, z, theta = run.scenario.model, run.z[rows], run.temperatures[rows]
    strains, (limit,) = _strains(model, z), _strains(model, exact.z[None])
    rate = run.invariants["angular_momentum"][rows] / (z[:, :4] ** 2 @ model.inertia())
    radii = np.cumsum(np.exp(limit) * model.natural_lengths)  # all on one line: turned a little S would be the same
    exact_rate = float(run.invariants["angular_momentum"][0] / (model.masses @ radii**2))
    gaps = columns | {"strain_gap": np.abs(strains - limit).max(axis=1), "rotation_gap": np.abs(rate - exact_rate)}
    if limit.max() > DISTANT:  # a distance to springs of more than a hundred natural lengths means nothing here
        gaps |= {name: np.full(len(z), np.nan) for name in gaps if name.endswith("_gap")}
    each = {"strain": strains.T, "temperature": theta.T}
    return (
        gaps | {f"{name}_{x}": of[i] for name, of in each.items() for i, x in enumerate("ab")} | {"rate": rate},
        {"exact_strain_a": float(limit[0]), "exact_strain_b": float(limit[1]), "exact_rate": exact_rate},
    )


def _strains(model: Any, z: Any) -> Any:
    """Of the springs of a pendulum in states z (n, 10): shape (n, 2)."""
    return model.log_strain(np.array([model.shape(one[:4]) for one in z]))


def exact_equilibrium(scenario: Scenario) -> Equilibrium:
    """That of the scenario's own energy and invariants. A pendulum's springs always pull back in the end: however far
    away it is, it exists."""
    within = math.inf if scenario.system is Pendulum else FAR
    return maximum_entropy(scenario.model, scenario.z0, within)


def log_spaced(t: Any) -> list[int]:
    """Indices of at most TIMES of the times t > 0, about equally spaced in ln t; the last one is among them."""
    if len(t) < 2:
        return list(range(len(t)))
    return sorted({int(i) for i in np.rint(np.geomspace(1, len(t) - 1, TIMES))})


def summarise(run: Trajectory, exact: Equilibrium, columns: Mapping[str, Any], exact_values: Row) -> Row:
    """One row a run: the last gaps, whether the entropy gap still falls, growth of the strains, and a sentence."""
    last = {name: float(values[-1]) for name, values in columns.items()}
    late = columns["t"] >= run.t[-1] / 10
    gap = columns["entropy_gap"]
    falls = bool(np.all(np.diff(gap[late]) <= 1e-12)) and len(gap[late]) > 1  # a fall below round-off of S is none
    start = exact.entropy - float(run.entropy[0])
    close = last["entropy_gap"] <= max(APPROACHED * start, ABOVE) and (falls or last["entropy_gap"] <= ABOVE)
    growth = {
        f"growth_{spring}": _slope(np.log(columns["t"][late]), columns[f"strain_{spring}"][late])
        for spring in ("ab" if "rate" in columns else "")
    }
    entries = {name: last[name] for name in columns if name.endswith("_gap")} | exact_values | growth
    word, note = _judged(run, exact, last | exact_values, list(growth.values()), close)
    return entries | {"t_final": float(run.t[-1]), "equilibrium": word, "entropy_gap_falls": falls, "note": note}


def _slope(x: Any, y: Any) -> float:
    """Least-squares slope; NaN for fewer than two points."""
    return float(np.polyfit(x, y, 1)[0]) if len(x) > 1 else float("nan")


def _judged(
    run: Trajectory, exact: Equilibrium, last: Mapping[str, float], growth: Sequence[float], close: bool
) -> tuple[str, str]:  # fmt: skip
    """none, run failed, distant, passed, approached or not reached; and the sentence that goes with it."""
    t, gap = run.t[-1], last["entropy_gap"]
    growing = f"strains grow by {growth[0]:.3f} and {growth[1]:.3f} per unit of ln t" if growth else ""
    if not exact.exists:
        return "none", f"{exact.note} By t = {t:g} {growing}." if growing else exact.note
    if not run.ok:
        return "run failed", run.failure
    a, b = last.get("exact_strain_a", 0.0), last.get("exact_strain_b", 0.0)
    if max(a, b) > DISTANT:
        return "distant", (
            f"No equilibrium is reached: it lies at strains {a:.3g}, {b:.3g}, S = {exact.entropy:.4f}; at t = {t:g} "
            f"strains are {last['strain_a']:.3f}, {last['strain_b']:.3f}, S = {last['entropy']:.4f}, and {growing}."
        )
    if gap < -ABOVE:
        return "passed", (
            f"At t = {t:g} the entropy is {-gap:.3g} above the largest that the initial energy allows: "
            f"the energy moved by {run.energy[-1] - run.energy[0]:.3g}."
        )
    word = "approached" if close else "not reached"
    sentence = f"At t = {t:g} the entropy is {gap:.3g} below that of the "
    if growth:
        return word, f"{sentence}relative equilibrium."
    sentence += "equilibrium, the largest that was found at its energy and invariants, from many starts"
    if close:
        return word, f"{sentence}."
    model, z = run.scenario.model, run.z[-1]
    slow = float(model.entropy_gradient(z) @ model.vector_field(z)) * t < SLOW * gap
    why = "; what dissipates is too slow, or something is conserved that invariants() does not name"
    return word, f"{sentence}{why if slow else ', and still rises'}."


def tabulate(records: Sequence[Row]) -> dict[str, DataFrame]:
    """`equilibrium`: one row a recorded time; `equilibrium_summary`: one row a run, failed cells included."""
    summaries: list[Row] = []
    for record in records:
        origin = {k: v for k, v in record.items() if k not in ("rows", "summary")}
        summaries.append(origin | (record.get("summary") or {"note": record.get("failure", "")}))
    return {
        "equilibrium": table_of(rows_in(records, "rows", ("integrator", "scenario", "dt")), EQUILIBRIUM, ORDER),
        "equilibrium_summary": table_of(summaries, SUMMARY, ORDER),
    }


STUDY = Study(
    name="equilibrium",
    place=30,
    description="gap to the largest entropy that energy and invariants allow, over time, or why there is none",
    tables=(EQUILIBRIUM, SUMMARY),
    plan=plan,
    measure=measure,
    tabulate=tabulate,
)
