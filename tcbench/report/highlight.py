"""Who is drawn in colour where many methods ran: the best of each family. Pictures and the page ask this."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ..chart import Tables
from .page_data import FAMILIES, families, names
from .pairs import is_finite, to_numbers

if TYPE_CHECKING:
    from pandas import DataFrame

CROWD = 8  # so many methods are all in colour
IN_COLOUR = 5  # of more: as many of each family as make this number, one at least
TARGETS = (1e-9, 1e-6, 1e-3)


def leaders(tables: Tables, declared: Tables) -> dict[str, list[str]]:
    """Scenario -> of each family the methods that reach the smallest error (1e-9, 1e-6, 1e-3, else their least), the
    fastest first; without errors those that fail least and keep the energy best. Under "" those that are it on most
    scenarios. All methods of a run that has no more than a few."""
    known = families(tables, declared)
    scenarios = names(tables, "scenario")
    ranks = {scenario: _ranks(tables, scenario) for scenario in scenarios}
    worst = (len(TARGETS), math.inf, math.inf)
    found = {
        scenario: front(known, {name: rank.get(name, worst) for name in known}) for scenario, rank in ranks.items()
    }
    firsts = {name: (-sum(name in of for of in found.values()), name) for name in known}
    return found | {"": front(known, firsts)}


def front(known: Mapping[str, str], rank: Mapping[str, Any]) -> list[str]:
    """Who is in colour, in every chart: all of a few methods; of more the first of each family by a rank."""
    if len(known) <= CROWD:
        return sorted(known)
    kinds = dict.fromkeys([*FAMILIES, *known.values()])
    of = {family: sorted((n for n in known if known[n] == family), key=lambda n: (rank[n], n)) for family in kinds}
    there = [members for members in of.values() if members]
    each = -(-IN_COLOUR // len(there))
    return [name for members in there for name in members[:each]]


def _ranks(tables: Tables, scenario: str) -> dict[str, tuple[float, float, float]]:
    """Method -> (how many targets it missed, its time to the last that it reached, its least error)."""
    found: dict[str, tuple[float, float, float]] = {}
    least: dict[str, float] = {}
    table = _of(tables.get("work_precision"), scenario)
    if table is not None and "error" in table:
        done = table[table["status"].eq("ok")]
        least = dict(to_numbers(done, "error").groupby(done["integrator"].astype(str)).min().dropna())
        found = {name: (len(TARGETS), math.inf, error) for name, error in least.items()}
    times, ladder = _of(tables.get("time_to_accuracy"), scenario), _of(tables.get("conservation"), scenario)
    if times is not None:
        for row in times[times["measure"].eq("error")].to_dict("records"):
            name, missed = str(row["integrator"]), sum(target < 0.5 * row["target"] for target in TARGETS)
            if is_finite(row["time_s"]):
                rank = (missed, float(row["time_s"]), least.get(name, math.inf))
                found[name] = min(rank, found.get(name, rank))
    if not found and ladder is not None and len(ladder):
        lost = to_numbers(ladder, "energy_error_max").groupby(ladder["integrator"].astype(str)).max()
        failed = ladder["status"].ne("ok").groupby(ladder["integrator"].astype(str)).sum()
        found = {str(name): (0.0, float(failed[name]), float(lost[name])) for name in lost.index}
    return found


def _of(table: DataFrame | None, scenario: str) -> DataFrame | None:
    return None if table is None else table[table["scenario"].astype(str) == scenario]
