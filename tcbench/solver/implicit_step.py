"""One implicit flow of one step: which solver is tried after which; and a method's flows set up for a system.

`quick` solves nearly every step; what it rejects goes to `newton`, `track` and `arc`, one after the other.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..compiler.caches import cached
from ..compiler.formula_hash import formula_hash
from ..compiler.language import Floats, copy_into, late, release, scratch
from ..compiler.library import evaluate
from ..integrator import Flow, Integrator
from ..systems.scenario import Scenario
from ..systems.system import System
from .continuation import COLD_ROOT, FOUND, LOST, UNDETERMINED, arc, detour
from .flow import CompiledFlow, Extrapolation, OldFactors, Tally
from .flow_kernels import build
from .kernels_of_flow import FlowKernels, constants
from .newton import ACCEPTED, NEGLIGIBLE, REJECTED, newton, set_step, track

# why there is no step (Trajectory turns these, and those of the loop, into statuses and sentences)
OK, NONCONVERGED, NO_ROOT, NONFINITE, COLLAPSED, COLD, BLOWUP, NO_WARM_ROOT, FOLDED = range(9)

# what follows the arc at every step: the audit counts accepted roots that are not the principal one; the other two take
# the arc's root itself, and the last ends the run at the first fold
NO_AUDIT, COUNT_WRONG, PRINCIPAL, STOP_AT_FOLD = range(4)
SAME_ROOT = 1e-6  # scaled distance below which two roots are one


@late
def solve_flow(flow: CompiledFlow, here: Floats, solved: bool) -> tuple[int, int]:
    """Increments dz of one flow of one step from `here`; returns (OK or why there are none, Newton iterations).

    solved: `quick` has done it, and its root, in x, is only to be audited.
    """
    tally, factors = flow.tally, scratch(flow.nnz)
    copy_into(flow.start, here)
    flow.kept.lost = 0.0
    for k in range(flow.nnz):
        factors[k] = flow.factors[k]
    set_step(flow, 1.0)
    copy_into(flow.scale, flow.inverse_sizes)
    code, total = ACCEPTED if solved else REJECTED, 0
    if flow.audit < PRINCIPAL and not solved:  # else the arc's root, whatever Newton would find
        copy_into(flow.x, flow.at_rest)  # z1 = z0
        code, total = newton(flow, NEGLIGIBLE, 0.0, flow.continuation)
        if code == ACCEPTED and flow.continuation:
            tally.retried += 1
        elif flow.continuation:
            code, count, tries = track(flow)
            total += count
            tally.tracked += 1
            tally.tries += tries
    reason = OK if code == ACCEPTED else NONCONVERGED
    if code != ACCEPTED and flow.too_large:
        return NONCONVERGED, total  # the arc asks for factors
    if (code != ACCEPTED and flow.continuation) or flow.audit != NO_AUDIT:
        reason, count = by_arc(flow, reason)
        total += count
    for k in range(flow.nnz if solved else 0):  # what is only audited goes on as without
        flow.factors[k] = factors[k]
    if not solved:
        flow.kept.made_in = 0.0  # the factors that are there now are of another step
    release(factors)
    return reason, total


@late
def by_arc(flow: CompiledFlow, reason: int) -> tuple[int, int]:
    """The arc's root into x and dz; returns (OK, FOLDED or why there is none, Jacobians).

    Where plain Newton gave up, or a root was accepted and is being audited, the arc's answer is only counted: x, dz and
    `reason` stay as they were. An arc that is undetermined proves nothing: such a root does not count as audited.
    """
    tally = flow.tally
    copy_into(flow.old, flow.x)
    copy_into(flow.accepted, flow.dz)
    code, jacobians, folds = arc(flow)
    tally.folds += folds
    if flow.audit >= PRINCIPAL or (reason != OK and flow.continuation):
        tally.arcs += 1
        if folds > 0 and flow.audit == STOP_AT_FOLD:
            return FOLDED, jacobians
        if code == FOUND:
            if flow.audit == COUNT_WRONG:
                tally.audited += 1  # the principal root by construction
            return OK, jacobians
        if code != COLD_ROOT and flow.audit < PRINCIPAL:
            found, more = detour(flow)
            jacobians += more
            if found == FOUND:
                return OK, jacobians
        return (NO_ROOT if code == LOST else NO_WARM_ROOT if code == COLD_ROOT else NONCONVERGED), jacobians
    if reason == OK and code != UNDETERMINED:
        tally.audited += 1
        wrong = code != FOUND
        for i in range(flow.nx):
            if abs(flow.old[i] - flow.x[i]) * flow.scale[i] > SAME_ROOT:
                wrong = True
        if wrong:
            tally.wrong_roots += 1
    copy_into(flow.x, flow.old)
    copy_into(flow.dz, flow.accepted)
    return reason, 0


# a method's flows on a system --------------------------------------------------------------------------------------


def compiled_flows(formulas: tuple[Flow, ...], symbolic: System) -> tuple[FlowKernels, ...]:
    """The kernels of a method's flows for a structure of system; traced again when what the formulas read changed."""
    seen = tuple([formula_hash(f.residual) for f in formulas])
    make = _compiled_flows.__wrapped__ if None in seen else _compiled_flows  # type: ignore[attr-defined]
    return make(formulas, symbolic, seen)


