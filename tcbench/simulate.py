"""`simulate`: one integrator on one scenario. A failed run is data, not an exception."""

from __future__ import annotations

import math
import time
import traceback
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from . import march as m
from .errors import TcbenchError
from .flow import Flow, FlowKernels, build
from .integrator import Integrator
from .newton import FIRST_BLOCK, TABLE_WIDTH
from .scenario import Scenario
from .system import System
from .trajectory import SolverCounts, Summary, Trajectory

ENTROPY_TOLERANCE = 1e-13  # what one converged solve leaves over: a smaller fall is round-off
ENTROPY_FALL = 1e-10  # a fall beyond this is a failure of the second law
CHUNK = 100_000  # steps between looks at the clock and the keyboard

_STATUS = {
    m.OK: ("ok", ""),
    m.NONCONVERGED: ("nonconverged", "the solver found no root"),
    m.NO_ROOT: ("no_root", "the principal branch of solutions ended"),
    m.NONFINITE: ("nonfinite", "the new state is not finite"),
    m.COLLAPSED: ("unphysical", "an element collapsed (strain measure not positive)"),
    m.COLD: ("unphysical", "a temperature is not positive"),
    m.BLOWUP: ("blowup", "|E - E0| exceeded {factor:g} times the initial exergy V0 = {V0:.6g}"),
}


@dataclass
class Recorder:
    """Arrays that a run fills: one row each `every` steps."""

    states: np.ndarray
    records: np.ndarray
    counts: np.ndarray
    every: int

    @classmethod
    def for_steps(cls, steps: int, every: int, size: int, observables: int) -> Recorder:
        rows = steps // every + 2
        return cls(np.zeros((rows, size)), np.zeros((rows, observables)), np.zeros(rows, dtype=np.int64), every)


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
) -> Trajectory:
    """Run one integrator on one scenario.

    dt : step, the scenario's own by default; the last step ends at or just past t_end.
    tolerance : rtol of an adaptive solver (atol = rtol); it has no dt. Default 1e-6.
    continuation : False is plain Newton from z0, for comparison.
    record_every : keep every k-th state (None: the first and the last); the summary covers every step.
    residuals : also measure the residual of each accepted step (summary.residual_max).

    Returns a Trajectory, of failed runs too; raises TcbenchError for bad input only.
    """
    from . import plugins

    integrator = plugins.find_integrator(integrator)
    scenario = plugins.find_scenario(scenario)
    if t_end is not None and t_end != scenario.t_end:
        # the step asked for is checked against the horizon asked for
        scenario = scenario.replace(t_end=t_end)
    if integrator.kind == "adaptive":
        from .stepping import run_adaptive

        return run_adaptive(integrator, scenario, _checked_tolerance(tolerance))
    if tolerance is not None:
        raise TcbenchError(f"{integrator.name!r} takes a step dt, not a tolerance.")
    dt = checked_dt(scenario.dt if dt is None else dt, scenario)
    steps = scenario.steps(dt)
    every = max(1, steps) if record_every is None else int(record_every)
    if every < 1:
        raise TcbenchError(f"record_every must be at least 1, not {record_every!r}.")
    if integrator.kind == "step":
        from .stepping import run_step

        return run_step(integrator, scenario, dt, steps, every)
    return _run_flows(integrator, scenario, dt, steps, every, continuation, residuals)


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
    value = 1e-6 if tolerance is None else float(tolerance)
    if not (math.isfinite(value) and value > 0):
        raise TcbenchError(f"tolerance must be positive and finite, not {value:g}.")
    return value


@dataclass(frozen=True)
class Compiled:
    """An integrator's flows for one structure of system, in the form the compiled loop takes."""

    table: np.ndarray
    fractions: np.ndarray
    blocks: np.ndarray


@cache
def compiled_flows(flows: tuple[Flow, ...], structure: tuple) -> Compiled:
    """Trace and compile the flows of an integrator, once per structure of system."""
    system = _STRUCTURES[structure]
    kernels: dict[Any, FlowKernels] = {}
    rows, blocks = [], []
    for flow in flows:
        key = (flow.residual, flow.variables, flow.stages)
        k = kernels.get(key) or kernels.setdefault(key, build(flow, system))
        row = [k.prologue.address, k.iterate.address, k.polish.address, k.finish.address, k.full.address]
        sizes = [k.n_unknowns, k.n_eliminated, k.n_positive, max(1, k.prologue.size), max(1, k.iterate.size)]
        rows.append([*row, *sizes, len(blocks)])
        blocks.extend(k.blocks)
    table = np.array(rows, dtype=np.int64)
    assert table.shape[1] == TABLE_WIDTH and FIRST_BLOCK == TABLE_WIDTH - 1
    fractions = np.array([flow.fraction for flow in flows])
    return Compiled(table, fractions, np.array(blocks or [0], dtype=np.int64))


_STRUCTURES: dict[tuple, System] = {}


def _run_flows(
    integrator: Integrator, scenario: Scenario, dt: float, steps: int, every: int, continuation: bool, residuals: bool
) -> Trajectory:
    model = scenario.model
    _STRUCTURES.setdefault(model.structure, model)
    flows = compiled_flows(integrator.flows, model.structure)
    observe, n_observables = model.observer
    z, constants = scenario.z0.copy(), model.constant_values.copy()
    carry = np.zeros_like(z)
    recorder = Recorder.for_steps(steps, every, len(z), n_observables)
    observables = np.empty((3, n_observables))
    observables[:] = observe(z, constants)
    recorder.states[0], recorder.records[0] = z, observables[0]
    limits = run_limits(scenario)
    shape = np.array([
        model.n_positions, model.n_elements, len(model.invariant_names), observe.address,
        continuation, residuals, every,
    ], dtype=np.int64)  # fmt: skip
    summary = empty_summary(len(model.invariant_names))
    done, reason = 0, m.OK
    begin = time.perf_counter()
    if not m.march.signatures:  # the first call of a process loads or compiles the loop: that is no time of the run
        _advance(flows, z, carry, constants, dt, 0, 0, limits, shape, observables, recorder, summary)
        begin = time.perf_counter()
    while done < steps and reason == m.OK:
        stop = min(steps, done + CHUNK)
        reason, done = _advance(
            flows, z, carry, constants, dt, done, stop, limits, shape, observables, recorder, summary
        )
    wall = time.perf_counter() - begin
    status, failure = explain(reason, done, dt, scenario)
    return assemble(integrator, scenario, dt, done, recorder, summary, status, failure, wall, residuals)


