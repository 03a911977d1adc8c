"""Pairs of Taylor series: never further from the solution than they say, on any system, alone or in a crowd."""

import numpy as np
import pytest
from mechanics import OfEntropies

import tcbench
from tcbench import Scenario
from tcbench.compiler import language
from tcbench.plugins import find_scenario
from tcbench.reference import pairs
from tcbench.reference.certified import gap
from tcbench.reference.lookup import _Recipe, from_pair

pytestmark = pytest.mark.skipif(language.PLAIN, reason="collocations take their place where everything is plain")


def solved(scenarios, times):
    return pairs.solve([s.model for s in scenarios], [s.z0 for s in scenarios], times)


def distance(a, b):
    return float(np.max(np.abs((a.states - b.states) + (a.low - b.low)) / np.maximum(1.0, np.abs(b.states))))


def more_precise(scenarios, times, monkeypatch):
    """A run of another order and other steps, with thirty digits throughout."""
    with monkeypatch.context() as patch:
        for name, value in (("ORDER", 46), ("WIDE", 46), ("FINE", 1e-29), ("COARSE", 1e-28)):
            patch.setattr(pairs, name, value)
        return solved(scenarios, times)


def test_where_no_double_knows_the_end_the_floor_says_so(monkeypatch):
    """A start moved in its twentieth digit ends elsewhere; one moved in its last has long stopped telling how far."""
    scenarios = [find_scenario(f"random[seed={k}]") for k in (52, 54)]
    found, truth = solved(scenarios, [25.0]), more_precise(scenarios, [25.0], monkeypatch)
    for scenario, pair, exact in zip(scenarios, found, truth, strict=True):
        assert 10 * distance(pair, exact) < pair.certificate[0] < 1e-5
        assert from_pair(pair, [25.0]).floor[0] > 1.0, scenario.name


@pytest.mark.parametrize("seeds", [range(8), pytest.param(range(500), marks=pytest.mark.slow)], ids=["few", "many"])
def test_no_certificate_is_below_the_true_error(seeds, monkeypatch):
    scenarios = [find_scenario(f"random[seed={k}]") for k in seeds]
    found, truth = solved(scenarios, [10.0]), more_precise(scenarios, [10.0], monkeypatch)
    bars = np.array([pair.certificate[0] for pair in found])
    errors = np.array([distance(pair, exact) for pair, exact in zip(found, truth, strict=True)])
    assert (10 * errors < bars).all() and np.median(bars) < 1e-20
    assert np.mean(bars <= 1e-11) >= 0.98 or len(seeds) < 500


def test_alone_in_a_crowd_and_through_other_times_it_is_the_same():
    """What lies in the other lanes does not matter; to stop on the way moves the steps, and no more than it may."""
    scenarios = [find_scenario(f"random[seed={k}]") for k in range(5)]
    crowd = solved(scenarios, [2.0])
    for scenario, pair in zip(scenarios, crowd, strict=True):
        (alone,) = solved([scenario], [2.0])
        assert np.array_equal(alone.states, pair.states) and np.array_equal(alone.low, pair.low)
        assert alone.certificate == pair.certificate and alone.steps == pair.steps
    (stopping,) = solved(scenarios[:1], [0.3, 1.1, 2.0])
    assert stopping.states.shape == (3, 10) and distance(stopping, crowd[0]) > 0.1
    assert np.array_equal(stopping.states[2:], crowd[0].states)
    assert abs(stopping.low[2] - crowd[0].low[0]).max() < 10 * (crowd[0].certificate + stopping.certificate[2])


GENERAL = ["damped_oscillator", "rubbing_piston", "heavy_top", "reaction", "gas_containers"]


@pytest.mark.parametrize("name", GENERAL)
def test_systems_of_every_kind_agree_with_a_more_precise_run(name, monkeypatch):
    scenario = tcbench.scenarios()[name]
    (found,), (exact,) = solved([scenario], [1.0]), more_precise([scenario], [1.0], monkeypatch)
    assert distance(found, exact) < found.certificate[0] < 1e-22


class Functions(OfEntropies):
    """z' = every elementary function of the tracer at once."""

    name = "functions"
    constants = {"a": ()}
    variables = {"z": (), "s": ()}

    def energy(self, z):
        return z.z

    def reversible(self, z, dE, dS):
        x = 0.5 + 0.3 * np.sin(z.s)
        smooth = np.tanh(x) + np.tan(x) + np.arcsin(x) + np.arccos(x) + np.arctan(x) + np.sinh(x) + np.cosh(x)
        others = np.expm1(x) + np.log1p(x) + np.hypot(x, self.a) + x**1.7 + np.sqrt(x) / x + 1.0 / x
        others = others + np.arctan2(x, np.cos(3.0 * z.s))
        return {"z": 0.0 * z.z, "s": 0.1 * dE.z * (smooth + others + np.cos(x) + np.exp(-x) * np.log(x))}

    def irreversible(self, z, dE, dS):
        return {}


def test_every_elementary_function_has_its_series():
    scenario = Scenario("functions", Functions, {"a": 0.7}, initial={"z": 1.0, "s": 0.2}, t_end=2.0, dt=0.1)
    (pair,) = solved([scenario], [2.0])
    exact = _Recipe(scenario, (2.0,)).collocations()
    assert gap(pair.states[0], exact.states[0]) < exact.floor[0] < 1e-12
    assert pair.certificate[0] < 1e-20


class Falling(OfEntropies):
    """Rates that are constants, or nothing at all."""

    name = "falling"
    constants = {"g": ()}
    variables = {"p": (), "x": (), "s": ()}

    def energy(self, z):
        return self.g * z.x

    def reversible(self, z, dE, dS):
        return {"p": -dE.x, "x": 0.0 * z.x}

    def irreversible(self, z, dE, dS):
        return {}


def test_rates_that_are_constant_have_a_pair():
    scenario = Scenario("falling", Falling, {"g": 0.1}, initial={"p": 1.0, "x": 2.0, "s": 3.0}, t_end=2.0, dt=0.1)
    (pair,) = solved([scenario], [1.5])
    assert pair.states[0].tolist() == [0.85, 2.0, 3.0] and pair.certificate[0] < 1e-24


def test_a_solution_that_ends_has_none():
    """z' = z^2 is infinite at t = 1; beside it others go on."""

    class Exploding(Falling):
        def reversible(self, z, dE, dS):
            return {"p": z.p * z.p * dE.x / self.g}

    made = [
        Scenario("e", Exploding, {"g": 0.1}, initial={"p": p, "x": 2.0, "s": 3.0}, t_end=2.0, dt=0.1)
        for p in (1.0, 0.25)
    ]
    gone, there = solved(made, [1.5])
    assert gone is None and there.states[0][0] == pytest.approx(0.25 / (1 - 0.25 * 1.5), rel=1e-15)
