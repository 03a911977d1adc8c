"""Timing a run: its seconds, for the tables, and the work that it is, by which repeats are counted.

Seconds of one and the same run wander by 5 to 40 % on a busy machine, where others take the core away; those of the
processor, which do not count that, by 1 to 3 %.
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
    """What `timed` found: the row of the run, the seconds of its repeats, and the least of those that others have not
    taken."""

    row: Row
    seconds: list[float]
    work: float = math.nan

    def columns(self) -> Row:
        """As a rung of a table has them."""
        least, middle = (min(self.seconds), median(self.seconds)) if self.seconds else (math.nan, math.nan)
        return {"wall_time_min_s": least, "wall_time_median_s": middle}


def timed(run: Run, spent: float, warm: bool = False) -> Timing:
    """A run and its repeats; one that fails is not repeated.

    spent: processor seconds for all repeats, what surrounds them included (of runs of 20 us that is most of it).
    warm: the method has run before. A long first run is then one of the repeats: it has nothing left to load.
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
    """Row, seconds, and seconds without what others took of the core.

    The processor time is of all that surrounds the run, too, the seconds are not: the smaller one is the better bound.
    """
    begin = time.process_time()
    row, elapsed = run(first)
    return row, elapsed, min(elapsed, time.process_time() - begin)


_WARM: set[tuple[Any, ...]] = set()  # in this process


def warm_up(integrator: Integrator, scenario: Scenario, controls: Iterable[Mapping[str, Any]]) -> None:
    """A short run for each of these settings (dt, tolerance), once in a process: what loads or compiles does so before
    the clock runs; heyoka compiles anew for each tolerance."""
    for control in controls:
        key = integrator.name, scenario.model.structure, control.get("tolerance")
        if key not in _WARM:
            _WARM.add(key)
            with shared_runs.made_anew():
                simulate(integrator, scenario.replace(t_end=control.get("dt", 1e-3 * scenario.t_end)), **control)


class Solved(NamedTuple):
    """What an adaptive solver gave: states at the times, its counts, seconds; status, and why there are none."""

    states: Any
    counts: Row
    seconds: float
    status: str = "ok"
    failure: str = ""


def solved(integrator: Integrator, scenario: Scenario, times: ArrayLike, tolerance: float) -> Solved:
    """One call of an adaptive solver; that it gives up is a result."""
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
