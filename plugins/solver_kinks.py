"""Restarts a solver behind each kink of the rates, which its error estimates do not see.

Between two states the numbers inside |.| of the rates, and their slopes, show whether one has changed its sign
(`Kinks.change`). The time of the change is then located by solving up to it, and the solver restarts there.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise
from typing import Any

import numpy as np

from tcbench import System
from tcbench.solver.foresight import NO_RATES

from .controlled import Kinks, kinks_in

PLACES = 100  # in a run, at least, between which kinks are sought
FIRST, GROW = 2, 2  # intervals in one call behind a kink, and the factor by which they grow while none follows
PARTS = 8  # of an interval with a kink, each tested
DEEP = 6  # levels of parts of parts, where a number turns before it changes its sign
FINER, FINEST = 8.0, 3e-14  # factor of the solver's tolerance, for errors of pieces add up; the smallest that it takes
MANY = 8  # kinks in one interval: a motion with more slides along one, or the errors that each adds are too many
MOST_PARTS = 50  # intervals in an interval that are solved in parts, for the same reasons
BEHIND = 1e-14  # distance of a restart from its kink, over the time


def counted(answer: Any) -> tuple[Any, dict[str, int]]:
    """(states, counts) of a solver's answer, which may be states alone."""
    return answer if isinstance(answer, tuple) else (answer, {})


def stopped_at_kinks(
    adaptive: Callable[..., Any], outputs: Callable[..., Any] | None, system: System, z0: Any, times: Any, rtol: float,
    atol: float,
) -> tuple[Iterable[Any], dict[str, int]]:  # fmt: skip
    """(states at the times, counts, which are complete with the last state). Without kinks the solver's own answer, one
    state after the other where it can (`outputs`)."""
    kinks = kinks_in(system)
    if kinks is None:
        return counted((outputs or adaptive)(system, z0, times, rtol, atol))
    run = Run(adaptive, system, kinks, rtol, atol)
    return run.states(np.asarray(z0, dtype=float), np.asarray(times, dtype=float)), run.counts


class Run:
    """A solver on a system with kinks."""

    def __init__(self, adaptive: Callable[..., Any], system: System, kinks: Kinks, rtol: float, atol: float) -> None:
        self.adaptive, self.system, self.kinks = adaptive, system, kinks
        self.tolerances = max(rtol / FINER, min(rtol, FINEST)), atol / FINER
        self.counts: Counter[str] = Counter()
        self.left = MOST_PARTS

    def solve(self, z: Any, times: Any) -> Any:
        """States (m - 1, n) at the times (m,) behind the first, where the state is z (n,)."""
        states, counts = counted(self.adaptive(self.system, z, times, *self.tolerances))
        self.counts.update(counts)
        return np.asarray(states, dtype=float)[1:]

    def states(self, z: Any, times: Any) -> Iterator[Any]:
        """States at the times; kinks are sought between more of them."""
        yield z
        wanted = set(times.tolist())
        grid = np.union1d(times, np.linspace(times[0], times[-1], PLACES + 1))
        here, many = 0, FIRST
        while here < len(grid) - 1:
            ahead, before = grid[here : here + many + 1], self.kinks(z)
            many *= GROW
            for t, end, state in zip(ahead[:-1], ahead[1:], self.solve(z, ahead), strict=True):
                after = self.kinks(state)
                kink = self.kinks.change(before, after, end - t)
                self.left = MOST_PARTS
                z = self.across(z, t, end) if kink else state
                here += 1
                if end in wanted:
                    yield z
                if kink:
                    many = FIRST
                    break
                before = after

    def across(self, z: Any, t: float, end: float, deep: int = 0) -> Any:
        """The state at the end of an interval, with a restart behind each kink in it."""
        for _ in range(min(MANY, self.left)):
            self.left -= 1
            parts = np.linspace(t, end, PARTS + 1)
            states = [z, *self.solve(z, parts)]
            turned = [self.kinks.change(*pair, parts[1] - t) for pair in pairwise(map(self.kinks, states))]
            if not any(turned):
                return states[-1]
            first = turned.index(True)
            z, t, after = states[first], parts[first], parts[first + 1]
            crossed = self.kinks.numbers(states[first]) * self.kinks.numbers(states[first + 1]) < 0.0
            if crossed.any():
                z, t = self.behind(z, t, after, np.flatnonzero(crossed))
            else:  # the interval begins or ends in one, or may pass it and come back
                z = self.across(z, t, after, deep + 1) if deep < DEEP else states[first + 1]
                t = after
            if t >= end:
                return z
        raise ArithmeticError(
            f"more than {MANY} kinks of the rates follow each other at t = {t:g}: ask for more output times; {NO_RATES}"
        )

    def behind(self, z: Any, t: float, end: float, crossed: Any) -> tuple[Any, float]:
        """(state, time) just behind the first of these kinks in an interval that is crossed."""
        from scipy.optimize import brentq  # when something runs, not when plugins are listed

        def at(x: float) -> Any:
            return self.solve(z, np.array([t, x]))[0] if x > t else z

        def number(x: float, j: int) -> Any:
            return self.kinks.numbers(at(x))[j]

        first, kink = end, int(crossed[0])
        for j in crossed:
            if number(t, j) * number(first, j) < 0.0:
                first, kink = brentq(number, t, first, (j,), xtol=BEHIND * abs(end)), j
        step, sign = BEHIND * max(abs(end), end - t), np.sign(number(t, kink))
        while first < end and number(min(end, first + step), kink) * sign >= 0.0:
            step *= 4.0
        first = min(end, first + step)
        return at(first), first
