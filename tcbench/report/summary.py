"""summary.csv: each method on each scenario in words, of the table of pairs; and what one run says of its laws."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ..studies.columns import ERROR_MAX, claim_column
from .pairs import is_finite, is_kept

if TYPE_CHECKING:
    from pandas import DataFrame

ABSENT = "-"
MOMENTA = "angular_momentum"


COLUMNS = ["scenario", "integrator", "claims kept", "order", "max stable step", "time to 1e-6", "failures",
           "claims broken"]  # fmt: skip


def summary(found: DataFrame, methods: Mapping[str, Any]) -> DataFrame:
    """One row an integrator and scenario: claims kept, order, largest stable step, time to 1e-6, failures.

    found : the table of pairs. methods : name -> what is declared of it, for its claims. Of an absent study: "-".
    """
    import pandas as pd

    rows = []
    for row in found.reset_index().sort_values(["scenario", "integrator"], kind="stable").to_dict("records"):
        kept, broken = claims_kept(row, (methods.get(row["integrator"]) or {}).get("claims"))
        rows.append({
            "scenario": row["scenario"], "integrator": row["integrator"], "claims kept": kept,
            "order": _order(row), "max stable step": stable_step(row), "time to 1e-6": _time(row),
            "failures": _of(row, "ladder_failed", "ladder_runs"), "claims broken": broken,
        })  # fmt: skip
    return pd.DataFrame(rows, columns=COLUMNS)  # of an ensemble alone, these


def claims_kept(row: Mapping[str, Any], claims: Any) -> tuple[str, int]:
    """ "3 of 3", or which are broken, over the completed steps of every run; and how many are broken.

    A claim counts where it was measured: what a system does not have, nothing keeps.
    """
    if not is_finite(row.get("ladder_runs")) or not isinstance(claims, list | tuple | set | frozenset):
        return ABSENT, 0
    if not claims:
        return "claims none", 0
    if not row["done"]:
        return "no step done", 0
    claims = set(claims) | (invariants_of(row) if MOMENTA in claims else set())
    if MOMENTA in claims and not row.get(f"of_{MOMENTA}", 0) > 0 and invariants_of(row):
        claims -= {MOMENTA}  # a system calls its momenta otherwise
    measured = [claim for claim in sorted(claims) if row.get(f"of_{claim}", 0) > 0]
    broken = [claim for claim in measured if row[f"kept_{claim}"] < row[f"of_{claim}"]]
    parts = [f"{len(measured) - len(broken)} of {len(measured)}"]
    parts += [f"not {', '.join(broken)}"] if broken else []
    parts += [f"{len(claims) - len(measured)} not measured"] if len(measured) < len(claims) else []
    return ", ".join(parts), len(broken)


def invariants_of(row: Mapping[str, Any]) -> set[str]:
    """Every invariant that was measured: who claims momenta claims whatever the system declares."""
    named = {str(name).removeprefix("of_") for name in row if str(name).startswith("of_")}
    return {name for name in named - {"energy", "entropy"} if row[f"of_{name}"] > 0}


def _order(row: Mapping[str, Any]) -> str:
    if not is_finite(row.get("fits")):
        return ABSENT
    return f"{row['order']:.2f}" if is_finite(row["order"]) else "undetermined"


def stable_step(row: Mapping[str, Any]) -> str:
    """dt_stable with the kind of its limit; "above H" where no limit was found up to H."""
    if math.isnan(row.get("step", math.nan)):
        return ABSENT
    limit, stable = str(row["limit"]), row["step"]
    if limit == "none":
        top = row["dt_cap"] if is_finite(row["dt_cap"]) else stable
        return f"above {top:.3g}" if is_finite(top) else "no limit"
    if not is_finite(stable):
        return "none found" if limit in ("nan", "None", "") else f"none found ({limit})"
    return f"{stable:.3g} ({limit})"


def _time(row: Mapping[str, Any]) -> str:
    time = row.get("time 1e-06", math.nan)
    return ABSENT if math.isnan(time) else seconds(time) if math.isfinite(time) else "not reached"


def _of(row: Mapping[str, Any], some: str, runs: str) -> str:
    return f"{int(row[some])} of {int(row[runs])}" if is_finite(row.get(runs)) else ABSENT


def seconds(value: float) -> str:
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if value >= size:
            return f"{value / size:.3g} {unit}"
    return f"{value:.3g} s"


def is_claimed(law: str, claims: Any) -> bool:
    """Is it among the claims? Who claims momenta claims every invariant, however a system calls it."""
    return law in claims or (MOMENTA in claims and law not in ("energy", "entropy"))


def verdicts(method: Any, row: Mapping[str, Any]) -> dict[str, str]:
    """Column -> what a run says of the law that it measures: claimed or not, kept or not; "" for every other column."""
    laws = {claim_column(claim): claim for claim in ("energy", "entropy", *method.claims)}
    laws |= {
        name: str(name).removesuffix(ERROR_MAX) for name in row if str(name).endswith(ERROR_MAX) and name not in laws
    }
    found = {}
    for column, law in laws.items():
        if is_finite(row.get(column)) and row.get("steps", 1) > 0:
            within = law == "energy" and float(row[column]) <= float(row.get("energy_round_off") or 0.0)
            holds = within or is_kept(law, float(row[column]))
            claimed = "claimed" if is_claimed(law, method.claims) else "not claimed"
            found[column] = f"{claimed}, {'kept' if holds else 'not kept'}"
    return found
