"""Integrators with one unknown, whose roots are known: they move one momentum and leave the rest of the state alone."""

from collections.abc import Callable
from typing import Any

import numpy as np

from tcbench import Integrator
from tcbench.compiler.jit import evaluate
from tcbench.simulation.run import _STRUCTURES, compiled_flows
from tcbench.simulation.run import Workspace as Buffers
from tcbench.solver.continuation import arc
from tcbench.solver.newton import NX, PROLOGUE
from tcbench.systems.scenario import Scenario

MOVED = 4  # the first momentum


def scalar(name: str, equation: Callable[[Any, Any], Any]) -> Integrator:
    """The integrator that solves equation(d, h) = 0 for the increment d of one momentum."""

    def residual(z0, z1, h, system):
        d = np.asarray(z1 - z0)
        return np.array([equation(d[i], h) if i == MOVED else d[i] for i in range(len(d))])

    return Integrator(name=name, order=1, flows=residual)


def parabola(d, h):
    """Roots h = d / (1 + d^2): they merge at d = 1, h = 1/2, and beyond there is none; the lost one has d ~ 1/h."""
    return d - h * (1 + d * d)


CUBIC = (1.0, -3.0, 2.5)  # h = d^3 - 3 d^2 + 2.5 d folds at d = 1 -+ 0.408, where h = 0.636 and 0.364


def cubic(d, h):
    return d * (CUBIC[2] + d * (CUBIC[1] + d * CUBIC[0])) - h


def logarithm(d, h):
    """log(1 + d) + d = 2 h: not finite for d <= -1."""
    return np.log(1 + d) + d - 2 * h


class Workspace:
    """One flow ready to be solved: what `march` sets up before a step."""

    def __init__(self, integrator: Integrator, scenario: Scenario, h: float) -> None:
        model = scenario.model
        _STRUCTURES.setdefault(model.structure, model)
        compiled = compiled_flows(integrator.flows, model.structure)
        self.flow, self.z, self.h = compiled.table[0], scenario.z0.copy(), h
        n = self.n = int(self.flow[NX])
        self.c = model.constant_values.copy()
        buffers = Buffers.of(compiled, self.c, h, len(self.z), model.observer[1])
        self.w, self.d, self.x, self.full, self.dz = buffers.works[0], buffers.d, buffers.x, buffers.full, buffers.dz
        self.space = (buffers.points, buffers.A)
        self.c[0] = h
        evaluate(int(self.flow[PROLOGUE]), self.z, self.c, self.w)
        self.scale = self.w[2 * n : 2 * n + n]
        kernel, size = model.observer
        self.gauge = (kernel.address, 300.0, scenario.initial_exergy, np.zeros((2, size)))

    def newton(self, function: Any, start: float) -> tuple[int, int]:
        """(code, iterations) of newton or plain_newton from this value of the unknown; the root is in x[0]."""
        self.x[0] = start
        return function(self.flow, self.w, self.x, self.scale, self.d, self.full, self.dz)

    def arc(self) -> tuple[int, int, int]:
        """(code, Jacobians, folds); the root is in x."""
        return arc(
            self.flow,
            self.z,
            self.dz,
            self.c,
            self.h,
            self.w,
            self.x,
            self.scale,
            self.d,
            self.full,
            *self.gauge,
            *self.space,
        )
