"""Runs of integrators in plain Python: a step function, or an adaptive solver; and the starts of multistep methods."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from numbers import Integral
from typing import Any, NamedTuple

import numpy as np

from ..compiler.library import evaluate
from ..errors import ending, leave_to_the_machine, shown
from ..integrator import Integrator
from ..progress import Meter, part
from ..solver import foresight
from ..solver.implicit_step import OK, Rules
from ..systems.scenario import Scenario
from . import shared_runs
from .compiled_loop import NOW, STATES
from .prepared import take
from .recorder import assemble, explain, raised
from .shared_runs import Solved
from .trajectory import SolverCounts, Summary, Trajectory

POINTS = 200  # output times of an adaptive run
AS_NUMPY = np.errstate(divide="warn", over="warn", under="ignore", invalid="warn")  # whatever a user's seterr says
TOGETHER, NUMBERS = 256, 2**16  # steps, and numbers in them, that one call of `march` is asked for at most


class FirstSteps(NamedTuple):
    """The first steps of a multistep method: z (steps + 1, n), the start and the states that the starter reached.

    iterations : shape (steps,), of Newton's method. failure : why there are fewer steps than asked for, or "".
    """

    z: np.ndarray
    iterations: np.ndarray
    status: str
    failure: str

    @property
    def steps(self) -> int:
        return len(self.z) - 1

    def slopes(self, dt: float) -> np.ndarray:
        """(earlier state - last state)/dt, shape (steps, n), the nearest first: what the compiled loop keeps."""
        differences: np.ndarray = (self.z[-2::-1] - self.z[-1]) / dt
        return differences


@AS_NUMPY
def run_step(
    integrator: Integrator, scenario: Scenario, dt: float, steps: int, every: int, starter: Callable[[], FirstSteps]
) -> Trajectory:
    """Take `steps` steps of a method in Python; its exceptions and wrong shapes become statuses."""
    model, z = scenario.model, scenario.z0.copy()
    monitor = Monitor(scenario, dt, steps, every)
    carry = np.zeros(len(z))
    begin = time.perf_counter()
    first = starter()
    reason, done = monitor.add(1, first.z[1:]) if first.steps else (OK, 0)
    past, z = list(first.z[-2::-1]) if integrator.memory else [], first.z[-1]
    ended, failure = first.status, first.failure
    alone, loaded, count = done + 1, begin, 1  # the first step by itself: it may load and compile what the others use
    held: tuple[Any, ...] | None = None
    together, meter = max(1, min(TOGETHER, NUMBERS // len(z))), None
    foresees, worked = integrator.march is not None and model.large, 0.0
    with ExitStack() as saying:
        while done < steps and reason == OK and not failure:
            try:
                held = integrator.held_by_a_run(model) if held is None else held
                states = _next_states(integrator, model, z, carry, dt, min(count, steps - done), past, held)
            except Exception as error:  # a plugin may raise anything: that is a row, not a crash
                leave_to_the_machine(error)
                ended, failure = raised(error, done + 1, (done + 1) * dt)
                break
            reason, done = monitor.add(done + 1, states)
            past = [z, *past][: integrator.memory]
            z = states[-1]
            if count == 1 and done == alone:
                loaded, worked, count = time.perf_counter(), time.thread_time(), together
            elif foresees and done == alone + len(states):  # the next ones: what a step takes differs with the method
                each = (time.thread_time() - worked) / len(states)
                if message := foresight.of_steps(model, each, steps):
                    meter = saying.enter_context(part(message))
                    meter.tell(meter.text)
            if meter is None and done > foresight.UNTOLD:
                meter = saying.enter_context(part(f"{steps} steps of {dt:g}"))
            if meter:
                meter.done, meter.total = done, steps
    end = time.perf_counter()
    wall = (end - loaded) * done / (done - alone) if done > alone else end - begin
    status, sentence = explain(reason, done, dt, scenario, integrator)
    if failure and reason == OK:
        status, sentence = ended, failure
    solver = SolverCounts(unknown=("newton_iterations",))
    try:
        solver = _told(held)
    except Exception as error:  # a plugin's
        leave_to_the_machine(error)
        if status == "ok":
            status, sentence = raised(error, done, done * dt)
    return monitor.trajectory(integrator, status, sentence, wall, solver)


def _told(held: tuple[Any, ...] | None) -> SolverCounts:
    """The counts that `cost()` of a run's workspace returns, if it has that method; TypeError for no mapping."""
    cost = getattr(held[0], "cost", None) if held else None
    answer = cost() if callable(cost) else {}
    if not isinstance(answer, Mapping):
        raise TypeError(f"cost() of a workspace returns a mapping of counts, not {shown(answer)}")
    counts = {name: int(value) for name, value in answer.items()}
    return SolverCounts(
        newton_iterations=counts.get("newton_iterations", 0), inner_steps=counts.get("steps", 0),
        unknown=() if "newton_iterations" in counts else ("newton_iterations",),
    )  # fmt: skip


