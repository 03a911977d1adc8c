"""A strain measure may be a constant: a bath, a rigid body, whatever has a temperature and no strain."""

import numpy as np
import pytest
from laws import assert_laws

import tcbench
from tcbench import ElementSystem, Scenario


class SpringAndBath(ElementSystem):
    """A mass on a thermoelastic spring; the second element is rigid and holds heat only."""

    name = "spring_and_bath"
    n_positions = 2
    n_elements = 2
    constants = {"conductivity": (), "reference_temperature": ()}

    def inertia(self):
        return np.ones(2)

    def shape(self, q):
        return np.array([q @ q, 1.0])

    def element_energy(self, pi, s):
        return (
            np.log(pi) ** 2 / 8
            - 0.2 * self.reference_temperature * np.log(pi) / 2
            + (2 * self.reference_temperature * (np.exp((s - 0.2 * np.log(pi) / 2) / 2) - 1))
        )

    def conduction(self, theta):
        a, b = theta
        return self.conductivity * np.array([(b - a) / a, (a - b) / b])

    def entropies(self, q, theta):
        return 2 * np.log(theta / self.reference_temperature) + 0.1 * np.log(self.shape(q))

    def invariants(self, q, p):
        return {"angular_momentum": q[0] * p[1] - q[1] * p[0]}


SCENARIO = Scenario(
    name="bath", system=SpringAndBath, constants={"conductivity": 0.5, "reference_temperature": 3.0},
    positions=(1.2, 0.0), momenta=(0.1, 0.8), temperatures=(3.0, 4.0), t_end=20.0, dt=0.1,
)  # fmt: skip


@pytest.mark.parametrize("method", ["tc_monolithic", "tc_gauss", "tc_gonzalez", "tc_taylor"])
def test_the_laws_hold(method):
    run = tcbench.simulate(method, SCENARIO, **({"tolerance": 1e-6} if method == "tc_taylor" else {}))
    assert_laws(run, energy=1e-11, entropy=1e-12, invariants=1e-11)
    assert abs(run.temperatures[-1, 0] - run.temperatures[-1, 1]) < 0.3  # the bath and the spring grow equal


def test_the_gradient_of_a_rigid_element_is_zero_and_its_temperature_is_not():
    model, z = SCENARIO.model, SCENARIO.z0
    assert np.allclose(model.temperatures(z), [3.0, 4.0], rtol=1e-14)
    step = 1e-6 * np.eye(6)
    differences = [(model.energy(z + e) - model.energy(z - e)) / 2e-6 for e in step]
    assert np.allclose(model.gradient(z), differences, rtol=1e-7, atol=1e-8)


N = 5  # springs in a row between masses, the first tied to the origin, and a bath for each spring


class NetOfBaths(ElementSystem):
    name = "net_of_baths"
    tables = {"ends": ("element", 4, "position+anchor"), "pairs": ("link", 2, "element"),
              "places": ("point", 2, "position")}  # fmt: skip
    constants = {"rigid": ("element",), "mass": ("position",), "anchors": ("anchor",), "conductivity": (),
                 "reference_temperature": ()}  # fmt: skip
    element_energy = SpringAndBath.element_energy
    entropies = SpringAndBath.entropies

    def inertia(self):
        return self.mass

    def shape(self, q):
        ends = np.concatenate([q, self.anchors])[self.ends]
        return self.rigid + (1.0 - self.rigid) * ((ends[:, 2:] - ends[:, :2]) ** 2).sum(axis=1)

    def conduction(self, theta):
        a, b = theta[self.pairs].T
        return self.conductivity * self.pairs.sums(np.stack([(b - a) / a, (a - b) / b], axis=1))

    def invariants(self, q, p):
        (x, y), (u, v) = q[self.places].T, p[self.places].T
        return {"angular_momentum": (x * v - y * u).sum()}


ENDS = np.stack([np.r_[N, : N - 1], np.arange(N)], axis=1)
TABLES = {
    "ends": np.tile((2 * ENDS[:, :, None] + np.arange(2)).reshape(N, 4), (2, 1)), "mass": np.ones(2 * N),
    "pairs": [*np.arange(2 * N).reshape(2, N).T, *np.stack([np.arange(N - 1), np.arange(1, N)], axis=1)],
    "places": np.arange(2 * N).reshape(N, 2), "anchors": np.zeros(2),
}  # fmt: skip


def of_baths(system, **more):
    row = np.arange(N)
    return Scenario(
        name=system.name, system=system, constants={"conductivity": 0.5, "reference_temperature": 3.0} | more,
        positions=np.stack([1.1 * (row + 1), 0.0 * row], axis=1).ravel(),
        momenta=np.stack([0.0 * row, 0.3 * np.sin(row + 1.0)], axis=1).ravel(),
        temperatures=3.0 + 0.5 * np.cos(np.arange(2.0 * N)), t_end=3.0, dt=0.1,
    )  # fmt: skip


@pytest.mark.parametrize("rigid", [np.repeat([0.0, 1.0], N), np.ones(2 * N)], ids=["springs and baths", "baths"])
@pytest.mark.parametrize("method", ["tc_monolithic", "tc_strang"])
def test_a_network_with_rigid_elements_keeps_the_laws_and_conducts_heat(method, rigid):
    run = tcbench.simulate(method, of_baths(NetOfBaths, rigid=rigid, **TABLES), t_end=100.0)
    assert_laws(run)
    assert "in loops over the elements" in run.solver.way and np.all(run.scenario.model.shapes(run.z[-1])[N:] == 1.0)
    assert np.ptp(run.temperatures[0]) > 0.9 and np.ptp(run.temperatures[-1]) < 0.2
