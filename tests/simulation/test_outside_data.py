"""Data sets of the learning field: what made them, how far from the solution they are; numbers are typed as facts."""

import numpy as np
import pytest
from mechanics import Mechanical

import tcbench
from tcbench.plugins import find_integrator
from tcbench.simulation.data_set import judge
from tcbench.simulation.stepper import stepper

LOG10 = np.log(10.0)
# quercushernandez/StructurePreservingNN, data/database_double_pendulum.mat: Z[0, :, 4] and Z[0, :, 5], dt = 0.3
BEFORE = [
    3.433027254907082, 6.302122739858635, 2.7435236846883533, 4.423876469815222, -0.9007797648261459,
    1.1237262174878127, 1.7067960186969429, 0.009265502510988692, 0.025381858528421564, -0.02502158919976183,
]  # fmt: skip
AFTER = [
    3.1588729999600975, 6.624238464671554, 3.0008297927077634, 4.431446751471344, -0.92691526815375,
    1.0237119479316514, 1.7239520882285273, 0.09167158623730266, 0.022743860030766117, -0.02238351337722988,
]  # fmt: skip


def pendulum():
    """short_term with decimal logarithms of strains in the place of natural ones."""
    return tcbench.scenarios()["short_term"].replace(stiffness=np.array([0.1, 1]) / LOG10**2, coupling=0.2 / LOG10)


def test_the_published_double_pendulum_is_one_monolithic_step_of_the_paper_between_two_states():
    """Momenta move the positions by the midpoint rule, springs pull along their middle, heat flows with kappa = 300."""
    scenario, h, z0, z1 = pendulum(), 0.3, np.array(BEFORE), np.array(AFTER)
    masses, middle = np.repeat([1, 2], 2), (z0 + z1) / 2
    assert z1[:4] - z0[:4] == pytest.approx(h * middle[4:8] / masses, abs=1e-14)
    (x, y), (fx, fy) = middle[2:4] - middle[:2], z1[6:8] - z0[6:8]
    assert x * fy - y * fx == pytest.approx(0, abs=1e-14)
    a, b = z1[8:] - z0[8:]
    assert a / h / (-a / b - 1) == pytest.approx(300, rel=1e-6)  # differences of temperatures by 1e-5
    missed = {
        name: np.abs(stepper(find_integrator(name), scenario)(z0, h) - z1).max()
        for name in ("tc_monolithic", "tc_staggered", "tc_strang", "tc_gonzalez", "tc_mean_value", "midpoint_entropy")
    }
    assert missed.pop("tc_monolithic") < 3e-6 and min(missed.values()) > 1e-4


def test_the_gas_containers_of_gfinn_are_a_method_of_third_order_and_off_by_a_thousandth(tmp_path):
    """zzhang222/gfinn_gc, data.py: alpha = 10, steps of 0.02 to t = 8 by (k1 + k2 + 4 k3)/6, called order 2; starts
    (1, 0, 2, 2), moved by up to (0.8, 1, 1, 1)."""
    scenario, h = tcbench.scenarios()["gas_containers"].replace(conductivity=10.0, t_end=8.0), 0.02
    field, draw = scenario.model.vector_field, np.random.default_rng(1)

    def runs(starts, h, steps):
        states = [starts]
        for _ in range(steps):
            z = states[-1]
            k1 = h * field(z)
            k2 = h * field(z + k1)
            states.append(z + (k1 + k2 + 4 * h * field(z + (k1 + k2) / 4)) / 6)
        return np.array(states).swapaxes(0, 1)

    starts = [1, 0, 2, 2] + draw.uniform(-1, 1, (20, 4)) * [0.8, 1, 1, 1]
    np.savez(tmp_path / "gas.npz", times=h * np.arange(401), states=runs(starts, h, 400))
    found = judge(tmp_path / "gas.npz", scenario)
    ends = found.errors[:, -1]
    assert 5e-5 < np.median(ends) < 5e-4 < 2e-3 < ends.max() < 2e-2 and found.certificates.max() < 1e-15
    exact, *coarser = (runs(starts[:3], 0.02 / n, 25 * n)[:, -1] for n in (16, 1, 2))
    errors = [np.abs(z - exact).max() for z in coarser]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(3, abs=0.2)


class FourParticles(Mechanical):
    """Two rods, two springs k (l^2 - 1)^2/2, a damper of viscosity eta (1 + l^2/2); friction heats a bath."""

    name = "four_particles"
    variables = {"q": (4, 3), "p": (4, 3), "s": ()}
    multipliers = {"lam": (2,)}
    constants = {"mass": (4,), "stiffness": (2,), "viscosity": ()}
    reference_temperature = 1.0

    def energy(self, z):
        a, b = z.q[2] - z.q[0], z.q[3] - z.q[1]
        springs = self.stiffness[0] / 2 * (a @ a - 1) ** 2 + self.stiffness[1] / 2 * (b @ b - 1) ** 2
        return (z.p**2 / (2 * self.mass[:, None])).sum() + springs + z.s

    def constraints(self, z):
        a, b = z.q[1] - z.q[0], z.q[3] - z.q[2]
        return {"lam": np.array([a @ a - 1, b @ b - 1]) / 2}

    def irreversible(self, z, dE, dS):
        line, slip = z.q[2] - z.q[1], dE.p[2] - dE.p[1]
        force = self.viscosity * (1 + line @ line / 2) * slip
        return {"p": np.stack([0 * slip, force, -force, 0 * slip]), "s": force @ slip / dE.s}


def test_the_errors_that_pydykit_stores_of_the_midpoint_rule_come_out_to_ten_digits():
    """pydykit/pydykit, four_particle_system_convergence.yml and its ..._MidpointPH_errors.csv: relative errors of the
    last particle at t = 0.1 against their own run of steps of 1e-4; its momentum there is a speed."""
    masses, push = np.array([1, 3, 2.3, 1.7]), np.zeros((4, 3))
    push[3, 2] = 2.0
    start = {"q": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], "p": push, "s": 0}
    constants = {"mass": masses, "stiffness": (50, 500), "viscosity": 1.0}
    scenario = tcbench.Scenario("four", FourParticles, constants, initial=start, t_end=0.1, dt=0.01)
    place = np.array([0.9959913700582607, 0.9962624043349306, 0.11725868954600029])
    speed = np.array([-0.08024555752463461, -0.10689735129193288, 1.1635313694660703])
    stored = {
        0.01: (3.092117015045031e-05, 0.0001365276534039056), 0.005: (7.80024470944988e-06, 2.8677362364815932e-05),
        0.002: (1.2483659283202484e-06, 4.3245071565262895e-06),
    }  # fmt: skip
    for h, (of_place, of_speed) in stored.items():
        end = tcbench.simulate("midpoint_entropy", scenario, dt=h).z[-1]
        missed = np.linalg.norm(end[9:12] - place) / np.linalg.norm(place)
        assert missed == pytest.approx(of_place, rel=2e-10)
        assert np.linalg.norm(end[21:24] / 1.7 - speed) / np.linalg.norm(speed) == pytest.approx(of_speed, rel=1e-3)
