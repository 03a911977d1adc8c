"""tc_auto: the better of two methods by measured stiffness, one run with one set of laws across the switch."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_laws import QUICK, assert_laws, assert_laws_of_any, random_start
from states import admissible_states
from tcbench_plugins.tc_auto import BothMethods, adaptive, chosen

import tcbench
from tcbench.plugins import find_scenario
from tcbench.reference.lookup import reference_for

from ..helpers.networks import cells

END = np.array([0.0, 20.0])


def shares(scenario, tolerance, times=END):
    """(implicit, explicit) steps of a run."""
    methods = BothMethods(scenario.model, *chosen(tolerance))
    methods.adaptive(scenario.z0, times, tolerance)
    return methods.gauss.counts.steps, methods.taylor.counts.steps


@pytest.mark.parametrize("name", ["bound_equilibrium", "gas_containers"])
def test_where_conduction_is_not_stiff_the_run_is_that_of_the_explicit_method(name):
    scenario = tcbench.scenarios()[name]
    found, _ = adaptive(scenario.model, scenario.z0, END, 1e-7, 1e-7)
    assert shares(scenario, 1e-7)[0] == 0
    alone, _ = tcbench.integrators()["tc_taylor"].adaptive(scenario.model, scenario.z0, END, 1e-7, 1e-7)
    assert np.abs(found - alone).max() < 1e-7  # it is mended at other steps


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
    scenario = tcbench.scenarios()[name]
    scenario = scenario.replace(t_end=1.0, conductivity=1000.0 * scenario.constants["conductivity"])
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
    scenario = scenario.replace(conductivity=4.0 * scenario.constants["conductivity"])
    _, alone = tcbench.integrators()["tc_gauss_adaptive"].adaptive(scenario.model, scenario.z0, END, 1e-4, 1e-4)
    _, cost = adaptive(scenario.model, scenario.z0, END, 1e-4, 1e-4)
    implicit, explicit = shares(scenario, 1e-4)
    assert explicit > 100 and implicit > 30 and cost["newton_iterations"] < alone["newton_iterations"]


@settings(max_examples=30)
@given(admissible_states(), st.sampled_from([-9.0, -6.0, -3.0]), st.floats(-1, 3))
def test_every_law_holds_from_random_states_whatever_conducts(state, exponent, conductivity):
    assert_laws("tc_auto", state, 10.0**conductivity, 10.0**exponent)


@settings(max_examples=20)
@given(st.sampled_from(QUICK), st.integers(0, 2**32), st.sampled_from((-3, -6)), st.floats(0, 3))
def test_every_law_of_any_system_holds_whatever_dissipates(name, seed, exponent, stiffer):
    assert_laws_of_any("tc_auto", name, seed, 10.0**exponent, 10.0**stiffer, 0.02)


@pytest.mark.parametrize("name", ["rigid_body", "reaction"])
def test_a_general_system_that_dissipates_fast_is_left_to_collocation_once_it_is_seen_to(name):
    """Where it begins the fastest motion may be another: it is looked for again."""
    scenario = random_start(name, 0, 1000)
    end = np.array([0.0, scenario.t_end])
    explicit_alone = tcbench.integrators()["tc_taylor"].adaptive(scenario.model, scenario.z0, end, 1e-6, 1e-6)
    implicit, explicit = shares(scenario, 1e-6, end)
    assert implicit > 3 and explicit < 0.2 * explicit_alone[1]["steps"]
    found, _ = adaptive(scenario.model, scenario.z0, end, 1e-6, 1e-6)
    assert np.max(abs(found[-1] - explicit_alone[0][-1])) <= 1e-4 * (1 + abs(found[-1]).max())


@pytest.mark.parametrize("name", QUICK)
def test_a_general_system_as_it_ships_is_left_to_the_series_and_never_interrupted(name):
    scenario = tcbench.scenarios()[name]
    end = np.array([0.0, scenario.t_end])
    implicit, explicit = shares(scenario, 1e-6, end)
    assert implicit == 0 and explicit > 3
    found, alone = (tcbench.integrators()[x].adaptive(scenario.model, scenario.z0, end, 1e-6, 1e-6)[0]
                    for x in ("tc_auto", "tc_taylor"))  # fmt: skip
    assert np.array_equal(found, alone) or name == "reaction"  # which is long enough for one


@pytest.mark.parametrize("name", ["cells", pytest.param("chain", marks=pytest.mark.slow)])
def test_large_systems_that_dissipate_fast_go_over_with_all_their_laws(name):
    """From loops over the entries to sparse factors; springs from temperatures as variables to entropies."""
    stiff = {
        "cells": cells(40).replace(diffusion=3000.0),
        "chain": find_scenario("chain[n=40]").replace(conductivity=2e4),
    }
    run = tcbench.simulate("tc_auto", stiff[name], t_end=20.0, tolerance=1e-4)
    assert run.ok and run.summary.energy_error_max < 1e-12 and run.summary.entropy_increment_min > -1e-11
    assert all(error < 1e-11 * 40 for error in run.summary.invariant_error_max.values())
    methods = BothMethods(stiff[name].model, *chosen(1e-4))
    assert methods.gauss.work.large
    states, counts = methods.adaptive(stiff[name].z0, np.array([0.0, 20.0]), 1e-4)
    assert counts["newton_iterations"] > 0 and counts["steps"] < 400
    exact = tcbench.simulate("tc_gauss_adaptive", stiff[name], t_end=20.0, tolerance=1e-7).z[-1]
    assert np.abs(states[-1] - exact).max() < 1e-2
