"""What is flat far away, exp(-(x/w)^2) or tanh(x/w), tells nothing of itself there, neither by values nor by slopes:
adaptive methods stepped over features of a thousandth of a run with errors of 4e-3, at every tolerance."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import tcbench
from tcbench import Scenario, System
from tcbench.compiler.chain_rule import discrete_gradient
from tcbench.compiler.flat import flat_away
from tcbench.compiler.kernels import kernel
from tcbench.compiler.symbols import variable

BUMPS = {
    "gaussian": lambda x: np.exp(-(x**2)),
    "power of 2": lambda x: 2.0 ** (-(x**2)),
    "fronts": lambda x: 0.5 * (np.tanh(x + 2) - np.tanh(x - 2)),
    "saturating": lambda x: 1 - np.tanh(x**2),
    "a distance": lambda x: np.exp(1 - np.sqrt(x**2 + 1)),
    "choice": lambda x: np.maximum(np.exp(-(x**2)) - 0.3, 0.0),
    "two tops": lambda x: np.exp(-((x**2 - 1) ** 2)),
}
SPREAD = 1e-3  # of starts over a space


def bump(form, many=0):
    """Particles on a long way, each through a narrow place that rubs; over a space the starts differ."""

    class Bump(System):
        variables = dict.fromkeys("qp", ("particle",) if many else ()) | {"s": ()}
        constants = {"width": ("particle",) if many else ()}

        def energy(self, z):
            return np.sum(z.p**2 / 2 + 0.01 * z.q**2) + z.s

        def entropy(self, z):
            return z.s

        def reversible(self, z, dE, dS):
            return {"q": dE.p, "p": -dE.q}

        def irreversible(self, z, dE, dS):
            rub = 0.3 * BUMPS[form]((z.q - 5.0) / self.width) + 1e-3
            return {"p": -rub * dE.p * dS.s, "s": np.sum(rub * dE.p**2) / dE.s * dS.s}

        def temperature(self, z, dE, dS):
            return dE.s

    return Bump


def scenario(form, width, many=0):
    q = -SPREAD * np.arange(many) if many else 0.0
    initial = {"q": q, "p": 1.3 + 0.0 * q, "s": 0.0}
    return Scenario("bump", bump(form, many), {"width": width + 0.0 * q}, initial=initial, t_end=10.0, dt=10.0)


def truth(form, width, q):
    def rates(t, y):
        return [y[1], -0.02 * y[0] - (0.3 * BUMPS[form]((y[0] - 5.0) / width) + 1e-3) * y[1]]

    return solve_ivp(rates, (0.0, 10.0), [q, 1.3], "DOP853", rtol=1e-11, atol=1e-12, max_step=width).y[:, -1]


@pytest.mark.parametrize(("form", "width"), [(form, 0.01) for form in BUMPS] + [("gaussian", 0.002)])
def test_no_adaptive_method_steps_over_what_is_flat_away(form, width):
    exact, at = truth(form, width, 0.0), np.array([0.0, 10.0])
    made = scenario(form, width)
    for method in ("tc_taylor", "tc_auto", "tc_gauss_adaptive", "controlled"):
        for tolerance in (1e-4, 1e-7):
            states, _ = tcbench.integrators()[method].adaptive(made.model, made.z0.copy(), at, tolerance, tolerance)
            assert np.abs(states[-1][:2] - exact).max() < 30 * tolerance, (method, tolerance)


def test_nor_over_a_space():
    made, at = scenario("gaussian", 0.01, many=40), np.array([0.0, 10.0])
    exact = np.array([truth("gaussian", 0.01, -SPREAD * i) for i in (0, 39)])
    for method in ("tc_taylor", "tc_gauss_adaptive"):
        states, _ = tcbench.integrators()[method].adaptive(made.model, made.z0.copy(), at, 1e-6, 1e-6)
        q, p = states[-1][:40], states[-1][40:80]
        assert np.abs(np.transpose([q[[0, 39]], p[[0, 39]]]) - exact).max() < 3e-5, method


def test_which_arguments_are_looked_at():
    """What grows on and on behind the place where it begins is seen from there; exp of logarithms is a power."""
    x, y, c = (variable(name) for name in "xyc")

    def of(*outputs):
        return [argument.both for argument in flat_away(list(outputs), [x, y])]

    assert of((c * x + y - 3.0).exp(), (0.5 * (x * x).log() + x).exp(), c.tanh() * x, (c * c).exp() * y) == []
    assert of((-(x * x)).exp(), (x * y).exp()) == [False, False]
    assert of(x.tanh()) == [True] and of(1.0 / (1.0 + x.exp())) == [True] and of(1.0 / x.exp()) == []
    assert of(c ** (x * y)) == [False]
    assert of(1.0 / x.cosh()) == of(1.0 / x.cosh() ** 2) == of(1.0 / (x * x).exp()) == [True]


def rubbing(speed):
    class Rubbing(System):
        """A spring and dry friction made smooth."""

        variables = {"q": (), "p": (), "s": ()}
        constants = {"speed": ()}

        def energy(self, z):
            return z.p**2 / 2 + z.q**2 / 2 + z.s

        def entropy(self, z):
            return z.s

        def reversible(self, z, dE, dS):
            return {"q": dE.p, "p": -dE.q}

        def irreversible(self, z, dE, dS):
            force = 0.1 * np.tanh(dE.p / self.speed)
            return {"p": -force * dS.s, "s": force * dE.p / dE.s * dS.s}

        def temperature(self, z, dE, dS):
            return dE.s

    initial = {"q": 1.5, "p": 0.0, "s": 0.0}
    return Scenario("rubbing", Rubbing, {"speed": speed}, initial=initial, t_end=20.0, dt=0.1)


@pytest.mark.parametrize("speed", [0.1, 0.02, 0.002])
def test_dry_friction_made_smooth_by_tanh_is_right_at_any_speed(speed):
    """tc_taylor erred by 0.3 at 1e-4, and by 0.08 at 1e-7: one step led over the change of the sign."""
    made, at = rubbing(speed), np.array([0.0, 20.0])

    def rates(t, y):
        return [y[1], -y[0] - 0.1 * np.tanh(y[1] / speed)]

    exact = solve_ivp(rates, (0.0, 20.0), [1.5, 0.0], "Radau", rtol=1e-10, atol=1e-12).y[:, -1]
    for method in ("tc_taylor", "tc_auto", "tc_gauss_adaptive"):
        for tolerance in (1e-3, 1e-5, 1e-7):
            states, _ = tcbench.integrators()[method].adaptive(made.model, made.z0.copy(), at, tolerance, tolerance)
            assert np.abs(states[-1][:2] - exact).max() < 30 * tolerance, (method, tolerance)


@pytest.mark.parametrize("form", BUMPS)
def test_nor_do_halves_of_a_method_that_reads_no_rates_at_its_ends(form):
    """From the shoulder of a bump, whose exponent is no larger further on, tc_monolithic's midpoints lie behind it."""
    made, at = scenario(form, 0.01), np.array([0.0, 10.0])
    method = tcbench.plugins.find_integrator(HALVES)
    states, _ = method.adaptive(made.model, made.z0.copy(), at, 1e-4, 1e-4)
    assert np.abs(states[-1][:2] - truth(form, 0.01, 0.0)).max() < 1e-3


