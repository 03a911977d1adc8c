"""A new elementary function is one row of the table: softplus(x) = log(1 + exp(x)), as a contributor would add it.

All that reads formulas then takes it: values, derivatives of any order, divided differences, inverses, series,
references, units, complex numbers, and peers.
"""

import mpmath as mp
import numpy as np
import pytest
from mechanics import Warm
from tcbench_plugins.tc_taylor.series import Normal
from tcbench_plugins.tc_taylor.writer import Writer

import tcbench
from tcbench import Scenario, TcbenchError
from tcbench.authoring.units import UnitsDiffer, check_units
from tcbench.building_blocks import divided_difference, function
from tcbench.compiler import derivatives as trace
from tcbench.compiler import ops
from tcbench.compiler.complex_symbols import Complex
from tcbench.compiler.inverse import solved
from tcbench.compiler.kernels import kernel, of_lines
from tcbench.compiler.language import of_c
from tcbench.reference.lookup import reference_for

exp, log1p = of_c("exp"), of_c("log1p")


def softplus_value(x: float) -> float:
    """log(1 + exp(x)), which does not overflow."""
    return max(x, 0.0) + log1p(exp(-abs(x)))


SOFTPLUS = ops.Operation(
    "softplus", softplus_value, lambda y, x: (1.0 / (1.0 + (-x).exp()),), numpy="softplus", positive=0,
    same="log(1.0 + exp(x))", difference=ops.COMPOSED, inverse=lambda y: y.expm1().log(),
)  # fmt: skip


@pytest.fixture(autouse=True)
def row(monkeypatch):
    monkeypatch.setitem(ops.OPERATIONS, "softplus", SOFTPLUS)


class Well(Warm):
    name = "well"
    constants = {"mass": (), "stiffness": (), "friction": (), "capacity": (), "warm": ()}
    positive = ("mass", "stiffness", "capacity")
    reference_temperature = "warm"
    units = {
        "q": "1", "s": "J/K", "p": "J s", "mass": "J s^2", "stiffness": "J", "friction": "J s", "capacity": "J/K",
        "warm": "K",
    }  # fmt: skip

    def energy(self, z):
        softplus = function("softplus")
        wall = self.stiffness * (softplus(z.q - 1) + softplus(-z.q - 1))
        return z.p**2 / (2 * self.mass) + wall + self.capacity * self.warm * self.warmth(z)

    def warmth(self, z):
        return np.exp(z.s / self.capacity)

    def irreversible(self, z, dE, dS):
        force = self.friction * function("softplus")(z.q) * dE.p
        return {"p": -force, "s": force * dE.p / dE.s}


WELL = {"mass": 1.0, "stiffness": 1.5, "friction": 0.2, "capacity": 1.2, "warm": 1.0}


def well():
    start = {"q": 0.4, "p": 1.0, "s": 0.1}
    return Scenario(name="well", system=Well, constants=WELL, initial=start, dt=0.1, t_end=2.0)


def test_values_and_derivatives_of_it():
    x = trace.variables("x", 1)
    y = function("softplus")(x)[0]
    slope = trace.jacobian([y], x)[0, 0]
    compiled = kernel({x[0]: "a[0]"}, [y, slope, trace.jacobian([slope], x)[0, 0]])
    for at in (-700.0, -3.0, 0.0, 1e-9, 0.7, 40.0):
        with mp.workdps(400):
            exact = [float(mp.diff(lambda t: mp.log1p(mp.exp(t)), at, k)) for k in range(3)]
        assert compiled(np.array([at]), np.zeros(1)) == pytest.approx(exact, rel=1e-15, abs=1e-300)
    assert function("softplus")(np.array([-1.0, 800.0])).tolist() == [softplus_value(-1.0), 800.0]
    with pytest.raises(TcbenchError, match=r"No function is called 'softplas'. Did you mean 'softplus'"):
        function("softplas")


