"""How far one way to a number is from another: a Jacobian from central differences, the traced one of a formula or that
of an author; a second way of a method from the first, `march` from `step`, `outputs` from `adaptive`, `step` again."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from ..integrator import Integrator
from ..simulation.trajectory import Trajectory
from ..solver.kernels_of_flow import FlowKernels
from ..systems.scenario import Scenario

STILL = 1e-9  # part of a state's size, by which every method that takes a step has moved it


def given_gap(function: Any, jacobian: Callable[..., Any], scenario: Scenario) -> float:
    """jacobian(z, system) of the vector field, or jacobian(z0, z1, h, system) of function.residual to z1."""
    model, h = scenario.model, scenario.dt / 10
    z0 = np.array(scenario.z0)
    residual = getattr(function, "residual", None)
    if residual is None:
        matrix, f = np.asarray(jacobian(model.state(z0), model), float), lambda z: np.asarray(model.vector_field(z))
        return _gap(matrix, f, z0)
    z1 = z0 + h * np.asarray(model.vector_field(z0))
    matrix = np.asarray(jacobian(model.state(z0), model.state(z1), h, model), float)
    return _gap(matrix, lambda z: np.asarray(residual(model.state(z0), model.state(z), h, model)), z1)


def traced_gap(method: Integrator, scenario: Scenario) -> float:
    """The traced Jacobian of each formula, away from its root."""
    from ..solver.implicit_step import compiled_flows, constants_of

    constants, worst = constants_of(method, scenario), 0.0
    constants[0] = scenario.dt
    for kernels in compiled_flows(method.flows, scenario.model.symbolic):
        n = kernels.n_unknowns
        if n > 0:
            w = kernels.prepared(scenario.z0, constants)
            x = 1e-2 * np.cos(np.arange(n))  # any point near the start: the formula is checked, not the root
            matrix = _matrix(kernels, kernels.linear(w, x)[n:])
            worst = max(worst, _gap(matrix, partial(_rows, kernels, w), x))
    return worst


def _matrix(kernels: FlowKernels, entries: Any) -> Any:
    """The Jacobian, dense: of a large system the entries of its pattern."""
    n, pattern = kernels.n_unknowns, kernels.pattern
    if pattern is None:
        return entries[: n * n].reshape(n, n)
    matrix = np.zeros((n, n))
    matrix[np.repeat(np.arange(n), np.diff(pattern.first)), pattern.columns] = entries[: pattern.nnz]
    return matrix


def _rows(kernels: FlowKernels, w: Any, x: Any) -> Any:
    """The residual at x."""
    return kernels.linear(w, x)[: kernels.n_unknowns]


def _gap(matrix: Any, f: Callable[[Any], Any], x: Any) -> float:
    """Largest difference of a Jacobian to central differences, relative to its largest entry."""
    columns = []
    for i in range(len(x)):
        e = np.zeros(len(x))
        e[i] = 1e-5 * max(1.0, abs(x[i]))
        columns.append((f(x + e) - f(x - e)) / (2 * e[i]))
    differences = np.stack(columns, axis=-1)
    if np.shape(matrix) != differences.shape:
        return math.inf
    return float(np.abs(matrix - differences).max() / np.abs(differences).max())


def march_gap(method: Integrator, scenario: Scenario, h: float, count: int) -> tuple[tuple[int, ...], float]:
    """Shape of what `march` returns, and its distance from what as many calls of `step` do (infinite: other shapes)."""
    assert method.march is not None and method.step is not None
    model, expected = scenario.model, []
    z = model.state(scenario.z0.copy())
    values = np.asarray(method.march(z, h, count, model, *method.held_by_a_run(model)), float)
    held = method.held_by_a_run(model)
    for _ in range(count):
        expected.append(np.array(method.step(z, h, model, *held)))
        z = model.state(np.asarray(z) + expected[-1] if method.increments else expected[-1])
    return values.shape, _largest(values, np.array(expected))


def workspace_gap(method: Integrator, scenario: Scenario, h: float) -> float:
    """How far one step is from itself after others that had the same workspace; 0 where a run holds none."""
    if method.step is None or method.workspace is None:
        return 0.0
    model, held, states = scenario.model, method.held_by_a_run(scenario.model), [scenario.z0]
    for start in (0, 1, 0, 1):  # once from where the last one ended
        z = model.state(states[start].copy())
        z1 = np.array(method.step(z, h, model, *[(z.copy(),) * method.memory] * bool(method.memory), *held))
        states.append(z + z1 if method.increments else z1)
    return _largest(states[2], states[4])


def outputs_gap(method: Integrator, scenario: Scenario, span: float, count: int) -> tuple[tuple[int, ...], float]:
    """The same of the states that `outputs` gives and those of `adaptive`, at so many times."""
    assert method.outputs is not None and method.adaptive is not None
    model, times = scenario.model, np.linspace(0.0, span, count)
    states, _ = method.outputs(model, scenario.z0.copy(), times, 1e-6, 1e-6)
    values = np.array(list(states), float)
    expected = method.adaptive(model, scenario.z0.copy(), times, 1e-6, 1e-6)
    return values.shape, _largest(values, np.asarray(expected[0] if isinstance(expected, tuple) else expected, float))


def _largest(values: np.ndarray, expected: np.ndarray) -> float:
    return float(np.abs(values - expected).max()) if values.shape == expected.shape else math.inf


def stands_still(one: Trajectory) -> bool:
    """Is a state of the run its next one to the last bit, though it would move by far more than round-off meanwhile?"""
    model = one.scenario.model
    for k in np.flatnonzero((one.z[1:] == one.z[:-1]).all(axis=1)):
        move = (one.t[k + 1] - one.t[k]) * np.abs(model.vector_field(one.z[k])).max()
        if move > STILL * max(1.0, np.abs(one.z[k]).max()):
            return True
    return False
