"""What the report says first: integrator by scenario, and what each method claims against what was measured."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ..studies.columns import column as column_named
from .chart_kinds import of_scenario

if TYPE_CHECKING:
    from pandas import DataFrame

KEPT = 1e-9  # relative error up to which a conserved quantity counts as kept: round-off and solver, over any horizon
TARGET = 1e-6  # error of "time to 1e-6"
ERRORS = ("error_q", "error_p", "error_s", "error_theta")
MEASURES = {  # claim -> column of `conservation`
    "energy": "energy_error_max",
    "entropy": "second_law_violations",
    "angular_momentum": "angular_momentum_error_max",
}
ABSENT = "-"
UNTESTED = "no step done"


def summary(tables: Mapping[str, DataFrame], declared: Mapping[str, Any]) -> DataFrame:
    """One row an integrator and scenario: claims kept, order, largest stable step, time to 1e-6, failures.

    declared : integrators by name, for their claims. Cells whose study is absent say "-".
    """
    import pandas as pd

    pairs: dict[tuple[str, str], None] = {}
    for table in tables.values():
        if {"integrator", "scenario"} <= set(table.columns):
            for pair in zip(table["scenario"].astype(str), table["integrator"].astype(str), strict=True):
                pairs[pair] = None
    rows = []
    for scenario, integrator in sorted(pairs):
        part = {
            name: rows_of(table, integrator, scenario)
            for name, table in tables.items()
            if {"integrator", "scenario"} <= set(table.columns)
        }
        kept, worth = claims_kept(part.get("conservation"), declared.get(integrator))
        rows.append(
            {
                "scenario": scenario,
                "integrator": integrator,
                "claims kept": kept,
                "order": measured_order(part.get("convergence")),
                "max stable step": stable_step(part.get("stability")),
                "time to 1e-6": time_to_target(part.get("work_precision")),
                "failures": failures(part.get("conservation")),
                "claims broken": worth,
            }
        )
    return pd.DataFrame(rows)


def rows_of(table: DataFrame, integrator: str, scenario: str) -> DataFrame:
    part = of_scenario(table, scenario)
    return part[part["integrator"].astype(str) == integrator]


def claims_kept(rows: DataFrame | None, method: Any) -> tuple[str, int]:
    """ "3 of 3", or which are broken, over the completed steps of every run; and how many are broken."""
    if rows is None or not len(rows) or method is None:
        return ABSENT, 0
    claims = [c for c in MEASURES if c in method.claims and MEASURES[c] in rows]
    if not claims:
        return "claims none", 0
    rows = completed(rows)
    if not len(rows):
        return UNTESTED, 0
    broken = [c for c in claims if not kept(c, worst(rows, MEASURES[c]))]
    text = f"{len(claims) - len(broken)} of {len(claims)}"
    return (f"{text}, not {', '.join(broken)}" if broken else text), len(broken)


def completed(rows: DataFrame) -> DataFrame:
    """The runs of which at least one step was completed: the others say nothing of a law."""
    return rows[rows["steps"].astype(float) > 0] if "steps" in rows else rows


def worst(rows: DataFrame, column: str) -> float:
    """The largest finite value, NaN if there is none."""
    values = [float(v) for v in rows[column] if v is not None and math.isfinite(float(v))]
    return max(values, default=math.nan)


def kept(claim: str, value: float) -> bool:
    return not value > (0 if claim == "entropy" else KEPT)


def measured_order(rows: DataFrame | None) -> str:
    """The fitted order of the whole state, or of the variable with the lowest where that was not fitted."""
    if rows is None or not len(rows):
        return ABSENT
    whole = rows[rows["variable"].astype(str) == "all"]
    chosen = whole if len(whole) else rows
    orders = [float(v) for v in chosen["order"] if v is not None and math.isfinite(float(v))]
    return f"{min(orders):.2f}" if orders else "undetermined"


def stable_step(rows: DataFrame | None) -> str:
    """dt_stable with the kind of its limit; "above H" where no limit was found up to H."""
    if rows is None or not len(rows):
        return ABSENT
    row = rows.iloc[-1]
    stable, cap = number(row.get("dt_stable")), number(row.get("dt_cap"))
    limit = str(row.get("limit"))
    if limit == "none":
        top = cap if math.isfinite(cap) else stable
        return f"above {top:.3g}" if math.isfinite(top) else "no limit"
    if not math.isfinite(stable):
        return "none found" if limit in ("nan", "None", "") else f"none found ({limit})"
    return f"{stable:.3g} ({limit})"


def number(value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError):
        return math.nan


def time_to_target(rows: DataFrame | None) -> str:
    """Least measured time of a completed run whose errors in q, p, s and theta are all at most 1e-6."""
    if rows is None or not len(rows):
        return ABSENT
    best = math.inf
    for _, row in rows[rows["status"].eq("ok")].iterrows():
        errors = [number(row.get(c)) for c in ERRORS]
        known = [e for e in errors if math.isfinite(e)]  # a masked error is below what the reference can tell
        if known and max(known) <= TARGET:
            best = min(best, number(row.get("wall_time_min_s")))
    return seconds(best) if math.isfinite(best) else "not reached"


def seconds(value: float) -> str:
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if value >= size:
            return f"{value / size:.3g} {unit}"
    return f"{value:.3g} s"


def failures(rows: DataFrame | None) -> str:
    """How many runs of the conservation study did not reach the end."""
    if rows is None or not len(rows):
        return ABSENT
    return f"{int(rows['status'].ne('ok').sum())} of {len(rows)}"


def claimed(tables: Mapping[str, DataFrame], declared: Mapping[str, Any]) -> DataFrame:
    """Each law and order: claimed or not, the worst that was measured and where, and whether it agrees."""
    import pandas as pd

    rows: list[dict[str, Any]] = []
    table = tables.get("conservation")
    if table is not None:
        for integrator, part in table.groupby("integrator", sort=False):
            rows += [row for claim in MEASURES if (row := _law(str(integrator), part, claim, declared)) is not None]
    fits = tables.get("convergence")
    if fits is not None and "declared" in fits:
        for integrator, part in fits[fits["variable"].astype(str) == "all"].groupby("integrator", sort=False):
            rows += [_order(str(integrator), part)]
    return pd.DataFrame(rows)


def _law(integrator: str, part: DataFrame, claim: str, declared: Mapping[str, Any]) -> dict[str, Any] | None:
    column = MEASURES[claim]
    if column not in part or integrator not in declared:
        return None
    values = completed(part)[column].astype(float)
    if not values.notna().any():
        return None
    row = part.loc[values.idxmax()]
    holds, promised = kept(claim, float(values.max())), claim in declared[integrator].claims
    verdict = {(True, True): "kept", (True, False): "broken", (False, True): "kept, not claimed"}
    return {
        "integrator": integrator,
        "claim": claim,
        "claimed": "yes" if promised else "no",
        "worst measured": float(values.max()),
        "measure": column_named(column).label,
        "where": f"{row['scenario']}, dt = {number(row.get('dt')):.3g}",
        "verdict": verdict.get((promised, holds), "not claimed, not kept"),
    }


def _order(integrator: str, part: DataFrame) -> dict[str, Any]:
    orders = part["order"].astype(float)
    some = orders.notna().any()
    row = part.loc[orders.idxmin()] if some else part.iloc[0]
    verdicts = part["verdict"].astype(str) if "verdict" in part else None
    off = [] if verdicts is None else sorted(set(verdicts) - {"as declared"})
    return {
        "integrator": integrator,
        "claim": "order",
        "claimed": "no" if row["declared"] is None else f"{number(row['declared']):g}",
        "worst measured": float(orders.min()) if some else math.nan,
        "measure": "lowest fitted order of the state",
        "where": str(row["scenario"]),
        "verdict": "; ".join(off) if off else "kept",
    }
