"""Are the timings of one run longer than another's, or is it chance? A verdict for each cell, not for each sample.

Samples of one process say nothing of how far apart two processes are, which is most of what chance does to a timing.
So a cell counts once: its change is the median over its rungs. What chance does is estimated from how far apart two
processes of one run are (the study work_precision times each cell in two), of seconds from how far apart most cells of
the two runs are, and, as long as there are few of either, from what was measured before (`CHANCE`).
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping, Sequence
from statistics import NormalDist, median
from typing import NamedTuple, TypeVar

Key = TypeVar("Key", bound=Hashable)
Process = Mapping[Hashable, float]  # rung -> time, in one unit

FALSE_ALARMS = 0.02  # comparisons of equal runs that are to find any change of timings
EFFECT = 0.12  # relative difference that is worth a word
CHANCE = 0.03  # standard deviation of the logarithm of a time in yardsticks, from process to process
CHANCE_SECONDS = 0.08  # of one in seconds, which a busy machine makes longer
WEIGHT = 4  # pairs of processes that this knowledge is worth
ENOUGH = 4  # cells (or methods) whose changes show what chance does
NORMAL = 1.4826  # standard deviation over the median of magnitudes, of a normal distribution


class Timed(NamedTuple):
    """One cell of two runs: the processes that timed it before and after; by the yardstick, or in seconds."""

    before: Sequence[Process]
    after: Sequence[Process]
    by_yardstick: bool
    group: Hashable = None  # what may have changed as a whole: the method


class Verdict(NamedTuple):
    """The time after over the time before, and the ratio (above 1) that chance alone reaches."""

    ratio: float
    chance: float

    @property
    def real(self) -> bool:
        return max(self.ratio, 1 / self.ratio) > self.chance


def judge(cells: Mapping[Key, Timed]) -> dict[Key, Verdict]:
    """What is to be said of the timings of each cell; of those that share no rung, nothing."""
    changes = {key: x for key, cell in cells.items() if (x := _change(cell)) is not None}
    verdicts: dict[Key, Verdict] = {}
    for kind, known in ((True, CHANCE), (False, CHANCE_SECONDS)):
        here = {key: x for key, x in changes.items() if cells[key].by_yardstick == kind}
        if not here:
            continue
        gaps = {key: _gaps(cells[key]) for key in here}
        usual = _usual([gap for found in gaps.values() for gap in found], known)
        methods: dict[Hashable, list[float]] = {}
        for key in here:
            methods.setdefault(cells[key].group, []).extend(gaps[key])
        between = 0.0 if kind else _between(here, cells)
        limit = NormalDist().inv_cdf(1 - FALSE_ALARMS / (2 * len(changes)))
        for key, x in here.items():
            variance = max(_variance(usual, gaps[key]), _usual(methods[cells[key].group], usual) ** 2)
            variance *= 1 / len(cells[key].before) + 1 / len(cells[key].after)
            chance = limit * math.sqrt(max(variance, between**2))
            verdicts[key] = Verdict(math.exp(x), max(math.exp(chance), 1 / (1 - EFFECT)))
    return verdicts


def _change(cell: Timed) -> float | None:
    """The logarithm of after over before, of the least that the processes needed; None where they share no rung."""
    return _apart(_least(cell.before), _least(cell.after))


def _least(processes: Sequence[Process]) -> dict[Hashable, float]:
    rungs = {rung for process in processes for rung in process}
    return {rung: min(process.get(rung, math.inf) for process in processes) for rung in rungs}


def _apart(a: Process, b: Process) -> float | None:
    ratios = [math.log(b[rung] / a[rung]) for rung in a if rung in b and _positive(a[rung]) and _positive(b[rung])]
    return median(ratios) if ratios else None


def _gaps(cell: Timed) -> list[float]:
    """How far apart the processes of one run are, for each run that has two."""
    found = [_apart(side[0], side[1]) for side in (cell.before, cell.after) if len(side) > 1]
    return [x for x in found if x is not None]


def _variance(usual: float, gaps: Sequence[float]) -> float:
    """Of a process, by the gaps of its cell (which have twice the variance) and by what is usual."""
    return (WEIGHT * usual**2 + sum(g * g / 2 for g in gaps)) / (WEIGHT + len(gaps))


def _usual(gaps: Sequence[float], known: float) -> float:
    """Standard deviation of a process, by most of the gaps and by what is known without them."""
    seen = (NORMAL * median(map(abs, gaps))) ** 2 / 2 if gaps else 0.0
    return math.sqrt((WEIGHT * known**2 + len(gaps) * seen) / (WEIGHT + len(gaps)))


def _between(changes: Mapping[Key, float], cells: Mapping[Key, Timed]) -> float:
    """How far apart most are. Of a few methods nobody knows which of them have changed: that says nothing, then."""
    groups: dict[Hashable, list[float]] = {}
    for key, x in changes.items():
        groups.setdefault(cells[key].group, []).append(abs(x))
    return NORMAL * median(map(median, groups.values())) if len(groups) >= ENOUGH else 0.0


def _positive(number: float) -> bool:
    return math.isfinite(number) and number > 0
