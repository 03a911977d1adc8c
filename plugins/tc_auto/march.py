"""One run by two methods: which one steps, and how a state goes from one to the other."""

from __future__ import annotations

import math

from tcbench.compiler.language import call, copy_into, rare
from tcbench.compiler.library import Library
from tcbench.compiler.records import Record

from ..tc_gauss import march as gauss
from ..tc_gauss.memory import Work as Gauss
from ..tc_taylor import march as taylor
from ..tc_taylor.march import Work as Taylor

# Explicit steps are measured in times of the fastest motion.
STABLE, STABLE_OF_ORDER = 2.0, 0.3  # those of order p that stability bounds: about so many, and so many p
STIFF = 0.7  # of these: from here on stability bounds a step
COVERED = 10.0  # decay times of an explicit step on average: damped ones take up to 16, of any order
PATIENCE, MORE = 8, 10  # stiff steps in a row before the other method is tried, and so many times as many each time
LONGER = 10.0  # the first implicit step, over the last explicit one
# Iterations that the explicit steps to the end must be worth for the other method to be tried, and the part of them
# that a trial may owe; steps until the fastest motion is looked for, each time four times as many, up to a most.
SHORT, SHARE, LEG, MOST_LEG = 80.0, 0.05, 16, 512
# Where formulas jump so that no explicit step leads on: iterations over there, and how often, until a run is given up.
OVER, MOST_OVER = 2048.0, 50
TURNS, SETTLED = 7, 3  # of the power method, and those of them that are not counted


class Counts(Record, mutable=True):
    """What a run took."""

    steps: int
    rejected: int
    iterations: int
    implicit: bool  # has the implicit method taken part?


class Both(Record):
    """Both methods, what explicit steps may miss, defect and residual of implicit ones, and the iterations that take
    the time of an explicit step."""

    counts: Counts
    explicit: Taylor
    implicit: Gauss
    tolerance: float
    defect: float
    residual: float
    worth: float


def run(both: Both) -> int:
    """The states and times that the explicit method has been lent, and what they took; how many rows were reached."""
    rows, counts, e, g = steps(both), both.counts, both.explicit.counts, both.implicit.counts
    counts.steps, counts.rejected, counts.iterations = e.steps + g.steps, e.rejected + g.rejected, g.iterations
    counts.implicit = g.steps + g.rejected > 0
    return rows


def steps(both: Both) -> int:
    """The states; how many rows were reached."""
    e, g, worth = both.explicit, both.implicit, both.worth
    times, states = e.times, e.states
    taylor.begin(e, states[0])
    g.counts.steps, g.counts.rejected, g.counts.iterations = 0, 0, 0
    stable = STABLE + STABLE_OF_ORDER * e.order
    row, t, h, patience, explicit, given_up = 1, times[0], 0.0, PATIENCE, True, False
    leg, left, busy, latest, over = LEG, 0.0, 0.0, 0.0, 0
    while row < len(times):
        if explicit:
            steps_before = e.counts.steps
            short = left < SHORT  # which is left to explicit steps
            rate = 1e-300 if short else max(gauss.rate_of(g, g.z, TURNS, SETTLED), 1e-300)
            most = STIFF * stable / rate
            few = 1 if latest > most else patience  # those of the leg before were stiff
            row, t, h = taylor.advance(e, times, both.tolerance, states, row, t, most, few, leg)
            if row == len(times):
                break
            latest = 0.0
            look(e, g)
            busy = 1.0 / max(h, 1e-300)
            left = worth * busy * (times[len(times) - 1] - t)
            if e.counts.steps - steps_before < leg:
                patience *= MORE
            if h > 0.0 and (left < SHORT or e.counts.steps - steps_before >= leg):
                leg, latest = min(4 * leg, MOST_LEG), h
                continue
            if not short:  # this step may be short for another reason, which passes
                busy = min(busy, rate / COVERED)
                left = worth * busy * (times[len(times) - 1] - t)
            go_over(e, g)
        else:
            g.budget.worth = worth * busy
            g.budget.most = math.inf if given_up else SHARE * left
            if given_up and e.n_kinks > 0:
                g.budget.worth, g.budget.most, over = 0.0, OVER, over + 1
            row, t, h = gauss.advance(g, times, both.defect, both.residual, states, row, t, LONGER * h)
            keep_laws(e, g)
        if (h == 0.0 and given_up) or over > MOST_OVER:
            g.budget.t = t
            return row
        given_up = h == 0.0
        explicit = not explicit
    return row


@rare
def look(e: Taylor, g: Gauss) -> None:
    """The explicit method's state as z, for the other."""
    call(e.to_z, e.mended, e.given, g.here)
    copy_into(g.z, g.here)


@rare
def go_over(e: Taylor, g: Gauss) -> None:
    """The implicit method on from there, to the other's laws."""
    gauss.go_to(g, g.here)
    copy_into(g.laws[e.size : len(e.target)], e.target[e.size : len(e.target)])


@rare
def keep_laws(e: Taylor, g: Gauss) -> None:
    """The explicit method on from the other's state, to the energy and invariants of the start of the run."""
    taylor.start_from(e, g.z)
    copy_into(e.target[e.size : len(e.target)], g.laws[e.size : len(e.target)])


LOOPS = Library("auto", run)
