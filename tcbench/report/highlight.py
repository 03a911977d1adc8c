"""Who is drawn in colour where many methods ran: the best of each family. Pictures and the page ask this."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ..chart import Tables
from .page_data import FAMILIES, families, names
from .pairs import TIMES, pairs, to_numbers

if TYPE_CHECKING:
    from pandas import DataFrame

CROWD = 8  # so many methods are all in colour
IN_COLOUR = 5  # of more: as many of each family as make this number, one at least
TARGETS = [key for key, (measure, _) in TIMES.items() if measure == "error"][::-1]  # the smallest error first


def leaders(tables: Tables, declared: Tables, results: DataFrame | None = None) -> dict[str, list[str]]:
    """Scenario -> of each family the methods that reach the smallest error (1e-9, 1e-6, 1e-3, else their least), the
    fastest first; without errors those that fail least and keep the energy best. Under "" those that are it on most
    scenarios. All methods of a run that has no more than a few. results : the table of `pairs`, if there is one."""
    family_of = families(tables, declared)
    if len(family_of) <= CROWD:
        return dict.fromkeys([*names(tables, "scenario"), ""], sorted(family_of))
    ranks = _ranks(tables, pairs(tables, declared) if results is None else results)
    scenarios, last = names(tables, "scenario"), (math.inf,)
    of = {s: front(family_of, {m: ranks.get((m, s), last) for m in family_of}) for s in scenarios}
    firsts = {name: (-sum(name in front for front in of.values()), name) for name in family_of}
    return of | {"": front(family_of, firsts)}


def front(family_of: Mapping[str, str], rank: Mapping[str, Any]) -> list[str]:
    """Who is in colour, in every chart: all of a few methods; of more the first of each family by a rank."""
    if len(family_of) <= CROWD:
        return sorted(family_of)
    kinds = dict.fromkeys([*FAMILIES, *family_of.values()])
    of = [sorted((n for n in family_of if family_of[n] == kind), key=lambda n: (rank[n], n)) for kind in kinds]
    ran = [members for members in of if members]
    each = -(-IN_COLOUR // len(ran))
    return [name for members in ran for name in members[:each]]


def _ranks(tables: Tables, results: DataFrame) -> dict[Any, tuple[float, ...]]:
    """(method, scenario) -> its times to the targets, the smallest error first, infinite where it missed one, and its
    least error; without errors how many of its runs failed, and the most energy that one lost."""
    rank = results.reindex(columns=[*TARGETS, "least"])
    work, ladder = tables.get("work_precision"), tables.get("conservation")
    if work is not None and "error" in work:
        done = work[work["status"].eq("ok")]
        rank["least"] = to_numbers(done, "error").groupby([done[c].astype(str) for c in results.index.names]).min()
    elif not set(TARGETS) & set(results) and ladder is not None:
        rank["least"] = to_numbers(ladder, "energy_error_max").groupby([ladder[c] for c in results.index.names]).max()
        rank[TARGETS[0]] = results["ladder_failed"] * 1.0
    return dict(zip(rank.index, rank.fillna(math.inf).itertuples(index=False, name=None), strict=True))
