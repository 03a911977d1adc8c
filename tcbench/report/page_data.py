"""What the page shows of the table of pairs: a row a method, one number a cell for each lens, and every failure."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

from ..chart import Tables
from ..errors import LOUD
from ..runner.declared import FAMILIES as DECLARED
from ..runner.declared import LAWS
from ..studies.base import table_owners
from .pairs import NUMBERS, PAIR, is_kept, ladder_runs, law_columns, laws, losses, settings, to_numbers
from .verdicts import is_claimed
from .words import is_finite

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
    """Method -> its family: declared, else whether work_precision says that it is another package's solver.

    One that is declared consistent and was measured not to be is of "other structure".
    """
    facts, peers, lost = declared.get("integrators", {}), set[str](), set[str]()
    if (work := tables.get("work_precision")) is not None and "peer" in work:
        peers = {*work.loc[work["peer"].fillna("").ne(""), "integrator"].astype(str)}
    if (table := tables.get("conservation")) is not None:  # what lost energy or entropy on its completed steps
        done = to_numbers(table, "steps") > 0 if "steps" in table else table["status"].eq("ok")
        for law in LAWS & law_columns(table).keys():
            values = losses(table, law).where(done)
            lost |= {*table.loc[values.notna() & ~is_kept(law, values), "integrator"].astype(str)}
    family_of = {
        name: facts.get(name, {}).get("family") or (FAMILIES[3] if name in peers else UNKNOWN)
        for name in names(tables, "integrator")
    }
    return {n: FAMILIES[2] if family == FAMILIES[1] and n in lost else family for n, family in family_of.items()}


def methods(results: DataFrame, tables: Tables, declared: Tables) -> list[dict[str, Any]]:
    """One row a method: its family, laws, order, stable step, and how many of its ladder runs failed."""
    facts_of = declared.get("integrators", {})
    of_method = {name: rows.droplevel("integrator") for name, rows in results.groupby(level="integrator")}
    rows = []
    for name, family in families(tables, declared).items():
        facts, mine = facts_of.get(name, {}), of_method.get(name, results.iloc[:0])
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
    rows: list[dict[str, Any]] = []
    for law in laws(mine):
        claimed = is_claimed(law, facts["claims"]) if "claims" in facts else None
        kept, runs = (int(mine[f"{count}_{law}"].sum()) for count in ("kept", "of"))
        rows.append({"law": law, "claimed": claimed, "kept": kept, "of": runs})
        if len(lost := mine[f"worst_{law}"].dropna()):
            where = str(lost.idxmax())
            rows[-1] |= {"worst": float(lost.max()), "where": f"{where}, {mine.loc[where, f'at_{law}']}"}
    return rows


def law_dots(results: DataFrame, declared: Tables) -> dict[str, dict[str, list[Any]]]:
    """{scenario: {method: [[law, runs that kept it, runs of it, claimed]]}}, of the laws that the system has."""
    facts, dots = declared.get("integrators", {}), dict[str, dict[str, list[Any]]]()
    for (method, scenario), row in results.iterrows():
        claims = facts.get(method, {}).get("claims")
        of = [[law, int(row[f"kept_{law}"]), int(row[f"of_{law}"]), claims is None or is_claimed(law, claims)]
              for law in laws(results) if row[f"of_{law}"] > 0]  # fmt: skip
        if of:
            dots.setdefault(scenario, {})[method] = of
    return dots


def telling(results: DataFrame) -> str:
    """The scenario that separates the methods: that on which most of them fail; the first of several."""
    fails = results["fails"].groupby(level="scenario").sum() if "fails" in results else results.iloc[:0].sum(axis=1)
    return str(fails.idxmax()) if len(fails) else ""


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
    searched = mine[mine["limit"].notna()]
    stable = searched.loc[searched["limit"].ne("none"), "dt_stable"].fillna(0.0)
    if len(stable):
        smallest, where = float(stable.min()), str(stable.idxmin())
        return {"least": smallest, "where": where, "limited": len(stable), "of": len(searched)}
    cap = float(searched["dt_cap"].min())
    return {"least": None, "where": "", "limited": 0, "of": len(searched), "cap": cap if is_finite(cap) else None}


def lenses(results: DataFrame) -> list[dict[str, Any]]:
    """What a cell may show: {key, cells: {method: {scenario: number, or None where it was not reached}}, order}."""
    shown = [key for key in NUMBERS if key in results]
    return [{"key": key, "cells": of, "order": order(results, key)} for key in shown if (of := cells(results, key))]


def order(results: DataFrame, key: str) -> list[str]:
    """The methods, the best first: fewest scenarios without the number, then the least mean of its logarithm over the
    best of each scenario; of steps, of which large ones are better, the other way round. What is not reached counts as
    infinite."""
    import numpy as np

    values = results[key].fillna(np.inf)
    if key == "step":
        free = results["limit"].eq("none")
        values = 1 / results["dt_cap"].where(free, values).where(values.ne(np.inf) | free, 0.0)
    values = values.clip(lower=1e-300)
    best = values.groupby(level="scenario").transform("min")
    ratios = np.log(values / best).where(best.ne(np.inf), 0.0)
    reached = np.isfinite(ratios)
    of = ratios.where(reached).groupby(level="integrator").mean().fillna(np.inf)
    missing = (~reached).groupby(level="integrator").sum()
    missing += results.index.get_level_values("scenario").nunique() - reached.groupby(level="integrator").size()
    return sorted(map(str, of.index), key=lambda name: (missing[name], of[name], name))


def cells(results: DataFrame, key: str) -> dict[str, dict[str, Any]]:
    """One of NUMBERS by method and scenario; of steps ["none", cap] where no limit was found up to the cap."""
    chosen: dict[str, dict[str, Any]] = {}
    for (method, scenario), value in results[key].dropna().items():
        shown: Any = float(value) if math.isfinite(value) else None
        if key == "step" and (row := results.loc[(method, scenario)])["limit"] == "none":
            shown = ["none", float(row["dt_cap"]) if is_finite(row["dt_cap"]) else shown]
        chosen.setdefault(method, {})[scenario] = shown
    return chosen


def stopped(tables: Tables) -> dict[str, dict[str, str]]:
    """{method: {scenario: why}} of the ladders of work_precision that ended before every accuracy was reached."""
    from ..studies.work_precision import REACHED

    table, reasons = tables.get("work_precision"), dict[str, dict[str, str]]()
    if table is not None and "left_out" in table:
        for method, scenario, why in table.loc[table["left_out"].notna(), [*PAIR, "left_out"]].astype(str).to_numpy():
            if why and not why.endswith(REACHED):
                reasons.setdefault(method, {})[scenario] = why
    return reasons


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
    def where(self) -> str:
        return f"{self.integrator} on {self.scenario}"

    @property
    def sentence(self) -> str:
        """What is missing, and why."""
        return f"{self.study} of {self.where}: {self.why}"


def unmeasured(tables: Tables) -> list[Unmeasured]:
    """The cells that ended as exception, crash or timeout, in studies whose tables have one row or few a cell, and in
    those of plugins."""
    cases = []
    brought = [name for name, table in tables.items() if name not in table_owners() and {*PAIR}.issubset(table)]
    for study in ("convergence", "equilibrium_summary", "stability", *brought):
        table = tables.get(study)
        if table is None or "status" not in table:
            continue
        said = table.reindex(columns=["failure", "note", "status"]).map(lambda v: (isinstance(v, str) and v) or None)
        rows = table[PAIR].assign(why=said.bfill(axis=1)["failure"], loud=table["status"].isin(LOUD), runs=1)
        for (method, scenario), of in rows[rows["loud"]].groupby(PAIR, sort=False):
            mine = (rows[PAIR] == [method, scenario]).all(axis=1).sum()
            counts = (len(of), int(mine)) if study in brought else ()
            name = study.removesuffix("_summary")
            cases.append(Unmeasured(name, str(method), str(scenario), str(of["why"].iloc[0]), *counts))
    return cases


def failures(tables: Tables, longest: int = 300) -> dict[str, dict[str, Any]]:
    """{method: {scenario: [failed, runs, sentence of the failed run at the smallest step or tolerance, {mark: runs}]}}
    of the ladders, with those on which only the entropy fell, and of what other studies could not measure."""
    ladders = ladder_runs(tables)
    runs, cells_of = ladders.groupby(PAIR).size(), dict[str, dict[str, list[Any]]]()
    size = ladders["dt"].fillna(ladders["tolerance"]).fillna(math.inf)
    rows = ladders.assign(at=settings(ladders), bad=ladders["status"].ne("ok"), size=size)
    rows = rows[rows["mark"].ne("")].sort_values(["bad", "size"], ascending=[False, True], kind="stable")
    for pair, of in rows.groupby(PAIR):
        method, scenario = pair
        first, text = of.iloc[0], of["failure"].iloc[0]
        text = text if isinstance(text, str) and text else str(first["status"])
        said = text[:longest] if first["bad"] else "the entropy fell, in a run that reached its end"
        cell = [int(of["bad"].sum()), int(runs[pair]), ": ".join(filter(None, (first["at"], said)))]
        cells_of.setdefault(str(method), {})[str(scenario)] = [*cell, of["mark"].value_counts().to_dict()]
    for item in unmeasured(tables):
        here = int(runs.get((item.integrator, item.scenario), 0))
        of_method, none = cells_of.setdefault(item.integrator, {}), list[Any]([0, here, "", {}])
        failed, every, text, marks = of_method.get(item.scenario, none)
        marks["x"] = marks.get("x", 0) + item.failed
        said = text or item.sentence[:longest]
        of_method[item.scenario] = [failed + item.failed, every + item.runs, said, marks]
    return cells_of
