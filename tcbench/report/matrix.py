"""Methods x scenarios: what each method keeps, its order, its step, and one number a cell for each lens."""

from __future__ import annotations

import math
from collections.abc import Mapping
from statistics import median
from typing import TYPE_CHECKING, Any, NamedTuple

from ..progress import LOUD
from .summary import KEPT

if TYPE_CHECKING:
    from pandas import DataFrame

Tables = Mapping[str, Any]
LAWS = {"energy": "energy_error_max", "entropy": "second_law_violations"}
ERROR = "_error_max"  # ends the column of an invariant's largest error
UNKNOWN = "not declared in this folder"
LEDGERS = ("claims", "literature", "literature_errors")  # statements: what only they name has no number in any lens
FAMILIES = ("Romero (2009)", "consistent, beyond the paper", "other structure", "peers", UNKNOWN)
TIMES = (("time 0.001", "error", 1e-3), ("time 1e-06", "error", 1e-6), ("time 1e-09", "error", 1e-9),
         ("time energy 1e-12", "energy_error_max", 1e-12))  # fmt: skip


def finite(value: Any) -> bool:
    try:
        return math.isfinite(float(value))
    except (TypeError, ValueError):
        return False


def to_numbers(table: DataFrame, column: str) -> Any:
    """A column as floats; NaN where the table has none."""
    import pandas as pd

    return pd.to_numeric(table[column] if column in table else pd.Series(math.nan, table.index), errors="coerce")


def is_fixed(row: Mapping[str, Any]) -> bool:
    """Whether a row of `work_precision` is a run with a fixed step."""
    return row.get("control") == "dt"


def names(tables: Tables, column: str) -> list[str]:
    """The methods or scenarios of all tables, sorted; those that only ledgers name where a run has nothing else."""
    measured = [table for name, table in tables.items() if name not in LEDGERS]
    chosen = measured if any(column in table for table in measured) else tables.values()
    return sorted({str(v) for t in chosen if column in t for v in t[column].dropna().unique()})


def law_columns(table: DataFrame) -> dict[str, str]:
    """Law -> column of `conservation`: energy, entropy, and each invariant that some system of the run has."""
    there = {law: column for law, column in LAWS.items() if column in table}
    others = [c for c in table if str(c).endswith(ERROR) and c not in LAWS.values()]
    return there | {str(c).removesuffix(ERROR): str(c) for c in others if table[c].notna().any()}


def laws_kept(rows: DataFrame, law: str, column: str) -> Any:
    """True, False or None of each run: None where the system has no such law or no step was completed."""
    import pandas as pd

    values = pd.to_numeric(rows[column], errors="coerce")
    kept = (values <= (0 if law == "entropy" else KEPT)).astype(object)
    done = rows["steps"].astype(float) > 0 if "steps" in rows else True
    return kept.where(values.notna() & done, None)


def methods(tables: Tables, declared: Tables) -> list[dict[str, Any]]:
    """One row a method: its family, laws, order, stable step, and how many of its ladder runs failed."""
    told = declared.get("integrators", {})
    solvers = peers(tables)
    rows = []
    for name in names(tables, "integrator"):
        facts = told.get(name, {})
        family = facts.get("family") or (FAMILIES[3] if name in solvers else UNKNOWN)
        failed, runs = _failed(tables, name)
        rows.append({
            "name": name, "family": FAMILIES.index(family) if family in FAMILIES else len(FAMILIES) - 1,
            "source": facts.get("source", ""), "kind": facts.get("kind", ""), "laws": _laws(tables, name, facts),
            "order": _order(tables, name, facts.get("order")), "step": _step(tables, name),
            "failed": failed, "runs": runs,
        })  # fmt: skip
    return rows


def peers(tables: Tables) -> set[str]:
    """The methods of which work_precision says that they are other packages' solvers."""
    table = tables.get("work_precision")
    if table is None or "peer" not in table:
        return set()
    return set(table.loc[table["peer"].fillna("").astype(str).ne(""), "integrator"].astype(str))


def _mine(tables: Tables, table: str, name: str) -> DataFrame | None:
    found = tables.get(table)
    rows = None if found is None else found[found["integrator"].astype(str) == name]
    return None if rows is None or not len(rows) else rows


def _laws(tables: Tables, name: str, facts: Mapping[str, Any]) -> list[dict[str, Any]]:
    """In how many of the runs a law was kept, of those whose system has it; none of 0 where it was never measured."""
    table = tables.get("conservation")
    if table is None:
        return []
    rows, found = _mine(tables, "conservation", name), []
    for law, column in law_columns(table).items():
        judged = [] if rows is None else [k for k in laws_kept(rows, law, column) if k is not None]
        claimed = law in facts["claims"] if "claims" in facts else None
        found.append({"law": law, "claimed": claimed, "kept": sum(map(bool, judged)), "of": len(judged)})
    return found


