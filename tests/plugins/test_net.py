"""Nets of springs: right (against plain numpy), lawful at every size, and of the order that methods declare."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tcbench_plugins.net.net import net

import tcbench
from tcbench.plugins import find_scenario


@pytest.mark.parametrize(
    ("method", "size"), [("tc_strang", (2, 2)), ("tc_monolithic", (7, 7)), ("tc_staggered", (12, 20)),
                         ("tc_gonzalez", (4, 3)), ("projected[method=midpoint_entropy]", (4, 3))]
)  # fmt: skip
def test_the_laws_hold_at_every_size(method, size):
    run = tcbench.simulate(method, net(*size), dt=0.1, t_end=1.0)
    assert run.ok and run.summary.energy_error_max < 1e-12 and run.summary.entropy_increment_min > -1e-13


@pytest.mark.parametrize("method", ["tc_monolithic", "tc_staggered", "tc_itoh_abe", "gauss2"])
def test_orders(method):
    scenario, order = net(6, 6), tcbench.integrators()[method].order
    steps = (0.1, 0.05) if order < 4 else (0.2, 0.1)
    fine = tcbench.simulate("gauss2", scenario, dt=0.02, t_end=1.0).z[-1]
    errors = [np.abs(tcbench.simulate(method, scenario, dt=h, t_end=1.0).z[-1] - fine).max() for h in steps]
    assert abs(np.log2(errors[0] / errors[1]) - order) < 0.3


@pytest.mark.parametrize("size", [(2, 2, 1), (3, 3, 4)])
def test_a_bar_in_space_keeps_the_laws_and_its_clamped_end(size):
    run = tcbench.simulate("tc_strang", "truss3d[nx={},ny={},nz={}]".format(*size), dt=0.1, t_end=1.0)
    assert run.ok and run.summary.energy_error_max < 1e-12 and run.summary.entropy_increment_min > -1e-12
    assert "loops over the elements" in run.solver.way
    assert np.ptp(run.z[:, 0]) > 1e-3  # it moves


def test_a_bar_has_a_size():
    for size in ("1", "0", "201", "x"):
        with pytest.raises(tcbench.TcbenchError, match="nx of truss3d is a whole number from 2 to 200"):
            find_scenario(f"truss3d[nx={size}]")


@settings(max_examples=12)
@given(seed=st.integers(0, 10**6), h=st.floats(0.01, 0.4))
def test_random_states_keep_the_laws(seed, h):
    rng, scenario = np.random.default_rng(seed), net(5, 4)
    q = np.array(scenario.positions) + rng.uniform(-0.3, 0.3, len(scenario.positions))
    changed = scenario.replace(
        positions=tuple(q), momenta=tuple(rng.normal(size=len(q))),
        temperatures=tuple(rng.uniform(200, 400, scenario.model.n_elements)), name="random",
    )  # fmt: skip
    run = tcbench.simulate("tc_monolithic", changed, dt=h, t_end=3 * h)
    assert run.ok and run.summary.energy_error_max < 1e-12 and run.summary.entropy_increment_min > -1e-12


def test_long_steps_are_solved_by_tracking_and_whole_factorisations():
    run = tcbench.simulate("tc_monolithic", net(8, 8), dt=0.8, t_end=4.0)
    assert run.ok and run.solver.tracked > 0 and run.summary.energy_error_max < 1e-12


def test_sizes_are_whole_numbers():
    for size in ("1", "0", "x", "-3", "1001", "2.5"):
        with pytest.raises(tcbench.TcbenchError, match="whole number from 2 to 1000"):
            find_scenario(f"net[ny={size}]")


def test_it_is_anchored_and_neighbours_conduct():
    model = net(3, 2).model
    assert model.n_positions == 12 and model.n_elements == 9 and len(model.anchors) == 4
    theta = np.linspace(280, 330, 9)
    assert abs(theta @ model.conduction(theta)) < 1e-10 and model.conduction(theta).sum() > 0
