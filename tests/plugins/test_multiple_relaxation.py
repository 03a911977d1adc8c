"""multiple_relaxation keeps E and the sign of the entropy produced, of any explicit tableau, at its order."""

import numpy as np
import pytest

import tcbench

STEPS = {"viscous_pendulum": 0.0375, "rubbing_piston": 0.02, "damped_oscillator": 0.05, "heavy_top": 0.05}


def run(order, name, dt, steps):
    found = tcbench.simulate(f"multiple_relaxation[order={order}]", name, dt=dt, t_end=steps * dt)
    assert found.ok, (name, found.failure)
    return found


@pytest.mark.parametrize(
    ("name", "order"),
    [("viscous_pendulum", 4), ("rubbing_piston", 3), ("heavy_top", 2), *(("damped_oscillator", k) for k in (2, 3, 4))],
)
def test_both_laws_are_exact_at_the_order(name, order):
    runs = [run(order, name, STEPS[name] / k, 8 * k) for k in (1, 2, 4)]
    for found in runs:
        assert found.summary.energy_error_max < 1e-13 and found.summary.entropy_increment_min >= 0
    near, far = (np.abs(a.z[-1] - b.z[-1]).max() for a, b in ((runs[1], runs[2]), (runs[0], runs[1])))
    assert np.log2(far / near) == pytest.approx(order, abs=0.35)


def test_the_entropy_produced_is_that_of_the_stages():
    """The classical method alone misses it by the order of the step."""
    h, system = 0.05, tcbench.scenarios()["gas_containers"].model
    z0 = tcbench.scenarios()["gas_containers"].z0
    found = run(4, "gas_containers", h, 1)
    k1 = system.vector_field(z0)
    k2 = system.vector_field(z0 + h / 2 * k1)
    k3 = system.vector_field(z0 + h / 2 * k2)
    k4 = system.vector_field(z0 + h * k3)
    produced = sum(w * k[2:].sum() for w, k in zip((1, 2, 2, 1), (k1, k2, k3, k4), strict=True)) * h / 6
    assert found.entropy[-1] - found.entropy[0] == pytest.approx(produced, rel=1e-12)
    classical = z0 + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    assert abs(system.energy(classical) - system.energy(z0)) > 1e-9 > abs(found.energy[-1] - found.energy[0])


def test_the_midpoint_rule_in_entropies_is_the_variational_integrator_of_the_midpoint_lagrangian():
    """Gay-Balmaz and Yoshimura: D1 Ld(q1, q2, s) + D2 Ld(q0, q1, s) = 0, and the temperature times the entropy's change
    is the heat that comes in."""
    scenario, h = tcbench.scenarios()["short_term"], 0.05
    system, (z0, z1, z2) = scenario.model, tcbench.simulate("midpoint_entropy", scenario, dt=h, t_end=2 * h).z
    masses = np.repeat(system.masses, 2)

    def lagrangian(q0, q1, s):
        v, still = (q1 - q0) / h, np.zeros(4)
        return h * (masses @ v**2 / 2 - system.energy(np.concatenate([(q0 + q1) / 2, still, s])))

    def slope(of, q):
        """By central differences."""
        return np.array([of(q + e) - of(q - e) for e in 1e-5 * np.eye(4)]) / 2e-5

    s01, s12 = (z0[8:] + z1[8:]) / 2, (z1[8:] + z2[8:]) / 2
    q0, q1, q2 = z0[:4], z1[:4], z2[:4]
    left = slope(lambda q: lagrangian(q, q2, s12), q1) + slope(lambda q: lagrangian(q0, q, s01), q1)
    assert np.abs(left).max() < 1e-7 < 1e-3 < np.abs(slope(lambda q: lagrangian(q0, q, s01), q1)).max()
    middle = (z0 + z1) / 2
    a, b = system.temperatures(middle)
    heat = h * system.conductivity * np.array([b - a, a - b])
    assert np.array([a, b]) * (z1[8:] - z0[8:]) == pytest.approx(heat, rel=1e-9)
