"""Adaptive tc_gauss solves to its tolerance and mends energy and invariants: the laws hold to round-off even so."""

import numpy as np
import pytest
from hypothesis import given, reject, settings
from hypothesis import strategies as st
from states import admissible_states, with_elements
from tcbench_plugins.tc_gauss.method import GaussMethod

import tcbench
from tcbench.compiler import derivatives as trace
from tcbench.compiler.kernels import kernel
from tcbench.compiler.library import evaluate
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


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_the_compiled_mending_gives_energy_and_invariants(scenario):
    scenario = SCENARIOS[scenario]
    system = scenario.model
    n, method = system.n_positions, GaussMethod(system, 2)
    z = tcbench.simulate("tc_gauss", scenario, t_end=0.5).z[-1]
    moving = z[n : 2 * n] @ (z[n : 2 * n] / system.inertia()) / 2
    wanted = [system.energy(z) + 1e-3 * moving, *(1.001 * system.momenta(z))]
    found = np.zeros(n + 1 + len(system.momenta(z)))
    inputs = np.array([*z, system.energy(z), *wanted])
    evaluate(method.work.to_mend, inputs, method.work.c, found)
    mended = z.copy()
    mended[n : 2 * n] += found[:n]
    assert system.energy(mended) == pytest.approx(wanted[0], rel=1e-14)
    np.testing.assert_allclose(system.momenta(mended), wanted[1:], rtol=1e-13)
    np.testing.assert_allclose(found[n + 1 :], system.momenta(z), rtol=1e-13)
    assert np.linalg.norm(found[:n]) <= 2e-3 * np.linalg.norm(z[n : 2 * n])


def run(method, scenario, tolerance=1e-2):
    """Energy error over V0, momentum error and smallest entropy increment of a run; iterations."""
    system = scenario.model
    states, counts = method.adaptive(scenario.z0, np.linspace(0.0, 25.0, 26), tolerance)
    E, S = np.array([system.energy(z) for z in states]), np.array([system.entropy(z) for z in states])
    J = np.array([system.momenta(z)[0] for z in states])
    energy = np.abs(E - E[0]).max() / scenario.initial_exergy
    return energy, np.abs(J - J[0]).max(), np.diff(S).min(), counts["newton_iterations"]


def without_mending(system, share):
    """A method whose mending changes nothing: share = inf says that it can't, share = 0 that nothing is missing."""
    method = GaussMethod(system, 5)
    values = [0.0] * system.n_positions + [share] + [0.0] * len(system.invariant_names)
    nothing = kernel({}, [trace.const(x) for x in values])
    method.work.to_mend = nothing.address
    return method, nothing  # which must live as long as its address is used


def test_what_mending_does_and_what_happens_where_it_cannot():
    scenario = SCENARIOS["bound_equilibrium"]
    energy, momentum, entropy, iterations = run(GaussMethod(scenario.model, 5), scenario)
    assert energy <= 1e-13 and momentum <= 1e-13 and entropy >= -1e-13
    method, _kept = without_mending(scenario.model, np.inf)  # every step goes on to round-off
    energy, momentum, entropy, more = run(method, scenario)
    assert energy <= 1e-12 and momentum <= 1e-12 and entropy >= -1e-13
    assert more > 1.5 * iterations
    method, _kept = without_mending(scenario.model, 0.0)  # what is missed is missed
    energy, momentum, entropy, _ = run(method, scenario, 3e-2)
    assert energy > 1e-6 and momentum > 1e-6 and entropy >= -1e-13


class Squared(Pendulum):
    """A pendulum whose invariant is quadratic in the momenta: it can't be mended."""

    name = "squared"

    def invariants(self, q, p):
        return {"square": super().invariants(q, p)["angular_momentum"] ** 2}


def test_invariants_that_cannot_be_mended_are_kept_by_convergence():
    scenario = SCENARIOS["bound_equilibrium"]
    system = Squared(**{name: getattr(scenario.model, name) for name in Squared.constants})
    method = GaussMethod(system, 5)
    energy, momentum, entropy, iterations = run(method, scenario)
    assert energy <= 1e-12 and momentum <= 1e-12 and entropy >= -1e-13
    assert iterations > 1.5 * run(GaussMethod(scenario.model, 5), scenario)[3]


def test_an_energy_that_is_right_to_round_off_is_left_alone():
    """Mending it would put its round-off into the momenta, which this scenario magnifies ten thousand times."""
    scenario = SCENARIOS["cold_spring"]
    exact = reference_for(scenario, [25.0]).states[0].astype(float)
    states, _ = GaussMethod(scenario.model, 5).adaptive(scenario.z0, np.array([0.0, 25.0]), 1e-12)
    assert np.max(np.abs(states[-1] - exact) / np.maximum(1, np.abs(exact))) <= 3e-9


@pytest.mark.parametrize(("scenario", "t"), [("fast_conduction", 25.0), ("relative_equilibrium", 500.0)])
def test_loose_tolerances_let_steps_grow_until_nothing_happens(scenario, t):
    """What is left unsolved of a stiff conduction comes back in each step, and would spoil the guess for the next."""
    scenario = SCENARIOS[scenario]
    method = GaussMethod(scenario.model, 5)
    method.adaptive(scenario.z0, np.array([0.0, t]), 1e-1)
    assert method.counts.steps < 100 and method.counts.rejected <= 5


def test_what_is_much_to_mend_asks_for_a_finer_quadrature():
    scenario = SCENARIOS["cold_spring"]
    raised = 0
    for tolerance in (1e-2, 1e-4, 1e-6):
        method = GaussMethod(scenario.model, 6)
        method.adaptive(scenario.z0, np.array([0.0, 25.0]), tolerance)
        raised += method.counts.raised
    assert raised >= 2


def test_masses_that_nearly_collide_leave_no_energy_behind():
    """From rest they fall into the origin; there round-off of positions is 1e-7 of energy, which must not stay."""
    scenario = SCENARIOS["short_term"].replace(
        positions=[1, 0, 2, 0], momenta=np.zeros(4), temperatures=[150, 212], name="fall"
    )
    system = scenario.model
    states, _ = GaussMethod(system, 5).adaptive(scenario.z0, np.linspace(0.0, 3.0, 7), 1e-12)
    E = np.array([system.energy(z) for z in states])
    assert np.abs(E - E[0]).max() <= 1e-12 * abs(E[0])
