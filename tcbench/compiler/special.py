"""Divided differences of elementary functions, for discrete gradients, and their derivatives.

    phi(x) = expm1(x)/x       lam(x) = log1p(x)/x       sinc(x) = sin(x)/x       all 1 at x = 0
    atan_slope(a, d) = (atan(a + d) - atan(a))/d       tanh_slope(a, d), abs_slope(a, d) likewise

Near 0 a series is both exact to the last digit and faster than the library call; each switch is below round-off.
All arguments and results are dimensionless.
"""

from __future__ import annotations

from .language import of_c

exp, expm1, log1p, sin, cos, tanh, atan2 = map(of_c, ("exp", "expm1", "log1p", "sin", "cos", "tanh", "atan2"))
SINC_SERIES = 0.2  # x^2 below this: the first omitted term of sinc is 0.2^7/15! = 1e-17, of its slope 4e-15
NEGLIGIBLE = 1e-18  # last term of a sum of positive ones, over the sum
PHI_SERIES = 0.3  # |x| below this: the first omitted term of phi is 0.3^12/13! = 9e-17
FAR = 300.0  # exponents: exp(FAR) is far below the largest number, exp(-FAR) nothing beside 1
LAM_TAYLOR = 0.05  # |x| below this: the first omitted term of lam is 0.05^12/13 = 2e-17
LAM_SERIES = 0.14  # |x/(2 + x)| below this: the first omitted term of lam is 0.14^18/19 = 2e-17


def _psi(x: float) -> float:
    """(phi(x) - 1)/x for |x| < PHI_SERIES: sum of x^k/(k + 2)!, in Estrin's order (short chains of operations)."""
    x2 = x * x
    x4 = x2 * x2
    low = ((1 / 2) + x * (1 / 6)) + x2 * ((1 / 24) + x * (1 / 120))
    mid = ((1 / 720) + x * (1 / 5040)) + x2 * ((1 / 40320) + x * (1 / 362880))
    top = ((1 / 3628800) + x * (1 / 39916800)) + x2 * (1 / 479001600)
    return low + x4 * (mid + x4 * top)


def phi(x: float) -> float:
    """expm1(x)/x."""
    return phi_pair(x)[0]


def phi_pair(x: float) -> tuple[float, float]:
    """phi and its derivative, which is phi - (phi - 1)/x."""
    if abs(x) < PHI_SERIES:
        psi = _psi(x)
        value = 1.0 + x * psi
        return value, value - psi
    value = expm1(x) / x
    return value, value - (value - 1.0) / x


def unless_far(x: float, z: float, d: float) -> float:
    """x where d < FAR, else z: phi(d) of a larger increment d of an exponent may be infinite."""
    return x if d < FAR else z


def _artanh_tail(u: float) -> float:
    """(artanh(y)/y - 1)/y^2 with u = y^2 < LAM_SERIES^2: sum of u^k/(2k + 3)."""
    u2 = u * u
    low = ((1 / 3) + u * (1 / 5)) + u2 * ((1 / 7) + u * (1 / 9))
    top = ((1 / 11) + u * (1 / 13)) + u2 * ((1 / 15) + u * (1 / 17))
    return low + u2 * u2 * top


def _log_tail(x: float) -> float:
    """(lam(x) - 1)/x for |x| < LAM_TAYLOR: sum of -(-x)^k/(k + 2)."""
    x2 = x * x
    x4 = x2 * x2
    low = (x * (1 / 3) - (1 / 2)) + x2 * (x * (1 / 5) - (1 / 4))
    mid = (x * (1 / 7) - (1 / 6)) + x2 * (x * (1 / 9) - (1 / 8))
    top = (x * (1 / 11) - (1 / 10)) - x2 * (1 / 12)
    return low + x4 * (mid + x4 * top)


def lam(x: float) -> float:
    """log1p(x)/x."""
    return lam_pair(x)[0]


def lam_pair(x: float) -> tuple[float, float]:
    """lam, through log1p(x) = 2 artanh(x/(2 + x)) unless x is small, and its derivative, (1 - lam)/x - 1/(1 + x)."""
    if abs(x) < LAM_TAYLOR:
        tail = _log_tail(x)
        return 1.0 + x * tail, -tail - 1.0 / (1.0 + x)
    r = 1.0 / (2.0 + x)
    y = x * r
    if abs(y) < LAM_SERIES:
        u = y * y
        tail = _artanh_tail(u)
        return 2.0 * r * (1.0 + u * tail), r - 2.0 * r * r * y * tail - 1.0 / (1.0 + x)
    value = log1p(x) / x
    return value, (1.0 - value) / x - 1.0 / (1.0 + x)


def dphi(x: float) -> float:
    return phi_pair(x)[1]


def dlam(x: float) -> float:
    return lam_pair(x)[1]


def phi_slope(order: float, x: float) -> float:
    """The `order`-th derivative of phi: the integral of t^order exp(x t) from 0 to 1."""
    if abs(x) > order + 40.0:  # by parts: nothing cancels there
        value, k = phi(x), 1.0
        while k <= order:
            value = (exp(x) - k * value) / x
            k += 1.0
        return value
    total, term, k = 0.0, 1.0 / (order + 1.0), order + 1.0
    if x < 0.0:  # terms of one sign, too: those of exp(-x) times the integral
        while term > NEGLIGIBLE * total:
            total += term
            k += 1.0
            term *= -x / k
        return exp(x) * total
    power, j = 1.0, 0.0
    while term > NEGLIGIBLE * total:
        total += term
        j += 1.0
        power *= x / j
        term = power / (k + j)
    return total


