"""Steps of the mended Taylor method: as long as the series is good, or of a length that is given."""

from __future__ import annotations

import math

from tcbench.compiler.language import Floats, Matrix, bits, call, copy_into, from_bits, late, rare
from tcbench.compiler.library import Library
from tcbench.compiler.polling import to_end
from tcbench.solver.mending import mended

from . import damping, kinks
from .looks import (
    AGREED,
    AGREED_AT_LEAST,
    BEFORE_KINK,
    FEW,
    GROWN,
    INSIDE,
    LEAST,
    LEAST_FALL,
    LOOKS,
    NEAR,
    SHORTEST,
    SHRINK,
    SHRUNK,
    agree,
    is_witness,
    looked_at,
    right_at,
    right_end,
)
from .memory import Work
from .texts import BESIDE

# The bits of a positive double, as a whole number, are its logarithm of base 2, up to 0.086 too small, times 2^52. So a
# root of high order is a division; those of the root's 1 are taken so that it is right on average.
ONE = (1023.0 - 0.043) * 2.0**52
NEVER = 2**62  # steps
FIRST = 4  # steps to the first mended state; after one that ends in none a single step
MOST_HELD = 10  # steps in a kink, each longer than the last
MOVED = 200.0  # tolerances of a step, by which mending may move where it ends
HOPELESS, MOST_HOPELESS = 1e-9, 500  # steps so short, over the time, and how many in a row: it would take 1e9 of them
# A step ends behind a kink: by so much, over the time, that round-off leaves it there, and by up to a tolerance of its
# length, if what that misses is no more than a tolerance, so that a root which all but turned at 0 has turned. To first
# order the rates behind it make up for what is missed: the thousand kinks of a ball that comes to rest would add up.
BEHIND_KINK, CLOSER_TO_KINK = 3e-14, 0.125
UNSURE = 1e-3  # tolerances of a step, by which a kink may lie elsewhere whatever the rates do there


def begin(w: Work, z: Floats) -> None:
    """A run from z: nothing spent, and energy, entropy and invariants of z as those to be kept."""
    w.counts.steps, w.counts.rejected = 0, 0
    w.trials.wait, w.trials.pause = 0, damping.PAUSE
    start_from(w, z)


def start_from(w: Work, z: Floats) -> None:
    """At z: with its energy, entropy and invariants as those to be kept."""
    call(w.to_start, z, w.given, w.target)
    call(w.to_y, z, w.given, w.mended)


def mended_state(w: Work, h: float) -> bool:
    """The state after h, mended, its entropy as the new lowest; False if it is not admissible."""
    w.length[0] = h
    call(w.to_state, w.coefficients, w.length, w.mended)
    return onto_laws(w, w.mended)


def onto_laws(w: Work, y: Floats) -> bool:
    """This state, mended: z of it in `target`, itself in `mended`."""
    call(w.to_z, y, w.given, w.target[0 : w.size])
    good = mended(w.to_mend, w.to_hold, w.target, w.given, w.found)
    call(w.to_y, w.target[0 : w.size], w.given, w.mended)
    return good


def mended_end(w: Work, tolerance: float) -> bool:
    """The state in `end`, mended; False, too, where that moves it by much more than a step may miss: what the laws miss
    by little may be made up for by much of a variable on which they hardly depend."""
    return onto_laws(w, w.end[0 : w.size]) and is_near(w, tolerance)


def is_near(w: Work, tolerance: float) -> bool:
    """Is the mended state near that in `end`?"""
    limit = MOVED * max(tolerance, AGREED_AT_LEAST)
    good = True
    for i in range(w.size):
        y, move = w.end[i], w.mended[i] - w.end[i]
        good = good and move * move <= limit * limit * (w.least[i] + y * y)
    return good


def step_length(w: Work, tolerance: float) -> float:
    """So long that neither of the last two terms of the series is above the tolerance; to 3 %."""
    first, goal = (w.order + 1) * w.size, bits(tolerance * tolerance)
    square, squared = w.coefficients[first], w.coefficients[first + 1]
    if not (square > LEAST and square < math.inf and squared > LEAST and squared < math.inf):
        return rough_length(w, goal)
    last = (goal - bits(squared)) * (0.5 / w.order)
    before = (goal - bits(square)) * (0.5 / (w.order - 1))
    return from_bits(int(ONE + min(last, before)))


@late
def rough_length(w: Work, goal: int) -> float:
    """The same where squares are none; 0 where coefficients are none."""
    least = math.inf
    for k in range(w.order - 1, w.order + 1):
        largest = 0.0
        for i in range(w.size):
            y = w.coefficients[i]
            size = abs(w.coefficients[k * w.size + i]) / math.sqrt(w.least[i] + y * y)
            if not size < math.inf:
                return 0.0
            largest = max(largest, size)
        square = 2.0 * bits(largest) - ONE if largest > 0.0 else 0.0
        least = min(least, (goal - square) * (0.5 / k))
    return from_bits(int(ONE + least))


