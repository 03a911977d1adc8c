"""tc_invariant keeps invariants that are not quadratic, into equilibrium; and check tells why others do not."""

import numpy as np
import pytest

import tcbench
from tcbench import Scenario, System
from tcbench.simulation.invariants import lost_in


class Volterra(System):
    """L_ij = A_ij x_i x_j, with a logarithmic Casimir."""

    name = "lotka_volterra"
    variables = {"x": (3,), "s": ()}
    constants = {"A": (3,), "gamma": ()}

    def energy(self, z):
        return (z.x - np.log(z.x)).sum() + np.exp(z.s)

    def entropy(self, z):
        return z.s

    def reversible(self, z, dE, dS):
        return {"x": z.x * np.cross(self.A, z.x * dE.x)}

    def irreversible(self, z, dE, dS):
        w = z.x * np.array([self.A[1], -self.A[0], 0 * self.A[0]])
        a = w @ dE.x
        return {"x": -self.gamma * w * a, "s": self.gamma * a**2 / dE.s}

    def measures(self, z):
        return z.x

    def invariants(self, z):
        return {"casimir": self.A @ np.log(z.x)}


class Angles(System):
    """Two bodies with a spring that sees the difference of their angles through sin alone, written with angles."""

    name = "two_arms"
    variables = {"q": (2,), "phi": (), "p": (2,), "l": (), "s": ()}
    constants = {"k": ()}

    def energy(self, z):
        along = z.q[0] * np.cos(z.phi) + z.q[1] * np.sin(z.phi)
        return (z.p @ z.p + z.l**2) / 2 + self.k * (along - 1) ** 2 / 2 + np.exp(z.s)

    def entropy(self, z):
        return z.s

    def reversible(self, z, dE, dS):
        return {"q": dE.p, "p": -dE.q, "phi": dE.l, "l": -dE.phi}

    def invariants(self, z):
        return {"spin": z.q[0] * z.p[1] - z.q[1] * z.p[0] + z.l}


VOLTERRA = Scenario("volterra", Volterra, {"A": (1.0, 0.7, 1.3), "gamma": 0.05},
                    initial={"x": [0.5, 1.3, 2.0], "s": 0.0}, t_end=10, dt=0.1, shows="", source="")  # fmt: skip
ARMS = Scenario("arms", Angles, {"k": 5.0}, initial={"q": [1.2, 0.1], "phi": 0.3, "p": [0.1, 0.7], "l": -0.2, "s": 0.0},
                t_end=5, dt=0.1, shows="", source="")  # fmt: skip


@pytest.mark.parametrize(("scenario", "why"), [(VOLTERRA, "not quadratic"), (ARMS, "not as invariant as the energy")])
def test_it_keeps_what_others_lose_and_the_cause_is_told(scenario, why):
    (name,) = scenario.model.invariant_names
    plain, kept = (tcbench.simulate(m, scenario) for m in ("tc_monolithic", "tc_invariant"))
    assert np.ptp(plain.invariants[name]) > 1e-5 and np.ptp(kept.invariants[name]) < 1e-14
    assert kept.summary.energy_error_max < 1e-14 and kept.summary.entropy_increment_min > -1e-15
    (found,) = lost_in(plain)
    assert why in found.why and not lost_in(kept)


def test_into_equilibrium():
    run = tcbench.simulate("tc_invariant", VOLTERRA, t_end=1000.0, record_every=100)
    assert run.ok and run.summary.entropy_increment_min > -1e-13
    assert np.ptp(run.invariants["casimir"]) < 1e-14 and run.summary.energy_error_max < 1e-14