def test_its_divided_difference_keeps_its_digits_and_it_is_inverted():
    for a, b in ((-0.3, -0.3 + 1e-9), (0.5, 0.5), (-30.0, 2.0)):
        with mp.workdps(60):
            f, x, y = (lambda t: mp.log1p(mp.exp(t))), mp.mpf(a), mp.mpf(b)
            exact = mp.diff(f, x) if a == b else (f(y) - f(x)) / (y - x)
        assert divided_difference(function("softplus"), a, b) == pytest.approx(float(exact), rel=1e-15)
    x, y = trace.variables("x", 2)
    inverse = kernel({y: "a[0]"}, [solved(2.0 * x.softplus(), x, y)])
    assert softplus_value(inverse(np.array([3.0]), np.zeros(1))[0]) == pytest.approx(1.5, rel=1e-15)
    z = Complex(x, y).softplus()
    found = kernel({x: "a[0]", y: "a[1]"}, [z.re, z.im])(np.array([0.3, 0.2]), np.zeros(1))
    assert complex(*found) == pytest.approx(np.log(1 + np.exp(0.3 + 0.2j)), rel=1e-15)


def test_its_series_is_that_of_fifty_digits():
    y = trace.variable("y")
    normal = Normal([y])
    (rate,) = normal.of([y.softplus() * y])
    writer = Writer(normal.variables, {0: normal.single(rate)})
    stored = [f"out[{k}] = {writer.coefficient(normal.variables[0], k)}" for k in range(9)]
    found = of_lines([*writer.lines, *stored], 9)(np.array([0.4]), np.zeros(1))
    rate_of = lambda y: mp.log1p(mp.exp(y)) * y  # noqa: E731
    with mp.workdps(50):
        exact = [mp.mpf(0.4)]
        for n in range(8):
            of_f = mp.taylor(lambda t: rate_of(sum(c * t**k for k, c in enumerate(exact))), 0, n)
            exact.append(of_f[n] / (n + 1))
    assert found == pytest.approx([float(c) for c in exact], rel=1e-13)


@pytest.mark.parametrize("method", ["tc_monolithic", "tc_gonzalez", "tc_auto", "tc_taylor", "cvode", "heyoka",
                                    "pydiffsol"])  # fmt: skip
def test_methods_and_peers_take_it_and_keep_what_they_claim(method):
    if method in ("cvode", "heyoka", "pydiffsol"):
        pytest.importorskip({"cvode": "sksundae"}.get(method, method))
    scenario = well()
    run = tcbench.simulate(method, scenario)
    assert run.ok, run.message
    exact = np.asarray(reference_for(scenario, [scenario.t_end]).states[-1], dtype=float)
    error = abs(run.z[-1] - exact).max()
    assert error < (1e-5 if method in ("tc_taylor", "tc_auto", "cvode", "heyoka", "pydiffsol") else 0.02), error
    if method in ("tc_monolithic", "tc_gonzalez", "tc_auto"):
        assert abs(np.ptp(run.energy)) < 1e-13 * abs(run.energy[0]) and np.diff(run.entropy).min() > -1e-15


def test_units_of_what_it_takes_are_pure_numbers():
    check_units(Well(**WELL))

    class Wrong(Well):
        def warmth(self, z):
            return function("softplus")(z.s)

    with pytest.raises(UnitsDiffer, match="the argument of softplus is a pure number, not J/K"):
        check_units(Wrong(**WELL))


def test_the_written_formula_of_what_a_language_lacks_is_the_same_number():
    text = "softplus(t1) + hypot(t1, (-2.0)) * log1p(t1)"
    functions = ops.functions() | {"t1": 0.3}
    again = ops.rewritten(text, ("exp", "log", "sqrt"))
    assert not {"softplus", "hypot", "log1p"} & set(ops.NAMED.findall(again))
    assert eval(again, functions) == pytest.approx(eval(text, functions), rel=1e-15)
