"""Next to a spring that is almost nothing equations curve by its inverse length: TC steps keep their energy even so."""

import numpy as np
import pytest

import tcbench
from tcbench.plugins import find_scenario
from tcbench.reference.digits import exactly
from tcbench.simulation.run import simulate

SCENARIO = tcbench.scenarios()["short_term"]
METHODS = ["tc_monolithic", "tc_staggered", "tc_strang", "tc_itoh_abe", "tc_strang_exact"]


def tiny(seed):
    """A pendulum of which one spring has a length of 1e-6 to 1e-2, and a step."""
    rng = np.random.default_rng([20, seed])
    natural, angles = rng.uniform(0.5, 3, 2), rng.uniform(0, 2 * np.pi, 2)
    lengths = rng.permutation([natural[0] * rng.uniform(0.5, 2), 10 ** rng.uniform(-6, -2)])
    a, b = (length * np.array([np.cos(angle), np.sin(angle)]) for length, angle in zip(lengths, angles, strict=True))
    h = float(10 ** rng.uniform(-3, 0))
    return SCENARIO.replace(
        name="tiny", positions=(*a, *(a + b)), momenta=tuple(rng.normal(size=4) * 10 ** rng.uniform(-0.5, 0.5)),
        temperatures=tuple(300 * rng.uniform(0.7, 1.4, 2)), stiffness=tuple(10 ** rng.uniform(-1.5, 2.5, 2)),
        masses=tuple(rng.uniform(0.3, 3, 2)), natural_lengths=tuple(natural), coupling=float(rng.uniform(0, 1)),
        conductivity=float(10 ** rng.uniform(-1, 3)), heat_capacity=float(rng.uniform(1, 20)), t_end=h,
    ), h  # fmt: skip


def last_places(model, z):
    """What the energy of a state changes by where each of its numbers does by one unit in the last place."""
    return float(np.abs(np.asarray(model.gradient(z))) @ np.spacing(np.abs(z)))


@pytest.mark.parametrize("method", METHODS)
def test_a_step_keeps_its_energy_as_exactly_as_its_states_can_be_written(method):
    for seed in range(40):
        scenario, h = tiny(seed)
        run = simulate(method, scenario, dt=h)
        assert run.ok, (seed, run)
        (before,), (after,) = exactly(scenario, "energy", run.z)
        gap, written = abs(float(after - before)), max(last_places(scenario.model, z) for z in run.z)
        size = max(scenario.initial_exergy, abs(float(run.energy[0])))
        # flows of a splitting meet at a state of their own, which may be nearer to collapse than the two ends
        assert gap <= 5 * written + 1e-12 * size, (seed, gap / size, written / size)


def test_a_run_with_a_spring_that_comes_close_to_nothing_keeps_its_energy():
    """It begins ten steps before: the whole motion is chaotic, and how close it comes the last digits decide."""
    scenario = find_scenario("random[seed=3000252]").replace(
        positions=(-1.086253, -0.906645, -1.101068, -0.917181), momenta=(3.874912, 0.790056, -3.162039, 1.653205),
        temperatures=(251.275287, 256.217558), t_end=0.5,
    )  # fmt: skip
    run = simulate("tc_strang", scenario, dt=0.025)
    q = run.z[:, :4]
    assert run.ok and np.hypot(*(q[:, 2:] - q[:, :2]).T).min() < 1e-3
    assert run.summary.energy_error_max < 1e-11
