"""What the report says first: integrator by scenario, and what each method claims against what was measured."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ..studies.columns import ERROR_MAX, claim_column, invariant_columns
from ..studies.columns import column as column_named
from ..studies.cost import reach

if TYPE_CHECKING:
    from pandas import DataFrame

KEPT = 1e-9  # relative error up to which a conserved quantity counts as kept: round-off and solver, over any horizon
TARGET = 1e-6  # error of "time to 1e-6"
ABSENT = "-"
UNTESTED = "no step done"
JUDGED = ("conservation", "convergence", "stability", "work_precision")  # tables that the summary draws on


def summary(tables: Mapping[str, DataFrame], declared: Mapping[str, Any]) -> DataFrame:
    """One row an integrator and scenario: claims kept, order, largest stable step, time to 1e-6, failures.

    declared : integrators by name, for their claims. Cells whose study is absent say "-".
    """
    import pandas as pd

    found = {name: by_pair(tables[name]) for name in JUDGED if name in tables}
    pairs = {pair for name, table in tables.items() for pair in (found[name] if name in found else by_pair(table))}
    rows = []
    for scenario, integrator in sorted(pairs):
        part = {name: groups.get((scenario, integrator)) for name, groups in found.items()}
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


def by_pair(table: DataFrame) -> dict[tuple[str, str], DataFrame]:
    """The rows of each (scenario, integrator) of a table that has both."""
    if not {"integrator", "scenario"} <= set(table.columns):
        return {}
    return dict(iter(table.groupby([table["scenario"].astype(str), table["integrator"].astype(str)], sort=False)))


def claims_kept(rows: DataFrame | None, method: Any) -> tuple[str, int]:
    """ "3 of 3", or which are broken, over the completed steps of every run; and how many are broken.

    A claim counts where it was measured: what a system does not have, nothing keeps.
    """
    if rows is None or not len(rows) or method is None:
        return ABSENT, 0
    if not method.claims:
        return "claims none", 0
    rows = completed(rows)
    if not len(rows):
        return UNTESTED, 0
    found = {claim: worst(rows, claim_column(claim)) for claim in sorted(method.claims)}
    measured = [claim for claim, value in found.items() if not math.isnan(value)]
    broken = [claim for claim in measured if not kept(claim, found[claim])]
    parts = [f"{len(measured) - len(broken)} of {len(measured)}"]
    parts += [f"not {', '.join(broken)}"] if broken else []
    parts += [f"{len(found) - len(measured)} not measured"] if len(measured) < len(found) else []
    return ", ".join(parts), len(broken)


def verdicts(method: Any, row: Mapping[str, Any]) -> dict[str, str]:
    """Column -> what a run says of the law that it measures: claimed or not, kept or not; "" for every other column."""
    laws = {claim_column(claim): claim for claim in ("energy", "entropy", *method.claims)}
    laws |= {
        name: str(name).removesuffix(ERROR_MAX) for name in row if str(name).endswith(ERROR_MAX) and name not in laws
    }
    found = {}
    for column, law in laws.items():
        if math.isfinite(number(row.get(column))) and number(row.get("steps", 1)) > 0:
            holds = kept(law, number(row[column]))
            found[column] = f"{'claimed' if law in method.claims else 'not claimed'}, {'kept' if holds else 'not kept'}"
    return found


def completed(rows: DataFrame) -> DataFrame:
    """The runs of which at least one step was completed: the others say nothing of a law."""
    return rows[rows["steps"].astype(float) > 0] if "steps" in rows else rows


def worst(rows: DataFrame, column: str) -> float:
    """The largest finite value, NaN if there is none."""
    values = [float(v) for v in rows.get(column, ()) if v is not None and math.isfinite(float(v))]
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
    """Time to a state error of 1e-6, as in the table time_to_accuracy."""
    if rows is None or not len(rows):
        return ABSENT
    best = reach(rows.to_dict("records"), "error", TARGET)
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
            invariants = [name.removesuffix(ERROR_MAX) for name in invariant_columns(part.columns)]
            laws = dict.fromkeys(("energy", "entropy", *invariants, *_claims(integrator, declared)))
            rows += [row for claim in laws if (row := _law(str(integrator), part, claim, declared)) is not None]
    fits = tables.get("convergence")
    if fits is not None and "declared" in fits:
        for integrator, part in fits[fits["variable"].astype(str) == "all"].groupby("integrator", sort=False):
            rows += [_order(str(integrator), part)]
    return pd.DataFrame(rows)


def _law(integrator: str, part: DataFrame, claim: str, declared: Mapping[str, Any]) -> dict[str, Any] | None:
    column = claim_column(claim)
    if integrator not in declared:
        return None
    promised = claim in _claims(integrator, declared)
    values = completed(part)[column].astype(float).dropna() if column in part else None
    if values is None or not len(values):
        unseen = {"claim": claim, "claimed": "yes", "worst measured": math.nan, "verdict": "not measured"}
        label = column_named(column).label
        told = promised and len(completed(part))  # of a method that did no step, nothing is said
        return {"integrator": integrator, **unseen, "measure": label, "where": ""} if told else None
    row = part.loc[values.idxmax()]
    holds = kept(claim, float(values.max()))
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


def _claims(integrator: Any, declared: Mapping[str, Any]) -> list[str]:
    return sorted(declared[integrator].claims) if integrator in declared else []


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
