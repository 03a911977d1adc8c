"""The two divided differences that every discrete gradient here is made of, and their derivatives.

    phi(x) = expm1(x)/x       lam(x) = log1p(x)/x       both 1 at x = 0 (PHYSICS of Romero 2009, (27)-(33))

Near 0 a series is both exact to the last digit and faster than the library call; each switch is below round-off.
All arguments and results are dimensionless.
"""

from __future__ import annotations

import math

from .jit import compiled

PHI_SERIES = 0.3  # |x| below this: the first omitted term of phi is 0.3^12/13! = 9e-17
LAM_SERIES = 0.14  # |x/(2 + x)| below this: the first omitted term of lam is 0.14^18/19 = 2e-17


@compiled
def phi(x: float) -> float:
    """expm1(x)/x."""
    if abs(x) < PHI_SERIES:
        x2 = x * x
        x4 = x2 * x2
        low = (1.0 + x * (1 / 2)) + x2 * ((1 / 6) + x * (1 / 24))
        mid = ((1 / 120) + x * (1 / 720)) + x2 * ((1 / 5040) + x * (1 / 40320))
        top = ((1 / 362880) + x * (1 / 3628800)) + x2 * ((1 / 39916800) + x * (1 / 479001600))
        return low + x4 * (mid + x4 * top)
    return math.expm1(x) / x


@compiled
def dphi(x: float) -> float:
    """Derivative of phi; used in Jacobians only."""
    if abs(x) < PHI_SERIES:
        x2 = x * x
        x4 = x2 * x2
        low = ((1 / 2) + x * (2 / 6)) + x2 * ((3 / 24) + x * (4 / 120))
        mid = ((5 / 720) + x * (6 / 5040)) + x2 * ((7 / 40320) + x * (8 / 362880))
        return low + x4 * (mid + x4 * ((9 / 3628800) + x * (10 / 39916800)))
    e = math.expm1(x)
    return (1.0 + e - e / x) / x


@compiled
def lam(x: float) -> float:
    """log1p(x)/x, through log1p(x) = 2 artanh(x/(2 + x))."""
    r = 1.0 / (2.0 + x)
    y = x * r
    if abs(y) < LAM_SERIES:
        u = y * y
        u2 = u * u
        u4 = u2 * u2
        low = (1.0 + u * (1 / 3)) + u2 * ((1 / 5) + u * (1 / 7))
        top = ((1 / 9) + u * (1 / 11)) + u2 * ((1 / 13) + u * (1 / 15))
        return 2.0 * r * (low + u4 * (top + u4 * (1 / 17)))
    return math.log1p(x) / x


@compiled
def dlam(x: float) -> float:
    """Derivative of lam; used in Jacobians only."""
    r = 1.0 / (2.0 + x)
    y = x * r
    if abs(y) < LAM_SERIES:
        u = y * y
        u2 = u * u
        u4 = u2 * u2
        low = (1.0 + u * (1 / 3)) + u2 * ((1 / 5) + u * (1 / 7))
        top = ((1 / 9) + u * (1 / 11)) + u2 * ((1 / 13) + u * (1 / 15))
        series = low + u4 * (top + u4 * (1 / 17))
        low = ((1 / 3) + u * (2 / 5)) + u2 * ((3 / 7) + u * (4 / 9))
        top = ((5 / 11) + u * (6 / 13)) + u2 * ((7 / 15) + u * (8 / 17))
        return 2.0 * r * r * (4.0 * r * y * (low + u4 * top) - series)
    return (1.0 / (1.0 + x) - math.log1p(x) / x) / x
