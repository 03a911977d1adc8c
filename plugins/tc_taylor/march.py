"""Steps of the mended Taylor method: as long as the series is good, or of a length that is given."""

from __future__ import annotations

import math

from tcbench.compiler.language import Floats, Matrix, bits, call, copy_into, from_bits, rare
from tcbench.compiler.library import Library
from tcbench.compiler.looks import to_end
from tcbench.solver.mending import mended

from . import damping, kinks
from .memory import Work
from .texts import BESIDE

# The bits of a positive double, as a whole number, are its logarithm of base 2, up to 0.086 too small, times 2^52. So a
# root of high order is a division; those of the root's 1 are taken so that it is right on average.
ONE = (1023.0 - 0.043) * 2.0**52
NEVER = 2**62  # steps
FIRST = 4  # steps to the first mended state; after one that ends in none a single step
SHRINK, SHORTEST = 0.5, 1e-12  # of a step that ends in no admissible state; of a step, over the time
# A step is looked at where its series alone is no witness: where it would be longer than any that is known to be right
# by so much that what it misses could grow by TRUSTED, at places 1/LOOKS of the whole time from each other at most; so
# is any that is longer than FEW of these. The
# formulas agree with the series where the step times what their rates differ by is so many tolerances: see `right_at`.
TRUSTED, LOOKS, FEW = 256.0, 33.3, 3.0
AGREED, AGREED_AT_LEAST = 60.0, 1e-11
MOVED = 200.0  # tolerances of a step, by which mending may move where it ends
GROWN, NEAR, OUT = 4.0, 0.15, 2.6  # a step that grew by so much also from there on, at places each so much farther
INSIDE = 0.381966  # else there and at its end
BEFORE_KINK = 0.98  # of a step to a kink: behind it the rates are others
CLOSER = 1e-3  # part of a length to which the end of what is right is found
SHRUNK, SPRUNG = (
    1.6,
    2.0,
)  # a series whose length is so much shorter or longer than the last one's tells of a step too far
LEAST = 1e-290  # a squared size that has all its digits: it goes with the unit of time to the power of twice the order


def begin(w: Work, z: Floats) -> None:
    """A run from z: nothing spent, and energy, entropy and invariants of z as those to be kept."""
    w.counts.steps, w.counts.rejected = 0, 0
    w.trials.wait, w.trials.pause = 0, damping.PAUSE
    start_from(w, z)


def start_from(w: Work, z: Floats) -> None:
    """At z: with its energy, entropy and invariants as those to be kept."""
    call(w.to_start, z, w.given, w.target)
    copy_into(w.mended[0 : w.size], w.target[0 : w.size])


def mended_state(w: Work, h: float) -> bool:
    """The state after h, mended, its entropy as the new lowest; False if it is not admissible."""
    w.length[0] = h
    call(w.to_state, w.coefficients, w.length, w.target)
    if w.of_elements:
        return mended_elements(w)
    good = mended(w.to_mend, w.to_hold, w.target, w.given, w.mended)
    copy_into(w.mended[0 : w.size], w.target[0 : w.size])
    return good


def mended_end(w: Work, h: float, tolerance: float) -> bool:
    """The same of the end of a step, or of what is near it; False too where mending moves it by much more than a
    step may miss: what the laws miss by little may be made up for by much of a variable on which they hardly depend."""
    w.length[0] = h
    call(w.to_state, w.coefficients, w.length, w.end)
    good, limit = mended_state(w, h), MOVED * max(tolerance, AGREED_AT_LEAST) * MOVED * max(tolerance, AGREED_AT_LEAST)
    for i in range(w.size):
        y, move = w.end[i], w.mended[i] - w.end[i]
        good = good and move * move <= limit * (w.least[i] + w.share[i] * y * y)
    return good


def mended_elements(w: Work) -> bool:
    """The same with the kernels of mending.py, which give the mended state at once, and hold the entropy exactly."""
    size = w.size
    call(w.to_mend, w.target, w.given, w.mended)
    if w.mended[size] < w.target[size + 1]:
        call(w.to_hold, w.target, w.given, w.mended)
    good = w.mended[size + 1] > 0.0 and abs(w.mended[size]) < math.inf
    if good:
        w.target[size + 1] = max(w.mended[size], w.target[size + 1])
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


@rare
def right_at(w: Work, x: float, h: float, tolerance: float) -> bool:
    """Do the formulas agree with the series at x of a step of h? What the step would miss, if all of it were so wrong,
    is h times the difference of the rates."""
    w.length[0] = x
    call(w.to_end, w.coefficients, w.length, w.end)
    call(w.to_rates, w.end, w.given, w.rates)
    limit = max(AGREED * tolerance, AGREED_AT_LEAST) / h
    limit *= limit
    first = w.size + BESIDE
    for i in range(w.size):
        y, miss = w.end[i], w.end[first + i] - w.rates[w.size + i]
        if not miss * miss <= limit * (w.least[i] + w.share[i] * y * y):
            return False
    return True


@rare
def sure(w: Work, h: float, x: float, gap: float, tolerance: float) -> float:
    """A step of h at most, at whose end the formulas agree with the series, and on its way: first at x, then at places
    each OUT times as far, but at most so far from each other; 0 where there is none."""
    good, longest = 0.0, h
    while good < h:
        if right_at(w, x, h, tolerance):
            good = x
            x = min(h, OUT * x, x + gap)
            continue
        x = SHRINK * (good + x)
        h = x
        if x - good <= CLOSER * good or not x > SHORTEST * longest:
            return good
    return h


