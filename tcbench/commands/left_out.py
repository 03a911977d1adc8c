"""Sentences on what a run left out or could not see, although nobody said so."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from .. import plugins

if TYPE_CHECKING:
    from pandas import DataFrame


def not_run(asked: list[str] | None, dt: list[float] | None) -> list[str]:
    """Sentences on what a run left out although nobody said so: absent peers, and steps that do not apply."""
    sentences = []
    for name, method in plugins.integrators().items() if asked is None else ():
        if method.lacks:
            sentences.append(f"{name} was not run: {method.lacks}.")
    chosen = plugins.expand_integrators(plugins.by_default() if asked is None else asked)
    adaptive = [method.name for method in chosen if method.kind == "adaptive"]
    if dt and adaptive:
        sentences.append(f"--dt does not apply to methods that choose their steps: {', '.join(adaptive)}.")
    return sentences


def short_ladder(dt: list[float] | None, tables: Mapping[str, DataFrame]) -> list[str]:
    """A sentence where --dt leaves the study of orders too few steps to see one."""
    from ..studies.order_fit import MIN_POINTS

    if not dt or len(set(dt)) >= MIN_POINTS or "convergence" not in tables:
        return []
    return [
        f"--dt gives the study convergence {len(set(dt))} step{'s' * (len(set(dt)) > 1)}, and an order takes at least "
        f"{MIN_POINTS}: leave --dt out for the study's own ladder, or give more steps."
    ]
