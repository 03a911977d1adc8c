"""`reference_for`: the certified states of any scenario: read from the package, or computed once and kept.

Built-in scenarios have stored references, looked up by their numbers and not by name, so that a variant made by
`replace()` never gets the wrong one. Others are computed from the system's traced equations, by two Taylor series in
double-doubles (`pairs`: milliseconds) or, where these fail, by two collocations in doubles (`certified.compute`:
seconds), and cached under a hash of all that they depend on.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib.metadata
import math
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from .. import cache
from ..errors import TcbenchError
from ..systems.constrained import MOST_REDUCED
from ..systems.right_hand_side import Field
from ..systems.scenario import Scenario
from . import pairs
from .certified import KINKED, SAFETY, Reference, cached, compute, gap, scenario_hash, stored
from .collocation import ReferenceFailed

DEADLINE = 100.0  # seconds for each of the two collocations: a cell has 300 for everything
SHORT = 10.0  # DEADLINE of one reference among many
REMEMBERED_S = 24 * 3600.0  # for which a failure is cached: another day the machine may have more time
HORIZON = 25.0  # `recompute` goes no further where nothing is stored: chaotic scenarios lose their digits
HALF_ULP = float(np.finfo(float).eps) / 2
DISAGREEMENT = 1e-10  # two computations further apart than this certify nothing


def reference_for(scenario: Scenario, times: Sequence[float]) -> Reference:
    """Certified states of `scenario` at `times` (increasing, > 0), and only at those.

    Compare a double-precision run with `states` and call errors up to 10 times `floor` reference-limited.
    Raises ReferenceFailed where the solution does not reach the last time.
    """
    reference = stored_for(scenario)
    if reference is not None:
        with contextlib.suppress(KeyError):
            return _at(reference, times)
    recipe = _Recipe(scenario, tuple(float(t) for t in times))
    return cached(recipe.key, lambda: _once(recipe))


def ends_of(scenarios: Sequence[Scenario]) -> list[tuple[Reference | None, float]]:
    """(reference, growth of a change of the start) of each scenario at its t_end, computed together and not cached;
    (None, NaN) where it takes more than SHORT seconds."""
    systems, starts = [s.model for s in scenarios], [s.z0 for s in scenarios]
    ends: list[tuple[Reference | None, float]] = []
    for scenario, pair in zip(scenarios, pairs.solve(systems, starts, [[s.t_end] for s in scenarios]), strict=True):
        if pair is not None:
            ends.append((from_pair(pair, [scenario.t_end]), float(pair.growth[0])))
            continue
        try:
            ends.append((_Recipe(scenario, (scenario.t_end,)).collocations(SHORT), math.nan))
        except ReferenceFailed:
            ends.append((None, math.nan))
    return ends


def _once(recipe: _Recipe) -> Reference:
    """The reference of a recipe; a failure is cached for a day, or each method would wait for it again."""
    note = f"{recipe.key}.failed"
    when, _, what = (cache.read("references", note) or b"").decode().partition("\n")
    if when and abs(time.time() - float(when)) < REMEMBERED_S:  # a clock may have been set back
        path = cache.folder("references") / note
        raise ReferenceFailed(f"{what} (Found before; to try again delete {path}.)")
    try:
        return recipe.compute()
    except ReferenceFailed as error:
        with contextlib.suppress(TcbenchError):
            cache.write("references", note, f"{time.time()}\n{error}".encode())
        raise


def algorithm() -> str:
    """Hash of the code and the packages that compute references."""
    return f"{cache.sources(str(__package__))} {_packages()}"


@functools.cache
def _packages() -> str:
    return " ".join(importlib.metadata.version(name) for name in ("numpy", "scipy"))


def stored_for(scenario: Scenario) -> Reference | None:
    """The reference stored in the package for these numbers, whatever the scenario is called; None if there is none."""
    digest = content_hash(scenario)
    return stored(digest) if digest else None


def content_hash(scenario: Scenario) -> str | None:
    """`reference.scenario_hash` of a pendulum scenario; None for other systems, whose references are never stored."""
    from ..systems.pendulum import Pendulum

    if scenario.system is not Pendulum:  # a subclass may have changed the physics
        return None
    initial = {name: getattr(scenario, name) for name in ("positions", "momenta", "temperatures")}
    return scenario_hash(scenario.constants, initial)


def _at(reference: Reference, times: Sequence[float]) -> Reference:
    """The reference at these times alone; KeyError where one is missing."""
    rows = [reference.index(t) for t in times]
    names = ("times", "certificate", "floor", *(["exact"] if reference.exact else []))
    chosen: dict[str, Any] = {name: tuple(getattr(reference, name)[i] for i in rows) for name in names}
    return replace(reference, states=reference.states[rows], **chosen)


class _Recipe:
    """The equations, start and times of a reference, and its key in the cache."""

    def __init__(self, scenario: Scenario, times: tuple[float, ...]) -> None:
        if scenario.model.multipliers and scenario.model.size > MOST_REDUCED:
            raise ReferenceFailed(
                f"a reference needs the ODE under the constraints as formulas, which are traced up to {MOST_REDUCED} "
                f"numbers; {scenario.name} has {scenario.model.size}. scipy_dop853 at a small tolerance takes it."
            )
        self.model, self.start, self.times = scenario.model, scenario.z0, times
        self.text, _ = self.model.formula("vector_field")
        parts = (self.model.constant_values, self.start)
        text = f"{algorithm()} {self.text} {[x.tolist() for x in parts]} {times} {self.model.magnitudes.tolist()}"
        self.key = hashlib.sha256(text.encode()).hexdigest()[:32]

    def compute(self) -> Reference:
        """The reference by the series; where they fail by the collocations."""
        (pair,) = pairs.solve([self.model], [self.start], self.times, self.text)
        return self.collocations() if pair is None else from_pair(pair, self.times)

    def collocations(self, max_seconds: float | None = None) -> Reference:
        """The reference by the collocations, which are slower and take stiff equations."""
        safety = KINKED if "abs(" in self.text else SAFETY
        return compute(
            Field(self.model), self.start, self.times, max_seconds=DEADLINE if max_seconds is None else max_seconds,
            magnitudes=self.model.state_magnitudes, safety=safety,
        )  # fmt: skip


def from_pair(pair: pairs.Pair, times: Sequence[float]) -> Reference:
    """The `Reference` of a pair; its floor adds the growth of the start's rounding, or the last digit of the states."""
    floor = pair.certificate + HALF_ULP * np.maximum(1.0, pair.growth)
    return Reference(tuple(times), pair.states, tuple(pair.certificate.tolist()), tuple(floor.tolist()), pairs.SOURCE)


