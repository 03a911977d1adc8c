"""Longer steps where something decays fast: a series whose last coefficients are damped.

Of a decay y' = -r y the polynomial of order p is R(-h r), and |R| <= 1 bounds h r to about 2 + 0.3 p. With factors on
the last four coefficients R is right to the order p - 4, and at most 0.9 down to -h r = -16 or further and in a strip
of one to either side: Chebyshev's trick, as explicit methods for parabolic equations have it (Abdulle 2002), on
coefficients that are there anyway. What such a step misses is estimated by another polynomial of them: it begins with
the term that R misses first, and is as small as it can be where R is (`python benchmarks/damped_series.py`).

A series is damped where its last two coefficients are those of a decay and the step of the series as it is would be
bounded by it. There is nothing to declare, and nothing to remember but how often it was tried in vain.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tcbench.compiler.language import late

from .memory import LAST, Work

# By order: h r down to which R is small; factors of the last coefficients; of those but the first, in the estimate.
DAMPED = {
    8: (17.95, (0.7535888096, 0.3675314898, 0.1040120036, 0.0131453607), (0.3088897920, 0.1478102168, 0.0265251289)),
    10: (16.1, (0.8433914524, 0.4976082514, 0.1757082974, 0.0279349232), (0.2759117757, 0.1803674865, 0.0432650217)),
    12: (15.56, (0.8898339079, 0.5848584768, 0.2364248762, 0.0434195993), (0.2426740365, 0.1946715389, 0.0564381343)),
    14: (15.55, (0.9168076677, 0.6456503753, 0.2862795800, 0.0581875797), (0.2151259944, 0.1999249085, 0.0664049865)),
    16: (15.83, (0.9339078782, 0.6898388782, 0.3273078673, 0.0718015489), (0.1928119628, 0.2001842260, 0.0736568202)),
    18: (16.26, (0.9454358613, 0.7229895454, 0.3612381015, 0.0841115661), (0.1750403631, 0.1983359776, 0.0791163900)),
    20: (16.78, (0.9536120052, 0.7486156742, 0.3896142510, 0.0951769063), (0.1607366890, 0.1955479733, 0.0833045388)),
}  # fmt: skip
BOUND = 0.25  # ratio of the last terms of a series from which on a decay may be what bounds a step
ALIKE = 0.8  # the square of the cosine between the last two coefficients of a decay
LONGER = 1.5  # times the step that the series allows as it is: the trial takes half the time of a small system's step
TRIES = 3  # lengths of one step
SAFETY, SHORTER = 0.9, 0.3  # of the length that the estimate suggests; of the last one, the least that is tried next
PAUSE, MOST_PAUSE = 4, 256  # steps until the next trial after the first that fails, and twice as many each time up to


def fields(order: int) -> dict[str, Any]:
    """Those of a record, for series of this order."""
    reach, factors, misses = DAMPED.get(order, (0.0, (1.0,) * LAST, (0.0,) * (LAST - 1)))
    return {"reach": reach, "factors": np.array(factors), "misses": np.array([1.0 - factors[0], *misses])}


def lengthened(w: Work, h: float, tolerance: float) -> float:
    """The length of a step from its series, which is damped if that allows more than the h that it has as it is."""
    if w.trials.wait > 0:
        w.trials.wait -= 1
        return h
    first = (w.order + 1) * w.size
    if not h * h * w.coefficients[first + 1] > BOUND * BOUND * w.coefficients[first]:
        return h
    rate = decay(w)
    length = w.reach / rate if rate > 0.0 else 0.0
    for _ in range(TRIES):
        if not length > LONGER * h:
            break
        size = missed(w, length) / (tolerance * tolerance)
        if size <= 1.0:
            damp(w)
            w.trials.pause = PAUSE
            return length
        length *= max(SHORTER, SAFETY * size ** (-0.5 / (w.order - LAST + 1)))
    put_off(w)
    return h


def decay(w: Work) -> float:
    """The rate of the fastest decay, whose coefficients have turns of signs; 0 where the last two are no such."""
    n = w.size
    last = w.order * n
    product, before, square = 0.0, 0.0, 0.0
    for i in range(n):
        a, b, y = w.coefficients[last - n + i], w.coefficients[last + i], w.coefficients[i]
        weight = 1.0 / (w.least[i] + y * y)
        product += weight * a * b
        before += weight * a * a
        square += weight * b * b
    # products of squares would overflow where time has a unit of its own
    alike = product < 0.0 and product * (product / before) > ALIKE * square
    return -w.order * product / before if alike else 0.0


def put_off(w: Work) -> None:
    """The next trial is later, and the one after that later still."""
    w.trials.wait, w.trials.pause = max(w.trials.wait, w.trials.pause), min(2 * w.trials.pause, MOST_PAUSE)


def missed(w: Work, h: float) -> float:
    """The square of what a damped step of length h misses, each variable over its size."""
    n, power, total = w.size, 1.0, 0.0
    first = (w.order + 1 - LAST) * n
    for _ in range(w.order + 1 - LAST):
        power *= h
    m0, m1, m2, m3 = w.misses[0], w.misses[1] * h, w.misses[2] * h * h, w.misses[3] * h * h * h
    for i in range(first, first + n):
        e = m0 * w.coefficients[i] + m1 * w.coefficients[i + n]
        e += m2 * w.coefficients[i + 2 * n] + m3 * w.coefficients[i + 3 * n]
        y = w.coefficients[i - first]
        total += e * e / (w.least[i - first] + y * y)
    return total * power * power


@late
def damp(w: Work) -> None:
    """The factors into the last coefficients, also of what is to keep its sign."""
    kinks = (w.order + 1) * w.size + 2
    for j in range(LAST):
        k = w.order + 1 - LAST + j
        for i in range(k * w.size, (k + 1) * w.size):
            w.coefficients[i] *= w.factors[j]
        for i in range(kinks + k * w.n_kinks, kinks + (k + 1) * w.n_kinks):
            w.coefficients[i] *= w.factors[j]
