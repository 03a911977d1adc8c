"""What the page shows of the judged table: a row a method, one number a cell for each lens, and every failure."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

from ..chart import Tables
from ..errors import LOUD
from ..runner.declared import FAMILIES as DECLARED
from ..studies.base import own_tables
from .judged import NUMBERS, PAIR, is_finite, ladder_runs, laws, settings
from .summary import is_claimed

if TYPE_CHECKING:
    from pandas import DataFrame

UNKNOWN = "not declared in this folder"
LEDGERS = ("claims", "literature", "literature_errors")  # statements: what only they name has no number in any lens
FAMILIES = (*DECLARED, UNKNOWN)


def names(tables: Tables, column: str) -> list[str]:
    """The methods or scenarios of all tables, sorted; those that only ledgers name where a run has nothing else."""
    measured = [table for name, table in tables.items() if name not in LEDGERS]
    chosen = measured if any(column in table for table in measured) else tables.values()
    return sorted({str(v) for t in chosen if column in t for v in t[column].dropna().unique()})


def families(tables: Tables, declared: Tables) -> dict[str, str]:
    """Method -> its family: declared, else whether work_precision says that it is another package's solver."""
    told, table, peers = declared.get("integrators", {}), tables.get("work_precision"), set()
    if table is not None and "peer" in table:
        peers = set(table.loc[table["peer"].fillna("").astype(str).ne(""), "integrator"].astype(str))
    return {
        name: told.get(name, {}).get("family") or (FAMILIES[3] if name in peers else UNKNOWN)
        for name in names(tables, "integrator")
    }


def methods(found: DataFrame, tables: Tables, declared: Tables) -> list[dict[str, Any]]:
    """One row a method: its family, laws, order, stable step, and how many of its ladder runs failed."""
    told = declared.get("integrators", {})
    pairs = {name: rows.droplevel("integrator") for name, rows in found.groupby(level="integrator")}
    rows = []
    for name, family in families(tables, declared).items():
        facts, mine = told.get(name, {}), pairs.get(name, found.iloc[:0])
        failed, runs = (int(mine[c].sum()) if c in mine else 0 for c in ("failed", "runs"))
        rows.append({
            "name": name, "family": FAMILIES.index(family) if family in FAMILIES else len(FAMILIES) - 1,
            "source": facts.get("source", ""), "kind": facts.get("kind", ""), "laws": _laws(mine, facts),
            "order": _order(mine, facts.get("order")), "step": _step(mine), "failed": failed, "runs": runs,
        })  # fmt: skip
    return rows


def _laws(mine: DataFrame, facts: Mapping[str, Any]) -> list[dict[str, Any]]:
    """In how many of the runs a law was kept, of those whose system has it, and the worst of them; none of 0 where it
    was never measured."""
    found: list[dict[str, Any]] = []
    for law in laws(mine):
        claimed = is_claimed(law, facts["claims"]) if "claims" in facts else None
        found.append({"law": law, "claimed": claimed, "kept": int(mine[f"kept_{law}"].sum()),
                      "of": int(mine[f"of_{law}"].sum())})  # fmt: skip
        if len(lost := mine[f"worst_{law}"].dropna()):
            where = str(lost.idxmax())
            found[-1] |= {"worst": float(lost.max()), "where": f"{where}, {mine.loc[where, f'at_{law}']}"}
    return found


def _order(mine: DataFrame, declared: Any) -> dict[str, Any] | None:
    """The fitted orders: median, least, largest, of how many scenarios."""
    if "fits" not in mine or mine["fits"].isna().all():
        return None
    orders = mine["order"].dropna()
    if not len(orders):
        return {"median": None, "low": None, "high": None, "of": 0, "declared": declared}
    low, high = float(orders.min()), float(orders.max())
    return {"median": float(orders.median()), "low": low, "high": high, "of": len(orders), "declared": declared}


def _step(mine: DataFrame) -> dict[str, Any] | None:
    """The least of the largest stable steps over the scenarios, and on how many there is a limit."""
    if "step" not in mine or mine["step"].isna().all():
        return None
    known = mine[mine["limit"].notna()]
    stable = known.loc[known["limit"].ne("none"), "dt_stable"].fillna(0.0)
    if len(stable):
        least, where = float(stable.min()), str(stable.idxmin())
        return {"least": least, "where": where, "limited": len(stable), "of": len(known)}
    cap = float(known["dt_cap"].min())
    return {"least": None, "where": "", "limited": 0, "of": len(known), "cap": cap if is_finite(cap) else None}


