"""A solver of somebody else's, begun anew behind each kink of the rates, which its estimates do not see.

Between two states the numbers whose size the rates have, and their slopes, tell whether one of them changed its sign
(`controlled.turns`). Then the time at which it did is found by solving up to it, and the solver begins there.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise
from typing import Any

import numpy as np

from tcbench import System
from tcbench.solver.foresight import NO_RATES

from .controlled import kinks_in, turns

LOOKS = 100  # places in a run, at least, between which kinks are looked for
FIRST, GROW = 2, 2  # of these at once behind a kink, and so many times as many each time that none follows
PARTS = 8  # of an interval with a kink, each looked at
DEEP = 6  # parts of parts, in which one that turns before it changes its sign may do so
FINER, FINEST = 8.0, 3e-14  # its tolerance, of which each piece may miss one, over this; the least that solvers take
MANY = 8  # kinks in one interval: a motion with more slides along one, or the errors that each adds are too many
MOST_PARTS = 50  # intervals in an interval that are solved in parts, for the same reasons
BEHIND = 1e-14  # a kink, over the time


def counted(answer: Any) -> tuple[Any, dict[str, int]]:
    """States and counts of a solver, which may give the states alone."""
    return answer if isinstance(answer, tuple) else (answer, {})


def stopped_at_kinks(
    adaptive: Callable[..., Any], outputs: Callable[..., Any] | None, system: System, z0: Any, times: Any, rtol: float,
    atol: float,
) -> tuple[Iterable[Any], dict[str, int]]:  # fmt: skip
    """(states at the times, counts, which are complete with the last state); as the solver gives them, one by one if it
    can (`outputs`), where the rates have no kinks."""
    kinks = kinks_in(system)
    if kinks is None:
        return counted((outputs or adaptive)(system, z0, times, rtol, atol))
    run = Run(adaptive, system, kinks, rtol, atol)
    return run.states(np.asarray(z0, dtype=float), np.asarray(times, dtype=float)), run.counts


class Run:
    """A solver on a system that has kinks."""

    def __init__(
        self, adaptive: Callable[..., Any], system: System, kinks: Callable[..., Any], rtol: float, atol: float
    ) -> None:
        self.adaptive, self.system, self.kinks = adaptive, system, kinks
        self.tolerances = max(rtol / FINER, min(rtol, FINEST)), atol / FINER
        self.counts: Counter[str] = Counter()
        self.left = MOST_PARTS

    def solve(self, z: Any, times: Any) -> Any:
        """States at the times behind the first, at which it is z."""
        states, counts = counted(self.adaptive(self.system, z, times, *self.tolerances))
        self.counts.update(counts)
        return np.asarray(states, dtype=float)[1:]

    def states(self, z: Any, times: Any) -> Iterator[Any]:
        """At the times; looked at between more of them."""
        yield z
        wanted = set(times.tolist())
        grid = np.union1d(times, np.linspace(times[0], times[-1], LOOKS + 1))
        here, many = 0, FIRST
        while here < len(grid) - 1:
            ahead, before = grid[here : here + many + 1], self.kinks(z)
            many *= GROW
            for t, end, state in zip(ahead[:-1], ahead[1:], self.solve(z, ahead), strict=True):
                after = self.kinks(state)
                kink = bool(turns(before, after, end - t))
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
        """The state at the end of an interval, begun anew behind each kink in it."""
        for _ in range(min(MANY, self.left)):
            self.left -= 1
            parts = np.linspace(t, end, PARTS + 1)
            states = [z, *self.solve(z, parts)]
            signs = [self.kinks(x) for x in states]
            turned = [bool(turns(*pair, parts[1] - t)) for pair in pairwise(signs)]
            if not any(turned):
                return states[-1]
            first = turned.index(True)
            z, t, after = states[first], parts[first], parts[first + 1]
            crossed = signs[first][0] * signs[first + 1][0] < 0.0
            if crossed.any():
                z, t = self.behind(z, t, after, np.flatnonzero(crossed))
            else:  # it begins or ends in one, or may pass it and come back
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

        first, kink = end, int(crossed[0])
        for j in crossed:
            u = self.kinks(z)[0][j]
            if u * self.kinks(at(first))[0][j] < 0.0:
                first, kink = brentq(lambda x, j=j: self.kinks(at(x))[0][j], t, first, xtol=BEHIND * abs(end)), j
        step, sign = BEHIND * max(abs(end), end - t), np.sign(self.kinks(z)[0][kink])
        while first < end and self.kinks(at(min(end, first + step)))[0][kink] * sign >= 0.0:
            step *= 4.0
        first = min(end, first + step)
        return at(first), first
