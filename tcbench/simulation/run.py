"""`simulate`: one integrator on one scenario. A failed run is data, not an exception."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from ..compiler.code_hash import content_hash
from ..compiler.jit import cache_folder
from ..errors import TcbenchError
from ..integrator import Flow, Integrator
from ..solver.flow_kernels import FlowKernels, build
from ..solver.newton import ND, NOW, NW, NX, TABLE_WIDTH
from ..systems.scenario import Scenario
from ..systems.system import System
from . import compiled_loop as m
from .python_loop import run_adaptive, run_step
from .recorder import Recorder, assemble, empty_summary, explain, run_limits
from .trajectory import Trajectory


def before_compiling() -> None:
    """Called before the time loop is compiled, which takes some ten seconds, once: the command line says so."""


MOST_GIB = 16.0  # of recorded states, more of which would hardly be meant
CHUNK = 100_000  # steps between looks at the clock and the keyboard


def simulate(
    integrator: str | Integrator,
    scenario: str | Scenario,
    dt: float | None = None,
    t_end: float | None = None,
    *,
    tolerance: float | None = None,
    continuation: bool = True,
    record_every: int | None = 1,
    residuals: bool = False,
    audit_roots: bool = False,
) -> Trajectory:
    """Run one integrator on one scenario.

    dt : step, the scenario's own by default; the last step ends at or just past t_end. An adaptive solver has none.
    tolerance : rtol of an adaptive solver (atol = rtol); it has no dt. Default 1e-6.
    continuation : True: Newton, then natural tracking in h, then pseudo-arclength through folds, so that a step fails
        only when it has no root (docs/stability.md). False: plain Newton from z0 (20 iterations), for comparison.
    record_every : keep every k-th state (None: the first and the last); the summary covers every step. An adaptive run
        is always reported at 200 times.
    residuals : also measure the residual of each accepted step (summary.residual_max).
    audit_roots : follow the arc at every step and count accepted roots that are not the principal one
        (solver.wrong_roots of solver.audited solves); some 50 times slower, the run itself is unchanged.

    Returns a Trajectory, of failed runs too; raises TcbenchError for bad input only.
    """
    from .. import plugins

    integrator = plugins.find_integrator(integrator)
    scenario = plugins.find_scenario(scenario).current()
    if t_end is not None and t_end != scenario.t_end:
        # the step asked for is checked against the horizon asked for
        scenario = scenario.replace(t_end=t_end)
    if reason := integrator.lacks or integrator.suits(scenario.model):
        raise TcbenchError(f"{integrator.name!r} cannot run on {scenario.name!r}: {reason}.")
    if integrator.kind == "adaptive":
        return run_adaptive(integrator, scenario, _checked_tolerance(tolerance))
    if tolerance is not None:
        raise TcbenchError(f"{integrator.name!r} takes a step dt, not a tolerance.")
    dt = checked_dt(scenario.dt if dt is None else dt, scenario)
    steps = scenario.steps(dt)
    if record_every is not None and not (isinstance(record_every, int | np.integer) and record_every >= 1):
        raise TcbenchError(f"record_every must be a whole number, at least 1, not {record_every!r}.")
    every = max(1, steps) if record_every is None else int(record_every)
    kept = (steps // every + 2) * (scenario.model.size + 2 * scenario.model.n_elements + 3) * 8 / 2**30
    if kept > MOST_GIB:
        raise TcbenchError(
            f"{steps} steps of {dt:g} would keep {kept:.0f} GiB of states; give record_every= a larger number."
        )
    if integrator.kind == "step":
        return run_step(integrator, scenario, dt, steps, every)
    audit = m.COUNT_WRONG if audit_roots else m.NO_AUDIT
    return run_flows(integrator, scenario, dt, steps, every, continuation, residuals, audit)


def checked_dt(dt: Any, scenario: Scenario) -> float:
    """dt as a float, or the error that says what is wrong with it."""
    try:
        value = float(dt)
    except (TypeError, ValueError):
        raise TcbenchError(f"dt must be a number, not {dt!r}.") from None
    if not (math.isfinite(value) and value > 0):
        raise TcbenchError(f"dt must be positive and finite, not {value:g}.")
    if value > scenario.t_end * (1 + 1e-12):
        raise TcbenchError(
            f"dt = {value:g} is longer than the horizon t_end = {scenario.t_end:g} of {scenario.name!r}."
        )
    return value


def _checked_tolerance(tolerance: float | None) -> float:
    try:
        value = 1e-6 if tolerance is None else float(tolerance)
    except (TypeError, ValueError):
        raise TcbenchError(f"tolerance must be a number, not {tolerance!r}.") from None
    if not (math.isfinite(value) and value > 0):
        raise TcbenchError(f"tolerance must be positive and finite, not {value:g}.")
    return value


@dataclass(frozen=True)
class Compiled:
    """An integrator's flows for one structure of system, in the form the compiled loop takes."""

    table: np.ndarray
    fractions: np.ndarray
    kernels: tuple[FlowKernels, ...]


def compiled_flows(flows: tuple[Flow, ...], structure: tuple) -> Compiled:
    """The flows of an integrator for a structure of system; traced and compiled again when what they read changed."""
    formulas = content_hash(flows)
    return _compiled_flows(flows, structure, formulas) if formulas else _compiled_flows.__wrapped__(flows, structure)


