"""Kernels as machine code against the same text run by Python."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tcbench import TcbenchError
from tcbench.compiler import derivatives as trace
from tcbench.compiler import kernels, language, machine
from tcbench.compiler.derivatives import guarded, jacobian, make, maximum, minimum
from tcbench.compiler.kernels import _code, kernel, namespace
from tcbench.errors import TraceError

pytestmark = pytest.mark.skipif(language.PLAIN, reason="the text itself runs")
ROUND_OFF = 1e-13  # contracted multiply-adds, and another order of no operation


def both(inputs, outputs, values):
    """Results of the machine code, and of the text run by Python."""
    compiled = kernel({x: f"a[{i}]" for i, x in enumerate(inputs)}, outputs)
    a = np.array(values, dtype=float)
    scope = dict(namespace())
    exec(compiled.text, scope)
    expected = np.empty(len(outputs))
    with np.errstate(all="ignore"):
        scope["kernel"](a, a, expected)
    return compiled(a, a), expected


@given(st.floats(0.05, 3.0), st.floats(-0.9, 2.0))
def test_every_operation_is_the_one_of_the_text(p, x):
    u, v = trace.variable("u"), trace.variable("v")
    phi, lam = make("phi", v), make("lam", v)
    outputs = [
        u + v, u - v, u * v, 1.0 / u, -v, u.sqrt(), v.exp(), u.log(), v.expm1(), v.log1p(), v.sin(), v.cos(), v.tanh(),
        v.arctan(), maximum(u, v), minimum(u, v), guarded(u, [v]), v - 1.5, u * math.inf, phi, lam,
    ]  # fmt: skip
    outputs += list(jacobian([phi, lam, u * make("phi", u * v)], [v]).ravel())  # with the derivatives of phi and lam
    found, expected = both([u, v], outputs, [p, x])
    np.testing.assert_allclose(found, expected, rtol=ROUND_OFF, atol=1e-300)


@pytest.mark.parametrize("values", [(math.nan, 1.0), (1.0, math.nan), (math.inf, 1.0), (-0.0, 0.0)])
def test_not_a_number_goes_where_python_lets_it_go(values):
    u, v = trace.variable("u"), trace.variable("v")
    outputs = [maximum(u, v), minimum(u, v), maximum(v, u), guarded(u, [v]), u * v]
    np.testing.assert_array_equal(*both([u, v], outputs, values))


def test_what_numpy_would_warn_of_is_quiet_in_machine_code():
    u = trace.variable("u")
    found = kernel({u: "a[0]"}, [1.0 / u, u.log(), (u - 1.0).sqrt()])(np.zeros(1), np.zeros(1))
    np.testing.assert_array_equal(found, [math.inf, -math.inf, math.nan])


def test_other_python_is_refused():
    with pytest.raises(TcbenchError, match=r"line 2, in kernel\(\).*only range"):
        machine.load("def kernel(a, b, out):\n    for i in a:\n        pass\n", _code)


@pytest.mark.parametrize("form", [lambda u: u // 2, lambda u: 2 % u, lambda u: divmod(u, 2), round, math.trunc])
def test_a_whole_number_made_of_a_symbol_is_refused(form):
    with pytest.raises(TraceError, match="a whole number made of a symbol"):
        form(trace.variable("u"))


def test_long_code_has_the_values_of_short_code():
    x = trace.variables("x", 1500)
    y = [x[k] * x[-k - 1] + x[(7 * k) % 1500] for k in range(1500)]
    places, rng = kernels.placed("a", x), np.random.default_rng(0)
    at = rng.normal(size=1500)
    short = [kernels.kernel(places, [v])(at, at)[0] for v in y[::50]]
    code = kernels._code(kernels.straight_line(places, y))
    assert code.count("\n") > machine.LONG and len(machine.LOADED.findall(code)) == 1500
    assert np.allclose(kernels.kernel(places, y)(at, at)[::50], short, rtol=1e-14, atol=1e-15)
