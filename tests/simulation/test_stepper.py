"""`stepper`: one step of a registered method as a function."""

import numpy as np
import pytest

import tcbench
from tcbench import Integrator, TcbenchError
from tcbench.studies import convergence

SCENARIO = tcbench.scenarios()["short_term"]
METHODS = ["tc_monolithic", "tc_strang", "midpoint_temperature", "verlet_heat", "tc_gauss", "projected"]


@pytest.mark.parametrize("method", METHODS)
def test_steps_are_those_of_a_run_whatever_was_done_in_between(method):
    run = tcbench.simulate(method, SCENARIO, dt=0.1, t_end=0.5)
    step, z = tcbench.stepper(method, SCENARIO), SCENARIO.z0
    for expected in run.z[1:]:
        step(SCENARIO.z0, 0.3)  # another step, another length
        z = step(z, 0.1)
        assert np.abs(z - expected).max() < 1e-12
    assert z.q.shape == (4,) and step.order == tcbench.integrators()[method].order


@pytest.mark.parametrize("scenario", ["short_term", "damped_oscillator"])
def test_it_leaves_its_argument_and_counts_its_own_iterations(scenario):
    scenario = tcbench.scenarios()[scenario]
    system, z = scenario.model, scenario.z0.copy()
    step, other = (tcbench.stepper("tc_monolithic", system) for _ in range(2))
    other(z, 0.3)
    assert other.iterations > step.iterations == 0
    first, before = step(z, 0.1), step.iterations
    again = step(z, 0.1)
    assert np.array_equal(z, scenario.z0) and np.array_equal(first, again) and step.iterations > before


def test_a_step_that_does_not_exist_is_an_error_with_its_cause():
    step = tcbench.stepper("midpoint_entropy", "stiff_spring")
    with pytest.raises(ArithmeticError, match=r"midpoint_entropy, a step of 1e\+06: "):
        step(tcbench.scenarios()["stiff_spring"].z0, 1e6)
    assert np.isfinite(step(tcbench.scenarios()["stiff_spring"].z0, 0.01)).all()


def test_what_has_no_step_is_refused():
    def formula(z0, z1, h, system, before):
        return z1 - before[0]

    two = Integrator(name="two", order=1, memory=1, starter="tc_monolithic", flows=formula)
    for method, words in (("scipy_odeint", "adaptive solver"), (two, "multistep")):
        with pytest.raises(TcbenchError, match=words):
            tcbench.stepper(method, SCENARIO)
    with pytest.raises(TcbenchError, match=r"shape \(10,\)"):
        tcbench.stepper("tc_monolithic", SCENARIO)([1.0, 2.0], 0.1)
    with pytest.raises(TcbenchError, match="written for chain only"):
        tcbench.stepper(Integrator(name="for_chains", order=1, step=formula, systems={"chain"}), SCENARIO)


def test_a_class_in_the_place_of_a_system_is_told_where_the_system_is():
    with pytest.raises(TcbenchError, match=r"The system of a scenario, with its constants, is scenario\.model"):
        tcbench.stepper("tc_monolithic", tcbench.scenarios()["short_term"].system)


def test_richardson_extrapolation_has_order_four():
    def richardson(z, h, system):
        step = tcbench.stepper("tc_monolithic", system)
        return (4 * step(step(z, h / 2), h / 2) - step(z, h)) / 3

    scenario = tcbench.scenarios()["bound_equilibrium"]
    method = Integrator(name="richardson", order=4, step=richardson)
    row = convergence.measure(method, scenario, {"dt": [scenario.t_converge / n for n in (4, 6, 8, 12, 16, 24, 32)]})
    fit = next(item for item in row["orders"] if item["variable"] == "all")
    assert fit["verdict"] == "as declared" and abs(fit["order"] - 4) < 0.1, fit


def test_what_is_no_step_is_refused_with_its_reason():
    scenario = tcbench.scenarios()["short_term"]
    step, z = tcbench.stepper("tc_monolithic", scenario), scenario.z0
    for state, h in ((z, np.nan), (z, np.inf), (np.nan * z, 0.1)):
        with pytest.raises(TcbenchError, match="finite"):
            step(state, h)
    assert isinstance(np.abs(step(z, 0.1) - z).max(), float)


@pytest.mark.parametrize("h", [0.01, 0.07, 0.3, 1.1])
@pytest.mark.parametrize("method", ["tc_monolithic", "tc_strang", "midpoint_entropy"])
def test_a_step_of_a_self_adjoint_method_can_be_taken_back(method, h):
    """(A1) with h and the two states exchanged is itself: its step of -h from z1 is z0, also beyond the pole of
    conduction (kappa h = c0, at 0.017 here), where the root has det J < 0."""
    step, z = tcbench.stepper(method, SCENARIO), tcbench.simulate(method, SCENARIO, dt=0.1, t_end=1.0).z[-1]
    assert np.abs(step(step(z, h), -h) - z).max() < 1e-11


def test_a_step_back_that_does_not_exist_says_what_was_looked_for():
    """Staggered steps are not their own adjoints: none of h leads to where a step of -h would begin."""
    with pytest.raises(
        ArithmeticError, match=r"a step of -0\.3: the roots .* no other was found from which a step of 0\.3"
    ):
        tcbench.stepper("tc_itoh_abe", SCENARIO)(SCENARIO.z0, -0.3)


@pytest.mark.parametrize("z", [
    np.ma.array([1.0, 0, 0], mask=[0, 0, 1]), np.array([True, False, False]), np.array(["1", "0", "0"]),
    np.array([1 + 0j, 0, 0]),
], ids=["masked", "bool", "words", "complex"])  # fmt: skip
def test_a_step_begins_at_plain_numbers_only(z):
    """A mask, truth values and words were taken for numbers without a word."""
    step = tcbench.stepper("tc_monolithic", "damped_oscillator")
    with pytest.raises(tcbench.TcbenchError, match="state of numbers"):
        step(z, 0.1)
    assert np.allclose(step(np.array([1, 0, 0], np.float32), 0.1), step([1.0, 0.0, 0.0], 0.1), atol=0)
