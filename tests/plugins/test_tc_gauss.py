"""tc_gauss: its order, its laws over long times and on two systems, and its compiled form against plain numpy."""

import numpy as np
import pytest
from laws import assert_laws
from states import with_elements
from tcbench_plugins.tc_gauss.formulas import POINTS, coefficients
from tcbench_plugins.tc_gauss.method import GaussMethod

import tcbench
from tcbench.plugins import find_integrator
from tcbench.reference.lookup import reference_for

# conduction slow enough that these steps resolve it; a stiff layer lowers the order of every collocation
SLOW = tcbench.scenarios()["short_term"].replace(name="slow_heat", conductivity=1.0, t_end=1.0)


def name(k):
    return "tc_gauss" if k == 3 else f"tc_gauss[k={k}]"


@pytest.mark.parametrize(
    ("integrator", "steps"),
    [
        ("tc_gauss[k=1]", (64, 128)), ("tc_gauss[k=2]", (32, 64)), ("tc_gauss", (16, 32)), ("gauss2", (64, 128)),
        pytest.param("gauss3", (16, 32), marks=pytest.mark.slow),
    ],
)  # fmt: skip
def test_the_order_is_twice_the_number_of_stages(integrator, steps):
    exact = reference_for(SLOW, [1.0]).states[0].astype(float)
    errors = [np.abs(tcbench.simulate(integrator, SLOW, dt=1 / n).z[-1] - exact).max() for n in steps]
    order = np.log(errors[0] / errors[1]) / np.log(steps[1] / steps[0])
    assert order == pytest.approx(find_integrator(integrator).order, abs=0.1)


@pytest.mark.parametrize("integrator", ["tc_gauss", "tc_gauss_adaptive"])
def test_the_laws_hold_over_a_long_time(integrator):
    run = tcbench.simulate(integrator, "bound_equilibrium", t_end=15000.0)
    assert_laws(run)


@pytest.mark.parametrize(
    ("still", "k", "h", "steps", "bound"),
    [("conductivity", 2, 0.3, 1024, 2e-11), ("conductivity", 3, 1.2, 1024, 5e-11), ("friction", 3, 0.3, 4096, 1e-14)],
)
def test_round_off_of_one_sign_does_not_add_up_where_nothing_dissipates(still, k, h, steps, bound):
    """A quadrature's misses are below a step's noise: 1e-10, 5e-10 and 4e-14 of V0 were left."""
    scenario = tcbench.scenarios()["stiff_spring" if still == "conductivity" else "damped_oscillator"]
    scenario = scenario.replace(name="conservative", **{still: 0.0})
    run = tcbench.simulate(name(k), scenario, h, steps * h, record_every=None)
    assert run.ok and run.summary.energy_error_max <= bound


@pytest.mark.parametrize("scenario", with_elements())
def test_adaptive_steps_keep_the_laws_and_follow_the_tolerance(scenario):
    scenario = tcbench.scenarios()[scenario]
    scenario = scenario.replace(t_end=min(scenario.t_end, 25.0))
    exact = reference_for(scenario, [1.0]).states[0].astype(float)
    for tolerance in (1e-1, 1e-6, 1e-10):
        assert_laws(tcbench.simulate("tc_gauss_adaptive", scenario, tolerance=tolerance), invariants=np.inf)
        short = tcbench.simulate("tc_gauss_adaptive", scenario, t_end=1.0, tolerance=tolerance)
        assert np.max(np.abs(short.z[-1] - exact) / np.maximum(1, np.abs(exact))) <= tolerance


