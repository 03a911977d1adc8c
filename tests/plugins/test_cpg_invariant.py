"""cpg_invariant keeps every declared law at order 2k: Kepler's ellipse closes, whatever the number of its turns."""

import numpy as np
import pytest
from mechanics import Mechanical

import tcbench
from tcbench import Scenario

ECCENTRICITY = 0.6


class Kepler(Mechanical):
    """Energy, momentum and the Runge-Lenz vector, of which one is a function of the others."""

    name = "kepler"
    variables = {"q": (2,), "p": (2,), "s": ()}
    constants = {"gm": ()}

    def energy(self, z):
        return z.p @ z.p / 2 - self.gm / np.sqrt(z.q @ z.q) + z.s

    def invariants(self, z):
        spin, r = z.q[0] * z.p[1] - z.q[1] * z.p[0], np.sqrt(z.q @ z.q)
        return {"spin": spin, "ax": z.p[1] * spin - self.gm * z.q[0] / r, "ay": -z.p[0] * spin - self.gm * z.q[1] / r}


ELLIPSE = Scenario(
    "ellipse", Kepler, {"gm": 1.0}, t_end=2 * np.pi, dt=0.1, shows="", source="",
    initial={"q": [1 - ECCENTRICITY, 0], "p": [0, np.sqrt((1 + ECCENTRICITY) / (1 - ECCENTRICITY))], "s": 1.0},
)  # fmt: skip


def missed(k, steps):
    run = tcbench.simulate(f"cpg_invariant[k={k}]", ELLIPSE, dt=2 * np.pi / steps)
    assert run.ok, run.failure
    return np.abs(run.z[-1] - run.z[0]).max()


@pytest.mark.parametrize("k", [1, 2])
def test_order_is_twice_the_stages(k):
    assert np.log2(missed(k, 100) / missed(k, 200)) == pytest.approx(2 * k, abs=0.1)


def test_the_ellipse_does_not_turn():
    """100 turns of 100 steps; a bias of 1e-16 a step would be 1e-12."""
    run = tcbench.simulate("cpg_invariant", ELLIPSE, dt=2 * np.pi / 100, t_end=200 * np.pi, record_every=50)
    assert run.ok and np.ptp(run.energy) < 1e-12
    assert all(np.ptp(values) < 1e-12 for values in run.invariants.values()) and len(run.invariants) == 3
    turning = tcbench.simulate("cpg", ELLIPSE, dt=2 * np.pi / 100, t_end=200 * np.pi, record_every=50)
    assert np.ptp(turning.invariants["ay"]) > 1e-3  # the method that it is made of


def test_the_energy_is_kept_where_no_invariant_is_declared():
    """Nothing was moved there: the energy of containers changed by 1e-5 in a long step, with status ok."""
    run = tcbench.simulate("cpg_invariant", "gas_containers", dt=1.0, t_end=5.0)
    assert run.ok and run.summary.energy_error_max < 1e-12
