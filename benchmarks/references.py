"""What references cost, how much they know, and whether they are ever further from the solution than they say.

    python benchmarks/references.py random 500     # random scenarios to t = 10
    python benchmarks/references.py systems 40     # random states of every other scenario's system, to t = 10

The truth is a run of order 46 at a tolerance of 1e-29, with thirty digits throughout, which shares no step with them.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

import tcbench
from tcbench.plugins import find_scenario
from tcbench.reference import pairs

T = 10.0
TRUTH = {"ORDER": 46, "WIDE": 46, "FINE": 1e-29, "COARSE": 1e-28}


def main(arguments: Sequence[str]) -> None:
    which, count = arguments[0], int(arguments[1])
    if which == "random":
        scenarios = [find_scenario(f"random[seed={k}]") for k in range(count)]
        tell("random", [s.model for s in scenarios], [s.z0 for s in scenarios])
        return
    for name, scenario in tcbench.scenarios().items():
        starts = admissible(scenario, count)
        tell(name, [scenario.model] * count, starts)


def admissible(scenario: tcbench.Scenario, count: int) -> list[Any]:
    """Random states around the start from which the system can go on."""
    model, rng, found = scenario.model, np.random.default_rng(1), list[Any]()
    while len(found) < count:
        z = np.asarray(model.nearby(scenario.z0, rng), float)
        positive = np.concatenate([np.ravel(model.temperatures(z)), np.ravel(model.shapes(z))])
        if np.isfinite(model.vector_field(z)).all() and (positive > 0).all():
            found.append(z)
    return found


def tell(name: str, systems: Sequence[Any], starts: Sequence[Any]) -> None:
    pairs.solve(systems[:1], starts[:1], [0.1])  # compiles
    begin = time.process_time()
    found = pairs.solve(systems, starts, [T])
    spent = time.process_time() - begin
    truth = more_precise(systems, starts)
    both = [(a, b) for a, b in zip(found, truth, strict=True) if a is not None and b is not None]
    bars = np.array([a.certificate[0] for a, _ in both])
    errors = np.array([distance(a, b) for a, b in both])
    steps = np.array([a.steps for a, _ in both])
    milliseconds = 1e3 * spent * steps / steps.sum()
    print(
        f"{name}: {len(both)} of {len(systems)}; CPU ms median {np.median(milliseconds):.2f}, mean "
        f"{milliseconds.mean():.2f}, most {milliseconds.max():.1f}; error bar median {np.median(bars):.1e}, "
        f"at most 1e-11 on {100 * np.mean(bars <= 1e-11):.1f} %; bar over true error at least "
        f"{np.min(bars / errors):.3g}",
        flush=True,
    )


def more_precise(systems: Sequence[Any], starts: Sequence[Any]) -> list[pairs.Pair | None]:
    before = {name: getattr(pairs, name) for name in TRUTH}
    try:
        for name, value in TRUTH.items():
            setattr(pairs, name, value)
        return pairs.solve(systems, starts, [T])
    finally:
        for name, value in before.items():
            setattr(pairs, name, value)


def distance(a: pairs.Pair, b: pairs.Pair) -> float:
    difference = (a.states - b.states) + (a.low - b.low)
    return float(np.max(np.abs(difference) / np.maximum(1.0, np.abs(b.states))))


if __name__ == "__main__":
    main(sys.argv[1:])
