"""Double-double arithmetic: a number as the unrounded sum of two doubles (h, l), 32 digits; eight of them at once.

Every operation here is rounded by itself (`exact`) and is one that IEEE 754 defines to the last bit (+, -, *, /, sqrt,
and exact products), so results are equal to the last bit on every processor, fused multiply-add or not, and in plain
Python. No function of the mathematical library is called: those differ between machines.
Dekker (1971), Numer. Math. 18, 224; Joldes, Muller and Popescu (2017), ACM TOMS 44, 15 (errors of a few 2^-104).
"""

from __future__ import annotations

import math
from collections.abc import Callable

from ..compiler.language import Eight, bits, exact, from_bits, rare, two_product, vector

ROUND = 1.5 * 2.0**52  # adding it rounds to a whole number
INVERSE_LN2 = 1.4426950408889634
LN2, LN2_LOW = 0.6931471805599453, 2.3190468138462996e-17
INVERSE_HALF_PI = 0.6366197723675814
HALF_PI, HALF_PI_LOW, HALF_PI_LAST = 1.5707963267948966, 6.123233995736766e-17, -1.4973849048591833e-33
EXPONENT, ONE = 2**52, 1023 * 2**52  # of a double's bits
LARGEST_POWER, LARGEST_TURN = 1000.0, 1e6
NAN = math.nan


@exact
def eight(x: float) -> Eight:
    """A number in every lane."""
    return vector(x, x, x, x, x, x, x, x)


@exact
def two_sum(x: Eight, y: Eight) -> tuple[Eight, Eight]:
    """(sum, error) with sum + error = x + y exactly."""
    s = x + y
    t = s - x
    return s, (x - (s - t)) + (y - t)


@exact
def fast_two_sum(x: Eight, y: Eight) -> tuple[Eight, Eight]:
    """`two_sum` where |x| >= |y|."""
    s = x + y
    return s, y - (s - x)


@exact
def add(xh: Eight, xl: Eight, yh: Eight, yl: Eight) -> tuple[Eight, Eight]:
    s, e = two_sum(xh, yh)
    t, f = two_sum(xl, yl)
    h, l = fast_two_sum(s, e + t)
    return fast_two_sum(h, l + f)


@exact
def mul(xh: Eight, xl: Eight, yh: Eight, yl: Eight) -> tuple[Eight, Eight]:
    p, e = two_product(xh, yh)
    return fast_two_sum(p, e + (xh * yl + xl * yh))


@exact
def mul_double(xh: Eight, xl: Eight, y: Eight) -> tuple[Eight, Eight]:
    p, e = two_product(xh, y)
    return fast_two_sum(p, e + xl * y)


@exact
def div(xh: Eight, xl: Eight, yh: Eight, yl: Eight) -> tuple[Eight, Eight]:
    """Long division, three quotients."""
    q1 = xh / yh
    ph, pl = mul_double(yh, yl, q1)
    rh, rl = add(xh, xl, -ph, -pl)
    q2 = rh / yh
    ph, pl = mul_double(yh, yl, q2)
    rh, rl = add(rh, rl, -ph, -pl)
    h, l = fast_two_sum(q1, q2)
    return add(h, l, rh / yh, eight(0.0))


@exact
def power_of_two(k: float) -> float:
    """2^k for an integer k; NaN beyond the exponents in use."""
    return from_bits((int(k) + 1023) * EXPONENT) if abs(k) < LARGEST_POWER else NAN


@exact
def rough_log(x: float) -> float:
    """log x to an ulp or two for x > 0; NaN of others."""
    if not x > 0.0:
        return NAN
    whole = bits(x)
    exponent, m = whole // EXPONENT - 1023, from_bits(whole % EXPONENT + ONE)
    if m > 1.4142135623730951:
        m, exponent = 0.5 * m, exponent + 1
    s = (m - 1.0) / (m + 1.0)
    z, total = s * s, 0.0
    for i in range(25, 0, -2):
        total = total * z + 1.0 / i
    return exponent * LN2 + 2.0 * s * total


@exact
def cosine_of_quarters(n: float) -> float:
    """The cosine of n quarter turns; NaN of too many."""
    if not abs(n) < LARGEST_TURN:
        return NAN
    k = int(n) % 4
    return 1.0 if k == 0 else -1.0 if k == 2 else 0.0


@exact
def size(x: float) -> float:
    return abs(x)


@exact
def sign(x: float) -> float:
    return 1.0 if x > 0.0 else -1.0 if x < 0.0 else x


def lanewise(function: Callable[[float], float]) -> Callable[[Eight], Eight]:
    """The function applied to eight numbers, one by one."""

    @exact
    def each(x: Eight) -> Eight:
        return vector(
            function(x[0]), function(x[1]), function(x[2]), function(x[3]),
            function(x[4]), function(x[5]), function(x[6]), function(x[7]),
        )  # fmt: skip

    return each