def run(w: Work) -> int:
    """States z at the times that the record has been lent, each mended, from the first; how many rows were reached."""
    begin(w, w.states[0])
    row, _, _ = advance(w, w.times, w.tolerance, w.states, 1, w.times[0], math.inf, 1, 0)
    return row


def advance(
    w: Work, times: Floats, tolerance: float, states: Matrix, row: int, t: float, most: float, patience: int, leg: int
) -> tuple[int, float, float]:
    """States z at times[row:] from t on, each mended; returns (row that is next, t, the last step).

    A step ends where its series does, not at output times: states on the way come from the series. It ends early where
    steps become too short (then the last is 0), and after `patience` of them in a row that were longer than `most`: so
    they are where stiffness bounds them; and in the first mended state after the steps of a `leg`, if that is not 0 and
    more than a few such steps are left.
    """
    c, h, fresh, end = w.course, 0.0, True, w.counts.steps + leg if leg > 0 else NEVER
    set_out(w, times, row, t)
    while c.row < len(times):
        if to_end(w.watch, c.t):
            return c.row, c.t, 0.0
        if fresh:
            leaves = c.long == patience or (c.since == 0 and w.counts.steps >= end and w.few * h < c.final - c.t)
            if leaves and (not c.checked or right_end(w, h, tolerance)):
                return c.row, c.t, h
            h = next_length(w, tolerance)
        scale = max(c.unit, abs(c.t))
        good = h > SHORTEST * scale and c.hopeless < MOST_HOPELESS
        if not good and c.since == 0:
            copy_into(w.mended, w.kept)
            return c.row, c.t, 0.0
        here = c.row
        if good:
            here = outputs(w, h, times, tolerance, states)
            good = here >= 0
        mended = True
        if good and here < len(times):
            leaves = w.counts.steps + 1 >= end and w.few * h < c.final - (c.t + h)
            mended = leaves or (h > most and c.long + 1 == patience) or c.since + 1 >= c.often
            if mended:
                reach(w, h, w.end)
                good = mended_end(w, tolerance)
            else:  # whether it is admissible shows when a later one is mended
                reach(w, h, w.mended)
        fresh = good or c.since > 0
        if good:
            c.last_t, c.last_row, c.last_since, c.h = c.t, c.row, c.since, h
            c.row, c.t = here, c.t + h
            w.counts.steps += 1
            c.long = c.long + 1 if h > most else 0
            c.since = 0 if mended else c.since + 1
            c.often = min(2 * c.often, w.seldom) if mended else c.often
        else:
            h = rejected(w, h)
    return c.row, c.t, h


def set_out(w: Work, times: Floats, row: int, t: float) -> None:
    """On from t, where the run is in a mended state."""
    c = w.course
    c.final = times[len(times) - 1]
    c.unit, c.gap = min(1.0, c.final - times[0]), (c.final - times[0]) / LOOKS
    c.t, c.row, c.since, c.often, c.long, c.checked = t, row, 0, min(FIRST, w.seldom), 0, False
    c.kept_t, c.kept_row, c.kept_entropy = t, row, w.target[w.size + 1]
    c.held, c.hopeless, c.longest, c.own = 0, 0, 0.0, 0.0


def next_length(w: Work, tolerance: float) -> float:
    """Of the step from where the run is, its series made; or, where the last step may have ended beside the truth, of
    one in its place that is looked at. 0: there is none."""
    c, first = w.course, (w.order + 1) * w.size
    copy_into(w.last, w.coefficients[0 : w.size])
    call(w.to_series, w.mended, w.given, w.coefficients)
    h = step_length(w, tolerance)
    wrong = SHRUNK * h < c.own and not c.checked
    if c.checked and not agree(w, w.coefficients, w.size, c.h, tolerance):
        wrong = not right_end(w, c.h, tolerance)
    if wrong:
        go_back(w)
        call(w.to_series, w.mended, w.given, w.coefficients)
        h = min(step_length(w, tolerance), c.h)
    if c.since == 0:  # also where the run is again, after steps that were taken back
        c.hopeless = c.hopeless + 1 if c.t - c.kept_t < HOPELESS * max(c.unit, abs(c.t)) else 0
        copy_into(w.kept, w.mended)
        c.kept_t, c.kept_row, c.kept_entropy = c.t, c.row, w.target[w.size + 1]
    c.last_entropy = w.target[w.size + 1]
    before, last, own = w.coefficients[first], h * h * w.coefficients[first + 1], h
    blank = not (last < before and last > LEAST_FALL * LEAST_FALL * before) and not is_witness(w, h)
    c.checked = h > GROWN * c.own and not wrong
    if blank or wrong or h > FEW * c.gap or c.t + h >= c.final:
        h = looked_at(w, h, INSIDE if wrong else NEAR if blank else 1.0, tolerance)
    c.own, c.behind = h if h == own and not wrong else 0.0, 0.0
    if w.reach > 0.0 and c.own > 0.0:
        h = damping.lengthened(w, h, tolerance)
        c.own = h if h == own else 0.0
    if w.n_kinks > 0:
        h = to_kink(w, h, tolerance)
    c.checked = c.checked and c.own > 0.0
    return h