def lam_slope(order: float, x: float) -> float:
    """The `order`-th derivative of lam: (-1)^order order! times the integral of t^order/(1 + x t)^(order + 1)."""
    total, j = 0.0, 0.0
    if x > 8.0 or not x > -0.75:  # by parts, from log1p(x) = x lam(x)
        value, rate, k = lam(x), 1.0 / (1.0 + x), 1.0
        while k <= order:
            value = (rate - k * value) / x
            rate *= -k / (1.0 + x)
            k += 1.0
        return value
    front, k = 1.0, 1.0
    while k <= order:
        front *= -k
        k += 1.0
    if x < 0.0:
        power, term = 1.0, 1.0 / (order + 1.0)
        while term > NEGLIGIBLE * total:
            total += term
            j += 1.0
            power *= -x * (order + j) / j
            term = power / (order + j + 1.0)
        return front * total
    w, power, term, k = x / (1.0 + x), 1.0, 1.0 / (order + 1.0), 0.0
    while term > NEGLIGIBLE * total:
        total += term
        j += 1.0
        power *= w
        term = power / (order + j + 1.0)
    while k <= order:
        front /= 1.0 + x
        k += 1.0
    return front * total


def sinc_pair(x: float) -> tuple[float, float]:
    """sinc and its derivative, which is (cos(x) - sinc)/x."""
    x2 = x * x
    if x2 < SINC_SERIES:
        x4 = x2 * x2
        low, slow = 1.0 - x2 * (1 / 6), x2 * (1 / 30) - 1 / 3
        mid, smid = 1 / 120 - x2 * (1 / 5040), x2 * (1 / 45360) - 1 / 840
        top, stop = 1 / 362880 - x2 * (1 / 39916800), x2 * (1 / 518918400) - 1 / 3991680
        return low + x4 * (mid + x4 * (top + x4 * (1 / 6227020800))), x * (slow + x4 * (smid + x4 * stop))
    value = sin(x) / x
    return value, (cos(x) - value) / x


def sinc(x: float) -> float:
    """sin(x)/x."""
    return sinc_pair(x)[0]


def dsinc(x: float) -> float:
    return sinc_pair(x)[1]


def sinc_slope(order: float, x: float) -> float:
    """The `order`-th derivative of sinc: the integral of t^order cos^(order)(x t) from 0 to 1."""
    k, value = 1.0, sinc(x)
    if abs(x) > order + 1.0:
        here, following = cos(x), -sin(x)
        while k <= order:
            value = (here - k * value) / x
            here, following = following, -here
            k += 1.0
        return value
    power, i, sign = 1.0, 0.0, 1.0  # (-1)^i x^(2i - order)/(2i - order)! / (2i + 1), from the least i on
    while 2.0 * i < order:
        i += 1.0
        sign = -sign
    if 2.0 * i > order:
        power = x
    k, value = 2.0 * i - order, 0.0
    while i < order + 15.0:
        value += sign * power / (2.0 * i + 1.0)
        power *= x * x / ((k + 1.0) * (k + 2.0))
        k += 2.0
        i += 1.0
        sign = -sign
    return value


def atan_slope(a: float, d: float) -> float:
    """(atan(a + d) - atan(a))/d, by the angle between (1, a) and (1, a + d)."""
    if d == 0.0:
        return 1.0 / (1.0 + a * a)
    return atan2(d, 1.0 + a * (a + d)) / d


def atan_bend(a: float, d: float) -> float:
    """Derivative of atan_slope by d."""
    b = a + d
    w = 1.0 + a * b
    if not abs(d) < 0.5 * w:
        return (1.0 / (1.0 + b * b) - atan_slope(a, d)) / d
    u = d / w  # the slope is atan(u)/u / w
    power, k, value, bend = 1.0, 1.0, 1.0, 0.0
    while k < 60.0:
        bend -= (k + 1.0) * u * power / (k + 2.0)
        power *= -u * u
        k += 2.0
        value += power / k
    return (bend * (1.0 + a * a) / w - value * a) / (w * w)


def abs_slope(a: float, d: float) -> float:
    """(|a + d| - |a|)/d: exactly 1 or -1 on one side, so that |x| - x stays 0; at 0 their mean."""
    b = a + d
    if min(a, b) < 0.0 and max(a, b) > 0.0:
        return (a + b) / (abs(a) + abs(b))
    size = max(abs(a), abs(b))
    return 0.0 if size == 0.0 else 1.0 if a == size or b == size else -1.0


def tanh_slope(a: float, d: float) -> float:
    """(tanh(a + d) - tanh(a))/d = sinh(d)/(d cosh(a) cosh(b)), b = a + d; by exponentials of negative numbers, none of
    which overflows."""
    b = a + d
    x, y = abs(a), abs(b)
    least = exp(-2.0 * min(x, y)) if a * b > 0.0 else 1.0
    return 4.0 * least * phi(-2.0 * abs(d)) / ((1.0 + exp(-2.0 * x)) * (1.0 + exp(-2.0 * y)))


def langevin(x: float) -> float:
    """coth(x) - 1/x, by Lambert's continued fraction near 0: the derivative of log tanh_slope by d, plus tanh(b)."""
    if abs(x) > 2.0:
        return 1.0 / tanh(x) - 1.0 / x
    below, k = 23.0, 21.0
    while k > 1.0:
        below = k + x * x / below
        k -= 2.0
    return x / below
