"""The discrete chain rule: directional, symmetric, and the gradient where both ends meet; at any increment."""

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import tcbench
from tcbench.compiler import derivatives as trace
from tcbench.compiler.chain_rule import discrete_gradient, gradient
from tcbench.compiler.kernels import kernel

FUNCTIONS = {  # numpy's, mpmath's, where x is taken from [-1, 1] to
    "exp": (np.exp, mpmath.exp, lambda x: 3 * x),
    "expm1": (np.expm1, mpmath.expm1, lambda x: 3 * x),
    "log": (np.log, mpmath.log, lambda x: 1.001 + x),
    "log1p": (np.log1p, mpmath.log1p, lambda x: 0.001 + 0.9 * x),
    "sqrt": (np.sqrt, mpmath.sqrt, lambda x: 1.001 + x),
    "reciprocal": (lambda x: 1 / x, lambda x: 1 / x, lambda x: 1.01 + x),
    "sin": (np.sin, mpmath.sin, lambda x: 30 * x),
    "cos": (np.cos, mpmath.cos, lambda x: 30 * x),
    "tanh": (np.tanh, mpmath.tanh, lambda x: 5 * x),
    "tan": (np.tan, mpmath.tan, lambda x: 1.5 * x),
    "sinh": (np.sinh, mpmath.sinh, lambda x: 3 * x),
    "cosh": (np.cosh, mpmath.cosh, lambda x: 3 * x),
    "arcsin": (np.arcsin, mpmath.asin, lambda x: 0.99 * x),
    "arccos": (np.arccos, mpmath.acos, lambda x: 0.99 * x),
    "arctan": (np.arctan, mpmath.atan, lambda x: 1e4 * x**5),
    "cube": (lambda x: x**3, lambda x: x**3, lambda x: 3 * x),
    "power": (lambda x: x**1.7, lambda x: x ** mpmath.mpf(1.7), lambda x: 1.001 + x),
    "inverse power": (lambda x: x**-2.5, lambda x: x ** mpmath.mpf(-2.5), lambda x: 1.1 + x),
    "abs": (abs, abs, lambda x: 1.5 + x),
    "hypot": (lambda x: np.hypot(x, 0.4), lambda x: mpmath.hypot(x, mpmath.mpf(0.4)), lambda x: x),
    "base": (lambda x: 3.0**x, lambda x: mpmath.mpf(3) ** x, lambda x: x),
    "inverse square": (lambda x: x**-2, lambda x: x**-2, lambda x: 1.1 + x),
}


def quotient(f):
    """(a, d) -> D f(a, a + d), compiled."""
    x, a, d = (trace.variable(n) for n in "xad")
    (slope,) = discrete_gradient(trace.lifted(f(x)), [x], [a], [d])
    made = kernel({a: "a[0]", d: "a[1]"}, [slope, *trace.jacobian([slope], [a, d])[0]])
    return lambda a, d: made(np.array([a, d]), np.zeros(1))


KERNELS = {name: quotient(f) for name, (f, _, _) in FUNCTIONS.items()}
units = st.floats(-1, 1)


@pytest.mark.parametrize("name", FUNCTIONS)
@given(a=units, b=units, nearness=st.integers(0, 20))
@settings(max_examples=15)
def test_quotient_is_exact_at_any_increment(name, a, b, nearness):
    """Against 60 digits: 1e-13 of the slopes, or 1e-15 of the values (a saturated tanh has no digits left)."""
    _, exact, where = FUNCTIONS[name]
    start, end = where(a), where(a + 10.0**-nearness * (b - a))
    step = end - start
    with mpmath.workdps(60):
        x, d = mpmath.mpf(start), mpmath.mpf(step)
        slope = (exact(x + d) - exact(x)) / d if abs(d) > 1e-20 else mpmath.diff(exact, x)
        size = max(abs(mpmath.diff(exact, x)), abs(mpmath.diff(exact, x + d)), abs(slope))
        size += max(abs(exact(x)), abs(exact(x + d))) / 100
    if name in ("sin", "cos"):
        size *= 1 + abs(start)  # of the middle of both ends, the last digit is lost
    assert abs(KERNELS[name](start, step)[0] - slope) <= 1e-13 * size + 1e-60