def go_back(w: Work) -> None:
    """To where the last step began."""
    c = w.course
    copy_into(w.mended, w.last)
    w.target[w.size + 1] = c.last_entropy
    c.t, c.row, c.since, c.long = c.last_t, c.last_row, c.last_since, 0
    w.counts.steps -= 1
    w.counts.rejected += 1


@late
def to_kink(w: Work, h: float, tolerance: float) -> float:
    """The part of a step up to behind the first kink, looked at before it; 0 after too many that are short."""
    c = w.course
    whole = min(h, c.final - c.t + c.unit)  # of polynomials it has no bound
    h = kinks.first(w, whole, kinks.CLOSE * whole * kinks.MORE ** min(c.held, MOST_HELD), kinks.DOUBT)
    if h < whole:
        behind, least = c.unsure, UNSURE * tolerance * whole
        while behind > least and behind < math.inf and right_at(w, h + behind, c.unsure, tolerance / AGREED):
            behind *= CLOSER_TO_KINK  # beyond may be the far side of a window
        if behind > least:
            h = max(h - 2.0 * c.unsure, SHRINK * h)  # the next step sees it from near by
        if c.own > 0.0 and not right_at(w, BEFORE_KINK * h, h, tolerance):
            h = looked_at(w, h, INSIDE, tolerance)
        behind, least = tolerance * h, BEHIND_KINK * max(c.unit, abs(c.t))
        while behind > least and not right_at(w, h + behind, behind, tolerance / AGREED):
            behind *= CLOSER_TO_KINK
        kink, h = h, min(h + max(behind, least), whole)
        c.behind = h - kink
        c.own = 0.0  # behind it the rates are others
    c.held = c.held + 1 if h < kinks.SHORT * min(whole, max(c.longest, c.gap)) else 0
    c.longest = max(c.longest, h)
    return h if c.held < kinks.MOST + w.n_kinks else 0.0


def reach(w: Work, h: float, state: Floats) -> None:
    """The end of a step of h; in `end` with slopes, too, where these are to be checked."""
    w.length[0] = h
    if w.course.checked or w.course.behind > 0.0:
        turn(w, state)
    else:
        call(w.to_state, w.coefficients, w.length, state)


@rare
def turn(w: Work, state: Floats) -> None:
    """The same by `end`; behind a kink with the rates that it has from there on."""
    call(w.to_end, w.coefficients, w.length, w.end)
    if w.course.behind > 0.0:
        call(w.to_rates, w.end, w.given, w.rates)
        for i in range(w.size):
            w.end[i] += w.course.behind * (w.rates[w.size + i] - w.end[w.size + BESIDE + i])
    copy_into(state[0 : w.size], w.end[0 : w.size])


def outputs(w: Work, h: float, times: Floats, tolerance: float, states: Matrix) -> int:
    """States at the times within a step; the row behind them, or -1: one is not admissible."""
    c = w.course
    here, n, end = c.row, len(times), c.t + h
    while here < n and times[here] <= end:
        good = mended_state(w, times[here] - c.t)
        call(w.to_z, w.mended, w.given, states[here])
        here += 1
        if not good:
            return -1
    if h > c.gap and here > c.row:
        call(w.to_state, w.coefficients, w.length, w.end)
        if not is_near(w, tolerance):
            return -1
    return here


@rare
def rejected(w: Work, h: float) -> float:
    """After a step that ends in no admissible state: half of it, from the last mended state, where each is mended."""
    c = w.course
    w.counts.rejected += 1
    damping.put_off(w)
    w.target[w.size + 1] = c.kept_entropy
    copy_into(w.mended, w.kept)
    if c.since > 0:
        c.checked, c.own = False, 0.0
        c.t, c.row, c.long, c.since, c.often = c.kept_t, c.kept_row, 0, 0, 1
        return h
    return SHRINK * h


def fixed_steps(w: Work, h: float, states: Matrix) -> int:
    """States z after each of the steps of length h, up to the first that ends in none; how many.

    The series of a root has digits up to some times the way from where it turned, so steps grow from there.
    """
    behind, grow = math.inf, 1.0 + kinks.GROW / w.order
    for row in range(len(states)):
        left, parts = h, 0
        while left != 0.0:
            if h < 0.0:  # back in time entropy falls
                w.target[w.size + 1] = -math.inf
            call(w.to_series, w.mended, w.given, w.coefficients)
            part = left if abs(left) <= grow * behind else grow * behind * left / abs(left)
            if w.n_kinks > 0:
                whole = part
                part = kinks.first(w, whole, kinks.FIXED * abs(whole), 0.0)
                behind += abs(part)
                if abs(part) < abs(whole):
                    behind = kinks.FIXED * abs(h)
                    part += kinks.FIXED * h
                    part = left if abs(part) > abs(left) else part
            parts += 1
            if parts > kinks.PARTS + kinks.EACH * w.n_kinks or not mended_state(w, part):
                return row
            left -= part
        call(w.to_z, w.mended, w.given, states[row])
    return len(states)


LOOPS = Library("taylor", begin, run, fixed_steps)
