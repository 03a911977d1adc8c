"""Tracing: values and derivatives of random formulas against complex step; no digit lost; clear refusals."""

import cmath
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tcbench.compiler import derivatives as trace
from tcbench.compiler import kernels as emit
from tcbench.compiler.ops import exp_slope
from tcbench.compiler.special import FAR
from tcbench.errors import TraceError


def evaluate(outputs, inputs, values):
    """Run the printed kernel on complex numbers: what complex step needs, and independent of LLVM."""
    text = emit.straight_line({x: f"a[{i}]" for i, x in enumerate(inputs)}, outputs)
    functions = {
        name: getattr(cmath, name)
        for name in ("exp", "log", "sqrt", "sin", "cos", "tanh", "tan", "atan", "sinh", "cosh")
    }
    functions["pow"] = lambda x, y: x**y
    functions["hypot"] = lambda x, y: cmath.sqrt(x * x + y * y)
    functions["expm1"] = lambda x: cmath.exp(x) - 1
    functions["log1p"] = lambda x: cmath.log(1 + x)
    functions["unless_far"] = lambda x, z, d: x if complex(d).real < FAR else z
    functions["phi"] = lambda x: (cmath.exp(x) - 1) / x
    functions["lam"] = lambda x: cmath.log(1 + x) / x
    functions["dphi"] = lambda x: (1 + (x - 1) * cmath.exp(x)) / x**2
    functions["dlam"] = lambda x: (x / (1 + x) - cmath.log(1 + x)) / x**2
    body = text[text.index("def kernel") :]
    exec(body, functions)
    out = [0j] * len(outputs)
    functions["kernel"](values, None, out)
    return out


@st.composite
def formulas(draw, size=3):
    """A random smooth formula of positive inputs, as a function of an array."""
    choices = draw(
        st.lists(st.tuples(st.integers(0, 16), st.integers(0, 99), st.integers(0, 99)), min_size=3, max_size=12)
    )

    def formula(x):
        pool = list(x)
        for kind, i, j in choices:
            a, b = pool[i % len(pool)], pool[j % len(pool)]
            safe = 1.0 + a * a  # keeps logarithms, roots and quotients in their domain
            pool.append(  # the list is indexed before a, b and safe change
                [
                    lambda: a + b, lambda: a - b, lambda: a * b, lambda: a / (1.0 + b * b), lambda: -a,
                    lambda: np.log(safe), lambda: np.sqrt(safe), lambda: np.tanh(a), lambda: np.sin(a) * b,
                    lambda: np.exp(np.tanh(a)), lambda: safe**1.5, lambda: np.log1p(a * a) - np.expm1(np.tanh(b)),
                    lambda: np.arctan(a) * b, lambda: np.sinh(np.tanh(a)) - np.cosh(np.tanh(b)),
                    lambda: np.tan(np.tanh(a)), lambda: np.hypot(safe, b), lambda: safe ** np.tanh(b) - safe**0.7,
                ][kind]()
            )  # fmt: skip
        return pool[-1] + 0.0 * pool[0]

    return formula


@given(formulas(), st.lists(st.floats(0.2, 1.5), min_size=3, max_size=3))
def test_traced_values_and_derivatives_agree_with_numpy_and_complex_step(formula, values):
    x = trace.variables("x", 3)
    f = formula(x)
    f = f if isinstance(f, trace.Symbol) else trace.const(float(f))
    gradient = list(trace.jacobian([f], list(x))[0])
    traced = evaluate([f, *gradient], x, [complex(v) for v in values])
    assert traced[0].real == pytest.approx(formula(np.array(values)), rel=1e-12, abs=1e-12)
    step = 1e-30  # complex step: no subtraction, so no cancellation
    for i in range(3):
        shifted = [complex(v, step if i == k else 0.0) for k, v in enumerate(values)]
        derivative = evaluate([f], x, shifted)[0].imag / step
        assert traced[1 + i].real == pytest.approx(derivative, rel=1e-10, abs=1e-10)


def test_increments_and_midpoints_are_taken_from_the_unknown_not_from_a_difference():
    z, d = trace.variable("z"), trace.variable("d")
    assert (z + d) - z is d
    assert (z + (z + d)) / 2 is z + 0.5 * d
    assert (d + d) / 2 is d and 3.0 * (d + d) is 6.0 * d


def test_equal_expressions_are_one_symbol():
    x, y = trace.variables("x", 2)
    assert np.exp(x * y) is np.exp(y * x)


def branch(x):
    return x if x > 0 else -x


def calls_math(x):
    return math.sin(x)


def equality(x):
    return x == 1.0


@pytest.mark.parametrize("formula", [branch, calls_math, equality])
def test_what_cannot_be_traced_is_refused_with_the_line_and_a_remedy(formula):
    with pytest.raises(TraceError) as caught:
        formula(trace.variable("x"))
    line = formula.__code__.co_firstlineno + 1
    assert f"test_derivatives.py, line {line}" in str(caught.value)
    assert "step=" in str(caught.value)


@pytest.mark.parametrize("value", [np.nan, np.float64("nan")])
def test_a_formula_with_nan_is_refused_with_its_line_and_no_warning_of_numpy(value, recwarn):
    with pytest.raises(TraceError, match=r"test_derivatives.py, line \d+: the formula contains NaN\.$"):
        trace.variables("x", 2) * value
    assert not recwarn.list


@pytest.mark.parametrize("d", [1e-3, -40.0, 299.0, 301.0, 650.0])
def test_slopes_of_exponentials_from_either_end_have_their_derivatives(d):
    """By complex step, and compiled against Python."""
    x = trace.variables("x", 2)
    slope = exp_slope(x[0].exp(), x[1].exp(), x[1] - x[0])
    outputs, at = [slope, *trace.jacobian([slope], list(x))[0]], np.array([-300.0, d - 300.0])
    found = emit.kernel({x[0]: "a[0]", x[1]: "a[1]"}, outputs)(at, np.zeros(1))
    value = (math.exp(at[1]) - math.exp(at[0])) / (at[1] - at[0])
    steps = [evaluate([slope], list(x), [*(at + 1e-30j * (np.arange(2) == i))])[0].imag / 1e-30 for i in range(2)]
    np.testing.assert_allclose(found, [value, *steps], rtol=1e-11 if abs(d) > 1.0 else 1e-9)
