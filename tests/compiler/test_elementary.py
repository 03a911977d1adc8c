"""Elementary functions of formulas: compiled values and derivatives against mpmath and numpy, wherever they are defined
and where they are not; the exact divided differences of each."""

import mpmath as mp
import numpy as np
import pytest

from tcbench.compiler import derivatives as trace
from tcbench.compiler.derivatives import jacobian
from tcbench.compiler.kernels import kernel
from tcbench.compiler.ops import TINY
from tcbench.compiler.symbols import make
from tcbench.errors import TraceError

ULP = 2.3e-16
LIMITS = [0.0, -0.0, 5e-324, -3e-310, 1e-300, 1.0, -1.0, 710.3, -745.2, 1e200, -1e300, np.inf, -np.inf, np.nan]
SIZES = [1e-9, 0.01, 0.3, 0.7, 0.999, 1.7, 6.0, 25.0]
POWERS = [0, 1, 2, 2.0, 3, 7.0, -1, -2, -3.0, 0.5, 1.5, -0.5, 2.5, 1 / 3, -0.7, 64, 65, -65, 100.0, np.inf, -np.inf]
ONE = {
    "sqrt": mp.sqrt, "exp": mp.exp, "log": mp.log, "expm1": mp.expm1, "log1p": mp.log1p, "sin": mp.sin, "cos": mp.cos,
    "tan": mp.tan, "arcsin": mp.asin, "arccos": mp.acos, "arctan": mp.atan, "sinh": mp.sinh, "cosh": mp.cosh,
    "tanh": mp.tanh,
}  # fmt: skip
TWO = {"hypot": mp.hypot, "arctan2": mp.atan2, "power": mp.power}


def values(outputs, inputs, x):
    outputs = [trace.lifted(y) for y in outputs]
    compiled = kernel({s: f"a[{i}]" for i, s in enumerate(inputs)}, outputs)
    return compiled(np.array(x, dtype=float), np.zeros(1))


def real(f, *x):
    """f in sixty digits; None where it has no real value there."""
    with mp.workdps(60):
        try:
            found = f(*map(mp.mpf, x))
        except (ValueError, ZeroDivisionError):
            return None
        return None if isinstance(found, mp.mpc) and found.imag != 0 else mp.re(found)


def assert_close(found, exact, ulps, where):
    with mp.workdps(60):
        assert abs(mp.mpf(float(found)) - exact) <= ulps * ULP * abs(exact) + mp.mpf("5e-324"), where


@pytest.mark.parametrize("name", ONE)
def test_values_and_slopes_have_the_digits_of_exact_arithmetic(name):
    x = trace.variables("x", 1)
    y = getattr(np, name)(x)[0]
    slope, bend = jacobian([y], x)[0, 0], jacobian([jacobian([y], x)[0, 0]], x)[0, 0]
    compiled = kernel({x[0]: "a[0]"}, [y, trace.lifted(slope), trace.lifted(bend)])
    for at in [s * sign for s in SIZES for sign in (1, -1)]:
        found = compiled(np.array([at]), np.zeros(1))
        if real(ONE[name], at) is None:
            assert np.isnan(found[0])
            continue
        assert_close(found[0], real(ONE[name], at), 3, (name, at))
        if at != -1:
            with mp.workdps(60):
                exact = [mp.diff(ONE[name], mp.mpf(at), k) for k in (1, 2)]
            for got, expected in zip(found[1:], exact, strict=True):  # some are formulas of the value, with its digits
                assert abs(got - expected) <= 1e-13 * abs(expected) + 4 * ULP * (1 + abs(found[0])), (name, at)


@pytest.mark.parametrize("name", ONE)
def test_limits_are_those_of_numpy(name):
    x = trace.variables("x", 1)
    compiled = kernel({x[0]: "a[0]"}, [getattr(np, name)(x)[0]])
    with np.errstate(all="ignore"):
        for at in LIMITS:
            found, expected = compiled(np.array([at]), np.zeros(1))[0], getattr(np, name)(at)
            np.testing.assert_allclose(found, expected, rtol=3 * ULP, atol=5e-324, err_msg=f"{name} of {at}")


@pytest.mark.parametrize("name", TWO)
def test_functions_of_two_numbers_too(name):
    x, y = trace.variables("x", 2)
    f = getattr(np, name)
    compiled = kernel({x: "a[0]", y: "a[1]"}, [f(x, y), *map(trace.lifted, jacobian([f(x, y)], [x, y])[0])])
    for a, b in [(0.3, 1.7), (1.7, -0.3), (6.0, 2.5), (1e-9, 3.0)]:
        found = compiled(np.array([a, b]), np.zeros(1))
        with mp.workdps(60):
            at = mp.mpf(a), mp.mpf(b)
            exact = [TWO[name](*at), *(mp.diff(TWO[name], at, n) for n in ((1, 0), (0, 1)))]
        assert_close(found[0], exact[0], 3, (a, b))
        for got, expected in zip(found[1:], exact[1:], strict=True):
            assert_close(got, expected, 20, (a, b))
    with np.errstate(all="ignore"):
        for a in LIMITS:
            for b in LIMITS:
                np.testing.assert_allclose(compiled(np.array([a, b]), np.zeros(1))[0], f(a, b), rtol=1e-15, atol=5e-324)


