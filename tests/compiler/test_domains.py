"""Random formulas of everything that can be traced: compiled values are numpy's, wherever they are and are not defined.

What the tracer makes of a formula may differ from numpy by round-off; x / y is x * (1/y), and 0 x and x - x are 0 of
infinite numbers, too: what is switched off costs nothing. (A state that is not finite ends a run.)
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tcbench.building_blocks import divided_difference
from tcbench.compiler import derivatives as trace
from tcbench.compiler.kernels import kernel
from tcbench.errors import TraceError

ARGUMENTS = [0.0, -0.0, 1.0, -1.0, 2.0, 0.3, -0.7, 1e-9, -1e-160, 1e160, -1e300, 1e-310, 5e-324, 700.0, -746.0, np.inf,
             -np.inf]  # fmt: skip
UNARY = ["sqrt", "exp", "log", "expm1", "log1p", "sin", "cos", "tan", "arcsin", "arccos", "arctan", "sinh", "cosh",
         "tanh", "abs", "negative"]  # fmt: skip
BINARY = ["add", "subtract", "multiply", "divide", "hypot", "arctan2", "power"]
POWERS = [0, 1, 2, 3.0, -1, -2, 0.5, 1.5, -0.5, 0.7, 9, 65]
SCALES = [2.0, -0.5, 1e-200, 3.0, 1.0]  # not such as undo each other: their product is taken first, and cannot overflow


def numpys(name, x, y):
    if name == "divide":
        return x * (1.0 / y)
    return getattr(np, name)(x, y)


@st.composite
def formulas(draw):
    """(formula of four numbers, each used once): no rewriting can cancel anything."""
    steps = draw(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 99), st.integers(0, 99)), min_size=2, max_size=8))

    def formula(x, divided):
        pool = list(x)
        for kind, i, j in steps:
            a = pool.pop(i % len(pool))
            if kind == 0:
                made = getattr(np, UNARY[j % len(UNARY)])(a)
            elif kind == 1 and pool:
                made = divided(BINARY[j % len(BINARY)], a, pool.pop(j % len(pool)))
            elif kind == 2:
                p = POWERS[j % len(POWERS)]
                made = a**p if p not in (0.5, 1.5) else np.sqrt(a) * a ** (p - 0.5)  # numpy itself has two of -inf
            else:
                made = SCALES[j % len(SCALES)] * a
            pool.append(made)
        return pool[-1]

    return formula


def traced(name, a, b):
    return getattr(np, name)(a, b)


@given(formulas(), st.lists(st.sampled_from(ARGUMENTS) | st.floats(-5, 5), min_size=4, max_size=4), st.integers(0, 99))
def test_compiled_values_are_numpys(formula, values, seed):
    x = trace.variables("x", 4)
    try:
        found = kernel({s: f"a[{i}]" for i, s in enumerate(x)}, [trace.lifted(formula(x, traced))])
    except TraceError as refusal:  # of what is NaN for every state, or divides by 0
        assert "NaN" in str(refusal) or "division by the constant zero" in str(refusal)
        return
    values = np.array(values)
    near = [values, *(values * (1 + 1e-9 * np.random.default_rng(seed).uniform(-1, 1, (4, 4))))]
    with np.errstate(all="ignore"):
        expected = np.array([formula(list(v), numpys) for v in near])
    if len({(np.isnan(v), np.isinf(v)) for v in expected}) > 1:
        return  # at the edge of overflow
    got, want = found(values, np.zeros(1))[0], expected[0]
    spread = 1e-3 * (expected.max() - expected.min()) if np.isfinite(expected).all() else 0.0
    np.testing.assert_allclose(got, want, rtol=1e-12, atol=spread + 1e-300)


CANCELLING = {
    "exp of log": lambda x, y: np.exp(np.log(x)), "x over x": lambda x, y: x / x, "xy over y": lambda x, y: (x * y) / y,
    "log of exp": lambda x, y: np.log(np.exp(x)), "root squared": lambda x, y: np.sqrt(x) ** 2,
    "square's root": lambda x, y: np.sqrt(x**2), "twice inverted": lambda x, y: 1 / (1 / x),
    "small twice": lambda x, y: 1e-200 * (1e-200 * x), "large twice": lambda x, y: 1e200 * (1e200 * x),
    "halves": lambda x, y: 0.5 * (x + x), "powers": lambda x, y: x**3 * x**-3,
}  # fmt: skip


@pytest.mark.parametrize("name", CANCELLING)
def test_rewriting_keeps_to_the_domain(name):
    formula, x = CANCELLING[name], trace.variables("x", 2)
    found = kernel({s: f"a[{i}]" for i, s in enumerate(x)}, [formula(*x)])
    for a in [0.0, 1.0, -1.0, 2.5, -3.0, 1e300, 1e-300, 1e250, 1e-250]:
        for b in (0.0, -2.0, 1e-3):
            with np.errstate(all="ignore"):
                want = formula(np.float64(a), np.float64(b))
            np.testing.assert_allclose(found(np.array([a, b]), np.zeros(1))[0], want, rtol=1e-14, err_msg=f"{a} {b}")


@pytest.mark.parametrize("power", [2.0, -2, 9, 3, -1.0, 0, 65, -65.0, 130])
def test_divided_differences_of_powers_take_any_base(power):
    def f(x):
        return x**power

    a = -1.0
    for b in (-2.0, -1.0, -0.25, 1.5):
        exact = (f(b) - f(a)) / (b - a) if a != b else power * a ** (power - 1)
        # of so many factors
        assert divided_difference(f, a, b) == pytest.approx(exact, rel=1e-14 * max(10, abs(power)), abs=1e-14)
        assert power <= 0 or divided_difference(f, 0.0, b) == pytest.approx(b ** (power - 1), rel=1e-13)


def test_the_slope_of_a_constant_is_none():
    assert divided_difference(lambda x: 3.0, 1.0, 2.0) == 0.0
