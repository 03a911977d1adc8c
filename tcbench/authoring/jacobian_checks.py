"""How far a Jacobian is from central differences: the traced one of a formula, or the one that an author gives."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from ..integrator import Integrator
    from ..solver.flow_kernels import FlowKernels
    from ..systems.scenario import Scenario


def given_gap(function: Any, given: Callable[..., Any], scenario: Scenario) -> float:
    """jacobian(z, system) of the vector field, or jacobian(z0, z1, h, system) of function.residual to z1."""
    model, h = scenario.model, scenario.dt / 10
    z0 = np.array(scenario.z0)
    residual = getattr(function, "residual", None)
    if residual is None:
        found, f = np.asarray(given(model.state(z0), model), float), lambda z: np.asarray(model.vector_field(z))
        return _gap(found, f, z0)
    z1 = z0 + h * np.asarray(model.vector_field(z0))
    found = np.asarray(given(model.state(z0), model.state(z1), h, model), float)
    return _gap(found, lambda z: np.asarray(residual(model.state(z0), model.state(z), h, model)), z1)


def traced_gap(method: Integrator, scenario: Scenario) -> float:
    """The traced Jacobian of each formula, away from its root."""
    from ..compiler.library import evaluate
    from ..solver.flow import Tally
    from ..solver.implicit_step import Rules, compiled_flows, constants_of, make_flows

    model = scenario.model
    constants, worst = constants_of(method, scenario), 0.0
    compiled = compiled_flows(method.flows, model.symbolic)
    flows = make_flows(method, model, scenario.bound, scenario.dt, constants, Tally(), Rules(), compiled)
    constants[0] = scenario.dt
    for flow, kernels in zip(flows, compiled, strict=True):
        n = flow.nx
        if n == 0:
            continue
        evaluate(flow.prologue, np.array(scenario.z0), constants, flow.w)
        x = 1e-2 * np.cos(np.arange(n))  # any point near the start: the formula is checked, not the root
        found = _matrix(kernels, kernels.full(flow.w, x)[n:])
        worst = max(worst, _gap(found, partial(_rows, kernels, flow.w), x))
    return worst


def _matrix(kernels: FlowKernels, entries: Any) -> Any:
    """The Jacobian, dense: of a large system the entries of its pattern."""
    n, pattern = kernels.n_unknowns, kernels.pattern
    if pattern is None:
        return entries[: n * n].reshape(n, n)
    found = np.zeros((n, n))
    found[np.repeat(np.arange(n), np.diff(pattern.first)), pattern.columns] = entries[: pattern.nnz]
    return found


def _rows(kernels: FlowKernels, work: Any, x: Any) -> Any:
    """The residual at x."""
    return kernels.full(work, np.ascontiguousarray(x))[: kernels.n_unknowns]


def _gap(found: Any, f: Callable[[Any], Any], x: Any) -> float:
    """Largest difference of a Jacobian to central differences, relative to its largest entry."""
    columns = []
    for i in range(len(x)):
        e = np.zeros(len(x))
        e[i] = 1e-5 * max(1.0, abs(x[i]))
        columns.append((f(x + e) - f(x - e)) / (2 * e[i]))
    differences = np.stack(columns, axis=-1)
    if np.shape(found) != differences.shape:
        return math.inf
    return float(np.abs(found - differences).max() / np.abs(differences).max())
