"""Formulas that rise with an infinite slope where a run begins."""

import numpy as np
import pytest

import tcbench
from tcbench import System


class Weight(System):
    """A mass that is pulled away from a point, by 2, and back by what `height` gives; beside it an oscillator."""

    name = "weight"
    variables = {"q": (), "p": (), "x": (), "y": (), "s": ()}

    def height(self, q):
        return abs(q)

    def energy(self, z):
        return z.p**2 / 2 + self.height(z.q) - 2 * z.q + z.y**2 / 2 + z.x**2 / 2 + z.x**4 / 4 + np.exp(z.s)

    def entropy(self, z):
        return z.s

    def reversible(self, z, DE, DS):
        return {"q": DE.p, "p": -DE.q, "x": DE.y, "y": -DE.x}

    def irreversible(self, z, DE, DS):
        return {}


class Rooted(Weight):
    def height(self, q):
        return q**1.5


class Weights(Weight):
    """Many of them, whose equations are sparse."""

    name = "weights"
    variables = dict.fromkeys("qpxys", ("weight",))
    constants = {"share": ("weight",)}

    def energy(self, z):
        beside = (z.y**2 / 2 + z.x**2 / 2 + z.x**4 / 4).sum()
        return z.p @ z.p / 2 + self.share @ self.height(z.q) - 2 * z.q.sum() + beside + np.exp(z.s).sum()

    def entropy(self, z):
        return z.s.sum()


class ManyRooted(Weights):
    height = Rooted.height


@pytest.mark.parametrize("name", ["midpoint_entropy", "tc_monolithic", "gauss2", "cpg"])
@pytest.mark.parametrize("beside", [0.0, 1.0])
@pytest.mark.parametrize(("system", "end"), [(Weight, 0.5), (Rooted, 0.765625), (Weights, 0.5), (ManyRooted, 0.765625)])
def test_a_start_with_an_infinite_slope_is_left(system, end, beside, name):
    """There every correction of Newton is 0, and where it began is no root: steps stood still, the energy kept, the
    whole run where an oscillator beside it converged.

    q = t^2/2, and t^2 (1 - t/8)^2 by p^2/2 = 2 q - q^1.5.
    """
    constants = {name: np.ones(40) for name in system.constants}
    start = {name: np.zeros(40 if constants else ()) for name in system.variables}
    start["x"] += beside
    scenario = tcbench.Scenario("weight", system, constants=constants, initial=start, dt=0.01, t_end=1.0)
    run = tcbench.simulate(name, scenario)
    assert run.ok and run.z[-1, 0] == pytest.approx(end, abs=1e-4)
