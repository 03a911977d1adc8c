"""Adaptive methods where a series sees nothing of what comes: errors are of the tolerance.

Truth has closed forms, or comes from SciPy with steps that no feature is shorter than."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import tcbench
from tcbench import Scenario, System

METHODS = ("tc_taylor", "tc_auto")
ALLOWED = 100.0  # tolerances, times what the motion makes of them


class Moving(System):
    """p^2/2 + potential(q), friction c p, heat 300 s."""

    name = "moving"
    variables = {"q": (), "p": (), "s": ()}
    constants = {"k": (), "at": (), "width": (), "c": ()}

    def potential(self, q):
        raise NotImplementedError

    def energy(self, z):
        return z.p**2 / 2 + self.potential(z.q) + 300.0 * z.s

    def entropy(self, z):
        return z.s

    def reversible(self, z, dE, dS):
        return {"q": dE.p, "p": -dE.q}

    def irreversible(self, z, dE, dS):
        return {"p": -self.c * dE.p, "s": self.c * dE.p**2 / dE.s}


class Gap(Moving):
    """From the middle the series begins with terms of orders 1, 8, 15, ..."""

    def potential(self, q):
        return self.k * q**8 / 8


class MixedGaps(Moving):
    def potential(self, q):
        return self.k * (1e-3 * q**4 + q**18 / 18)


class Lacunary(Moving):
    """The first term that is not that of free motion has an order above that of any series here."""

    def potential(self, q):
        return self.k * q**40 / 40


class Hill(Moving):
    def potential(self, q):
        return self.k * np.exp(-(((q - self.at) / self.width) ** 2))


class Front(Moving):
    def potential(self, q):
        return self.k * np.tanh((q - self.at) / self.width)


def truth(scenario, tolerance=1e-12):
    t = np.linspace(0.0, scenario.t_end, 201)
    field = scenario.model.vector_field
    found = solve_ivp(lambda t, z: field(z), t[[0, -1]], scenario.z0, "DOP853", t, rtol=tolerance, atol=tolerance,
                      max_step=scenario.t_end / 2000)  # fmt: skip
    return found.y.T


@pytest.mark.parametrize(
    ("kind", "k", "at", "width", "c", "t_end"),
    [
        (Gap, 1.0, 0.0, 1.0, 0.0, 10.0),
        (MixedGaps, 3.0, 0.0, 1.0, 0.0, 9.0),
        (Lacunary, 1.0, 0.0, 1.0, 0.0, 7.0),
        (Hill, 0.3, 12.0, 1.0, 0.01, 30.0),
        (Hill, 0.23, 55.0, 1.7, 0.0, 100.0),
        (Front, 0.2, 6e3, 150.0, 0.0, 1e4),
    ],
)
@pytest.mark.parametrize("method", METHODS)
def test_what_a_series_does_not_see_is_not_stepped_over(method, kind, k, at, width, c, t_end):
    """Errors of order 1 at every tolerance, with status ok: the last two terms were all that was asked."""
    constants = {"k": k, "at": at, "width": width, "c": c}
    scenario = Scenario("unseen", kind, constants, initial={"q": 0.0, "p": 1.0, "s": 0.0}, t_end=t_end, dt=t_end / 200)
    exact = truth(scenario)
    size = np.maximum(1.0, np.abs(exact).max(axis=0))
    run = tcbench.simulate(method, scenario, tolerance=1e-4)
    assert run.ok, run.failure
    assert (np.abs(run.z - exact) / size).max() < ALLOWED * 1e-4


class Ball(Moving):
    def potential(self, q):
        return 9.81 * q + self.k / 2 * ((abs(q) - q) / 2) ** 2


def bounced(t, g=9.81, k=1e6):
    """The ball from 1, which stays in the floor for (pi + 2 atan(g / (w v))) / w, w = sqrt(k)."""
    v, w = np.sqrt(2 * g), np.sqrt(k)
    flight, contact = v / g, (np.pi + 2 * np.arctan(g / (w * v))) / w
    t = (t + flight) % (2 * flight + contact) - flight
    if t <= flight:
        return np.array([1.0 - g * t * t / 2, -g * t])
    x = w * (t - flight)
    return np.array([-g / k * (1.0 - np.cos(x)) - v / w * np.sin(x), -g / w * np.sin(x) - v * np.cos(x)])


@pytest.mark.parametrize("method", METHODS)
def test_the_state_at_a_time_does_not_depend_on_how_long_the_run_goes_on(method):
    """A ball on a stiff floor, learn-multibody-dynamics, pull request 158: the place of a kink was found to a
    part of the step that was tried, which of free flight is the whole run."""
    constants = {"k": 1e6, "at": 0.0, "width": 1.0, "c": 0.0}
    scenario = Scenario("ball", Ball, constants, initial={"q": 1.0, "p": 0.0, "s": 0.0}, t_end=1.0, dt=0.01)
    for end in (2.5, 10.0, 100.0):
        run = tcbench.simulate(method, scenario.replace(t_end=end), tolerance=1e-3, times=[1.0, end])
        assert run.ok and np.abs(run.z[1, :2] - bounced(1.0)).max() < 1e-4


def test_a_step_backwards_undoes_a_step():
    """It held the entropy, which falls on the way back, and was wrong by 1e-4."""
    scenario = tcbench.scenarios()["damped_oscillator"]
    step = tcbench.stepper("tc_taylor[order=8]", scenario.model)
    there = step(scenario.z0, 0.05)
    assert np.abs(step(there, -0.05) - scenario.z0).max() < 1e-11
