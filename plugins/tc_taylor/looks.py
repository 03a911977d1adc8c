"""Do formulas and series agree? What a step's series does not witness is looked at before the step is taken."""

from __future__ import annotations

import math

from tcbench.compiler.language import Floats, call, rare

from . import damping, kinks
from .memory import Work
from .texts import BESIDE

# A step of h agrees with the formulas where h times what their rates differ by from the series' slopes is so many
# tolerances at most. That is asked at the end of a step that is GROWN times as long as the last one, and of one from
# whose end the next would be SHRUNK times shorter. A step is looked at on its way, too, before it is taken, where the
# series is no witness of it: where its last terms do not fall, or fall by more than any function's do (it is blank, has
# gaps, or is the tail of something narrow far away), and where it is long beside the run: at places 1/LOOKS of the run
# from each other at most, or RADII of the last terms' ratio, if those are no more than MOST_LOOKS.
AGREED, AGREED_AT_LEAST = 60.0, 1e-11
GROWN, SHRUNK, LEAST_FALL, FALL = 1.3, 1.6, 0.02, 0.5
LOOKS, FEW, RADII, MOST_LOOKS = 33.3, 3.0, 2.0, 64.0
MOST_DECAY = 2.0  # orders: decay times of a step, of order 10, up to which no later term is above 16 times the last
NEAR, OUT, INSIDE = 0.15, 2.6, 0.381966  # the first look at a step, and how much farther each next one is
SHRINK, SHORTEST = 0.5, 1e-14  # of a step that ends in no admissible state; of a step, over the time
BEFORE_KINK = 0.98  # of a step to a kink: behind it the rates are others
CLOSER = 1e-3  # part of a length to which the end of what is right is found
LEAST = 1e-290  # a squared size that has all its digits: it goes with the unit of time to the power of twice the order


def agree(w: Work, rates: Floats, first: int, h: float, tolerance: float) -> bool:
    """Are the slopes in `end` those of the formulas, rates[first:]? What a step of h would miss, if all of it were so
    wrong, is h times their difference."""
    limit = max(AGREED * tolerance, AGREED_AT_LEAST) / h
    limit *= limit
    slopes, good = w.size + BESIDE, True
    for i in range(w.size):
        y, miss = w.end[i], w.end[slopes + i] - rates[first + i]
        good = good and miss * miss <= limit * (w.least[i] + y * y)
    return good


@rare
def right_at(w: Work, x: float, h: float, tolerance: float) -> bool:
    """Do the formulas agree with the series at x of a step of h?"""
    w.length[0] = x
    call(w.to_end, w.coefficients, w.length, w.end)
    return right_end(w, h, tolerance)


@rare
def right_end(w: Work, h: float, tolerance: float) -> bool:
    """The same of the place in `end`."""
    call(w.to_rates, w.end, w.given, w.rates)
    return agree(w, w.rates, w.size, h, tolerance)


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
def is_witness(w: Work, h: float) -> bool:
    """Do the last two terms of a step fall beside the two before them, as a function's do, or are they a decay's, whose
    signs alternate?"""
    square, earlier, first, sizes = h * h, 0.0, (w.order - 3) * w.size, (w.order + 1) * w.size
    before, last = w.coefficients[sizes], square * w.coefficients[sizes + 1]
    if last >= before and w.reach > 0.0:
        decays = damping.decay(w) * h
        if decays > 0.0 and decays < MOST_DECAY * w.order:
            return True
    for i in range(w.size):
        y, a, b = w.coefficients[i], w.coefficients[first + i], w.coefficients[first + w.size + i]
        earlier += (a * a + square * b * b) / (w.least[i] + y * y)
    later = square * square * (before + last)
    return later < FALL * FALL * earlier and later > LEAST_FALL**4 * earlier


@rare
def looked_at(w: Work, h: float, x: float, tolerance: float) -> float:
    """This step, if formulas and series agree at x of it, on from there and at its end; else a shorter one."""
    c, first = w.course, (w.order + 1) * w.size
    most, radius = min(h, c.final - c.t), 0.0
    before, last = w.coefficients[first], w.coefficients[first + 1]
    if last > LEAST and before < math.inf:
        radius = math.sqrt(before / last)
    if w.n_kinks > 0:
        kink = kinks.first(w, most, most, kinks.DOUBT)
        most = BEFORE_KINK * kink if kink < most else most
    gap = min(c.gap, max(RADII * radius, most / MOST_LOOKS)) if radius > 0.0 else c.gap
    found = sure(w, most, min(x * most, gap) if x < 1.0 else min(most, c.gap), gap, tolerance)
    return h if found == most else found
