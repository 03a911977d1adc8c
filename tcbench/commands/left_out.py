"""Sentences on what a run left out or could not see, although nobody said so."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pandas import DataFrame


def short_ladder(dt: list[float] | None, tables: Mapping[str, DataFrame]) -> list[str]:
    """A sentence where --dt leaves the study of orders too few steps to see one."""
    from ..studies.order_fit import MIN_POINTS

    if not dt or len(set(dt)) >= MIN_POINTS or "convergence" not in tables:
        return []
    return [
        f"--dt gives the study convergence {len(set(dt))} step{'s' * (len(set(dt)) > 1)}, and an order takes at least "
        f"{MIN_POINTS}: leave --dt out for the study's own ladder, or give more steps."
    ]
