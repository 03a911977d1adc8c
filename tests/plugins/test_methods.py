"""Splittings with exact conduction and other discrete gradients: what makes each of them what it is."""

import numpy as np
import pytest
from tcbench_plugins.discrete_gradients import gonzalez, itoh_abe, mean_value

import tcbench
from tcbench.compiler import derivatives as trace
from tcbench.compiler.kernels import kernel
from tcbench.reference.lookup import reference_for

SCENARIO = tcbench.scenarios()["short_term"]


def evaluated(gradient, z0, z1):
    """A discrete gradient, which is made for symbols, on numbers."""
    model = SCENARIO.model
    a, b = trace.variables("a", model.size), trace.variables("b", model.size)
    values = gradient(model.symbolic, a, b)
    inputs = {x: f"a[{i}]" for i, x in enumerate([*a, *b])} | model.constant_symbols()
    return kernel(inputs, list(np.asarray(values)))(np.concatenate([z0, z1]), model.constant_values)


@pytest.mark.parametrize("gradient", [gonzalez, itoh_abe, mean_value])
@pytest.mark.parametrize("size", [0.1, 1e-4, 1e-9])
def test_directionality_the_gradient_gives_the_difference_of_energies(gradient, size):
    rng = np.random.default_rng(3)
    for _ in range(5):
        dz = size * rng.uniform(-1, 1, 10)
        z0, z1 = SCENARIO.z0, SCENARIO.z0 + dz
        difference = SCENARIO.model.energy(z1) - SCENARIO.model.energy(z0)
        assert evaluated(gradient, z0, z1) @ (z1 - z0) == pytest.approx(difference, abs=1e-11)


@pytest.mark.parametrize("gradient", [gonzalez, itoh_abe, mean_value])
def test_consistency_without_increments_it_is_the_gradient(gradient):
    assert np.allclose(evaluated(gradient, SCENARIO.z0, SCENARIO.z0), SCENARIO.model.gradient(SCENARIO.z0), rtol=1e-13)


def test_symmetry_holds_for_all_but_itoh_abe():
    z1 = SCENARIO.z0 + 0.1 * np.sin(np.arange(10.0))
    swapped = [
        np.abs(evaluated(g, SCENARIO.z0, z1) - evaluated(g, z1, SCENARIO.z0)).max() for g in (gonzalez, mean_value)
    ]
    assert (
        max(swapped) < 1e-10 < np.abs(evaluated(itoh_abe, SCENARIO.z0, z1) - evaluated(itoh_abe, z1, SCENARIO.z0)).max()
    )


def test_the_closed_form_of_the_conduction_is_its_flow():
    still = SCENARIO.replace(name="still", momenta=(0, 0, 0, 0), masses=(1e12, 1e12), t_end=0.005)
    exact = reference_for(still, [0.005]).states[0].astype(float)
    theta = np.array(still.temperatures)
    increments, mean = still.model.conduction_flow(theta, 0.005)
    assert np.allclose(increments, exact[8:] - still.z0[8:], atol=1e-10)
    x = 2 * 300 * 0.005 / 5
    assert mean[0] - mean[1] == pytest.approx(70 * (1 - np.exp(-x)) / x) and mean.sum() == pytest.approx(690)


def test_tc_strang_exact_does_not_ring():
    # one step with kappa h = 900: the implicit conduction overshoots, its exact flow does not
    fast = tcbench.scenarios()["fast_conduction"]

    def after_a_step(name):
        run = tcbench.simulate(name, fast, dt=0.3, t_end=0.3)
        return run.temperatures[-1, 0] - run.temperatures[-1, 1]

    assert abs(after_a_step("tc_strang_exact")) < 1.0 < abs(after_a_step("tc_monolithic"))


def test_verlet_heat_needs_no_solver():
    run = tcbench.simulate("verlet_heat", "bound_equilibrium", t_end=100.0)
    assert run.ok and run.solver.newton_iterations == 0


def test_the_midpoint_rule_claims_no_entropy_for_it_may_fall_where_it_is_no_sum_of_variables():
    """Of elements it cannot (test_laws); a reaction far from rest at a large step loses some, so nothing is claimed."""
    far = tcbench.scenarios()["reaction"].replace(n=[1.66, 0.85], u=4.3, t_end=100.0)
    assert np.diff(tcbench.simulate("midpoint_entropy", far, dt=25.0).entropy).min() < -1e-3
    assert np.diff(tcbench.simulate("tc_monolithic", far, dt=25.0).entropy).min() > -1e-13
    assert "entropy" not in tcbench.integrators()["midpoint_entropy"].claims
