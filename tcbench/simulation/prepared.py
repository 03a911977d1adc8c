"""Workspaces of compiled runs, made once for a method on a system and used again by later runs."""

from __future__ import annotations

import math
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from ..compiler.records import Rows
from ..integrator import Integrator
from ..solver.flow import CompiledFlow, Tally
from ..solver.implicit_step import Rules, make_flows, set_length
from ..solver.kernels_of_flow import FlowKernels
from ..systems.magnitudes import entropy_size
from ..systems.scenario import Scenario
from ..systems.system import System
from .compiled_loop import LOOPS, Run

ENTROPY_TOLERANCE = 1e-13  # what one converged solve leaves over: a smaller fall is round-off
ENTROPY_FALL = 1e-10  # a fall beyond this is a failure of the second law
MOST_METHODS = 100  # that records are kept of, for each system
FEW_ROWS = 100  # of records that may stay in memory
LARGE = 1000  # length of a state whose records are made anew: they are memory rather than time

_NO_STEP = Tally(entropy_min=math.inf, lyapunov_max=-math.inf)


class Prepared:
    """A Run with its Tally, and the flows of a method; of a method in plain Python (no kernels) there are none.

    run.c is as of `implicit_step.constants_of`.
    """

    def __init__(
        self,
        model: System,
        method: Integrator | None = None,
        kernels: tuple[FlowKernels, ...] = (),
        free: list[Prepared] | None = None,
    ) -> None:
        self.free = free if model.size <= LARGE else None
        observe, n_observables = model.observer
        states = 0 if method is None else method.memory or 2
        count = len(model.constant_values)
        c, self.tally = np.ones(count + states * model.size), Tally()
        c[:count] = model.constant_values
        self.constants = c[:count]  # parts of c
        self.others = c[count:].reshape(-1, model.size)  # a row is of a state
        self.rules, self.bound = Rules(), math.inf
        self.flows: list[tuple[CompiledFlow, FlowKernels, float]] = []
        fields: dict[str, Any] = {}
        if method is not None:
            opening, n_fixed = kernels[0].opening, kernels[0].opening.size - n_observables
            rows = Rows(make_flows(method, model, math.inf, 1.0, c, self.tally, self.rules, kernels))
            fields = {
                "opening": opening.address, "opened": rows[0].w[n_fixed : opening.size],
                "n_flows": len(kernels) - (method.flows[-1].most > 1),
                "of_step": any(flow.of_step for flow in method.flows), "memory": method.memory, "flows": rows,
                "mends": kernels[-1].mends, "holds": "angular_momentum" in method.claims,
            }  # fmt: skip
            self.flows = [(*pair, f.fraction) for *pair, f in zip(rows.records, kernels, method.flows, strict=True)]
        self.run = Run(
            n=model.size, n_elements=model.n_temperatures, n_invariants=len(model.invariant_names), n_rows=0,
            every=1, n_observables=n_observables, n_constants=len(c), n_others=states, observe=observe.address,
            bound=math.inf, h=1.0,
            reference=model.reference_temperature, entropy_tolerance=ENTROPY_TOLERANCE, entropy_fall=ENTROPY_FALL,
            entropy_size=entropy_size(model),
            c=c, others=self.others, tally=self.tally, magnitudes=model.law_magnitudes, **fields,
        )  # fmt: skip
        self.run.make_room(2)
        self.way = "; ".join(dict.fromkeys(k.way for k in kernels))

    def clear(self) -> None:
        """As if nothing had run yet."""
        self.tally.table[...] = _NO_STEP.table  # half of the time of [:]
        self.run.clear()
        for flow, _, _ in self.flows:
            flow.clear()

    def set_length(self, h: float) -> None:
        """Steps of length h, with what depends on h and the constants only."""
        self.run.h = h
        for flow, kernels, fraction in self.flows:
            set_length(flow, kernels, fraction * h)

    def set_rules(self, rules: Rules, bound: float) -> None:
        """How the flows are solved; bound: of the energy error."""
        if (rules, bound) == (self.rules, self.bound):
            return
        self.rules, self.bound = rules, bound
        self.run.residuals, self.run.bound = rules.residuals, bound
        for flow, _, _ in self.flows:
            flow.continuation, flow.audit, flow.residuals = rules.continuation, rules.audit, rules.residuals
            flow.bound = bound

    def start(self, scenario: Scenario, dt: float, steps: int, every: int, rules: Rules) -> Run:
        """Everything at the start of a scenario, with room for a row each `every` steps."""
        run, z0 = self.run, scenario.z0
        self.clear()
        self.set_rules(rules, scenario.bound)
        run.every = every
        run.make_room(steps // every + 2)
        self.constants[...], run.z[...] = scenario.model.constant_values, z0
        self.others[...] = 0.0 if run.memory else z0
        self.set_length(dt)
        return run

    def give_back(self) -> None:
        """For the next call, without what this one recorded."""
        if self.free is not None:
            if self.run.n_rows > FEW_ROWS:
                self.run.make_room(2)
            self.free.append(self)

    def step(self, z: Any) -> int:
        """One step from z, as if a run began there, to run.z; returns why there is none, or OK."""
        run = self.run
        run.z[...], run.carry[...], self.others[...] = z, 0.0, z
        if run.of_step:
            self.set_length(run.h)  # with what depends on the start of the run
            LOOPS.begin(run)
        return int(LOOPS.march(run, 0, 1))


# by the identity of the kernels, records that nobody uses; they refer to no system, so that one that is gone takes
# them along
_KEPT: WeakKeyDictionary[System, dict[int, tuple[tuple[FlowKernels, ...], list[Prepared]]]] = WeakKeyDictionary()


def take(method: Integrator | None, system: System, kernels: tuple[FlowKernels, ...]) -> Prepared:
    """Records of a method with these kernels on a system, to be given back.

    kernels is one object for formulas of one content on one structure of system: what was traced anew finds nothing.
    """
    kept = _KEPT.get(system)
    if kept is None:
        kept = _KEPT[system] = {}
    entry = kept.get(id(kernels))
    if entry is None:
        if len(kept) >= MOST_METHODS:
            kept.clear()
        entry = kept[id(kernels)] = kernels, []
    free = entry[1]
    try:
        return free.pop()  # by one thread at a time
    except IndexError:
        return Prepared(system, method, kernels, free)