def _next_states(
    integrator: Integrator, model: Any, z: np.ndarray, carry: np.ndarray, dt: float, count: int, past: Sequence[Any],
    held: tuple[Any, ...],
) -> np.ndarray:  # fmt: skip
    """The states after up to `count` steps where the method has a `march`, else after one: shape (steps, n).

    z, carry : shape (n,), the state and its low part, which is updated. held : the run's workspace, if the method has
    one. Raises TypeError and ValueError for what is no state.
    """
    start = model.state(z.copy())
    if integrator.march is not None:
        rows = real(integrator.march(start, dt, count, model, *held))
        if rows.ndim != 2 or not 1 <= len(rows) <= count or rows.shape[1] != len(z):
            raise ValueError(f"march returned shape {rows.shape}; up to {count} states of {len(z)} were asked for")
    else:
        assert integrator.step is not None
        before = (tuple(model.state(earlier.copy()) for earlier in past),) if integrator.memory else ()
        returned = integrator.step(start, dt, model, *before, *held)
        result = real(returned)
        if result.shape != z.shape:
            missing = "; is `return` missing?" if returned is None else ""
            raise ValueError(f"the step returned shape {result.shape}, a state has shape {z.shape}{missing}")
        rows = result[None]
    if integrator.increments:
        states = np.empty_like(rows)
        STATES.add_increments(z.copy(), rows, carry, states)
        return states
    return rows


def real(values: Any) -> np.ndarray:
    """A new array of doubles. TypeError for complex numbers, whose imaginary parts numpy drops, and for no numbers."""
    array = np.asarray(values)
    if array.dtype.kind == "c" or (array.dtype == object and any(isinstance(v, complex) for v in array.ravel())):
        raise TypeError("complex numbers were returned; states are real")
    if array.dtype.kind in "bSU" or array.dtype.names or isinstance(values, np.ma.MaskedArray):
        kind = "a masked array" if isinstance(values, np.ma.MaskedArray) else f"an array of {array.dtype}"
        raise TypeError(f"{kind} was returned; states are plain numbers")
    return np.array(array, dtype=np.float64, order="C")


class Monitor:
    """Observables and criteria of the compiled loop, for states that a loop in Python computes."""

    def __init__(self, scenario: Scenario, dt: float, steps: int, every: int) -> None:
        self.scenario, self.ready = scenario, take(None, scenario.model, ())
        self.run = run = self.ready.start(scenario, dt, steps, every, Rules())
        start = run.observables[NOW]
        evaluate(run.observe, run.z, run.c, start)
        run.observables[:] = start
        run.states[0], run.records[0] = run.z, start

    def add(self, first: int, rows: np.ndarray) -> tuple[int, int]:
        """(OK or why the run ended, completed steps) after the states rows (m, n) of the steps first, first + 1, ..."""
        rows = np.ascontiguousarray(rows)  # kernels and the compiled loop read rows as they lie in memory
        return STATES.monitor(self.run, first, rows), self.ready.tally.steps

    def trajectory(
        self, integrator: Integrator, status: str, failure: str, wall: float, solver: SolverCounts
    ) -> Trajectory:
        run = assemble(integrator, self.scenario, self.run, status, failure, wall, solver=solver)
        self.ready.give_back()
        return run