HILLS = {
    "sech": lambda x: 0.3 / np.cosh(x),
    "its square": lambda x: 0.3 / np.cosh(x) ** 2,
    "saturating": lambda x: 0.3 * np.exp(-(x**2)) / (1 + np.exp(-(x**2))),
    "a cube": lambda x: 0.3 * np.exp(-(x**2)) ** 3,
    "far apart": lambda x: 5e3 * np.exp(-((x - 2) ** 2)) * np.exp(-((x + 2) ** 2)),
    "a quotient": lambda x: 0.2 * (np.exp(x) - np.exp(-x)) / (np.exp(x) + np.exp(-x)),
    "two tops": lambda x: 0.3 * np.exp(-((x**2 - 1) ** 2)),
    "steep walls": lambda x: 0.3 * np.exp(1 - np.cosh(x)),
}
HALVES = "controlled[method=tc_monolithic]"


@pytest.mark.parametrize(
    ("form", "width", "method", "tolerance"),
    [
        ("sech", 0.02, HALVES, 1e-6),
        ("its square", 0.02, "tc_gauss_adaptive", 1e-6),
        ("its square", 0.02, HALVES, 1e-6),
        ("saturating", 0.003, "tc_gauss_adaptive", 1e-9),
        ("a cube", 0.004, "tc_gauss_adaptive", 1e-9),
        ("a cube", 0.004, HALVES, 1e-3),
        ("far apart", 0.01, HALVES, 1e-6),
        ("a quotient", 0.02, "tc_taylor", 1e-6),
        ("a quotient", 0.02, "tc_auto", 1e-6),
        ("two tops", 0.01, HALVES, 1e-3),
        ("steep walls", 0.02, HALVES, 1e-6),
    ],
)
def test_hills_whose_exponentials_vanish_or_overflow_far_away_are_met(form, width, method, tolerance):
    """Hundreds of widths away 1/cosh is 1e-108 and the square of a Gaussian nothing: silent errors of 1e-3 to 3e-2, and
    runs that ended at their first step."""
    hill = HILLS[form]

    class Hill(System):
        variables = {"q": (), "p": (), "s": ()}
        constants = {"width": ()}

        def energy(self, z):
            return z.p**2 / 2 + hill((z.q - 5.03) / self.width) + z.s

        def entropy(self, z):
            return z.s

        def reversible(self, z, dE, dS):
            return {"q": dE.p, "p": -dE.q}

    def rates(t, y):
        return [y[1], -hill((y[0] - 5.03 + 1e-30j) / width).imag / 1e-30]

    made = Scenario("hill", Hill, {"width": width}, initial={"q": 0.0, "p": 1.0, "s": 0.0}, t_end=10.0, dt=0.1)
    exact = solve_ivp(rates, (0.0, 10.0), [0.0, 1.0], "DOP853", rtol=1e-11, atol=1e-12, max_step=width / 2).y[:, -1]
    run = tcbench.simulate(method, made, tolerance=tolerance, times=[10.0])
    assert run.ok, run.failure
    assert np.abs(run.z[-1][:2] - exact).max() < max(30 * tolerance, 3e-9)


@pytest.mark.parametrize("form", HILLS)
def test_a_discrete_gradient_reaches_a_hill_from_where_it_is_nothing(form):
    """exp(a) of a = -700 and less is 0, and exp(b - a) infinite: their product, exp(b), was NaN."""
    hill, x = HILLS[form], variable("x")
    for start, end in [(-60.0, -1.0), (-40.0, 0.5), (-31.0, -30.0), (0.7, 45.0), (-50.0, 50.0)]:
        y = variable("y")
        found = discrete_gradient(hill(x), [x], [x], [y - x])[0]
        change = (end - start) * kernel({x: "a[0]", y: "a[1]"}, [found])(np.array([start, end]), np.zeros(1))[0]
        assert change == pytest.approx(hill(end) - hill(start), rel=1e-11, abs=1e-16), (start, end)
