"""`simulate`: one integrator on one scenario. A failed run is data, not an exception."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from ..compiler.library import compiled_late
from ..errors import TcbenchError, expect, positive, shown
from ..integrator import Integrator
from ..progress import part
from ..solver import foresight
from ..solver.implicit_step import COUNT_WRONG, NO_AUDIT, NO_ROOT, NONCONVERGED, NONFINITE, OK, Rules, compiled_flows
from ..solver.quotients import REMEDY, finite_at_rest, zero_over_zero
from ..systems.as_written import check_repeats
from ..systems.multipliers import check_start, dependent
from ..systems.refusals import check_invariants
from ..systems.scenario import Scenario
from .compiled_loop import LOOPS, STATES, Run
from .prepared import take
from .python_loop import FirstSteps, run_adaptive, run_step
from .recorder import assemble, explain
from .trajectory import Trajectory

MOST_GIB = 16.0  # of recorded states: who asks for more has hardly meant it
SHORT_STATE = 100  # length of a state up to which a chunk has CHUNK steps; those of longer ones have fewer
LEAST_TOLERANCE = float(np.finfo(float).eps)
CHUNK = 100_000  # steps between two checks of the clock and the keyboard


def simulate(
    integrator: str | Integrator,
    scenario: str | Scenario,
    dt: float | None = None,
    t_end: float | None = None,
    *,
    tolerance: float | None = None,
    times: Any = None,
    continuation: bool = True,
    record_every: int | None = 1,
    residuals: bool = False,
    audit_roots: bool = False,
) -> Trajectory:
    """Run one integrator on one scenario.

    Parameters
    ----------
    integrator : str or Integrator
        A name of `integrators()`, a variant such as "tc_gauss[k=3]", or an Integrator of your own.
    scenario : str or Scenario
        A name of `scenarios()`, a member of a family such as "chain[n=10]", or a Scenario of your own.
    dt : float, optional
        Step, in the scenario's (dimensionless) time; its own by default. The last step ends at or just past `t_end`. An
        adaptive solver chooses its own, whatever is given, so that one call serves all methods.
    t_end : float, optional
        Horizon, in the same time; the scenario's own by default.
    tolerance : float, optional
        rtol of an adaptive solver (atol = rtol), which has no dt; dimensionless. Default 1e-6.
    times : sequence of float, optional
        When an adaptive solver reports, shape (k,), growing; the last is the horizon, and the state at 0 always comes
        first. The states are the solver's own: its steps end there, or its own interpolation gives them.
    continuation : bool
        True: Newton, then natural tracking in h, then pseudo-arclength through folds, so that a step fails only when it
        has no root (docs/stability.md). False: plain Newton from z0 (20 iterations), for comparison.
    record_every : int or None
        Keep every k-th state; None: the first and the last. The summary covers every step. An adaptive run is
        reported at 200 times, or at `times`.
    residuals : bool
        Also measure the residual of each accepted step (`summary.residual_max`).
    audit_roots : bool
        Follow the arc at every step and count accepted roots that are not the principal one (`solver.wrong_roots` of
        `solver.audited` solves); some 50 times slower, the run itself is unchanged.

    Returns
    -------
    Trajectory
        Of m recorded states of n numbers, `z` of shape (m, n), everything dimensionless; of a failed run, too: its
        `status` and `failure` say so.

    Raises
    ------
    TcbenchError
        For bad input only: an unknown name, a method that is not for this system, a step that is not positive, more
        states than memory could hold.

    References
    ----------
    Romero (2009), eqs. (6)-(13) and section 6; how the equations of a step are solved: docs/stability.md.
    """
    from .. import plugins

    if {type(continuation), type(residuals), type(audit_roots)} != {bool}:
        flags = {"continuation": continuation, "residuals": residuals, "audit_roots": audit_roots}
        expect("simulate", flags, dict.fromkeys(flags, "True or False"))
    integrator = plugins.find_integrator(integrator)
    scenario = plugins.find_scenario(scenario).current()
    if t_end is not None and (t_end := positive("t_end", t_end)) != scenario.t_end:
        # the step asked for is checked against the horizon asked for
        scenario = scenario.replace(t_end=t_end)
    if reason := integrator.lacks or integrator.suits(scenario.model):
        raise TcbenchError(f"{integrator.name!r} cannot run on {scenario.name!r}: {reason}.")
    check_start(scenario.model, scenario.z0)
    check_invariants(scenario.model, scenario.z0)
    if integrator.kind != "flows":
        check_repeats(scenario.model.symbolic)
    if integrator.kind == "adaptive":
        chosen = None if times is None else _checked_times(times, t_end)
        if chosen is not None:
            end = float(chosen[-1])
            scenario = scenario.replace(t_end=end, dt=min(scenario.dt, end))
        tolerance = positive("tolerance", 1e-6 if tolerance is None else tolerance)
        if tolerance < LEAST_TOLERANCE:
            raise TcbenchError(
                f"tolerance = {tolerance:g} is below the round-off of a number, {LEAST_TOLERANCE:.1e}: no step does. "
                "Ask for 1e-14 or more."
            )
        return run_adaptive(integrator, scenario, tolerance, chosen)
    if times is not None:
        raise TcbenchError(f"{integrator.name!r} has states at the ends of its steps: give dt=, not times=.")
    if tolerance is not None:
        raise TcbenchError(f"{integrator.name!r} takes a step dt, not a tolerance.")
    dt = checked_dt(scenario.dt if dt is None else dt, scenario)
    steps = scenario.steps(dt)
    every = max(1, steps) if record_every is None else min(_whole(record_every), max(1, steps))
    check_memory(scenario, dt, steps, every)
    if integrator.kind == "step":
        return run_step(integrator, scenario, dt, steps, every, lambda: first_steps(integrator, scenario, dt, steps))
    rules = Rules(continuation, residuals, COUNT_WRONG if audit_roots else NO_AUDIT)
    return run_flows(integrator, scenario, dt, steps, every, rules)


def _whole(record_every: Any) -> int:
    if not (isinstance(record_every, int | np.integer) and record_every >= 1):
        raise TcbenchError(f"record_every must be a whole number, at least 1, not {record_every!r}.")
    return int(record_every)


def check_memory(scenario: Scenario, dt: float, steps: int, every: int = 1) -> None:
    """Raise TcbenchError where a run that keeps every `every`-th state would need more memory than could be meant."""
    kept = (steps // every + 2) * (scenario.model.size + 2 * scenario.model.n_temperatures + 3) * 8 / 2**30
    if kept > MOST_GIB:
        raise TcbenchError(
            f"{steps} steps of {dt:g} would keep {kept:.0f} GiB of states; give a longer dt, or record_every= a larger "
            "number."
        )


def checked_dt(dt: Any, scenario: Scenario) -> float:
    """dt as a float, or the error that says what is wrong with it."""
    value = positive("dt", dt)
    if value > scenario.t_end * (1 + 1e-12):
        raise TcbenchError(
            f"dt = {value:g} is longer than the horizon t_end = {scenario.t_end:g} of {scenario.name!r}."
        )
    return value


def _checked_times(times: Any, t_end: float | None) -> np.ndarray:
    """The times after 0, ascending; the last one is the horizon."""
    try:
        checked = np.asarray(times, dtype=float).ravel()
    except (TypeError, ValueError, OverflowError):
        raise TcbenchError(f"times must be numbers, not {shown(times)}.") from None
    checked = checked[1:] if len(checked) and checked[0] == 0 else checked
    if not len(checked) or not np.isfinite(checked).all() or checked[0] <= 0 or (np.diff(checked) <= 0).any():
        raise TcbenchError("times must be finite numbers that grow, the first at 0 or later, the last after 0.")
    if t_end is not None and t_end != checked[-1]:
        raise TcbenchError(f"The run ends at the last of its times, {checked[-1]:g}: leave out t_end = {t_end:g}.")
    return checked


def first_steps(integrator: Integrator, scenario: Scenario, dt: float, steps: int) -> FirstSteps:
    """The first `memory` steps of a multistep method (fewer if the run has fewer), by its starter; else none."""
    if not integrator.memory:
        return FirstSteps(scenario.z0[None], np.zeros(0, np.int64), "ok", "")
    from .. import plugins

    count = min(integrator.memory, steps)
    run = simulate(plugins.starter_of(integrator), scenario, dt, count * dt)
    failure = "" if run.ok else f"the starter {run.integrator.name}: {run.failure}"
    return FirstSteps(np.ascontiguousarray(run.z), run.newton_iterations, run.status, failure)


def run_flows(
    integrator: Integrator, scenario: Scenario, dt: float, steps: int, every: int, rules: Rules
) -> Trajectory:
    """`simulate` for an integrator of the kind "flows", its input checked."""
    model = scenario.model
    kernels = compiled_flows(integrator.flows, model.symbolic)
    message = foresight.of_steps(model, foresight.seconds_a_step(kernels), steps)  # before anything is compiled
    ready = take(integrator, model, kernels)
    run = ready.start(scenario, dt, steps, every, rules)
    LOOPS.begin(run)
    begin, late = time.perf_counter(), compiled_late()
    reason, done, first = OK, 0, None
    if integrator.memory:
        first = first_steps(integrator, scenario, dt, steps)
        reason, done = STATES.monitor(run, 1, first.z[1:]) if first.steps else OK, first.steps
        if done == integrator.memory:
            run.z[:], run.others[:] = first.z[-1], first.slopes(dt)
            np.add.at(run.counts, np.arange(done) // every, first.iterations)
            run.tally.iterations += first.iterations.sum()
    if done < steps and reason == OK and not (first and first.failure):
        reason = march(run, done, steps, message)
        done = run.tally.steps
    wall = time.perf_counter() - begin - (compiled_late() - late)
    status, failure = explain(reason, done, dt, scenario, integrator)
    if reason == OK and first and first.failure:
        status, failure = first.status, first.failure
    if reason in (NONCONVERGED, NO_ROOT, NONFINITE):
        places = [
            zero_over_zero(flow, model, run.z, dt)
            for flow, kernel in zip(integrator.flows, kernels, strict=True)
            if not finite_at_rest(kernel, flow.memory, model, run.z, dt)
        ]
        if message := dependent(model, run.z[None], [run.tally.steps * dt], failed=True):
            failure += f"; {message}"
        if any(flow.kept.lost for flow in run.flows.records):
            failure += (
                ": iterations did not solve its linear equations, too many to be factorised; a shorter dt is needed"
            )
        failure += "".join(f". The formula divides 0 by 0 at z1 = z0 ({place}): {REMEDY}" for place in places if place)
    trajectory = assemble(integrator, scenario, run, status, failure, wall, way=ready.way)
    ready.give_back()
    return trajectory


def march(run: Run, done: int, steps: int, message: str) -> int:
    """The steps from `done` on; returns why they ended. told: of a run that is foreseen to be long."""
    small = run.n <= SHORT_STATE
    if small and not message:
        reason: int = LOOPS.march(run, done, min(steps, done + foresight.UNTOLD, done + CHUNK))
        done = run.tally.steps
        if done == steps or reason != OK:
            return reason
    chunk, reason = CHUNK if small else max(1, CHUNK * SHORT_STATE // (5 * run.n)), OK
    with part(message or f"{steps} steps of {run.h:g}") as meter:
        while done < steps and reason == OK:
            reason = LOOPS.march(run, done, min(steps, done + chunk))
            done = run.tally.steps
            meter.done, meter.total = done, steps
    return reason
