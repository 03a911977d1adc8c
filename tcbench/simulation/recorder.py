"""What every kind of run records, and how it becomes a Trajectory."""

from __future__ import annotations

import math
import traceback
from dataclasses import dataclass

import numpy as np

from ..integrator import Integrator
from ..systems.scenario import Scenario
from . import compiled_loop as m
from .trajectory import SolverCounts, Summary, Trajectory

ENTROPY_TOLERANCE = 1e-13  # what one converged solve leaves over: a smaller fall is round-off
ENTROPY_FALL = 1e-10  # a fall beyond this is a failure of the second law

_STATUS = {
    m.OK: ("ok", ""),
    m.NONCONVERGED: ("nonconverged", "the solver found no root"),
    m.NO_ROOT: ("no_root", "the principal branch of solutions ended"),
    m.NONFINITE: ("nonfinite", "the new state is not finite"),
    m.COLLAPSED: ("unphysical", "an element collapsed (strain measure not positive)"),
    m.COLD: ("unphysical", "a temperature is not positive"),
    m.NO_WARM_ROOT: ("unphysical", "the principal root has a temperature that is not positive"),
    m.FOLDED: ("ok", ""),  # the run was to end at the first fold
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
    step = done if reason == m.BLOWUP else done + 1  # the state of a blow-up exists; otherwise the next step failed
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
            arcs=int(summary[m.ARCS]), folds=int(summary[m.FOLDS]), audited=int(summary[m.AUDITED]),
            wrong_roots=int(summary[m.WRONG_ROOTS]),
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
