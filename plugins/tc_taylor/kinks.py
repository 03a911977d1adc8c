"""Event location at kinks of |u|: a step ends just behind the first time at which u, a number in the formulas, is 0.

On either side |u| is u or -u, and has its series. So the sign is that of the start of a step, and the step ends where
the series of u has left it. Roots are such numbers too: where q touches 0 or passes it closer than the tolerance sees,
the series of sqrt(q . q) is that of a distance which goes on below 0.
"""

from __future__ import annotations

import math

from tcbench.compiler.language import rare

from .memory import Work

LOOK = 2.0**-18  # of a step: where u has another sign for less that may not be seen
LOOK_DOUBTFUL = 2.0**-10  # the same of a step that ends there anyway, and after so many looks:
MOST_LOOKS = 4000
DOUBT = 4.0  # times the last terms of u: what its series may owe
SHORT, MOST = 1e-4, 20  # part of a step; so many in a row, and one a kink, that these make shorter: formulas have jumps
PARTS, EACH = 100, 40  # of a fixed step at most, and so many a kink
FIXED = 1e-10  # the same of a fixed step
GROW = 10.0  # over the order: what rounding leaves of a root's first coefficients grows with that power of a step
# A step ends behind a kink by this part of the way to it at most; where one begins in a kink and ends there, too, the
# next is MORE times as long.
CLOSE, MORE = 1e-13, 4.0


@rare
def first(w: Work, h: float, near: float, doubt: float) -> float:
    """The length of the step: h, or less, to end just behind the first kink; `near` at most if it begins in one.

    It also ends where u comes so close to 0 that its series does not tell whether it passes 0: closer than `doubt`
    times its last terms. A shorter step tells. `course.unsure` is then infinite, and behind a kink it is the time by
    which the kink may lie elsewhere.
    """
    for j in range(w.n_kinks):
        u, most = term(w, j, 0), moved(w, j, abs(h))
        if u == 0.0 and most != 0.0:  # it has no sign yet
            h = min(abs(h), near) if h > 0.0 else -min(abs(h), near)
        if u == 0.0 or abs(u) > most:
            continue
        sign = 1.0 if u > 0.0 else -1.0
        low, high = crossed(w, j, sign, h, doubt)
        if high == 0.0:
            continue
        w.course.unsure = math.inf
        if low != high:
            while abs(high - low) > CLOSE * abs(high):
                x = 0.5 * (low + high)
                if sign * at(w, j, x) < 0.0:
                    high = x
                else:
                    low = x
            slope = abs(slope_at(w, j, high))
            if slope > 0.0:
                w.course.unsure = doubt * last_terms(w, j, abs(high)) / slope
        h = high
    return h


@rare
def crossed(w: Work, j: int, sign: float, h: float, doubt: float) -> tuple[float, float]:
    """Two times of a step, between which u first loses this sign. Equal times: u comes closer to 0 there than `doubt`
    times the last terms of its series. 0 and 0: u keeps its sign.

    On its way it goes as far as u must keep it, by its slope and a bound of its curvature: u may pass 0 and come back.
    """
    size, way = abs(h), 1.0 if h > 0.0 else -1.0
    bent = 0.0
    for k in range(w.order, 1, -1):
        bent = bent * size + abs(term(w, j, k)) * k * (k - 1)
    high, value, doubtful, look, looks = 0.0, sign * term(w, j, 0), 0.0, LOOK, 0
    while high < size:
        looks += 1
        look = LOOK_DOUBTFUL if looks == MOST_LOOKS else look
        low, slope = high, sign * way * slope_at(w, j, way * high)
        root = math.sqrt(slope * slope + 2.0 * bent * value)
        sure = 2.0 * value / (root - slope) if root > slope else size
        high = min(size, low + max(sure, look * size))
        value = sign * at(w, j, way * high)
        if value < 0.0:
            if doubtful > 0.0 and high > 2.0 * doubtful:
                break
            return way * low, way * high
        near = value < doubt * last_terms(w, j, high)
        if near and doubtful == 0.0:
            doubtful, look = high, LOOK_DOUBTFUL
        elif doubtful > 0.0 and not near:
            break
    return way * doubtful, way * doubtful


def term(w: Work, j: int, k: int) -> float:
    """A coefficient of u."""
    return w.coefficients[(w.order + 1) * w.size + 2 + k * w.n_kinks + j]


def last_terms(w: Work, j: int, t: float) -> float:
    """The size of the last four terms of u after t, which bounds what the series leaves out."""
    total = 0.0
    for k in range(w.order, w.order - 4, -1):
        total = total * t + abs(term(w, j, k))
    return total * t ** (w.order - 3)


def slope_at(w: Work, j: int, t: float) -> float:
    """The slope of u after t."""
    total = 0.0
    for k in range(w.order, 0, -1):
        total = total * t + k * term(w, j, k)
    return total


def moved(w: Work, j: int, h: float) -> float:
    """By how much u can change in a step: two sums side by side, for each operation waits for the one before."""
    n, begin = w.n_kinks, (w.order + 1) * w.size + 2 + j
    odd, even, power, square = 0.0, 0.0, h, h * h
    for k in range(1, w.order, 2):
        odd += abs(w.coefficients[begin + k * n]) * power
        even += abs(w.coefficients[begin + (k + 1) * n]) * power
        power *= square
    if w.order % 2 == 1:
        odd += abs(w.coefficients[begin + w.order * n]) * power
    return odd + even * h


def at(w: Work, j: int, t: float) -> float:
    """u after t."""
    total = 0.0
    for k in range(w.order, -1, -1):
        total = total * t + term(w, j, k)
    return total