def _order(tables: Tables, name: str, declared: Any) -> dict[str, Any] | None:
    """The fitted orders of the whole state: median, least, largest, of how many scenarios."""
    rows = _mine(tables, "convergence", name)
    if rows is None:
        return None
    whole = rows[rows["variable"].astype(str) == "all"]
    orders = [float(v) for v in (whole if len(whole) else rows)["order"] if finite(v)]
    if not orders:
        return {"median": None, "low": None, "high": None, "of": 0, "declared": declared}
    return {
        "median": median(orders), "low": min(orders), "high": max(orders), "of": len(orders), "declared": declared,
    }  # fmt: skip


def _step(tables: Tables, name: str) -> dict[str, Any] | None:
    """The least of the largest stable steps over the scenarios, and on how many there is a limit."""
    rows = _mine(tables, "stability", name)
    if rows is None:
        return None
    limits = rows[rows["limit"].notna()]
    ends = limits[limits["limit"].ne("none")]
    if len(ends):
        stable = [float(v) for v in ends["dt_stable"] if finite(v)]
        worst = min(ends.to_dict("records"), key=lambda r: r["dt_stable"] if finite(r["dt_stable"]) else 0.0)
        least = min(stable) if len(stable) == len(ends) else 0.0
        return {"least": least, "where": str(worst["scenario"]), "limited": len(ends), "of": len(limits)}
    caps = [float(v) for v in limits["dt_cap"] if finite(v)] if "dt_cap" in limits else []
    return {"least": None, "where": "", "limited": 0, "of": len(limits), "cap": min(caps, default=None)}


def _failed(tables: Tables, name: str) -> tuple[int, int]:
    """Failed runs and runs on the ladders of steps and tolerances."""
    parts = [rows for t in ("conservation", "work_precision") if (rows := _mine(tables, t, name)) is not None]
    return sum(int(p["status"].ne("ok").sum()) for p in parts), sum(map(len, parts))


