"""Literature: what later authors state of their methods, measured as they measure it; beside the paper's own claims.

Shang and Ottinger (2020): YBABY and mYBABY on a damped linear oscillator, a damped pendulum and two gas containers, at
ten steps h = 0.1/1.3^k. An error is the root of the mean of its squares over all states 0, h, 2h, ... of a run: of q,
of p, of the total entropy and of the energy. Their printed errors were not at hand: a claim is an order, or what their
abstract says; the errors are the table `literature_errors`, for who has them. The column stated_by separates what the
authors say from what is measured here besides.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from .. import plugins
from ..analysis.theorems import LedgerRow, command
from ..integrator import Integrator
from ..plugins import find_integrator
from ..simulation.run import simulate
from ..simulation.trajectory import Trajectory
from ..study import Cells, Row, Study, Tables
from ..systems.scenario import Scenario
from ..table import Column, Table
from .claims import not_measured
from .frames import spread, table_of

AUTHORS, ADDED = "Shang and Ottinger (2020)", "tcbench"
ORDERS = {"ybaby": 2, "mybaby": 2}
SCENARIOS = ("linear_oscillator", "damped_oscillator", "gas_containers")
STEPS = tuple(0.1 / 1.3**k for k in range(10))
ERRORS = {"rmse_q": "q", "rmse_p": "p", "rmse_entropy": "S", "rmse_energy": "E"}
FINER = 4  # steps of the reference in one: Gauss collocation of order six
REFERENCE = "gauss3"
ORDER_MARGIN = 0.05  # how far the slope over the ten steps may be from the order
EXACT = 1e-9  # of an area, by differences
NUDGE = 1e-4
LITERATURE = Table(
    "literature",
    (
        "claim", "stated_by", "section", "expected", "measured", "verdict", "why", "command", "integrator", "scenario",
    ),
    key=("claim",),
)  # fmt: skip
POINTS = Table(
    "literature_errors",
    (
        "integrator", "scenario", "dt", "status",
        *(Column(n, f"root mean square of the error of {of}", worse="larger") for n, of in ERRORS.items()),
    ),
    key=("dt",),
)  # fmt: skip


def plan(integrators: Sequence[Integrator], scenarios: Sequence[Scenario], options: Mapping[str, Any]) -> Cells:
    """A cell a pair of those that are selected; where all methods that run by themselves are, theirs as well."""
    methods = {i.name: i for i in integrators}
    if methods.keys() >= set(plugins.by_default()):
        methods |= {name: plugins.find_integrator(name) for name in ORDERS if name in plugins.present()}
    chosen = [s for s in scenarios if s.name.partition("[")[0] in SCENARIOS]
    return [(methods[name], s, {}) for s in chosen for name in ORDERS if name in methods]


def measure(integrator: Integrator, scenario: Scenario, options: Row) -> Row:
    points = [errors_at(integrator, scenario, dt) for dt in STEPS]
    findings = [*orders(integrator, scenario, points)]
    findings += [area(integrator, scenario)] if scenario.model.name == "linear_oscillator" else []
    return {"status": "ok", "findings": [x.as_dict() for x in findings], "points": points}


def errors_at(integrator: Integrator, scenario: Scenario, dt: float) -> Row:
    """The four errors of a run of steps dt, as many as end before t_end."""
    run, exact = _run(integrator, scenario, dt, 1), _run(find_integrator(REFERENCE), scenario, dt, FINER)
    row: Row = {"dt": dt, "status": run.status} | dict.fromkeys(ERRORS, math.nan)
    if run.ok:
        gaps = [
            (run.z - exact.z)[:, 0],
            (run.z - exact.z)[:, 1],
            run.entropy - exact.entropy,
            run.energy - run.energy[0],
        ]
        row |= {name: float(np.sqrt(np.mean(gap**2))) for name, gap in zip(ERRORS, gaps, strict=True)}
    return row


def _run(integrator: Integrator, scenario: Scenario, dt: float, finer: int) -> Trajectory:
    steps = math.floor(scenario.t_end / dt)
    return simulate(integrator, scenario, dt=dt / finer, t_end=steps * dt, record_every=finer)


def orders(integrator: Integrator, scenario: Scenario, points: Sequence[Row]) -> Iterator[LedgerRow]:
    """The slopes of the errors over the ten steps; and those of the energy beside the unmodified method's."""
    declared = ORDERS[integrator.name]
    for column, name in ERRORS.items():
        values = np.array([point[column] for point in points])
        good = bool(np.isfinite(values).all())
        slope = float(np.polyfit(np.log(STEPS), np.log(values), 1)[0]) if good else math.nan
        yield LedgerRow(
            f"{integrator.name}, {scenario.name}: {name} is of order {declared}", AUTHORS, str(declared),
            f"{slope:.3f}; errors {values[0]:.3e} at h = {STEPS[0]:g} to {values[-1]:.3e} at {STEPS[-1]:.3g}",
            abs(slope - declared) <= ORDER_MARGIN, command(integrator, scenario, "literature"),
            "Slope over ten steps 0.1/1.3^k of root mean squares over a run.",
        )  # fmt: skip
    if integrator.name == "mybaby":
        yield from _beside_ybaby(integrator, scenario, points)


