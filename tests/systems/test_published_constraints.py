"""Problems that pydykit (and metis, its predecessor) ship, of Kinon, Bauer and Betsch, with their numbers and steps.

github.com/pydykit/pydykit, example_files: four_particle_system_discrete_gradient, pendulum_3d_cartesian,
rigid_body_rotating_quaternion. The equations are written here anew; a heat bath stands beside them, at rest.
"""

import numpy as np
import pytest
from mechanics import Mechanical

import tcbench
from tcbench import Scenario, plugins
from tcbench.reference.lookup import reference_for


class FourParticles(Mechanical):
    """Rigid between 1, 2 and between 3, 4; springs between 1, 3 and between 2, 4, of energy k (l^2 - l0^2)^2/2."""

    name = "four_particles"
    variables = {"q": (4, 3), "p": (4, 3), "s": ()}
    multipliers = {"rod": (2,)}
    constants = {"mass": (4,), "k": (2,)}

    def squares(self, z, pairs):
        return np.array([(z.q[b] - z.q[a]) @ (z.q[b] - z.q[a]) for a, b in pairs])

    def energy(self, z):
        strain = self.squares(z, [(0, 2), (1, 3)]) - 1
        return (z.p**2 / self.mass[:, None]).sum() / 2 + (self.k * strain**2).sum() / 2 + np.exp(z.s)

    def constraints(self, z):
        return {"rod": (self.squares(z, [(0, 1), (2, 3)]) - 1) / 2}

    def invariants(self, z):
        spin, push = np.cross(z.q, z.p).sum(axis=0), z.p.sum(axis=0)
        return {f"spin_{k}": spin[k] for k in range(3)} | {f"push_{k}": push[k] for k in range(3)}


class Rotor(Mechanical):
    """A unit quaternion and its momentum; momenta in the body and in space are products of the two."""

    name = "rotor"
    variables = {"q": (4,), "p": (4,), "s": ()}
    multipliers = {"length": ()}
    constants = {"inertia": (3,)}

    def momenta_of(self, z, sign):
        """Half of vec(q* p) in the body, of vec(p q*) in space."""
        return (z.q[0] * z.p[1:] - z.p[0] * z.q[1:] - sign * np.cross(z.q[1:], z.p[1:])) / 2

    def energy(self, z):
        along = z.q @ z.p / 2  # with half the trace as inertia the mass matrix is regular
        turning = (self.momenta_of(z, 1) ** 2 / self.inertia).sum() + along**2 / (self.inertia.sum() / 2)
        return turning / 2 + np.exp(z.s)

    def constraints(self, z):
        return {"length": (z.q @ z.q - 1) / 2}

    def invariants(self, z):
        space = self.momenta_of(z, -1)
        return {"x": space[0], "y": space[1], "z": space[2]}


def problem(system, constants, q, p, t_end, dt):
    initial = {"q": q, "p": p, "s": 0.0}
    return Scenario(system.name, system, constants, initial=initial, t_end=t_end, dt=dt, shows="", source="pydykit")


PARTICLES = problem(
    FourParticles, {"mass": (1.0, 3.0, 2.3, 1.7), "k": (50.0, 500.0)},
    [[0, 0, 0], [1.0, 0, 0], [0, 1.0, 0], [1.0, 1.0, 0]], [[0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 2.0]], 0.09, 0.01,
)  # fmt: skip
INERTIA, OMEGA = np.array([6.0, 8.0, 3.0]), 2 * np.array([5.0, 10.0, 10.0])  # from the velocity (0, 5, 10, 10)
ROTOR = problem(Rotor, {"inertia": INERTIA}, [1.0, 0, 0, 0], [0, *(2 * INERTIA * OMEGA)], 0.45, 0.05)
PENDULUM = plugins.find_scenario("rods[n=1]").replace(
    q=[[1.0, 0, 0]], p=[[0, 1.0, 0]], s=[0.0], mass=[1.0], t_end=2.0, dt=0.2
)


@pytest.mark.parametrize("scenario", [PARTICLES, ROTOR, PENDULUM], ids=["four particles", "rotor", "pendulum"])
def test_energy_momenta_and_constraints_to_round_off(scenario):
    run = tcbench.simulate("tc_monolithic", scenario, t_end=100 * scenario.t_end)
    assert run.ok and np.abs(scenario.model.constraint_values(run.z)).max() < 1e-12
    assert run.summary.energy_error_max < 1e-12
    for values in run.invariants.values():
        assert np.ptp(values) < 1e-12 * max(1.0, np.abs(values).max())


def test_the_rotor_begins_as_published():
    """omega . J omega/2 = 2500 and J omega = (60, 160, 60)."""
    z0 = ROTOR.z0
    assert ROTOR.model.energy(z0) - 1 == pytest.approx(2500.0)
    assert np.allclose(ROTOR.model.momenta(z0), INERTIA * OMEGA)


@pytest.mark.parametrize("scenario", [PARTICLES, ROTOR, PENDULUM], ids=["four particles", "rotor", "pendulum"])
def test_order_two(scenario):
    t = 0.09
    exact, one = reference_for(scenario, [t]).states[0], scenario.replace(t_end=t)
    errors = [np.abs(tcbench.simulate("tc_monolithic", one, dt=t / n).z[-1] - exact).max() for n in (90, 180)]
    assert 1.95 < np.log2(errors[0] / errors[1]) < 2.05
