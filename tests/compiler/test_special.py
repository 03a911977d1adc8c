"""phi and lam against mpmath, on both sides of the switch between series and library call."""

import mpmath as mp
import numpy as np
import pytest

from tcbench.compiler import special
from tcbench.compiler.derivatives import jacobian, variables
from tcbench.compiler.kernels import kernel
from tcbench.compiler.symbols import make

mp.mp.dps = 60
EXACT = {
    "phi": lambda x: mp.expm1(x) / x if x else mp.mpf(1),
    "lam": lambda x: mp.log1p(x) / x if x else mp.mpf(1),
    "dphi": lambda x: (1 + (x - 1) * mp.exp(x)) / x**2 if x else mp.mpf(1) / 2,
    "dlam": lambda x: (x / (1 + x) - mp.log1p(x)) / x**2 if x else -mp.mpf(1) / 2,
}
SIZES = [
    0.0, 1e-17, 1e-12, 1e-8, 1e-4, 0.01, 0.04999999, 0.05000001, 0.1, 0.2, 0.2799, 0.2999999, 0.3000001, 0.3255, 0.33,
    0.5, 0.9,
]  # fmt: skip


@pytest.mark.parametrize("name", EXACT)
def test_divided_differences_of_exp_and_log_keep_their_digits(name):
    # values enter residuals: 4 ulp; derivatives enter Jacobians only, where 1e-12 costs Newton nothing
    tolerance = 9e-16 if name in ("phi", "lam") else 1e-12
    for x in [s * sign for s in SIZES for sign in (1, -1)] + [3.0, 20.0]:
        exact = EXACT[name](mp.mpf(x))
        assert abs(getattr(special, name)(x) - exact) <= tolerance * abs(exact), x


@pytest.mark.parametrize("name", ["phi", "lam"])
def test_the_switches_between_series_and_library_are_below_round_off(name):
    edges = [special.PHI_SERIES, -special.PHI_SERIES]
    if name == "lam":
        tiny, small = special.LAM_TAYLOR, special.LAM_SERIES
        edges = [tiny, -tiny, 2 * small / (1 - small), -2 * small / (1 + small)]
    f = getattr(special, name)
    for x in edges:
        left, right = f(np.nextafter(x, -9.0)), f(np.nextafter(x, 9.0))
        assert abs(left - right) <= 1e-15 * abs(left)


@pytest.mark.parametrize("a", [0.0, 1e-9, 0.3, -4.9, 19.0, 300.0, 800.0])
@pytest.mark.parametrize("d", [0.0, 1e-12, 0.7, -4.9, -900.0])
def test_the_divided_difference_of_tanh_keeps_its_digits(a, d):
    """1 - tanh(a) tanh(b) had lost four of them at 4.9, and all at 19; and 0 times infinity is no number."""
    with mp.workdps(800):
        x, step = mp.mpf(a), mp.mpf(d)
        exact = (mp.tanh(x + step) - mp.tanh(x)) / step if d else mp.sech(x) ** 2
        bend = mp.coth(step) - 1 / step if d else mp.mpf(0)
        assert abs(special.tanh_slope(a, d) - exact) <= 2.3e-16 * (5 + abs(a)) * exact + 1e-300  # of a + d
        assert abs(special.langevin(d) - bend) <= 1e-15 * abs(bend)


@pytest.mark.parametrize(
    ("a", "d"), [(0.1, 0.7), (-0.3, -0.1), (-0.3, 0.1), (0.3, -0.9), (0.0, 0.0), (-1e-200, 2e-200)]
)
def test_the_divided_difference_of_a_size_is_a_sign_to_the_last_bit(a, d):
    b = a + d
    exact = (mp.mpf(abs(b)) - mp.mpf(abs(a))) / (mp.mpf(b) - mp.mpf(a)) if d else 0.0
    sign = special.abs_slope(a, d)
    assert sign == exact if abs(exact) == 1 else np.isclose(sign, float(exact), rtol=1e-15)
    x = variables("x", 2)
    slope = make("abs_slope", *x)
    found = kernel({x[0]: "a[0]", x[1]: "a[1]"}, jacobian([slope], x).ravel())(np.array([a, d]), np.zeros(1))
    crossed = 2 / abs(d) * np.array([1, -a / d]) if a * b < 0 else np.zeros(2)
    assert np.allclose(found, crossed, atol=1e-12)
