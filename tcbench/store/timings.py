"""Are the timings of one run longer than another's, or is it chance? A verdict for each cell, not for each sample.

Samples of one process say nothing of how far apart two processes are, which is most of what chance does to a timing:
4 % of a method in Python where seven jobs share a core, 1 % of compiled ones. So each process of a cell counts once, by
its level, the median over its rungs of how far it is from the others. Chance makes a process slow, seldom fast: the
level of a run is that of its faster half, and a method's change the mean over its cells. What chance does is estimated
from how far apart the processes of one run are (the study work_precision times each cell in two or more), of seconds
from how far apart most cells of the two runs are, and, as long as there are few of either, from what was measured
before (`CHANCE`).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Hashable, Mapping, Sequence
from itertools import pairwise
from statistics import NormalDist, fmean, median
from typing import NamedTuple, TypeVar

Key = TypeVar("Key", bound=Hashable)
Process = Mapping[Hashable, float]  # rung -> time, in one unit

FALSE_ALARMS = 0.02  # comparisons of equal runs that are to find any change of timings
EFFECT = 0.1  # relative difference that is worth a word
CHANCE = 0.03  # standard deviation of the logarithm of a time in yardsticks, from process to process
CHANCE_SECONDS = 0.08  # of one in seconds, which a busy machine makes longer
WEIGHT = 4  # differences of processes that this knowledge is worth
ENOUGH = 4  # methods whose changes show what chance does
LAPSES, LAPSE = 0.03, 0.3  # share of processes that something else disturbs, and the standard deviation of that
HALF = 1.4  # variance of the mean of the faster half of normal numbers, over that of the mean of all
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


class _Levels:
    """Of the processes of a cell on both sides: the logarithms of their times over what is usual on its rungs."""

    def __init__(self, cell: Timed) -> None:
        rungs = {r for p in cell.before for r in p} & {r for p in cell.after for r in p}
        found: dict[Hashable, list[float]] = {}
        for process in (*cell.before, *cell.after):
            for rung, time in process.items():
                if rung in rungs and math.isfinite(time) and time > 0:
                    found.setdefault(rung, []).append(time)
        self._usual = {rung: median(times) for rung, times in found.items()}
        self.sides = [[x for p in side if (x := self._level(p)) is not None] for side in (cell.before, cell.after)]

    def _level(self, process: Process) -> float | None:
        times = [(process[rung], usual) for rung, usual in self._usual.items() if rung in process]
        apart = [math.log(time / usual) for time, usual in times if math.isfinite(time) and time > 0]
        return median(apart) if apart else None

    def change(self) -> float:
        """From before to after."""
        before, after = (fmean(sorted(side)[: _half(side)]) for side in self.sides)
        return after - before

    def share(self) -> float:
        """Variance of the change over that of a process."""
        return sum(HALF / len(side) if len(side) > 1 else 1.0 for side in self.sides)

    def apart(self) -> list[list[float]]:
        """How far neighbouring processes of each run are from each other: of the variance of a process each."""
        return [[(x - y) / math.sqrt(2) for x, y in pairwise(side)] for side in self.sides]

    def variance(self, usual: float) -> float:
        """Of a process, by what is usual and by most of those of this cell."""
        own = math.fsum(len(side) * _most(side) ** 2 for side in self.apart())
        return (WEIGHT * usual**2 + own) / (WEIGHT + sum(map(len, self.apart())))


def judge(cells: Mapping[Key, Timed]) -> dict[Key, Verdict]:
    """What is to be said of the timings of each cell; of those that share no rung, nothing."""
    levels = {key: found for key, cell in cells.items() if all((found := _Levels(cell)).sides)}
    groups = Counter((cells[key].by_yardstick, cells[key].group) for key in levels)
    tests = len(levels) + sum(count > 1 for count in groups.values())
    verdicts: dict[Key, Verdict] = {}
    for kind, known in ((True, CHANCE), (False, CHANCE_SECONDS)):
        here = {key: found for key, found in levels.items() if cells[key].by_yardstick == kind}
        usual = _usual([x for found in here.values() for side in found.apart() for x in side], known)
        methods: dict[Hashable, dict[Key, _Levels]] = {}
        for key, found in here.items():
            methods.setdefault(cells[key].group, {})[key] = found
        changes = [[found.change() for found in method.values()] for method in methods.values()]
        between = 0.0 if kind else _between(changes)
        for method in methods.values():
            verdicts |= _of_method(method, usual, between, tests)
    return verdicts


def _of_method(cells: Mapping[Key, _Levels], usual: float, between: float, tests: int) -> dict[Key, Verdict]:
    """Verdicts on the cells of one method, of as many tests in all."""
    apart = [x for cell in cells.values() for side in cell.apart() for x in side]
    known = _usual(apart, usual) ** 2
    variances = {k: max(max(c.variance(usual), known) * c.share(), between**2) for k, c in cells.items()}
    limit = NormalDist().inv_cdf(1 - FALSE_ALARMS / (2 * tests))
    limit *= 1 + (limit**2 + 1) / (4 * (2 * WEIGHT + len(apart)))  # Student's: the variance is an estimate
    changes = {key: cell.change() for key, cell in cells.items()}
    chance = {key: max(limit * math.sqrt(variances[key]), _lapse(cell, tests)) for key, cell in cells.items()}
    of_all = limit * max(math.sqrt(math.fsum(variances.values())) / len(cells), between)
    if abs(fmean(changes.values())) > max(of_all, -math.log(1 - EFFECT)):  # it has changed as a whole
        chance = {key: min(x, of_all) for key, x in chance.items()}
    return {key: Verdict(math.exp(x), max(math.exp(chance[key]), 1 / (1 - EFFECT))) for key, x in changes.items()}


def _half(side: Sequence[float]) -> int:
    """How many of the processes of a run tell its level."""
    return max(1, len(side) // 2)


def _lapse(levels: _Levels, tests: int) -> float:
    """The change that processes disturbed all at once would make as seldom as a false alarm is to be."""
    at_once = min(len(side) - _half(side) + 1 for side in levels.sides)
    share = (FALSE_ALARMS / (2 * tests)) ** (1 / at_once) / LAPSES
    return LAPSE * NormalDist().inv_cdf(1 - share / 2) if at_once > 1 and share < 1 else 0.0


def _usual(apart: Sequence[float], known: float) -> float:
    """Standard deviation of a process, by most of what is seen and by what is known without it."""
    return math.sqrt((WEIGHT * known**2 + len(apart) * _most(apart) ** 2) / (WEIGHT + len(apart)))


def _most(apart: Sequence[float]) -> float:
    """The standard deviation of a process, by most of how far they are apart."""
    if len(apart) < 2:
        return abs(apart[0]) if apart else 0.0
    return NORMAL * median(map(abs, apart))


def _between(methods: Sequence[Sequence[float]]) -> float:
    """How far apart most are. Of a few methods nobody knows which of them have changed: that says nothing, then."""
    return NORMAL * median(median(map(abs, xs)) for xs in methods) if len(methods) >= ENOUGH else 0.0