roots, powers_of_two = lanewise(math.sqrt), lanewise(power_of_two)
rough_logs, cosines_of_quarters = lanewise(rough_log), lanewise(cosine_of_quarters)
sizes, signs = lanewise(size), lanewise(sign)


@rare
@exact
def sqrt(xh: Eight, xl: Eight) -> tuple[Eight, Eight]:
    """Square root: one Newton step from the root in doubles; NaN of negative numbers."""
    y = roots(xh)
    ph, pl = two_product(y, y)
    rh, rl = add(xh, xl, -ph, -pl)
    return fast_two_sum(y, (rh + rl) / (y + y))


@rare
@exact
def exp(xh: Eight, xl: Eight) -> tuple[Eight, Eight]:
    """e^x: x = k ln 2 + 64 r, the series of e^r - 1, squared six times."""
    k = (xh * INVERSE_LN2 + ROUND) - ROUND
    ph, pl = mul_double(eight(LN2), eight(LN2_LOW), k)
    rh, rl = add(xh, xl, -ph, -pl)
    rh, rl = rh * 0.015625, rl * 0.015625
    th, tl = rh, rl
    sh, sl = rh, rl
    for i in range(2, 14):
        th, tl = mul(th, tl, rh, rl)
        th, tl = div(th, tl, eight(float(i)), eight(0.0))
        sh, sl = add(sh, sl, th, tl)
    for _ in range(6):
        ph, pl = mul(sh, sl, sh, sl)
        sh, sl = add(sh + sh, sl + sl, ph, pl)
    sh, sl = add(sh, sl, eight(1.0), eight(0.0))
    scale = powers_of_two(k)
    return sh * scale, sl * scale


@rare
@exact
def log(xh: Eight, xl: Eight) -> tuple[Eight, Eight]:
    """log x: two Newton steps, y + x e^-y - 1, from the logarithm in doubles."""
    yh, yl = rough_logs(xh), eight(0.0)
    for _ in range(2):
        eh, el = exp(-yh, -yl)
        ph, pl = mul(xh, xl, eh, el)
        ph, pl = add(ph, pl, eight(-1.0), eight(0.0))
        yh, yl = add(yh, yl, ph, pl)
    return yh, yl


@rare
@exact
def cos_sin(xh: Eight, xl: Eight) -> tuple[Eight, Eight, Eight, Eight]:
    """cos x and sin x: x = n pi/2 + r; the series of both at r."""
    n = (xh * INVERSE_HALF_PI + ROUND) - ROUND
    ph, pl = mul_double(eight(HALF_PI), eight(HALF_PI_LOW), n)
    rh, rl = add(xh, xl, -ph, -pl)
    rh, rl = add(rh, rl, -n * HALF_PI_LAST, eight(0.0))
    ch, cl, sh, sl = eight(1.0), eight(0.0), rh, rl
    th, tl = rh, rl
    sign = -1.0
    for i in range(2, 31, 2):
        th, tl = mul(th, tl, rh, rl)
        th, tl = div(th, tl, eight(float(i)), eight(0.0))
        ch, cl = add(ch, cl, th * sign, tl * sign)
        th, tl = mul(th, tl, rh, rl)
        th, tl = div(th, tl, eight(float(i + 1)), eight(0.0))
        sh, sl = add(sh, sl, th * sign, tl * sign)
        sign = -sign
    c, s = cosines_of_quarters(n), cosines_of_quarters(n - 1.0)
    h, l = add(ch * c, cl * c, -sh * s, -sl * s)
    g, k = add(sh * c, sl * c, ch * s, cl * s)
    return h, l, g, k


@rare
@exact
def atan(xh: Eight, xl: Eight) -> tuple[Eight, Eight]:
    """atan x: the angle is halved four times, t/(1 + sqrt(1 + t^2)); then its series."""
    for _ in range(4):
        ph, pl = mul(xh, xl, xh, xl)
        ph, pl = add(ph, pl, eight(1.0), eight(0.0))
        ph, pl = sqrt(ph, pl)
        ph, pl = add(ph, pl, eight(1.0), eight(0.0))
        xh, xl = div(xh, xl, ph, pl)
    zh, zl = mul(xh, xl, xh, xl)
    sh, sl = eight(0.0), eight(0.0)
    for i in range(33, 0, -2):
        sh, sl = mul(sh, sl, -zh, -zl)
        ph, pl = div(eight(1.0), eight(0.0), eight(float(i)), eight(0.0))
        sh, sl = add(sh, sl, ph, pl)
    sh, sl = mul(sh, sl, xh, xl)
    return sh * 16.0, sl * 16.0