def scenario_dt(declared: Tables, name: str, rows: DataFrame | None = None) -> float | None:
    """The scenario's own step: declared, else the middle one of its ladder in `conservation`."""
    dt = declared.get("scenarios", {}).get(name, {}).get("dt")
    if finite(dt):
        return float(dt)
    steps = sorted({float(h) for h in rows["dt"] if finite(h)}) if rows is not None and "dt" in rows else []
    return steps[len(steps) // 2] if steps else None


def at_own_step(tables: Tables, declared: Tables) -> list[dict[str, Any]]:
    """The rows of `conservation` at each scenario's own step; adaptive solvers have none."""
    table = tables.get("conservation")
    if table is None or "dt" not in table:
        return []
    found: list[dict[str, Any]] = []
    for scenario, rows in table.groupby("scenario", sort=True):
        dt = scenario_dt(declared, str(scenario), rows)
        if dt is not None:
            near = (rows["dt"].astype(float) / dt - 1).abs() < 1e-9
            found += rows[near].to_dict("records")
    return found


def own_steps(tables: Tables, declared: Tables) -> dict[str, dict[str, float]]:
    """Microseconds a step of fixed-step methods by scenario: as timed alone, else beside other cells."""
    table, points = tables.get("cost"), tables.get("work_precision")
    found: dict[str, dict[str, float]] = {}
    if table is not None and points is not None:
        fixed = set(points.loc[points["control"].astype(str) == "dt", "integrator"].astype(str))
        rows = [r for r in table.to_dict("records") if str(r["integrator"]) in fixed]
    else:
        rows = [r for r in at_own_step(tables, declared) if r["status"] == "ok"]
    for row in rows:
        if finite(row.get("us_per_step")):
            found.setdefault(str(row["integrator"]), {})[str(row["scenario"])] = float(row["us_per_step"])
    return found


def lenses(tables: Tables, declared: Tables) -> list[dict[str, Any]]:
    """What a cell may show: {key, cells: {method: {scenario: number, or None where it was not reached}}}."""
    found = [{"key": key, "cells": _times(tables, measure, target)} for key, measure, target in TIMES]
    energy: dict[str, dict[str, float | None]] = {}
    for row in at_own_step(tables, declared):
        value: Any = row.get("energy_error_max")
        ok = row["status"] == "ok" and finite(value)
        energy.setdefault(str(row["integrator"]), {})[str(row["scenario"])] = float(value) if ok else None
    found += [
        {"key": "coarse", "cells": coarse_errors(tables)},
        {"key": "produced", "cells": coarse_errors(tables, "error_entropy_produced")},
        {"key": "energy", "cells": energy},
        {"key": "step", "cells": _stable(tables)},
        {"key": "cost", "cells": own_steps(tables, declared)},
    ]
    return [lens for lens in found if lens["cells"]]


def coarse_errors(tables: Tables, measure: str = "error_theta") -> dict[str, dict[str, float | None]]:
    """An error at the end of the run with the coarsest step of a scenario's ladder, of the temperatures by default;
    None where that run failed. One that the reference's own hides counts as ten times that; a scenario without this
    error is left out."""
    table = tables.get("work_precision")
    cells: dict[str, dict[str, float | None]] = {}
    if table is None or measure not in table:
        return cells
    for scenario, rows in table[table["control"].eq("dt")].groupby("scenario", sort=True):
        steps = to_numbers(rows, "value")
        rows = rows[steps >= (1 - 1e-9) * steps.max()]
        for row in rows.to_dict("records") if to_numbers(rows, measure).notna().any() else ():
            value = row[measure] if finite(row[measure]) else 10 * float(row.get("reference_floor", math.nan))
            ok = row["status"] == "ok" and finite(value)
            cells.setdefault(str(row["integrator"]), {})[str(scenario)] = float(value) if ok else None
    return cells


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


def _times(tables: Tables, measure: str, target: float) -> dict[str, dict[str, float | None]]:
    table = tables.get("time_to_accuracy")
    cells: dict[str, dict[str, float | None]] = {}
    if table is None:
        return cells
    for row in table[table["measure"].eq(measure) & table["target"].eq(target)].to_dict("records"):
        time = float(row["time_s"]) if finite(row["time_s"]) else None
        cells.setdefault(str(row["integrator"]), {})[str(row["scenario"])] = time
    return cells


def _stable(tables: Tables) -> dict[str, dict[str, Any]]:
    """The largest stable step; ["none", cap] where no limit was found up to the cap."""
    cells: dict[str, dict[str, Any]] = {}
    for row in tables["stability"].to_dict("records") if "stability" in tables else ():
        value = float(row["dt_stable"]) if finite(row.get("dt_stable")) else None
        if row.get("limit") == "none":
            value = ["none", float(row["dt_cap"]) if finite(row.get("dt_cap")) else value]  # type: ignore[assignment]
        cells.setdefault(str(row["integrator"]), {})[str(row["scenario"])] = value
    return cells


class Unmeasured(NamedTuple):
    """A cell of another study than those of the ladders that ended without a result."""

    study: str
    integrator: str
    scenario: str
    why: str

    @property
    def sentence(self) -> str:
        """What is missing, and why."""
        return f"{self.study} of {self.integrator} on {self.scenario}: {self.why}"


def unmeasured(tables: Tables) -> list[Unmeasured]:
    """The cells that ended as exception, crash or timeout, in studies whose tables have one row or few a cell."""
    found: dict[tuple[str, str, str], Unmeasured] = {}
    for study in ("convergence", "equilibrium_summary", "stability"):
        table = tables.get(study)
        if table is None or "status" not in table:
            continue
        for row in table[table["status"].isin(LOUD)].to_dict("records"):
            said = [row.get(name) for name in ("failure", "note")]
            why = next((str(text) for text in said if isinstance(text, str) and text), str(row["status"]))
            item = Unmeasured(study.removesuffix("_summary"), str(row["integrator"]), str(row["scenario"]), why)
            found.setdefault(item[:3], item)
    return list(found.values())


def failures(tables: Tables, longest: int = 300) -> dict[str, dict[str, Any]]:
    """{method: {scenario: [failed, runs, sentence of the failed run at the smallest step]}} of the ladders, and of
    what other studies could not measure."""
    found: dict[str, dict[str, list[Any]]] = {}
    for study, step in (("conservation", "dt"), ("work_precision", "value")):
        table = tables.get(study)
        for row in table.to_dict("records") if table is not None else ():
            cell = found.setdefault(str(row["integrator"]), {}).setdefault(str(row["scenario"]), [0, 0, "", math.inf])
            cell[1] += 1
            if row["status"] == "ok":
                continue
            cell[0] += 1
            size = float(row[step]) if finite(row.get(step)) else math.inf
            if not cell[2] or (study == "conservation" and size < cell[3]):
                text = row.get("failure")
                said = text if isinstance(text, str) and text else str(row["status"])
                cell[2], cell[3] = _at(row, step) + said[:longest], size
    for item in unmeasured(tables):
        cell = found.setdefault(item.integrator, {}).setdefault(item.scenario, [0, 0, "", math.inf])
        cell[:3] = [cell[0] + 1, cell[1] + 1, cell[2] or item.sentence[:longest]]
    return {m: {s: c[:3] for s, c in cells.items() if c[0]} for m, cells in found.items() if any(
        c[0] for c in cells.values())}  # fmt: skip


def _at(row: Mapping[str, Any], step: str) -> str:
    if finite(row.get(step)):
        return f"{'h' if step == 'dt' or is_fixed(row) else 'rtol'} = {float(row[step]):.3g}: "
    return f"tolerance {float(row['tolerance']):.0e}: " if finite(row.get("tolerance")) else ""
