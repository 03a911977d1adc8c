"""A strain measure may be a constant: a bath, a rigid body, whatever has a temperature and no strain."""

import numpy as np
import pytest

import tcbench
from tcbench import Scenario, System


class SpringAndBath(System):
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


@pytest.mark.parametrize("method", ["tc_monolithic", "tc_strang", "tc_gauss", "tc_gonzalez", "tc_taylor"])
def test_the_laws_hold(method):
    if method == "tc_taylor":
        run = tcbench.simulate(method, SCENARIO, tolerance=1e-6)
    else:
        run = tcbench.simulate(method, SCENARIO)
    assert run.ok, run.failure
    assert run.summary.energy_error_max < 1e-11 and run.summary.invariant_error_max["angular_momentum"] < 1e-11
    assert run.summary.entropy_increment_min > -1e-12
    assert abs(run.temperatures[-1, 0] - run.temperatures[-1, 1]) < 0.3  # the bath and the spring grow equal


def test_the_gradient_of_a_rigid_element_is_zero_and_its_temperature_is_not():
    model, z = SCENARIO.model, SCENARIO.z0
    assert np.allclose(model.temperatures(z), [3.0, 4.0], rtol=1e-14)
    step = 1e-6 * np.eye(6)
    differences = [(model.energy(z + e) - model.energy(z - e)) / 2e-6 for e in step]
    assert np.allclose(model.gradient(z), differences, rtol=1e-7, atol=1e-8)
