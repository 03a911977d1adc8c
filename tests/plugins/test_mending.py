"""Adaptive tc_gauss solves to its tolerance and mends energy and invariants: the laws hold to round-off even so."""

import numpy as np
from hypothesis import given, reject, settings
from hypothesis import strategies as st
from states import admissible_states, with_elements
from tcbench_plugins.tc_gauss.method import GaussMethod

from tcbench.reference.lookup import reference_for
from tcbench.systems.pendulum import Pendulum

SCENARIOS = with_elements()


@settings(max_examples=30)
@given(admissible_states(), st.sampled_from([1e-1, 1e-3, 1e-6, 1e-12]), st.sampled_from([2, 5]))
def test_the_laws_hold_from_random_states_at_any_tolerance(y, tolerance, k):
    scenario = SCENARIOS["short_term"].replace(
        positions=y[:4], momenta=y[4:8], temperatures=y[8:], t_end=3.0, name="random"
    )
    method, system = GaussMethod(scenario.model, k), scenario.model
    try:
        states, _ = method.adaptive(scenario.z0, np.linspace(0.0, 3.0, 7), tolerance)
    except ArithmeticError:  # masses that collide head-on, as from rest, squeeze a spring to nothing
        assert system.shape(method.work.z[:4]).min() < 1e-6
        reject()
    E, S = np.array([system.energy(z) for z in states]), np.array([system.entropy(z) for z in states])
    J = np.array([system.momenta(z)[0] for z in states])
    arms = np.abs(states[:, :4]).max() * max(1.0, np.abs(states[:, 4:8]).max())
    # over some tens of steps, each of which may leave round-off
    assert np.abs(E - E[0]).max() <= 1e-12 * (max(scenario.initial_exergy, 1.0) + abs(E[0]))
    assert np.abs(J - J[0]).max() <= 1e-12 * arms
    assert np.diff(S).min() >= -1e-13 * max(1.0, np.abs(S).max())


def run(method, scenario, tolerance=1e-2):
    """Energy error over V0, momentum error and smallest entropy increment of a run; iterations."""
    system = scenario.model
    states, counts = method.adaptive(scenario.z0, np.linspace(0.0, 25.0, 26), tolerance)
    E, S = np.array([system.energy(z) for z in states]), np.array([system.entropy(z) for z in states])
    J = np.array([system.momenta(z)[0] for z in states])
    energy = np.abs(E - E[0]).max() / scenario.initial_exergy
    return energy, np.abs(J - J[0]).max(), np.diff(S).min(), counts["newton_iterations"]


class Squared(Pendulum):
    """A pendulum whose invariant is quadratic in the momenta."""

    name = "squared"

    def invariants(self, q, p):
        return {"square": super().invariants(q, p)["angular_momentum"] ** 2}


def test_invariants_that_are_not_linear_are_mended():
    scenario = SCENARIOS["bound_equilibrium"]
    system = Squared(**{name: getattr(scenario.model, name) for name in Squared.constants})
    energy, momentum, entropy, _ = run(GaussMethod(system, 5), scenario)
    assert energy <= 1e-12 and momentum <= 1e-12 and entropy >= -1e-13


def test_an_energy_that_is_right_to_round_off_is_left_alone():
    """Mending it would put its round-off into the momenta, which this scenario magnifies ten thousand times."""
    scenario = SCENARIOS["cold_spring"]
    exact = reference_for(scenario, [25.0]).states[0].astype(float)
    states, _ = GaussMethod(scenario.model, 5).adaptive(scenario.z0, np.array([0.0, 25.0]), 1e-12)
    assert np.max(np.abs(states[-1] - exact) / np.maximum(1, np.abs(exact))) <= 3e-9


def test_masses_that_nearly_collide_leave_no_energy_behind():
    """From rest they fall into the origin; there round-off of positions is 1e-7 of energy, which must not stay."""
    scenario = SCENARIOS["short_term"].replace(
        positions=[1, 0, 2, 0], momenta=np.zeros(4), temperatures=[150, 212], name="fall"
    )
    system = scenario.model
    states, _ = GaussMethod(system, 5).adaptive(scenario.z0, np.linspace(0.0, 3.0, 7), 1e-10)
    E = np.array([system.energy(z) for z in states])
    assert np.abs(E - E[0]).max() <= 1e-12 * abs(E[0])
