"""A formula that changed in the session is traced again: globals, closures, helpers, and those of a System."""

import types

import numpy as np
import pytest

import tcbench
from tcbench import ElementSystem, Integrator

THETA = 0.5


def theta_method(z0, z1, h, system):
    return z1 - z0 - h * system.vector_field((1 - THETA) * z0 + THETA * z1)


def error(method, scenario="short_term"):
    return tcbench.simulate(method, scenario, dt=0.3).summary.energy_error_max


def alone(theta):
    """What a formula with this number in it gives."""

    def formula(z0, z1, h, system):
        return z1 - z0 - h * system.vector_field((1 - theta) * z0 + theta * z1)

    return error(Integrator(name="alone", order=1, flows=formula))


def test_a_global_that_changes_between_two_runs_is_seen(monkeypatch):
    method = Integrator(name="mine", order=1, flows=theta_method)
    found = []
    for theta in (0.5, 1.0, 0.5):
        monkeypatch.setitem(globals(), "THETA", theta)
        found.append(error(method))
    assert found == [alone(0.5), alone(1.0), alone(0.5)] and found[0] != found[1]


def test_an_attribute_of_a_namespace_in_a_closure_is_seen():
    settings = types.SimpleNamespace(theta=0.5)

    def formula(z0, z1, h, system):
        return z1 - z0 - h * system.vector_field((1 - settings.theta) * z0 + settings.theta * z1)

    method = Integrator(name="mine", order=1, flows=formula)
    first = error(method)
    settings.theta = 1.0
    assert (first, error(method)) == (alone(0.5), alone(1.0))


HARDNESS = 1.0


class Springs(ElementSystem):
    """Two springs in a row between walls; the global above is in their energy."""

    name = "springs_of_a_test"
    n_positions, n_elements = 1, 2
    constants = {"mass": (), "mu": (), "reference_temperature": ()}
    positive = ("mass",)

    def inertia(self):
        return np.array([self.mass])

    def shape(self, q):
        return np.array([1.0 + q[0], 2.0 - q[0]])

    def element_energy(self, pi, s):
        return 0.5 * HARDNESS * (pi - 1.0) ** 2 + np.exp(s)

    def conduction(self, theta):
        return self.mu * (theta[1] - theta[0]) / theta * np.array([1.0, -1.0])

    def entropies(self, q, theta):
        return np.log(theta)


def springs():
    return tcbench.Scenario(
        name="springs", system=Springs, constants={"mass": 1.0, "mu": 0.1, "reference_temperature": 1.0},
        positions=(0.1,), momenta=(0.5,),
        temperatures=(1.0, 1.2), t_end=3.0, dt=0.1,
    )  # fmt: skip


@pytest.mark.parametrize("made_before", [True, False])
def test_a_system_whose_formula_reads_a_global_is_traced_again(monkeypatch, made_before):
    scenario = springs()
    soft = tcbench.simulate("tc_monolithic", scenario)
    monkeypatch.setitem(globals(), "HARDNESS", 4.0)
    hard = tcbench.simulate("tc_monolithic", scenario if made_before else springs())
    assert hard.ok and soft.ok
    q, p = hard.z[:, 0], hard.z[:, 1]
    by_hand = p**2 / 2 + 2.0 * (q**2 + (1 - q) ** 2) + np.exp(hard.z[:, 2:]).sum(axis=1)
    assert np.allclose(hard.energy, by_hand, rtol=1e-14)
    assert hard.energy[0] > soft.energy[0]
    assert hard.summary.energy_error_max < 1e-13
