"""Which laws a method claims, and what one run says of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..studies.columns import ERROR_MAX, claim_column
from ..systems.energy_scale import HIDDEN
from .pairs import is_kept
from .words import is_finite

MOMENTA = "angular_momentum"


def is_claimed(law: str, claims: Any) -> bool:
    """Is it among the claims? Who claims momenta claims every invariant, however a system calls it."""
    return law in claims or (MOMENTA in claims and law not in ("energy", "entropy"))


def verdicts(method: Any, row: Mapping[str, Any]) -> dict[str, str]:
    """Column -> what a run says of the law that it measures: claimed, kept or hidden; "" for every other column."""
    laws = {claim_column(claim): claim for claim in ("energy", "entropy", *method.claims)}
    laws = {str(name): str(name).removesuffix(ERROR_MAX) for name in row if str(name).endswith(ERROR_MAX)} | laws
    texts = {}
    for column, law in laws.items():
        if is_finite(row.get(column)) and row.get("steps", 1) > 0:
            round_off = float(row.get("energy_round_off") or 0.0) if law == "energy" else 0.0
            holds = float(row[column]) <= round_off or is_kept(law, float(row[column]))
            claimed = "claimed" if is_claimed(law, method.claims) else "not claimed"
            seen = "kept" if holds else "not kept"
            texts[column] = f"{claimed}, {'hidden by the round-off of E' if round_off > HIDDEN else seen}"
    return texts