@pytest.mark.parametrize("name", FUNCTIONS)
@given(a=units, b=units)
@settings(max_examples=6)
def test_derivative_of_a_quotient(name, a, b):
    """Newton's matrix has it: against differences of 40 digits."""
    _, exact, where = FUNCTIONS[name]
    start, step = where(a), where(b) - where(a)
    if abs(step) < 1e-9:  # the differences below would have no digits
        return
    with mpmath.workdps(40):

        def slope(x, d):
            return (exact(x + d) - exact(x)) / d

        x, d, e = mpmath.mpf(start), mpmath.mpf(step), mpmath.mpf(10) ** -12
        by = [(slope(x + e, d) - slope(x - e, d)) / (2 * e), (slope(x, d + e) - slope(x, d - e)) / (2 * e)]
        size = 1 + max(abs(mpmath.diff(exact, y, 2)) for y in (x, x + d))
    found = KERNELS[name](start, step)[1:]
    assert max(abs(found - by)) <= 1e-8 * size


def energy(z):
    a, b, c = z
    found = np.exp(a * b) * np.cos(c) + np.sqrt(1 + a**2 + c**4) / (2 + np.sin(b)) - np.log(1 + b**2) * np.tanh(a - c)
    return found + np.hypot(1 + a**2, b) + (1 + a**2) ** (b - c)


def test_many_variables():
    """Directional, symmetric in both ends, consistent; and the gradient is that of forward derivatives."""
    x, a, d = (trace.variables(n, 3) for n in "xad")
    f = energy(x)
    ways = [discrete_gradient(f, list(x), list(a), list(d)), discrete_gradient(f, list(x), list(a + d), list(-d))]
    inputs = {s: f"a[{i}]" for i, s in enumerate([*a, *d])}
    made = kernel(inputs, [*ways[0], *ways[1]])
    plain = kernel({s: f"a[{i}]" for i, s in enumerate(x)}, [*gradient(f, list(x)), *trace.jacobian([f], list(x))[0]])
    rng = np.random.default_rng(1)
    for _ in range(50):
        start, step = rng.normal(size=3), rng.normal(size=3) * 10.0 ** -rng.integers(0, 3)
        there, back = np.split(made(np.concatenate([start, step]), start), 2)
        assert abs(there @ step - (energy(start + step) - energy(start))) < 1e-14 * (
            1 + abs(energy(start)) + abs(energy(start + step))
        )
        assert there == pytest.approx(back, rel=1e-12, abs=1e-14)
        still = made(np.concatenate([start, 0 * step]), start)[:3]
        reverse, forward = np.split(plain(start, start), 2)
        assert still == pytest.approx(forward, rel=1e-13, abs=1e-14)
        assert reverse == pytest.approx(forward, rel=1e-13, abs=1e-14)


def test_discrete_gradients_of_elements_are_those_of_the_simplified_formula():
    """Of two gases, (exp(s) / pi)^(2/3): as it is written it took twice the instructions a step."""
    system = tcbench.scenarios()["gas_containers"].model.symbolic
    with trace.tracing():
        z0, z1 = trace.variables("z", 4), trace.variables("y", 4)
        nodes = trace.topological(list(system.discrete_gradient(z0, z1)))
    found = [node.op for node in nodes if node.op in ("exp", "log", "phi", "lam")]
    assert {op: found.count(op) for op in set(found)} == {"exp": 2, "log": 2, "lam": 2, "phi": 4}


def test_an_unknown_that_no_other_row_sees_is_explicit():
    """The heat of a bath of constant temperature is known when the momentum is: one unknown, and the same laws."""
    run = tcbench.simulate("tc_monolithic", "damped_oscillator", t_end=3.0)
    assert run.solver.way == "unrolled: 1 unknowns" and run.summary.energy_error_max < 1e-14