def recompute(scenario: Scenario) -> dict[str, Any]:
    """Compute the reference of a scenario anew and compare it with the one in use.

    Returns scenario, method, agrees (bool), and rows: one dict a time with t, gap (new against the one in use),
    certificate (of the new one) and check (gap of the collocations to the new one; NaN where that is theirs).
    """
    kept = stored_for(scenario)
    last = max(scenario.t_converge, min(scenario.t_end, HORIZON))
    times = kept.times if kept else tuple(sorted({scenario.t_converge, last}))
    recipe, magnitudes = _Recipe(scenario, times), scenario.model.state_magnitudes
    fresh, check = recipe.compute(), [float("nan")] * len(times)
    if fresh.source == pairs.SOURCE:
        with contextlib.suppress(ReferenceFailed):
            states = recipe.collocations().states
            check = [gap(a, b, magnitudes) for a, b in zip(states, fresh.states, strict=True)]
    before = kept or cached(recipe.key, lambda: fresh)
    gaps = [gap(a, b, magnitudes) for a, b in zip(fresh.states, before.states, strict=True)]
    allowed = [a + b for a, b in zip(fresh.floor, before.floor, strict=True)]
    rows = [
        {"t": t, "gap": g, "certificate": c, "check": other}
        for t, g, c, other in zip(times, gaps, fresh.certificate, check, strict=True)
    ]
    agrees = all(g <= a for g, a in zip(gaps, allowed, strict=True)) and max(fresh.certificate) <= DISAGREEMENT
    return {"scenario": scenario.name, "method": fresh.source, "agrees": agrees, "rows": rows}