def _advance(
    flows: Compiled, z: np.ndarray, carry: np.ndarray, constants: np.ndarray, dt: float, start: int, stop: int,
    limits: np.ndarray, shape: np.ndarray, observables: np.ndarray, recorder: Recorder, summary: np.ndarray,
) -> tuple[int, int]:  # fmt: skip
    """One call of the compiled loop; returns (why it ended, completed steps)."""
    return m.march(
        flows.table, flows.fractions, flows.blocks, z, carry, constants, dt, start, stop, limits,
        shape, observables, recorder.states, recorder.records, recorder.counts, summary,
    )  # fmt: skip


def run_limits(scenario: Scenario) -> np.ndarray:
    limits = np.empty(m.LIMITS_SIZE)
    limits[m.V0] = scenario.blowup_factor * scenario.initial_exergy
    limits[m.REFERENCE] = scenario.model.reference_temperature  # type: ignore[attr-defined]
    limits[m.ENTROPY_TOLERANCE], limits[m.ENTROPY_FALL] = ENTROPY_TOLERANCE, ENTROPY_FALL
    return limits


def empty_summary(invariants: int) -> np.ndarray:
    summary = np.zeros(m.MOMENTA + invariants)
    summary[m.ENTROPY_MIN] = np.inf
    summary[m.LYAPUNOV_MAX] = -np.inf
    return summary


def explain(reason: int, done: int, dt: float, scenario: Scenario) -> tuple[str, str]:
    """Status and sentence for the way a run ended."""
    status, cause = _STATUS[reason]
    if not cause:
        return status, ""
    # a state that exists but is unacceptable belongs to a completed step; otherwise the next step failed
    step = done if reason in (m.COLLAPSED, m.COLD, m.BLOWUP) else done + 1
    cause = cause.format(factor=scenario.blowup_factor, V0=scenario.initial_exergy)
    return status, f"step {step} (t = {step * dt:.6g}, dt = {dt:g}): {cause}"


def assemble(
    integrator: Integrator,
    scenario: Scenario,
    dt: float,
    done: int,
    recorder: Recorder,
    summary: np.ndarray,
    status: str,
    failure: str,
    wall: float,
    residuals: bool,
    solver: SolverCounts | None = None,
) -> Trajectory:
    """The Trajectory of the completed steps."""
    rows = -(-done // recorder.every) + 1
    t = np.minimum(np.arange(rows) * recorder.every, done) * dt
    names, n = scenario.model.invariant_names, scenario.model.n_elements
    observed = recorder.records[:rows]
    first = m.FIRST_INVARIANT
    return Trajectory(
        integrator=integrator, scenario=scenario, dt=dt, t=t, z=recorder.states[:rows],
        energy=observed[:, m.E], entropy=observed[:, m.S],
        invariants={name: observed[:, first + i] for i, name in enumerate(names)},
        temperatures=observed[:, first + len(names) : first + len(names) + n],
        status=status, failure=failure, steps=done, newton_iterations=recorder.counts[: rows - 1],
        wall_time_s=wall, summary=summarise(summary, names, done, dt, residuals),
        solver=solver or SolverCounts(
            newton_iterations=int(summary[m.ITERATIONS]), retried=int(summary[m.RETRIED]),
            tracked=int(summary[m.TRACKED]), continuation_tries=int(summary[m.TRACK_TRIES_SUM]),
        ),
    )  # fmt: skip


def summarise(s: np.ndarray, names: tuple[str, ...], steps: int, dt: float, residuals: bool) -> Summary:
    spread = steps * s[m.SUM_TT] - s[m.SUM_T] ** 2
    drift = (steps * s[m.SUM_TE] - s[m.SUM_T] * s[m.SUM_E]) / spread if steps > 1 and spread > 0 else math.nan
    nan = math.nan
    return Summary(
        energy_error_max=float(s[m.ENERGY_ERROR]) if steps else nan,
        energy_drift=float(drift),
        entropy_increment_min=float(s[m.ENTROPY_MIN]) if steps else nan,
        second_law_violations=int(s[m.VIOLATIONS]),
        first_entropy_fall=float(s[m.FIRST_FALL]) * dt if s[m.FIRST_FALL] else nan,
        lyapunov_increment_max=float(s[m.LYAPUNOV_MAX]) if steps else nan,
        invariant_error_max={name: float(s[m.MOMENTA + i]) if steps else nan for i, name in enumerate(names)},
        residual_max=float(s[m.RESIDUAL_MAX]) if residuals and steps else nan,
    )


def exception_sentence(error: BaseException, step: int, t: float) -> str:
    """One line for an exception in a plugin: type, message, and the last line of its own code."""
    frames = traceback.extract_tb(error.__traceback__)
    where = f" at {frames[-1].filename.rsplit('/', 1)[-1]}:{frames[-1].lineno}" if frames else ""
    message = str(error).splitlines()[0][:300] if str(error) else ""
    return f"step {step} (t = {t:.6g}): {type(error).__name__}{': ' + message if message else ''}{where}"
