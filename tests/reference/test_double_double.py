"""Double-double arithmetic: exact where it says so, 30 digits elsewhere, and equal to the last bit in plain Python."""

from decimal import Decimal, localcontext
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tcbench.compiler import language
from tcbench.compiler.language import Eight, Floats, exact, put, row, two_product
from tcbench.compiler.library import Library
from tcbench.reference import double_double as dd
from tcbench.reference.double_double import add, atan, cos_sin, div, exp, log, mul, sqrt, two_sum


@exact
def pairs(a: Floats, out: Floats) -> None:
    """The sum and the product of two doubles, exactly."""
    x, y = row(a, 0, 8), row(a, 8, 8)
    h, l = two_sum(x, y)
    put(out, 0, h)
    put(out, 8, l)
    h, l = two_product(x, y)
    put(out, 16, h)
    put(out, 24, l)


@exact
def keep(out: Floats, at: int, h: Eight, l: Eight) -> None:
    put(out, 16 * at, h)
    put(out, 16 * at + 8, l)


@exact
def elementary(a: Floats, out: Floats) -> None:
    """Of two numbers x and y, y positive."""
    xh, xl, yh, yl = row(a, 0, 8), row(a, 8, 8), row(a, 16, 8), row(a, 24, 8)
    h, l = add(xh, xl, yh, yl)
    keep(out, 0, h, l)
    h, l = mul(xh, xl, yh, yl)
    keep(out, 1, h, l)
    h, l = div(xh, xl, yh, yl)
    keep(out, 2, h, l)
    h, l = sqrt(yh, yl)
    keep(out, 3, h, l)
    h, l = exp(xh, xl)
    keep(out, 4, h, l)
    h, l = log(yh, yl)
    keep(out, 5, h, l)
    ch, cl, sh, sl = cos_sin(xh, xl)
    keep(out, 6, ch, cl)
    keep(out, 7, sh, sl)
    h, l = atan(xh, xl)
    keep(out, 8, h, l)


LIBRARY = Library("tests of double-doubles", pairs, elementary)
DIGITS = 3e-31
DOUBLES = st.floats(-1e60, 1e60).map(lambda x: x if abs(x) > 1e-60 else 0.0)


@given(st.lists(st.tuples(DOUBLES, DOUBLES), min_size=8, max_size=8))
@settings(max_examples=30)
def test_sums_and_products_of_doubles_lose_nothing(numbers):
    a, out = np.array(numbers).T.ravel(), np.empty(32)
    LIBRARY.pairs(a, out)
    for x, y, s, e, p, f in zip(*a.reshape(2, 8), *out.reshape(4, 8), strict=True):
        assert s == x + y and Fraction(s) + Fraction(e) == Fraction(x) + Fraction(y)
        assert p == x * y and Fraction(p) + Fraction(f) == Fraction(x) * Fraction(y)
    plain = np.empty(32)
    pairs(a, plain)
    assert np.array_equal(plain, out)


def cos_sin_of(x):
    """By their series, of x of a few turns at most."""
    c, s, term, i = Decimal(0), Decimal(0), Decimal(1), 0
    while abs(term) > Decimal("1e-60") or i < abs(x):
        sign = 1 if i % 4 < 2 else -1
        c, s = (c + sign * term, s) if i % 2 == 0 else (c, s + sign * term)
        i += 1
        term = term * x / i
    return c, s


def right(x, y):
    c, s = cos_sin_of(x)
    return [x + y, x * y, x / y, y.sqrt(), x.exp(), y.ln(), c, s]


def numbers(seed):
    """Eight x between -20 and 20 and eight positive y of all sizes, each with a low part."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-20, 20, 8), 10.0 ** rng.uniform(-8, 8, 8)
    return np.concatenate([part for z in (x, y) for part in (z, z * 2.0**-54 * rng.uniform(-1, 1, 8))])


@pytest.mark.parametrize("seed", range(4))
def test_functions_have_thirty_digits_and_the_same_bits_in_plain_python(seed):
    a, out, plain = numbers(seed), np.empty(144), np.empty(144)
    LIBRARY.elementary(a, out)
    elementary(a, plain)
    assert plain.tobytes() == out.tobytes()
    parts = out.reshape(9, 2, 8)
    with localcontext(prec=70):
        for lane in range(8):
            xh, xl, yh, yl = (Decimal(float(v)) for v in a.reshape(4, 8)[:, lane])
            found = [Decimal(float(h)) + Decimal(float(l)) for h, l in parts[:, :, lane]]
            for which, (value, truth) in enumerate(zip(found, right(xh + xl, yh + yl), strict=False)):
                size = abs(truth) if which != 6 and which != 7 else Decimal(1)
                assert abs(value - truth) <= Decimal(DIGITS) * max(size, Decimal(1) if which == 5 else size), which
            c, s = cos_sin_of(found[8])
            assert abs(s - (xh + xl) * c) <= Decimal(DIGITS) * (1 + abs(xh))  # x is the tangent


def test_beyond_what_it_is_for_there_is_no_number():
    a, out = np.full(32, 1.0), np.empty(144)
    a[:8] = [800.0, -800.0, 1e300, -1e300, np.inf, np.nan, 2e6, 1.0]
    a[16:24] = [0.0, -1.0, np.nan, np.inf, 1.0, 1.0, 1.0, 1.0]
    LIBRARY.elementary(a, out)
    parts = out.reshape(9, 2, 8)[:, 0]
    assert np.isnan(parts[4, :7]).all() and np.isfinite(parts[4, 7])
    assert np.isnan(parts[5, [1, 2]]).all() and np.isnan(parts[6, 2:7]).all()
    assert not np.isfinite(parts[5, [0, 3]]).any()


@pytest.mark.skipif(language.PLAIN, reason="everything is plain")
def test_exact_functions_are_not_contracted():
    code = LIBRARY.code()
    assert "fmul" in code and "contract" not in code and dd.ROUND == 1.5 * 2**52