@cached
def _compiled_flows(
    formulas: tuple[Flow, ...], symbolic: System, seen: tuple[str | None, ...]
) -> tuple[FlowKernels, ...]:
    """Equal formulas share their kernels."""
    made: dict[Any, FlowKernels] = {}
    chosen = []
    for flow in formulas:
        key = (flow.residual, flow.variables, flow.stages, flow.numbers, flow.chosen, flow.of_step, flow.memory)
        chosen.append(made.get(key) or made.setdefault(key, build(flow, symbolic)))
    return tuple(chosen)


def constants_of(integrator: Integrator, scenario: Scenario) -> np.ndarray:
    """(h, constants, the magnitudes of the variables, two states: those at the start of the step and of the run, and
    what corrections have moved); of a multistep method, in place of the states, the slopes (earlier state - z)/h."""
    z0 = scenario.z0
    further = [np.zeros(integrator.memory * len(z0))] if integrator.memory else [z0, z0, np.zeros(len(z0))]
    return constants(scenario.model, 0.0, *further)


class Rules(NamedTuple):
    """How the flows of a run are solved."""

    continuation: bool = True
    residuals: bool = False
    audit: int = NO_AUDIT


def make_flows(
    integrator: Integrator,
    model: System,
    bound: float,
    dt: float,
    c: np.ndarray,
    tally: Tally,
    rules: Rules,
    kernels: tuple[FlowKernels, ...],
) -> list[CompiledFlow]:
    """The flows of a method on a system, ready for a step dt. c: constants, which all of them share; bound: of the
    energy error."""
    observe, n_observables = model.observer
    flows = []
    for formula, k in zip(integrator.flows, kernels, strict=True):
        flow = CompiledFlow(
            **k.fields, n=model.size, n_constants=len(c), n_observables=n_observables, most=formula.most,
            observe=observe.address,
            continuation=rules.continuation, audit=rules.audit, residuals=rules.residuals,
            reference=model.reference_temperature, least_energy=model.energy_magnitude,
            least_entropy=model.entropy_magnitude, bound=bound, tally=tally, c=c,
            foreseen=Extrapolation(), kept=OldFactors(),
        )  # fmt: skip
        set_length(flow, k, formula.fraction * dt)
        flows.append(flow)
    return flows


def set_length(flow: CompiledFlow, kernels: FlowKernels, h: float) -> None:
    """Make the flow one of length h, with what depends on h and the constants only."""
    flow.h = h
    if kernels.setup.size:
        flow.c[0] = h
        evaluate(kernels.setup.address, flow.c, flow.c, flow.w[kernels.opening.size :])
