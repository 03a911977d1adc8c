"""The numbers of plugins/tc_taylor/damping.py: polynomials that are small along a decay, by linear programming.

    python benchmarks/damped_series.py

R(x) = sum of w_k x^k/k! is right to the order p - 4, and |R| <= 0.9 from -1 down to -reach, in a strip of one to either
side; the reach is the longest for which there is such an R (Ketcheson and Ahmadi 2012). The estimate D(x) = sum of
d_k x^k/k! begins with the term that R misses first, and is the smallest such on [-reach, 0].
"""

from __future__ import annotations

import math

import numpy as np
from numpy.polynomial import chebyshev, polynomial
from scipy.optimize import linprog

LAST, SMALL, STRIP = 4, 0.9, 1.0
POINTS, DIRECTIONS, BISECTIONS = 160, 12, 22


def powers(coefficients, reach, first):
    """x^first times a Chebyshev series in 1 + 2x/reach, as factors of x^k/k!."""
    series = np.zeros(1)
    power = np.ones(1)
    for c in chebyshev.cheb2poly(coefficients):
        series, power = polynomial.polyadd(series, c * power), polynomial.polymul(power, [1.0, 2.0 / reach])
    return np.array([0.0] * first + [c * math.factorial(first + k) for k, c in enumerate(series)])


def basis(x, reach, first):
    return chebyshev.chebvander(1 + 2 * x / reach, LAST - 1) * ((-x / reach) ** first)[:, None]


def smallest(columns, fixed, equal=None):
    """(the least maximum of |fixed + columns . c|, c)."""
    turns = np.exp(2j * np.pi * np.arange(DIRECTIONS) / DIRECTIONS)
    above = np.vstack([np.c_[(columns * turn).real, -np.ones(len(columns))] for turn in turns])
    below = np.concatenate([-(fixed * turn).real for turn in turns])
    bounds = [(None, None)] * LAST + [(0, None)]
    a, b = (None, None) if equal is None else (np.r_[equal, 0.0][None], [1.0])
    found = linprog(np.r_[np.zeros(LAST), 1.0], A_ub=above, b_ub=below, A_eq=a, b_eq=b, bounds=bounds)
    return (found.x[-1], found.x[:-1]) if found.status == 0 else (np.inf, np.zeros(LAST))


def damped(p, reach):
    """(largest |R|, the factors of the last coefficients) for this reach."""
    first = p + 1 - LAST
    x = -reach / 2 * (1 + np.cos(np.linspace(0, np.pi, POINTS)))
    z = np.concatenate([x[x <= -1] + 1j * y for y in (0.0, STRIP / 2, STRIP)])
    exponential = sum(z**k / math.factorial(k) for k in range(first))
    size, c = smallest(basis(z, reach, first), exponential)
    return size, powers(c * (-1.0 / reach) ** first, reach, first)[first:]


def estimate(p, reach, factors):
    """The factors of the last coefficients in D."""
    first = p + 1 - LAST
    x = -reach / 2 * (1 + np.cos(np.linspace(0, np.pi, POINTS)))
    leading = (1 - factors[0]) / math.factorial(first) * reach**first
    columns = basis(x, reach, first) * leading
    _, c = smallest(columns, np.zeros(len(x)), chebyshev.chebvander(np.ones(1), LAST - 1)[0])
    return powers(c * leading / reach**first, reach, first)[first:]


def main():
    for p in range(8, 21, 2):
        low, high = 4.0, 40.0
        for _ in range(BISECTIONS):
            reach = (low + high) / 2
            low, high = (reach, high) if damped(p, reach)[0] <= SMALL else (low, reach)
        _, factors = damped(p, low)
        rows = [", ".join(f"{x:.10f}" for x in row) for row in (factors, estimate(p, low, factors)[1:])]
        print(f"    {p}: ({math.floor(100 * low) / 100}, ({rows[0]}), ({rows[1]})),")


if __name__ == "__main__":
    main()