@rare
def rough_length(w: Work, goal: int) -> float:
    """The same where squares are none; 0 where coefficients are none."""
    least = math.inf
    for k in range(w.order - 1, w.order + 1):
        largest = 0.0
        for i in range(w.size):
            y = w.coefficients[i]
            size = abs(w.coefficients[k * w.size + i]) / math.sqrt(w.least[i] + w.share[i] * y * y)
            if not size < math.inf:
                return 0.0
            largest = max(largest, size)
        square = 2.0 * bits(largest) - ONE if largest > 0.0 else 0.0
        least = min(least, (goal - square) * (0.5 / k))
    return from_bits(int(ONE + least))


@rare
def looked_at(
    w: Work, h: float, known: float, left: float, gap: float, tolerance: float, closely: bool
) -> tuple[float, float]:
    """(the step, the longest that is known to be right): this one, if formulas and series agree, else a shorter one."""
    most = min(h, left)
    if w.n_kinks > 0:
        kink = kinks.first(w, most, tolerance)
        most = BEFORE_KINK * kink if kink < most else most
    x = NEAR if most > GROWN * known else INSIDE if closely else 1.0
    found = sure(w, most, min(x * most, gap), gap, tolerance)
    return h if found == most else found, found


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
    Between outputs only some steps end in a mended state; from one that ends in none the run goes back to the
    last, and mends each step.
    """
    h, fresh, long, end = 0.0, True, 0, w.counts.steps + leg if leg > 0 else NEVER
    since, often, begun = 0, min(FIRST, w.seldom), t  # steps since a mended state, how many at most, and when it was
    held = 0  # short steps in a row from kink to kink
    lowest, row_begun = w.target[w.size + 1], row  # entropy, when `begun`, and the row
    final = times[len(times) - 1]
    unit, gap = min(1.0, final - times[0]), (final - times[0]) / LOOKS
    # The length of the last series, and of the longest that is known to be right; until when each step is looked at.
    before, known, careful, trust = 0.0, 0.0, t, TRUSTED ** (1.0 / w.order)
    while row < len(times):
        if to_end(w.watch, t):
            return row, t, 0.0
        if fresh:
            if long == patience or (since == 0 and w.counts.steps >= end and w.few * h < final - t):
                return row, t, h
            call(w.to_series, w.mended, w.given, w.coefficients)
            h = step_length(w, tolerance)
            if before > 0.0 and h > 0.0 and t > careful and (SHRUNK * h < before or h > SPRUNG * before):
                # the last step may have gone on into what its series did not see
                careful, t, row, before, known, long, since = t, begun, row_begun, 0.0, 0.0, 0, 0
                w.target[w.size + 1] = lowest
                copy_into(w.mended, w.kept)
                call(w.to_series, w.mended, w.given, w.coefficients)
                h = step_length(w, tolerance)
            if since == 0:
                copy_into(w.kept, w.mended)
                begun, lowest, row_begun = t, w.target[w.size + 1], row
            if h > trust * known or h > FEW * gap or t < careful:
                own = h
                h, known = looked_at(w, h, known, final - t, gap, tolerance, t < careful)
                before = h if h == own else 0.0
                if w.reach > 0.0 and h == own:
                    h = damping.lengthened(w, h, tolerance)
            else:
                before, known = h, min(known, h)
                if w.reach > 0.0:
                    h = damping.lengthened(w, h, tolerance)
            if w.n_kinks > 0:
                whole = min(h, final - t + unit)  # of polynomials it has no bound
                h = kinks.first(w, whole, tolerance)
                held = held + 1 if h < kinks.SHORT * whole else 0
                if h < whole:  # behind it is another series
                    before, known = 0.0, 0.0
                h = h if held < kinks.MOST + w.n_kinks else 0.0
        good = h > SHORTEST * max(unit, abs(t))
        if not good and since == 0:
            copy_into(w.mended, w.kept)
            return row, t, 0.0
        here, mended = row, True
        while good and here < len(times) and times[here] <= t + h:
            if h > gap and (here + 1 == len(times) or times[here + 1] > t + h):
                good = mended_end(w, times[here] - t, tolerance)
            else:
                good = mended_state(w, times[here] - t)
            call(w.to_z, w.mended, w.given, states[here])
            here += 1
        if good and here < len(times):
            last = w.counts.steps + 1 >= end and w.few * h < final - (t + h)
            mended = last or (h > most and long + 1 == patience) or since + 1 >= often
            if mended:
                good = mended_end(w, h, tolerance)
            else:  # whether it is admissible shows when a later one is mended
                w.length[0] = h
                call(w.to_state, w.coefficients, w.length, w.mended)
        fresh = good or since > 0
        if good:
            w.counts.steps += 1
            row = here
            t += h
            long = long + 1 if h > most else 0
            since = 0 if mended else since + 1
            often = min(2 * often, w.seldom) if mended else often
            continue
        w.counts.rejected += 1
        damping.put_off(w)
        w.target[w.size + 1] = lowest
        if since > 0:
            copy_into(w.mended, w.kept)
            t, long, since, often = begun, 0, 0, 1
        else:
            h *= SHRINK
    return row, t, h


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
                part = kinks.first(w, whole, 0.0)
                behind += abs(part)
                if abs(part) < abs(whole):
                    behind = kinks.CLOSE * abs(h)
                    part += kinks.CLOSE * h
                    part = left if abs(part) > abs(left) else part
            parts += 1
            if parts > kinks.PARTS + kinks.EACH * w.n_kinks or not mended_state(w, part):
                return row
            left -= part
        call(w.to_z, w.mended, w.given, states[row])
    return len(states)


LOOPS = Library("taylor", begin, run, fixed_steps)
