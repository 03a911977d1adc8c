"""Mirror images and turned axes: where coordinates are negative every method does what it does where they are not."""

import numpy as np
import pytest

import tcbench
from tcbench import ElementSystem, Scenario
from tcbench.plugins import find_integrator

OURS = ["tc_monolithic", "tc_strang", "tc_gonzalez", "midpoint_entropy", "midpoint_temperature", "gauss2", "tc_gauss",
        "tc_taylor[order=4]", "tc_taylor", "tc_auto", "verlet_heat4", "projected", "tc_strang_exact"]  # fmt: skip
CONSTANTS = {"mass": 1.0, "k": 10.0, "conductivity": 1.0, "reference_temperature": 300.0}


class Wall(ElementSystem):
    """A mass on a line between two springs; subclasses say on which side of 0 and how the strains are written."""

    n_positions, n_elements = 1, 2
    constants = dict.fromkeys(CONSTANTS, ())
    side = 1.0

    def inertia(self):
        return np.array([self.mass])

    def shape(self, q):
        return np.array([q[0] ** 2, (q[0] - self.side * 4.0) ** 2])

    def strain(self, pi):
        return 0.5 * np.log(pi) - np.log(2.0)

    def element_energy(self, pi, s):
        return self.k / 2 * self.strain(pi) ** 2 + 5.0 * self.reference_temperature * (np.exp(s / 5.0) - 1.0)

    def entropies(self, q, theta):
        return 5.0 * np.log(theta / self.reference_temperature)

    def conduction(self, theta):
        a, b = theta
        return self.conductivity * np.array([(b - a) / a, (a - b) / b])


class Scaled(Wall):
    """The logarithm of a product with a constant in it, of sizes that a sign is taken out of."""

    def shape(self, q):
        return np.array([q[0] * (self.side * self.k), self.side * 4.0 * (self.side * 4.0 - q[0])])


class Powers(Wall):
    def strain(self, pi):
        return (pi / 4.0) ** 0.75 - pi**-1.5


class Inverse(Wall):
    """The logarithm of a quotient of two coordinates, each of them of either sign."""

    def strain(self, pi):
        return np.log(1.0 / pi) + np.sqrt(pi)


def scenario(base, side):
    system = type(f"{base.__name__}{'Left' if side < 0 else 'Right'}", (base,), {"side": side, "name": "wall"})
    return Scenario(
        name="wall", system=system, constants=CONSTANTS, positions=(2.3 * side,), momenta=(0.3 * side,),
        temperatures=(310.0, 300.0), t_end=0.5, dt=0.05,
    )  # fmt: skip


def end(method, scenario):
    adaptive = find_integrator(method).kind == "adaptive"
    run = tcbench.simulate(method, scenario, **({"tolerance": 1e-8} if adaptive else {"dt": scenario.dt}))
    assert run.ok, (method, run.failure)
    return run.z[-1]


@pytest.mark.parametrize(
    ("method", "base"), [("tc_gauss", Inverse), *(("tc_taylor", base) for base in (Wall, Scaled, Powers, Inverse))]
)
def test_on_the_other_side_of_zero_all_is_as_on_this_side(base, method):
    right, left = (end(method, scenario(base, side)) for side in (1.0, -1.0))
    assert left == pytest.approx(right * [-1, -1, 1, 1], rel=1e-12, abs=1e-12)


IMAGES = {
    "mirrored": np.diag([-1.0, 1.0]), "turned by 180": -np.eye(2), "swapped": np.array([[0.0, 1.0], [1.0, 0.0]]),
    "turned": np.array([[0.28, -0.96], [0.96, 0.28]]),
}  # fmt: skip


@pytest.mark.parametrize("method", OURS)
def test_images_of_a_pendulum_move_as_images(method):
    start = tcbench.scenarios()["stiff_spring"].replace(t_end=0.5, dt=0.01)
    known = end(method, start)
    for what, image in IMAGES.items():
        positions, momenta = ((np.reshape(v, (-1, 2)) @ image.T).ravel() for v in (start.positions, start.momenta))
        found = end(method, start.replace(positions=tuple(positions), momenta=tuple(momenta)))
        expected = np.concatenate([(known[:8].reshape(4, 2) @ image.T).ravel(), known[8:]])
        assert found == pytest.approx(expected, rel=1e-9, abs=1e-9), what