@cache
def _compiled_flows(flows: tuple[Flow, ...], structure: tuple, formulas: str = "") -> Compiled:
    system = _STRUCTURES[structure]
    kernels: dict[Any, FlowKernels] = {}
    rows: list[list[int]] = []
    chosen: list[FlowKernels] = []
    for flow in flows:
        key = (flow.residual, flow.variables, flow.stages, flow.of_step)
        k = kernels.get(key) or kernels.setdefault(key, build(flow, system))
        chosen.append(k)
        opening = k.opening.address if len(rows) == 0 else 0
        addresses = [k.prologue.address, k.iterate.address, k.polish.address, k.finish.address, k.full.address, opening]
        work = k.opening.size + k.setup.size
        rows.append([*addresses, k.n_unknowns, k.n_eliminated, k.n_positive, work, k.iterate.size, k.prologue.size])
    table = np.array(rows, dtype=np.int64)
    assert table.shape[1] == TABLE_WIDTH
    return Compiled(table, np.array([flow.fraction for flow in flows]), tuple(chosen))


@dataclass(frozen=True)
class Workspace:
    """Arrays of the compiled loop, in the order of its last arguments."""

    works: np.ndarray
    x: np.ndarray
    d: np.ndarray
    dz: np.ndarray
    a: np.ndarray
    trial: np.ndarray
    scale: np.ndarray
    full: np.ndarray
    old: np.ndarray
    known: np.ndarray
    accepted: np.ndarray
    seen: np.ndarray
    points: np.ndarray
    A: np.ndarray

    @classmethod
    def of(cls, flows: Compiled, constants: np.ndarray, dt: float, size: int, observables: int) -> Workspace:
        table = flows.table
        unknowns = max(1, int(table[:, NX].max()))
        corrections = max(1, int(table[:, ND].max()))
        works = np.zeros((len(table), int(table[:, NW].max())))
        given = constants.copy()
        for work, kernels, fraction in zip(works, flows.kernels, flows.fractions, strict=True):
            if kernels.setup.size:
                first, given[0] = kernels.opening.size, fraction * dt
                work[first : first + kernels.setup.size] = kernels.setup(given, given)
        return cls(
            works, np.zeros(unknowns), np.zeros(corrections), np.zeros(size), np.zeros(size), np.zeros(size),
            np.zeros(corrections), np.zeros(unknowns * (unknowns + 2)), np.zeros(unknowns), np.zeros(unknowns),
            np.zeros(size), np.zeros((2, observables)), np.zeros((4, unknowns + 1)),
            np.zeros((unknowns + 1, unknowns + 3)),
        )  # fmt: skip


_STRUCTURES: dict[tuple, System] = {}


def run_flows(
    integrator: Integrator,
    scenario: Scenario,
    dt: float,
    steps: int,
    every: int,
    continuation: bool = True,
    residuals: bool = False,
    audit: int = m.NO_AUDIT,
) -> Trajectory:
    """`simulate` for an integrator of the kind "flows", its input checked; audit: see march.AUDIT."""
    model = scenario.model
    _STRUCTURES.setdefault(model.structure, model)
    flows = compiled_flows(integrator.flows, model.structure)
    observe, n_observables = model.observer
    z, constants = scenario.z0.copy(), np.concatenate([model.constant_values, scenario.z0, scenario.z0])
    carry = np.zeros_like(z)
    recorder = Recorder.for_steps(steps, every, len(z), n_observables)
    workspace = Workspace.of(flows, constants, dt, len(z), n_observables)
    # observed by the kernel that observes every step: the same round-off in E0 as in E
    of_step = any(flow.of_step for flow in integrator.flows)
    m.open_step(flows.table, flows.fractions, z, constants, dt, workspace.works, of_step)
    observables = np.tile(workspace.works[0, flows.table[0, NOW] :][:n_observables], (2, 1))
    recorder.states[0], recorder.records[0] = z, observables[0]
    limits = run_limits(scenario)
    shape = np.array([
        model.n_positions, model.n_elements, len(model.invariant_names), observe.address,
        continuation, residuals, every, audit, of_step,
    ], dtype=np.int64)  # fmt: skip
    summary = empty_summary(len(model.invariant_names))
    done, reason = 0, m.OK
    begin = time.perf_counter()
    if not getattr(m.march, "signatures", True):  # loading or compiling the loop is no time of the run
        if not any(cache_folder().rglob("march.march-*.nbi")):
            before_compiling()
        _advance(flows, z, carry, constants, dt, 0, 0, limits, shape, observables, recorder, summary, workspace)
        begin = time.perf_counter()
    while done < steps and reason == m.OK:
        stop = min(steps, done + CHUNK)
        reason, done = _advance(
            flows, z, carry, constants, dt, done, stop, limits, shape, observables, recorder, summary, workspace
        )
    wall = time.perf_counter() - begin
    status, failure = explain(reason, done, dt, scenario)
    return assemble(integrator, scenario, dt, done, recorder, summary, status, failure, wall, residuals)


def _advance(
    flows: Compiled, z: np.ndarray, carry: np.ndarray, constants: np.ndarray, dt: float, start: int, stop: int,
    limits: np.ndarray, shape: np.ndarray, observables: np.ndarray, recorder: Recorder, summary: np.ndarray,
    workspace: Workspace,
) -> tuple[int, int]:  # fmt: skip
    """One call of the compiled loop; returns (why it ended, completed steps)."""
    w = workspace
    return m.march(
        flows.table, flows.fractions, z, carry, constants, dt, start, stop, limits,
        shape, observables, recorder.states, recorder.records, recorder.counts, summary,
        w.works, w.x, w.d, w.dz, w.a, w.trial, w.scale, w.full, w.old, w.known, w.accepted,
        w.seen, w.points, w.A,
    )  # fmt: skip
