"""Which chart needs which tables: what `tcbench plot` and the report have in common."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

from ..errors import unknown_name

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame

Tables = Mapping[str, Any]
SERIES = "series"  # runs in time, thin, as rows of the conservation study keep them
OPENING = "opening"  # their first steps, every one of them


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
        Kind("path", "conservation", "Paths of the masses in the plane over the first steps, coloured by temperature.",
             (OPENING,), lambda t: runs.path(t[OPENING])),
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