@AS_NUMPY
def run_adaptive(
    integrator: Integrator, scenario: Scenario, tolerance: float, times: np.ndarray | None = None
) -> Trajectory:
    """One adaptive run at rtol = atol = tolerance, reported at `times` (k,), by default at POINTS even ones.

    Where the solver yields its states one by one (`outputs`), the run ends at the first time at which it has failed.
    """
    t = np.linspace(0.0, scenario.t_end, POINTS + 1) if times is None else np.append(0.0, times)
    course = shared_runs.recorded(integrator.name, scenario, tolerance) if times is None else None
    if course is None:
        with part(f"at tolerance {tolerance:g}, in steps that it chooses") as meter:
            course = _solve(integrator, scenario, t, tolerance, meter)
        if times is None:
            shared_runs.keep(integrator.name, scenario, tolerance, course)
    shared_runs.used(course)
    monitor = Monitor(scenario, t[1], len(t) - 1, 1)
    reason, done = monitor.add(1, course.states[1:]) if len(course.states) > 1 else (OK, 0)
    status, sentence = (
        (course.status, course.failure) if course.failure else explain(reason, done, t[1], scenario, integrator)
    )
    if times is not None and reason != OK and not course.failure:
        last = min(done if status == "blowup" else done + 1, len(t) - 1)
        sentence = f"output {last} (t = {t[last]:.6g}): {sentence.partition(': ')[2]}"
    solver = SolverCounts(
        newton_iterations=course.counts.get("newton_iterations", 0),
        rhs_evaluations=course.counts.get("rhs_evaluations", 0),
        unknown=tuple(name for name in ("steps", "newton_iterations") if name not in course.counts),
    )
    run = monitor.trajectory(integrator, status, sentence, course.wall_s, solver)
    if times is not None:
        run = replace(run, summary=at_times(run, t))
    return replace(run, t=t[: len(run.t)], dt=math.nan, steps=course.counts.get("steps", done))


def at_times(run: Trajectory, t: np.ndarray) -> Summary:
    """The summary of a run with records at the times t (m,): the loop took them for evenly spaced."""
    summary, x = run.summary, t[1 : len(run.t)]
    error, middle = (run.energy[1:] - run.energy[0]) / run.scenario.initial_exergy, x - x.mean() if len(x) else x
    spread = float(middle @ middle)
    fall = summary.first_entropy_fall
    return replace(
        summary,
        energy_drift=float(middle @ error) / spread if len(x) > 1 and spread > 0.0 else math.nan,
        first_entropy_fall=fall if math.isnan(fall) else float(t[round(fall / t[1])]),
    )


def _solve(integrator: Integrator, scenario: Scenario, t: np.ndarray, tolerance: float, meter: Meter) -> Solved:
    """Call the solver at the times t (m,); its exceptions become a status and a sentence."""
    assert integrator.adaptive is not None
    model, z0 = scenario.model, scenario.z0.copy()
    states, status, failure = np.empty((0, model.size)), "ok", ""
    counts: Any = {}
    reached: list[np.ndarray] = []
    begin, work = time.perf_counter(), time.process_time()
    try:
        if integrator.outputs is not None:
            rows, counts = integrator.outputs(model, z0, t, tolerance, tolerance)
            _until_failed(rows, scenario, t, meter, reached)
            states = np.array(reached)
        else:
            result = integrator.adaptive(model, z0, t, tolerance, tolerance)
            states, counts = result if isinstance(result, tuple) else (result, {})
            states = _as_states(states, (len(t), model.size))
        if not isinstance(counts, Mapping):
            raise TypeError(f"beside the states a mapping of counts is returned, not {shown(counts)}")
        counts = {name: _whole(name, value) for name, value in counts.items()}
    except Exception as error:
        leave_to_the_machine(error)
        status, failure = raised(error, len(reached), float(t[len(reached) - 1])) if reached else ending(error)
        reached = reached or list(getattr(error, "states", ()))[: len(t)]
        states = np.array(reached) if reached else np.empty((0, model.size))  # states before the failure count
        counts = {n: v for n, v in counts.items() if isinstance(v, Integral)} if isinstance(counts, Mapping) else {}
    wall, work = time.perf_counter() - begin, time.process_time() - work
    return Solved(states, counts, status, failure, wall, work)


def _whole(name: str, value: Any) -> int:
    try:
        return int(value)
    except (TypeError, ValueError):
        raise TypeError(f"counts are whole numbers, and {name!r} is {shown(value)}") from None


def _until_failed(
    rows: Iterator[Any], scenario: Scenario, t: np.ndarray, meter: Meter, reached: list[np.ndarray]
) -> None:
    """Append to `reached` the states of an iterator, up to the first at which the run has failed."""
    monitor = Monitor(scenario, t[1], len(t) - 1, 1)
    for i in range(len(t)):
        row = next(rows, None)
        if row is None:
            raise ValueError(f"outputs ended after {i} states, {len(t)} were asked for")
        reached.append(_as_states(row, (scenario.model.size,)))
        meter.done, meter.total = i, len(t) - 1
        if i and monitor.add(i, reached[i][None])[0] != OK:
            return


def _as_states(value: Any, shape: tuple[int, ...]) -> np.ndarray:
    try:
        z = real(value)
    except TypeError as error:
        raise TypeError(f"the solver returned {shown(value)}, states of shape {shape} were asked for") from error
    if z.shape != shape:
        raise ValueError(f"the solver returned shape {z.shape}, {shape} were asked for")
    return z
