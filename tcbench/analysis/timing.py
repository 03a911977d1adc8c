"""Timing of runs: seconds for the tables, processor seconds to decide how often a run is repeated.

On a busy machine seconds of one run wander by 5 to 40 %, processor seconds by 1 to 3 %.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping
from statistics import median
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..errors import ending, leave_to_the_machine
from ..integrator import Integrator
from ..simulation import shared_runs
from ..simulation.run import simulate
from ..study import Row
from ..systems.scenario import Scenario

MOST_REPEATS = 30  # minimum and median of 30 wander by 1 % from time to time, and those of 100 by as much
PATIENCE = 20  # limit of wall over processor seconds, for runs that wait or share their core
Run = Callable[[bool], tuple[Row, float]]  # run(first) -> row, seconds


class Timing(NamedTuple):
    """The result of `timed`: the row of the run, the seconds of its repeats, and the least of its processor seconds."""

    row: Row
    seconds: list[float]
    work: float = math.nan

    def columns(self) -> Row:
        """The columns of a table's rung."""
        least, middle = (min(self.seconds), median(self.seconds)) if self.seconds else (math.nan, math.nan)
        return {"wall_time_min_s": least, "wall_time_median_s": middle}


def timed(run: Run, spent: float, warm: bool = False) -> Timing:
    """A run and its repeats; one that fails is not repeated.

    spent : processor seconds for all repeats, overhead included, which is most of a run of 20 us. warm : the method has
    run before; a long first run then counts as a repeat, for it has nothing left to load.
    """
    row, elapsed, work = _once(run, first=True)
    if row["status"] != "ok":
        return Timing(row, [])
    seconds, works = ([elapsed], [work]) if warm and elapsed >= 2 * spent else ([], [])
    end = time.process_time() + spent
    while not works or (
        len(works) < MOST_REPEATS
        and sum(works) < spent
        and time.process_time() < end
        and sum(seconds) < PATIENCE * spent
    ):
        row, elapsed, work = _once(run, first=False)
        if row["status"] != "ok":
            return Timing(row, [])
        seconds.append(elapsed)
        works.append(work)
    return Timing(row, seconds, min(works))


def _once(run: Run, first: bool) -> tuple[Row, float, float]:
    """Row, seconds, and the smaller one of seconds and processor seconds.

    Processor seconds include overhead, seconds include waiting for the core: the smaller one is the better bound.
    """
    begin = time.process_time()
    row, elapsed = run(first)
    return row, elapsed, min(elapsed, time.process_time() - begin)


_WARM: set[tuple[Any, ...]] = set()  # in this process


def warm_up(integrator: Integrator, scenario: Scenario, controls: Iterable[Mapping[str, Any]]) -> None:
    """A short run for each of these settings (dt, tolerance), once in a process, so that loading and compiling are not
    timed; heyoka compiles anew for each tolerance."""
    for control in controls:
        key = integrator.name, scenario.model.structure, control.get("tolerance")
        if key not in _WARM:
            _WARM.add(key)
            with shared_runs.unshared():
                simulate(integrator, scenario.replace(t_end=control.get("dt", 1e-3 * scenario.t_end)), **control)


class Solved(NamedTuple):
    """The result of an adaptive solver: states (k, n) at the times, counts, seconds; status, and why there are none."""

    states: Any
    counts: Row
    seconds: float
    status: str = "ok"
    failure: str = ""


def solved(integrator: Integrator, scenario: Scenario, times: ArrayLike, tolerance: float) -> Solved:
    """One call of an adaptive solver; a failure is a result, too."""
    model, z0, t = scenario.model, scenario.z0.copy(), np.asarray(times, dtype=float)
    begin = time.perf_counter()
    try:
        answer = integrator.adaptive(model, z0, t, tolerance, tolerance)  # type: ignore[misc]
    except Exception as error:
        leave_to_the_machine(error)
        status, failure = ending(error)
        return Solved(None, {}, time.perf_counter() - begin, status, failure[:300])
    elapsed = time.perf_counter() - begin
    states, counts = answer if isinstance(answer, tuple) else (answer, {})
    return Solved(states, counts, elapsed)
