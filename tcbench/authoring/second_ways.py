"""How far a second way of a method is from the first: `march` from `step`, `outputs` from `adaptive`, `step` again."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ..integrator import Integrator
    from ..systems.scenario import Scenario


def march_gap(method: Integrator, scenario: Scenario, h: float, count: int) -> tuple[tuple[int, ...], float]:
    """Shape of what `march` returns, and its distance from what as many calls of `step` do (infinite: other shapes)."""
    assert method.march is not None and method.step is not None
    model, expected = scenario.model, []
    z = model.state(scenario.z0.copy())
    found = np.asarray(method.march(z, h, count, model, *method.held_by_a_run(model)), float)
    held = method.held_by_a_run(model)
    for _ in range(count):
        expected.append(np.array(method.step(z, h, model, *held)))
        z = model.state(np.asarray(z) + expected[-1] if method.increments else expected[-1])
    return found.shape, _gap(found, np.array(expected))


def workspace_gap(method: Integrator, scenario: Scenario, h: float) -> float:
    """How far one step is from itself after others that had the same workspace; 0 where a run holds none."""
    if method.step is None or method.workspace is None:
        return 0.0
    model, held, found = scenario.model, method.held_by_a_run(scenario.model), [scenario.z0]
    for start in (0, 1, 0, 1):  # once from where the last one ended
        z = model.state(found[start].copy())
        z1 = np.array(method.step(z, h, model, *[(z.copy(),) * method.memory] * bool(method.memory), *held))
        found.append(z + z1 if method.increments else z1)
    return _gap(found[2], found[4])


def outputs_gap(method: Integrator, scenario: Scenario, span: float, count: int) -> tuple[tuple[int, ...], float]:
    """The same of the states that `outputs` gives and those of `adaptive`, at so many times."""
    assert method.outputs is not None and method.adaptive is not None
    model, times = scenario.model, np.linspace(0.0, span, count)
    states, _ = method.outputs(model, scenario.z0.copy(), times, 1e-6, 1e-6)
    found = np.array(list(states), float)
    expected = method.adaptive(model, scenario.z0.copy(), times, 1e-6, 1e-6)
    return found.shape, _gap(found, np.asarray(expected[0] if isinstance(expected, tuple) else expected, float))


def _gap(found: np.ndarray, expected: np.ndarray) -> float:
    return float(np.abs(found - expected).max()) if found.shape == expected.shape else math.inf
