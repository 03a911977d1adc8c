"""Which chart needs which tables: what `tcbench plot` and the report have in common."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

from ..errors import TcbenchError, unknown_name

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame

    from ..simulation.trajectory import Trajectory

Tables = Mapping[str, Any]
SERIES = "series"  # trajectories in time, simulated again: runs do not keep them
OPENING = "opening"  # their first steps, every one of them: a path of every twentieth state is no path
POINTS = 180  # recorded states of a trajectory that a chart needs
PATIENCE = 2.0  # seconds that a run to be simulated again may have taken


@dataclass(frozen=True)
class Kind:
    """One kind of chart.

    needs : tables that must be there, the first one is what the chart shows; also : tables used where they are there.
    draw : tables (of one scenario, if by_scenario) -> Figure. study : where the report puts it.
    """

    name: str
    study: str
    text: str
    needs: tuple[str, ...]
    draw: Callable[..., Figure]
    also: tuple[str, ...] = ()
    by_scenario: bool = True

    def possible(self, tables: Tables) -> bool:
        return all(name in tables and len(tables[name]) for name in self.needs)

    def select(self, tables: Tables, scenario: str | None) -> dict[str, DataFrame]:
        """The tables that this chart draws, of one scenario."""
        chosen = {name: tables[name] for name in (*self.needs, *self.also) if name in tables}
        return {name: of_scenario(table, scenario) for name, table in chosen.items()}

    def worth(self, chosen: Tables) -> bool:
        """Is there anything to see? Blow-up times of runs that all reached the end are none."""
        if self.name != "blowup":
            return True
        rows = chosen[self.needs[0]]
        failed = rows["status"].ne("ok")
        return bool((failed & rows["solver"].ne("plain") if "solver" in rows else failed).any())

    def scenarios(self, tables: Tables) -> list[str | None]:
        """The scenarios that it can be drawn for; [None] for a chart of all together."""
        table = tables[self.needs[0]]
        if not self.by_scenario or "scenario" not in table:
            return [None]
        return [str(name) for name in dict.fromkeys(table["scenario"].dropna())]


def of_scenario(table: DataFrame, scenario: str | None) -> DataFrame:
    if scenario is None or "scenario" not in table:
        return table
    return table[table["scenario"].astype(str) == scenario]


@cache
def kinds() -> dict[str, Kind]:
    """Every kind of chart by name."""
    from .charts import ladders, precision, runs

    found = [
        Kind("work-precision", "work_precision", "Error against cost; one panel an error.", ("work_precision",),
             lambda t, **options: precision.work_precision(t["work_precision"], **options)),
        Kind("convergence", "convergence", "Error against step size; the number at a line's end is its fitted order.",
             ("convergence_points",), lambda t: precision.convergence(t["convergence_points"], t.get("convergence")),
             ("convergence",)),
        Kind("conservation", "conservation", "Largest losses of a run against its step size.", ("conservation",),
             lambda t, **options: ladders.conservation(t["conservation"], **options)),
        Kind("laws", "conservation", "Losses in time, at the scenario's own step; on the 0 a law is kept exactly.",
             (SERIES,), lambda t: runs.laws(t[SERIES])),
        Kind("four-panel", "conservation", "Energy, entropy, temperatures and strains in time, as in the paper.",
             (SERIES,), lambda t: runs.four_panel(t[SERIES])),
        Kind("path", "conservation", f"Paths of the masses in the plane over the first {POINTS} steps, coloured by "
             "temperature.", (OPENING,), lambda t: runs.path(t[OPENING])),
        Kind("stable-step", "stability", "Largest stable step, by kind of limit.", ("stability",),
             lambda t: ladders.stable_step(t["stability"]), by_scenario=False),
        Kind("blowup", "stability", "Time at which a run failed, against its step size.", ("stability_points",),
             lambda t: ladders.blowup(t["stability_points"], t.get("blowup_sensitivity")), ("blowup_sensitivity",)),
        Kind("map", "stability", "How runs end in a plane of two parameters.", ("map",), _stability_map),
        Kind("equilibrium", "equilibrium", "Distance to the exact relative equilibrium in time.", ("equilibrium",),
             lambda t: runs.equilibrium(t["equilibrium"], t.get("equilibrium_summary")), ("equilibrium_summary",)),
    ]  # fmt: skip
    return {kind.name: kind for kind in found}


def _stability_map(tables: Tables) -> Figure:
    from .charts.stability_map import map_figure

    return map_figure(tables["map"])


def find_kind(name: str) -> Kind:
    if name not in kinds():
        raise unknown_name("chart", name, kinds())
    return kinds()[name]


def with_fallbacks(tables: Tables) -> dict[str, Any]:
    """Tables that can stand in for absent ones: blow-up times of the conservation study."""
    known = dict(tables)
    if "stability_points" not in known and "conservation" in known:
        rows = known["conservation"]
        if "status" in rows and rows["status"].ne("ok").any():
            known["stability_points"] = rows[rows["dt"].notna()] if "dt" in rows else rows
    return known


def replay(tables: Tables, scenarios: Iterable[str] | None = None, dt: float | None = None) -> dict[str, DataFrame]:
    """Trajectories of the conservation study's runs at each scenario's own step, simulated again, where they can be.

    Only what is repeated quickly: integrators that are installed, scenarios with the data that the rows were measured
    with, and runs that neither crashed nor hung nor took long.
    """
    from . import trajectory_table as series

    rows = tables.get("conservation")
    if rows is None or not len(rows) or "dt" not in rows:
        return {}
    wanted = None if scenarios is None else set(scenarios)
    found: dict[str, list[Trajectory]] = {SERIES: [], OPENING: []}
    for (integrator, scenario), part in rows.groupby(["integrator", "scenario"], sort=False):
        if wanted is None or scenario in wanted:
            for name, run in _again(str(integrator), str(scenario), part, dt).items():
                found[name].append(run)
    return {name: series.trajectories(runs) for name, runs in found.items() if runs}


def _again(integrator: str, name: str, rows: DataFrame, dt: float | None) -> dict[str, Trajectory]:
    import numpy as np

    from .. import plugins
    from ..simulation.run import simulate

    try:
        method, scenario = plugins.find_integrator(integrator), plugins.find_scenario(name)
    except TcbenchError:
        return {}
    step = scenario.dt if dt is None else dt
    near = rows[np.isclose(rows["dt"].astype(float), step, rtol=1e-9)]
    if method.kind == "adaptive" or not len(near):
        return {}
    row = near.iloc[-1]
    other = bool(row.get("scenario_hash")) and row["scenario_hash"] != scenario.hash  # the name means other data by now
    if other or row["status"] in ("crash", "timeout", "exception", "skipped"):
        return {}
    cost = float(row.get("us_per_step", 0.0)) * scenario.steps(step) / 1e6
    if not cost < PATIENCE:
        return {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        whole = simulate(method, scenario, step, record_every=max(1, scenario.steps(step) // POINTS))
        if scenario.steps(step) < 2 * POINTS:
            return {SERIES: whole, OPENING: whole}
        return {SERIES: whole, OPENING: simulate(method, scenario, step, t_end=POINTS * step)}