def lenses(found: DataFrame) -> list[dict[str, Any]]:
    """What a cell may show: {key, cells: {method: {scenario: number, or None where it was not reached}}}."""
    return [{"key": key, "cells": of} for key in NUMBERS if key in found and (of := cells(found, key))]


def cells(found: DataFrame, key: str) -> dict[str, dict[str, Any]]:
    """One of NUMBERS by method and scenario; of steps ["none", cap] where no limit was found up to the cap."""
    chosen: dict[str, dict[str, Any]] = {}
    for (method, scenario), value in found[key].dropna().items():
        shown: Any = float(value) if math.isfinite(value) else None
        if key == "step" and (row := found.loc[(method, scenario)])["limit"] == "none":
            shown = ["none", float(row["dt_cap"]) if is_finite(row["dt_cap"]) else shown]
        chosen.setdefault(method, {})[scenario] = shown
    return chosen


def stopped(tables: Tables) -> dict[str, dict[str, str]]:
    """{method: {scenario: why}} of the ladders of work_precision that ended before every accuracy was reached."""
    from ..studies.work_precision import REACHED

    found: dict[str, dict[str, str]] = {}
    table = tables.get("work_precision")
    if table is not None and "left_out" in table:
        for row in table[table["left_out"].notna()].to_dict("records"):
            if str(row["left_out"]) and not str(row["left_out"]).endswith(REACHED):
                found.setdefault(str(row["integrator"]), {})[str(row["scenario"])] = str(row["left_out"])
    return found


class Unmeasured(NamedTuple):
    """A cell of another study than those of the ladders that ended without a result; of a plugin's those of a method on
    a scenario together, how many they are and of how many."""

    study: str
    integrator: str
    scenario: str
    why: str
    failed: int = 1
    runs: int = 1

    @property
    def sentence(self) -> str:
        """What is missing, and why."""
        return f"{self.study} of {self.integrator} on {self.scenario}: {self.why}"


def unmeasured(tables: Tables) -> list[Unmeasured]:
    """The cells that ended as exception, crash or timeout, in studies whose tables have one row or few a cell, and in
    those of plugins."""
    found: dict[tuple[str, str, str], Unmeasured] = {}
    brought = [name for name, table in tables.items() if name not in own_tables() and {*PAIR}.issubset(table)]
    for study in ("convergence", "equilibrium_summary", "stability", *brought):
        table = tables.get(study)
        if table is None or "status" not in table:
            continue
        for row in table[table["status"].isin(LOUD)].to_dict("records"):
            said = [row.get(name) for name in ("failure", "note")]
            why = next((str(text) for text in said if isinstance(text, str) and text), str(row["status"]))
            item = Unmeasured(study.removesuffix("_summary"), str(row["integrator"]), str(row["scenario"]), why)
            if study in brought and item[:3] not in found:
                rows = table.loc[(table[PAIR] == [row[name] for name in PAIR]).all(axis=1), "status"]
                item = item._replace(failed=int(rows.isin(LOUD).sum()), runs=len(rows))
            found.setdefault(item[:3], item)
    return list(found.values())


def failures(tables: Tables, longest: int = 300) -> dict[str, dict[str, Any]]:
    """{method: {scenario: [failed, runs, sentence of the failed run at the smallest step or tolerance]}} of the
    ladders, and of what other studies could not measure."""
    found: dict[str, dict[str, list[Any]]] = {}
    ladders = ladder_runs(tables)
    for row in ladders.assign(at=settings(ladders)).to_dict("records"):
        cell = found.setdefault(str(row["integrator"]), {}).setdefault(str(row["scenario"]), [0, 0, "", math.inf])
        cell[1] += 1
        if row["status"] == "ok":
            continue
        cell[0] += 1
        size = next((float(row[name]) for name in ("dt", "tolerance") if is_finite(row[name])), math.inf)
        if not cell[2] or size < cell[3]:
            text = row["failure"]
            said = text if isinstance(text, str) and text else str(row["status"])
            cell[2], cell[3] = ": ".join(filter(None, (row["at"], said[:longest]))), size
    for item in unmeasured(tables):
        cell = found.setdefault(item.integrator, {}).setdefault(item.scenario, [0, 0, "", math.inf])
        cell[:3] = [cell[0] + item.failed, cell[1] + item.runs, cell[2] or item.sentence[:longest]]
    return {m: {s: c[:3] for s, c in cells.items() if c[0]} for m, cells in found.items() if any(
        c[0] for c in cells.values())}  # fmt: skip