@pytest.mark.parametrize("exponent", POWERS)
def test_powers_are_those_of_numpy_for_every_base(exponent):
    x = trace.variables("x", 1)
    compiled = kernel({x[0]: "a[0]"}, [trace.lifted((x**exponent)[0])])
    with np.errstate(all="ignore"):
        for at in [*LIMITS, 2.0, -2.0, -1.1, 1.1, 1e-3, -7.3]:
            if at == -np.inf and exponent in (0.5, 1.5, 2.5):
                continue  # numpy has NaN for an array of them and infinity for one
            found, expected = compiled(np.array([at]), np.zeros(1))[0], np.float64(at) ** exponent
            if -TINY < at < 0 and exponent in (1.5, 2.5):
                expected = 0.0  # as of 0, where such a power has a slope, too
            np.testing.assert_allclose(found, expected, rtol=2e-14, atol=1e-300, err_msg=f"{at} ** {exponent}")


def test_a_number_to_the_power_of_a_symbol_and_an_array_of_exponents():
    x, y = trace.variables("x", 2)
    found = values([2.0**x, *(x ** np.array([1.0, 2.0])), x**y, np.float64(3.0) ** y], [x, y], [3.0, -1.5])
    assert found.tolist() == pytest.approx([8.0, 3.0, 9.0, 3.0**-1.5, 3.0**-1.5], rel=4e-16)


def test_constants_are_folded_as_numpy_does_it():
    x = trace.variable("x")
    assert np.log(0.0 * x).value == -np.inf and np.exp(0.0 * x + 1000.0).value == np.inf
    for nan in (lambda: np.log(0.0 * x - 1.0), lambda: (0.0 * x - 1.0) ** 0.5, lambda: np.arcsin(0.0 * x + 2.0)):
        with pytest.raises(TraceError, match=r"test_elementary.py, line \d+: the formula contains NaN"):
            nan()
    assert values([x - np.inf, x * -np.inf], [x], [1.0]).tolist() == [-np.inf, -np.inf]


SLOPES = {
    "phi": lambda x: mp.expm1(x) / x, "lam": lambda x: mp.log1p(x) / x, "sinc": lambda x: mp.sin(x) / x,
}  # fmt: skip


@pytest.mark.parametrize("name", SLOPES)
def test_quotients_have_derivatives_of_every_order(name):
    exact, x = SLOPES[name], trace.variable("x")
    outputs = [make(name, x)]
    for _ in range(5):
        outputs.append(jacobian([outputs[-1]], [x])[0, 0])
    compiled = kernel({x: "a[0]"}, outputs)
    for at in [0.0, 1e-8, 0.04, -0.3, 0.31, 0.9, -0.7, -0.76, -0.95, 2.0, 4.1, 7.9, 8.1, 60.0, -5.0, -60.0]:
        if name == "lam" and at < -1:
            continue
        with mp.workdps(80):
            series = mp.taylor(exact, mp.mpf(at) if at else mp.mpf("1e-30"), 5)
            expected = [float(c * mp.factorial(k)) for k, c in enumerate(series)]
        np.testing.assert_allclose(compiled(np.array([at]), np.zeros(1)), expected, rtol=2e-12, atol=1e-18)


@pytest.mark.parametrize(("a", "b"), [(-5.0, 4.0), (1e8, -1e8), (-1e5, 1e5 + 2), (0.3, 0.3 + 1e-12), (-2.0, 0.5)])
def test_the_angle_between_is_the_principal_one_and_so_is_its_slope(a, b):
    x = trace.variables("x", 2)
    slope = make("atan_slope", x[0], x[1] - x[0])
    found = values([slope, *jacobian([slope], list(x))[0]], x, [a, b])
    with mp.workdps(60):
        f = lambda p, q: (mp.atan(q) - mp.atan(p)) / (q - p)  # noqa: E731
        at = mp.mpf(a), mp.mpf(b)
        exact = [f(*at), mp.diff(f, at, (1, 0), h=mp.mpf("1e-25")), mp.diff(f, at, (0, 1), h=mp.mpf("1e-25"))]
    np.testing.assert_allclose(found, [float(x) for x in exact], rtol=1e-9, atol=1e-12 * abs(float(exact[0])))
    assert found[0] == pytest.approx(float(exact[0]), rel=4e-16)
