"""Workspaces of compiled runs, made once for a method on a system and used again by later runs."""

from __future__ import annotations

import math
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from ..compiler.records import Rows
from ..integrator import Integrator
from ..solver.equations import states_of
from ..solver.flow import CompiledFlow, Tally
from ..solver.implicit_step import Rules, make_flows, set_length
from ..solver.kernels_of_flow import FlowKernels
from ..systems.magnitudes import entropy_size
from ..systems.scenario import Scenario
from ..systems.system import System
from .compiled_loop import LOOPS, Run

ENTROPY_TOLERANCE = 1e-13  # relative fall of S that a converged solve leaves: round-off
ENTROPY_FALL = 1e-10  # a larger relative fall is a failure of the second law
MOST_METHODS = 100  # of a system whose workspaces are kept
FEW_ROWS = 100  # of records in a workspace that is kept
LARGE = 1000  # length of a state whose records are allocated anew: they cost memory rather than time

_NO_STEP = Tally(entropy_min=math.inf, lyapunov_max=-math.inf)


class Prepared:
    """The workspace of a run: its `Run`, its `Tally` and the flows of its method, none of a method in plain Python.

    run.c is laid out as `implicit_step.constants_of` has it.
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
        states = 0 if method is None else method.memory or max(map(states_of, method.flows or ()), default=0)
        count = len(model.constant_values)
        c, self.tally = np.ones(count + states * model.size), Tally()
        c[:count] = model.constant_values
        self.constants = c[:count]
        self.others = c[count:].reshape(-1, model.size)  # one state a row
        self.rules, self.bound = Rules(), math.inf
        self.flows: list[tuple[CompiledFlow, FlowKernels, float]] = []
        fields: dict[str, Any] = {"n_mended": 0}
        if method is not None:
            opening, n_fixed = kernels[0].opening, kernels[0].opening.size - n_observables
            rows = Rows(make_flows(method, model, math.inf, 1.0, c, self.tally, self.rules, kernels))
            fields |= {
                "opening": opening.address, "opened": rows[0].w[n_fixed : opening.size],
                "n_flows": len(kernels) - (method.flows[-1].most > 1),
                "of_step": any(flow.of_step for flow in method.flows), "memory": method.memory, "flows": rows,
                "mends": kernels[-1].mends, "n_mended": model.size * kernels[-1].mends,
                "holds": "angular_momentum" in method.claims,
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
        """Forget all earlier runs."""
        self.tally.table[...] = _NO_STEP.table  # takes half the time of [:]
        self.run.clear()
        for flow, _, _ in self.flows:
            flow.clear()

    def set_length(self, h: float) -> None:
        """Set the length h of steps, and compute what depends on h and the constants only."""
        self.run.h = h
        for flow, kernels, fraction in self.flows:
            set_length(flow, kernels, fraction * h)

    def set_rules(self, rules: Rules, bound: float) -> None:
        """Set how the flows are solved; bound : the energy error beyond which a root is refused."""
        if (rules, bound) == (self.rules, self.bound):
            return
        self.rules, self.bound = rules, bound
        self.run.residuals, self.run.bound = rules.residuals, bound
        for flow, _, _ in self.flows:
            flow.continuation, flow.audit, flow.residuals = rules.continuation, rules.audit, rules.residuals
            flow.bound = bound

    def start(self, scenario: Scenario, dt: float, steps: int, every: int, rules: Rules) -> Run:
        """Set the run to the start of a scenario, with room for a record each `every` steps."""
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
        """Make the workspace free for other runs; long records are released."""
        if self.free is not None:
            if self.run.n_rows > FEW_ROWS:
                self.run.make_room(2)
            self.free.append(self)

    def step(self, z: Any) -> int:
        """Take one step from z (n,), as the first of a run, to run.z; returns OK or why there is no step."""
        run = self.run
        run.z[...], run.carry[...], self.others[...] = z, 0.0, z
        if run.of_step:
            self.set_length(run.h)  # what is hoisted may depend on the start of the run
            LOOPS.begin(run)
        return int(LOOPS.march(run, 0, 1))


# by system and identity of the kernels: free workspaces, which refer to no system, so that they go with theirs
_FREE: WeakKeyDictionary[System, dict[int, tuple[tuple[FlowKernels, ...], list[Prepared]]]] = WeakKeyDictionary()


def take(method: Integrator | None, system: System, kernels: tuple[FlowKernels, ...]) -> Prepared:
    """A free workspace of a method with these kernels on a system, or a new one; the caller gives it back.

    kernels is one object for formulas of one content on one structure of system: what was traced anew finds nothing.
    """
    kept = _FREE.get(system)
    if kept is None:
        kept = _FREE[system] = {}
    entry = kept.get(id(kernels))
    if entry is None:
        if len(kept) >= MOST_METHODS:
            kept.clear()
        entry = kept[id(kernels)] = kernels, []
    free = entry[1]
    try:
        return free.pop()  # atomic: of two threads each gets another
    except IndexError:
        return Prepared(system, method, kernels, free)
