"""tc_taylor on systems that are not made of elements: series from the vector field, mended onto their own laws."""

from math import factorial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_laws import GENERAL, QUICK, assert_laws_of_any, random_start
from scipy.integrate import solve_ivp
from tcbench_plugins.tc_taylor import damping, lanes
from tcbench_plugins.tc_taylor.method import TaylorMethod
from tcbench_plugins.tc_taylor.texts import series_kernels

import tcbench
from tcbench.compiler.kernels import kernel, namespace

ORDER = 10
EACH = [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in GENERAL]


@pytest.mark.parametrize("name", EACH)
def test_series_begin_with_the_rates_and_lanes_and_plain_python_agree(name, monkeypatch):
    scenario = random_start(name, 0)
    system, found = scenario.model, []
    for width in (4, 1):
        monkeypatch.setattr(lanes, "WIDTH", width)
        series, _, _, more, _ = series_kernels(system, ORDER, len(system.constant_values))
        setup = kernel(system.constant_symbols(), more)(system.constant_values, system.constant_values)
        given = np.concatenate([system.constant_values, setup])
        found.append(series(scenario.z0, given))
        scope, out = dict(namespace()), np.empty(series.size)
        exec(series.text, scope)
        scope["kernel"](scenario.z0, given, out)
        found.append(out)
    end = (ORDER + 1) * scenario.z0.size  # two sizes after it, then what is to keep its sign: the reaction's root
    table = found[0][:end].reshape(ORDER + 1, -1)
    field = np.asarray(system.vector_field(scenario.z0))
    assert np.array_equal(table[0], scenario.z0) and np.allclose(table[1], field, rtol=1e-13, atol=1e-14)
    largest = abs(table).max(axis=1, keepdims=True)
    for other in found[1:]:
        assert np.all(abs(other[:end].reshape(ORDER + 1, -1) - table) <= 1e-11 * largest)
    sizes = [np.sum(table[k] ** 2 / (1 + scenario.z0**2)) for k in (ORDER - 1, ORDER)]
    assert found[0][end : end + 2] == pytest.approx(sizes, rel=1e-12)


@pytest.mark.parametrize("name", EACH)
def test_errors_follow_the_tolerance(name):
    scenario = random_start(name, 1)
    times = np.array([0.0, 0.05 * scenario.t_end])
    exact = solve_ivp(
        lambda t, z: np.asarray(scenario.model.vector_field(z)), times, scenario.z0, "DOP853", rtol=1e-13, atol=1e-13
    ).y[:, -1]
    solve = tcbench.integrators()["tc_taylor"].adaptive
    for tolerance in (1e-4, 1e-8):
        states, _ = solve(scenario.model, scenario.z0, times, tolerance, tolerance)
        assert np.max(abs(states[-1] - exact) / np.maximum(1.0, abs(exact))) <= 10 * tolerance + 1e-11


@settings(max_examples=20)
@given(st.sampled_from(QUICK), st.integers(0, 2**32), st.sampled_from((-4, -8)), st.floats(0, 3))
def test_every_law_holds_from_random_states_whatever_dissipates(name, seed, exponent, stiffer):
    assert_laws_of_any("tc_taylor", name, seed, 10.0**exponent, 10.0**stiffer, 0.02)


@pytest.mark.parametrize("order", damping.DAMPED)
def test_a_damped_series_is_small_along_a_decay_and_so_is_its_estimate(order):
    parts = damping.fields(order)
    x = -np.linspace(1.0, parts["reach"], 400)
    x = np.concatenate([x, x + 0.5j, x + 1j])
    terms = np.array([x**k / factorial(k) for k in range(order + 1)])
    weights = np.concatenate([np.ones(order + 1 - damping.LAST), parts["factors"]])
    assert np.max(abs(weights @ terms)) <= 0.93  # 0.9 in the directions that were asked for
    assert np.max(abs(parts["misses"] @ terms[-damping.LAST :])[:400]) <= 6.0
    assert parts["misses"][0] == 1.0 - parts["factors"][0]  # the first term that the series misses


@pytest.mark.parametrize(("name", "times"), [("rigid_body", 100), ("short_term", 1)])
def test_where_something_decays_fast_steps_are_damped_and_few(name, times):
    """As accurate as those of the series as they are, of which stability bounds each."""
    scenario = tcbench.scenarios()[name] if times == 1 else random_start(name, 0, times)
    span = np.array([0.0, min(20.0, 0.5 * scenario.t_end)])
    method, found = TaylorMethod(scenario.model, 12), []
    for reach in (method.work.reach, 0.0):
        method.work.reach = reach
        states, cost = method.adaptive(scenario.z0, span, 1e-8)
        found.append((states[-1], cost["steps"]))
    (damped, few), (plain, many) = found
    assert few < 0.7 * many
    assert damped == pytest.approx(plain, rel=1e-5, abs=1e-5)


def test_an_oscillation_is_not_damped():
    scenario = tcbench.scenarios()["damped_oscillator"]
    method, span = TaylorMethod(scenario.model, 12), np.array([0.0, 30.0])
    states, cost = method.adaptive(scenario.z0, span, 1e-8)
    method.work.reach = 0.0
    plain, same = method.adaptive(scenario.z0, span, 1e-8)
    assert np.array_equal(states, plain) and cost == same


class Cancels(tcbench.System):
    """A variable leaves by cancellation: what holds it is a constant, and so is a function of that."""

    name = "cancels"
    variables = {"a": (), "b": (), "u": ()}
    constants = {"sites": ()}

    def energy(self, z):
        return z.u

    def entropy(self, z):
        """The slope of the last terms by b has b / (b / sites) / sites in it."""
        free = self.sites - z.b
        mixing = z.b * np.log(z.b / self.sites) + free * np.log(free / self.sites)
        return np.log(z.u) - z.a * (np.log(z.a) - 1) - mixing

    def irreversible(self, z, dE, dS):
        flow = z.a * (self.sites - z.b) * (dS.b - dS.a)
        return {"a": -flow, "b": flow}


def test_what_cancels_is_a_constant():
    scenario = tcbench.Scenario("c", Cancels, {"sites": 2}, initial={"a": 1, "b": 0.1, "u": 1}, t_end=2, dt=0.1)
    ends = [tcbench.simulate(method, scenario, tolerance=1e-11).z[-1] for method in ("tc_taylor", "solve_ivp_dop853")]
    assert ends[0] == pytest.approx(ends[1], rel=1e-9)