def _beside_ybaby(integrator: Integrator, scenario: Scenario, points: Sequence[Row]) -> Iterator[LedgerRow]:
    plain = [errors_at(find_integrator("ybaby"), scenario, dt) for dt in STEPS]
    for column, name in (("rmse_energy", "E"), ("rmse_entropy", "S")):
        ratios = [a[column] / b[column] for a, b in zip(plain, points, strict=True)]
        yield LedgerRow(
            f"{integrator.name}, {scenario.name}: {name} is nearer than by ybaby at every step", ADDED, "ratio > 1",
            f"{min(ratios):.2f} to {max(ratios):.2f} times", min(ratios) > 1,
            command(integrator, scenario, "literature"),
            f"The error of {name} by ybaby over that by mybaby, at ten steps.",
        )  # fmt: skip


def area(integrator: Integrator, scenario: Scenario) -> LedgerRow:
    """The determinant of d(q, p) after a step: the same everywhere, exp(-friction h) up to the method's own factor."""
    h, areas = STEPS[0], []
    for q, p in ((2.0, 0.0), (0.5, 1.5), (-1.0, 0.3)):

        def step(dq: float, dp: float, q: float = q, p: float = p) -> Any:
            start = scenario.replace(name="moved", initial={"q": q + dq, "p": p + dp, "s": 0.0})
            return simulate(integrator, start, dt=h, t_end=h).z[-1][:2]

        slopes = [(step(*d) - step(-d[0], -d[1])) / (2 * NUDGE) for d in ((NUDGE, 0.0), (0.0, NUDGE))]
        areas.append(float(np.linalg.det(slopes)))
    spread, decay = max(areas) / min(areas) - 1, -math.log(areas[0]) / (scenario.constants["friction"] * h)
    return LedgerRow(
        f"{integrator.name}, {scenario.name}: the conformal symplectic structure is kept", AUTHORS,
        "the area of (q, p) shrinks by one factor", f"spread {spread:.1e}; factor exp(-{decay:.6f} friction h)",
        spread <= EXACT, command(integrator, scenario, "literature"),
        "Determinants of the step at three states; friction is linear in p.",
    )  # fmt: skip


def tabulate(records: Sequence[Row]) -> Tables:
    """`literature`: one row a statement, by whom; `literature_errors`: the errors at every step."""
    claims = spread(records, "findings", "points", "failure", failed=not_measured)
    for row in claims:
        row["stated_by"] = stated = row.get("section", "")
        row["section"] = "abstract, section 4" * (stated == AUTHORS)
    points = spread(records, "points", "findings", "failure")
    return {table.name: table_of(rows, table, by=()) for table, rows in ((LITERATURE, claims), (POINTS, points))}


STUDY = Study(
    name="literature",
    place=45,
    description="what later authors state of their methods, measured as they do: orders, errors at ten steps",
    tables=(LITERATURE, POINTS),
    plan=plan,
    measure=measure,
    tabulate=tabulate,
    scenarios=SCENARIOS,
)