def plain_step(scenario, k, h, iterations=200):
    """The equations of step.py for the pendulum in plain numpy, by an undamped fixed point."""
    a, model = coefficients(k), scenario.model
    masses, points = model.inertia(), POINTS[0]
    Ahat, W = a.Ahats[0][:points], a.Ws[0][:, :points]
    z0 = model.state(scenario.z0)
    C, beta, c0, ref = model.stiffness, model.coupling, model.heat_capacity, model.reference_temperature
    F, G = np.zeros((k, 4)), np.zeros((k, 2))

    def slopes(pi, s):
        L = model.log_strain(pi)
        theta = ref * np.exp((s - beta * L) / c0)
        return (C * L - beta * (theta - ref)) / (2 * pi), theta

    for _ in range(iterations):
        p = z0.p + h * a.A @ F
        q = z0.q + h * a.A @ (p / masses)
        pull = np.array(
            [np.array([[*(2 * x[:2]), 0, 0], [*(-2 * (x[2:] - x[:2])), *(2 * (x[2:] - x[:2]))]]) for x in q]
        )
        rates = np.einsum("jei,ji->je", pull, p / masses)
        stress, theta = slopes(model.shape(z0.q) + h * Ahat @ rates, z0.s + h * Ahat @ G)
        F = -np.einsum("jei,je->ji", pull, W @ stress)
        G = np.array([model.conduction(x) for x in W @ theta])
    dz = [h * a.b @ (p / masses), h * a.b @ F, h * a.b @ G]
    return np.concatenate(dz)


@pytest.mark.parametrize("k", [1, 3])
def test_the_compiled_step_is_the_formula(k):
    scenario = SLOW.replace(stiffness=(10, 100))
    expected = plain_step(scenario, k, 0.05)
    method = GaussMethod(scenario.model, k)
    assert np.allclose(method.increments(scenario.z0, 0.05), expected, rtol=1e-12, atol=1e-14)
    assert method.counts.raised == 0  # no finer quadrature had to make up for the fast kernel
    method.work.n_lanes = 0  # the same through the loops that serve finer quadratures
    assert np.allclose(method.increments(scenario.z0, 0.05), expected, rtol=1e-12, atol=1e-14)


def test_a_step_without_a_root_is_an_error_that_becomes_a_row():
    scenario = tcbench.scenarios()["short_term"]
    with pytest.raises(ArithmeticError, match="no solution"):
        GaussMethod(scenario.model, 2).increments(np.full(10, np.nan), 0.1)


@pytest.mark.parametrize("k", [5, 8])
def test_round_off_in_stiff_conduction_rejects_no_step(k):
    """It is about one residual there: a residual that no longer shrinks is not one that does not converge."""
    scenario = tcbench.scenarios()["relative_equilibrium"]
    solve = find_integrator(f"tc_gauss_adaptive[k={k}]").adaptive
    for tolerance in (1e-8, 1e-10, 1e-12):
        _, cost = solve(scenario.model, scenario.z0, np.array([0.0, 1500.0]), tolerance, tolerance)
        assert cost["rejected"] == 0 and cost["steps"] < 100


def test_a_step_that_begins_with_an_initial_layer_is_divided_and_no_other():
    """Undivided the first step of 0.3 leaves an error of 3.7e-2."""
    scenario = tcbench.scenarios()["short_term"]
    exact = reference_for(scenario, [1.2]).states[0].astype(float)
    method, steps, z = GaussMethod(scenario.model, 3), [], scenario.z0
    for _ in range(4):
        z = z + method.increments(z, 0.3)
        steps.append(method.counts.steps)
    assert steps[0] > 4 and steps[1:] == [1, 1, 1]
    assert np.abs(z - exact).max() < 1e-4


def test_long_kernels_wait_until_they_are_called():
    """tc_auto has those of tc_gauss at hand, and many of its runs never call them."""
    from tcbench_plugins.tc_gauss.method import LATE_LINES, address_of

    from tcbench.compiler.kernels import Kernel
    from tcbench.compiler.library import evaluate

    text = "def kernel(a, b, out):\n" + "    t0 = a[0]\n" * LATE_LINES + "    out[0] = 2.0 * t0\n"
    late, found = Kernel(text, 1), np.zeros(1)
    place = address_of(late)
    assert "address" not in vars(late)
    evaluate(place, np.array([3.0]), np.zeros(1), found)
    assert found[0] == 6.0 and "address" in vars(late)
