"""tc_auto: the better of two methods by measured stiffness, one run with one set of laws across the switch."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from random_laws import assert_laws
from states import admissible_states
from tcbench_plugins.tc_auto import adaptive, both, methods_of
from tcbench_plugins.tc_gauss import march

import tcbench
from tcbench.plugins import find_scenario
from tcbench.reference.lookup import reference_for

END = np.array([0.0, 20.0])


def shares(scenario, tolerance, times=END):
    """(implicit, explicit) steps of a run."""
    implicit, explicit = methods_of(scenario.model, tolerance)
    both(implicit, explicit, scenario.z0, times, tolerance)
    return implicit.counts.steps, explicit.counts.steps


@pytest.mark.parametrize("name", ["bound_equilibrium", "gas_containers"])
def test_where_conduction_is_not_stiff_the_run_is_that_of_the_explicit_method(name):
    scenario = tcbench.scenarios()[name]
    found, _ = adaptive(scenario.model, scenario.z0, END, 1e-7, 1e-7)
    assert shares(scenario, 1e-7)[0] == 0
    alone, _ = tcbench.integrators()["tc_taylor"].adaptive(scenario.model, scenario.z0, END, 1e-7, 1e-7)
    assert np.array_equal(found, alone)


@pytest.mark.parametrize("name", ["short_term", "fast_conduction", "long_term"])
def test_where_it_is_stiff_few_explicit_steps_are_taken_and_most_work_is_saved(name):
    scenario = tcbench.scenarios()[name]
    _, alone = tcbench.integrators()["tc_gauss_adaptive"].adaptive(scenario.model, scenario.z0, END, 1e-7, 1e-7)
    _, cost = adaptive(scenario.model, scenario.z0, END, 1e-7, 1e-7)
    implicit, explicit = shares(scenario, 1e-7)
    assert 8 <= explicit < 30 and implicit > 3  # once out of what decays at the start, eight that conduction bounds
    assert cost["newton_iterations"] < alone["newton_iterations"]


@pytest.mark.parametrize("name", ["cold_spring", "short_term"])
def test_a_run_that_goes_over_keeps_its_laws_and_its_tolerance(name):
    scenario = tcbench.scenarios()[name].replace(t_end=1.0)
    reference = reference_for(scenario, [1.0]).states[-1].astype(float)
    for tolerance in (1e-4, 1e-8):
        run = tcbench.simulate("tc_auto", scenario, tolerance=tolerance)
        implicit, explicit = shares(scenario, tolerance, run.t)
        assert run.ok and implicit > 0 and explicit > 3
        error = np.max(np.abs(run.z[-1] - reference) / np.maximum(1.0, np.abs(reference)))
        assert error <= 3e3 * tolerance  # what the scenario itself makes of a disturbance, as of tc_taylor's
        assert np.abs(run.energy - run.energy[0]).max() <= 1e-12 * scenario.initial_exergy
        assert np.diff(run.entropy).min() >= -1e-13


def test_it_goes_to_and_fro_as_stiffness_comes_and_goes():
    """Close encounters ask for steps so short that conduction does not bound them; between them it does."""
    scenario = tcbench.scenarios()["cold_spring"]
    _, alone = tcbench.integrators()["tc_gauss_adaptive"].adaptive(scenario.model, scenario.z0, END, 1e-4, 1e-4)
    _, cost = adaptive(scenario.model, scenario.z0, END, 1e-4, 1e-4)
    implicit, explicit = shares(scenario, 1e-4)
    assert explicit > 3 and implicit > 3 and cost["newton_iterations"] < alone["newton_iterations"]


@given(admissible_states(), st.floats(-10, -2), st.floats(-1, 3))
def test_every_law_holds_from_random_states_whatever_conducts(state, exponent, conductivity):
    assert_laws("tc_auto", state, 10.0**conductivity, 10.0**exponent)


def test_output_times_are_hit_and_a_large_system_is_left_to_collocation():
    scenario = tcbench.scenarios()["stiff_spring"]
    times = np.linspace(0.0, 2.0, 41)
    many, _ = adaptive(scenario.model, scenario.z0, times, 1e-9, 1e-9)
    few, _ = adaptive(scenario.model, scenario.z0, times[[0, 20, 40]], 1e-9, 1e-9)
    assert many.shape == (41, 10) and np.abs(many[[20, 40]] - few[1:]).max() < 1e-6
    chain = find_scenario("chain[n=40]")
    found, _ = adaptive(chain.model, chain.z0, np.array([0.0, 0.1]), 1e-5, 1e-5)
    assert np.isfinite(found).all()


def test_an_attempt_is_given_up_when_it_owes_what_it_may():
    scenario = tcbench.scenarios()["cold_spring"]
    gauss, _ = methods_of(scenario.model, 1e-7)
    states = np.empty((2, len(scenario.z0)))
    for owed in (5.0, 9.0):
        march.begin(gauss.work, scenario.z0)
        gauss.work.budget[:2] = 0.0, owed
        row, t, _ = march.advance(gauss.work, END, *gauss.held(1e-7), states, 1, 0.0, 0.5)
        assert row == 1 and t == 0.0 and gauss.counts.iterations == owed + 1  # an attempt at 0.5 would take some fifty
