"""Event location at kinks of |u|: a step ends just behind the first time at which u, a number in the formulas, is 0.

On either side |u| is u or -u, and has its series. So the sign is that of the start of a step, and the step ends where
the series of u has left it. Roots are such numbers too: where q touches 0 or passes it closer than the tolerance sees,
the series of sqrt(q . q) is that of a distance which goes on below 0.
"""

from __future__ import annotations

from tcbench.compiler.language import rare

from .memory import Work

SAMPLES = 8  # of a step in which u may change its sign
SHORT, MOST = 1e-4, 20  # part of a step; so many in a row, and one a kink, that these make shorter: formulas have jumps
PARTS, EACH = 100, 40  # of a fixed step at most, and so many a kink
GROW = 10.0  # over the order: what rounding leaves of a root's first coefficients grows with that power of a step
CLOSE = 1e-10  # part of a step by which it ends behind a kink at least; else the tolerance


@rare
def first(w: Work, h: float, tolerance: float) -> float:
    """The length of a step of h from its series, or up to just behind the first kink."""
    near = abs(h) * max(CLOSE, tolerance)
    for j in range(w.n_kinks):
        begin = (w.order + 1) * w.size + 2 + j
        u, most = w.coefficients[begin], moved(w, j, abs(h))
        if u == 0.0 and most != 0.0:  # it has no sign yet
            h = min(abs(h), near) if h > 0.0 else -min(abs(h), near)
        if u == 0.0 or abs(u) > most:
            continue
        sign = 1.0 if u > 0.0 else -1.0
        low, high = 0.0, 0.0
        for i in range(SAMPLES):
            x = h * (i + 1) / SAMPLES
            if high == 0.0 and sign * at(w, j, x) < 0.0:
                high = x
            elif high == 0.0:
                low = x
        while abs(high - low) > near:
            x = 0.5 * (low + high)
            if sign * at(w, j, x) < 0.0:
                high = x
            else:
                low = x
        h = high if high != 0.0 else h
    return h


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
    for k in range(w.order + 1):
        total = total * t + w.coefficients[(w.order + 1) * w.size + 2 + (w.order - k) * w.n_kinks + j]
    return total
