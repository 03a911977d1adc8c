"""summary.csv: each method on each scenario in words, of the table of pairs; and what one run says of its laws."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ..studies.columns import ERROR_MAX, claim_column
from .pairs import is_kept
from .words import ABSENT, is_finite, seconds, share_of

if TYPE_CHECKING:
    from pandas import DataFrame

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
        order, time = row.get("order"), row.get("time 1e-06", math.nan)
        fitted = ABSENT if not is_finite(row.get("fits")) else f"{order:.2f}" if is_finite(order) else "undetermined"
        timed = ABSENT if math.isnan(time) else "not reached" if math.isinf(time) else seconds(time)
        failed = share_of(row.get("ladder_failed", 0), row.get("ladder_runs", math.nan))
        rows.append([row["scenario"], row["integrator"], kept, fitted, stable_step(row), timed, failed, broken])
    return pd.DataFrame(rows, columns=COLUMNS)  # of an ensemble alone, these


def claims_kept(row: Mapping[str, Any], claims: Any) -> tuple[str, int]:
    """ "3 of 3", or which are broken, over the completed steps of every run; and how many are broken.

    A claim counts where it was measured: what a system does not have, nothing keeps.
    """
    if not is_finite(row.get("ladder_runs")) or not isinstance(claims, list | tuple | set | frozenset):
        return ABSENT, 0
    if not claims or not row["done"]:
        return "no step done" if claims else "claims none", 0
    there = {str(name).removeprefix("of_") for name, runs in row.items() if str(name).startswith("of_") and runs > 0}
    claims, invariants = {*claims}, there - {"energy", "entropy"}
    if MOMENTA in claims:  # who claims momenta claims every invariant; a system may call its momenta otherwise
        claims = (claims - {MOMENTA} if invariants else claims) | invariants
    measured = sorted(claims & there)
    broken = [claim for claim in measured if row[f"kept_{claim}"] < row[f"of_{claim}"]]
    parts = [f"{len(measured) - len(broken)} of {len(measured)}"]
    parts += [f"not {', '.join(broken)}"] if broken else []
    parts += [f"{len(claims) - len(measured)} not measured"] if len(measured) < len(claims) else []
    return ", ".join(parts), len(broken)


def stable_step(row: Mapping[str, Any]) -> str:
    """dt_stable with the kind of its limit; "above H" where no limit was found up to H."""
    if math.isnan(row.get("step", math.nan)):
        return ABSENT
    limit, stable = str(row["limit"]), row["step"]
    if limit == "none":
        top = row["dt_cap"] if is_finite(row["dt_cap"]) else stable
        return f"above {top:.3g}" if is_finite(top) else "no limit"
    kind = "" if limit in ("nan", "None", "") else f" ({limit})"
    return f"{stable:.3g}{kind}" if is_finite(stable) else f"none found{kind}"


def is_claimed(law: str, claims: Any) -> bool:
    """Is it among the claims? Who claims momenta claims every invariant, however a system calls it."""
    return law in claims or (MOMENTA in claims and law not in ("energy", "entropy"))


def verdicts(method: Any, row: Mapping[str, Any]) -> dict[str, str]:
    """Column -> what a run says of the law that it measures: claimed or not, kept or not; "" for every other column."""
    laws = {claim_column(claim): claim for claim in ("energy", "entropy", *method.claims)}
    laws = {str(name): str(name).removesuffix(ERROR_MAX) for name in row if str(name).endswith(ERROR_MAX)} | laws
    found = {}
    for column, law in laws.items():
        if is_finite(row.get(column)) and row.get("steps", 1) > 0:
            within = law == "energy" and float(row[column]) <= float(row.get("energy_round_off") or 0.0)
            holds = within or is_kept(law, float(row[column]))
            claimed = "claimed" if is_claimed(law, method.claims) else "not claimed"
            found[column] = f"{claimed}, {'kept' if holds else 'not kept'}"
    return found
