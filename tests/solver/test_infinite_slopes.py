"""Formulas that rise with an infinite slope where a run begins."""

import numpy as np
import pytest

import tcbench
from tcbench import System


class Weight(System):
    """A mass that is pulled away from a point, by 2, and back by what `height` gives."""

    name = "weight"
    variables = {"q": (), "p": (), "s": ()}

    def height(self, q):
        return abs(q)

    def energy(self, z):
        return z.p**2 / 2 + self.height(z.q) - 2 * z.q + np.exp(z.s)

    def entropy(self, z):
        return z.s

    def reversible(self, z, DE, DS):
        return {"q": DE.p, "p": -DE.q, "s": 0 * z.s}

    def irreversible(self, z, DE, DS):
        return {"q": 0 * z.q, "p": 0 * z.p, "s": 0 * z.s}


class Rooted(Weight):
    def height(self, q):
        return q**1.5


class Weights(Weight):
    """Many of them, whose equations are sparse."""

    name = "weights"
    variables = {"q": ("weight",), "p": ("weight",), "s": ("weight",)}
    constants = {"share": ("weight",)}

    def energy(self, z):
        return z.p @ z.p / 2 + self.share @ self.height(z.q) - 2 * z.q.sum() + np.exp(z.s).sum()

    def entropy(self, z):
        return z.s.sum()


class ManyRooted(Weights):
    height = Rooted.height


@pytest.mark.parametrize("name", ["midpoint_entropy", "gauss2", "cpg"])
@pytest.mark.parametrize(("system", "end"), [(Weight, 0.5), (Rooted, 0.765625), (Weights, 0.5), (ManyRooted, 0.765625)])
def test_a_start_with_an_infinite_slope_is_left(system, end, name):
    """There every correction of Newton is 0, and where it began is no root: first steps stood still, the energy kept.

    q = t^2/2, and t^2 (1 - t/8)^2 by p^2/2 = 2 q - q^1.5.
    """
    constants = {name: np.ones(40) for name in system.constants}
    start = {name: np.zeros(40 if constants else ()) for name in "qps"}
    scenario = tcbench.Scenario("weight", system, constants=constants, initial=start, dt=0.01, t_end=1.0)
    run = tcbench.simulate(name, scenario)
    assert run.ok and run.z[-1, 0] == pytest.approx(end, abs=1e-4)
