"""A step that has no root since an amount of matter comes to 0 is limited by positivity, and not by the solver."""

import numpy as np
import pytest
from tiers import tiers

import tcbench
from tcbench import Scenario, System
from tcbench.studies.stability import measure


class Bound(System):
    """A + B <-> C at constant energy, by the law of mass action in its nonlinear form: amounts may be used up."""

    name = "bound"
    variables = {"n": (3,), "u": ()}
    constants = {"rate": (), "binding": (), "c": ()}

    def energy(self, z):
        return z.u

    def entropy(self, z):
        n = z.n.sum()
        return self.c * n * np.log((z.u + self.binding * z.n[2]) / (self.c * n)) - (z.n * np.log(z.n)).sum()

    def irreversible(self, z, dE, dS):
        force = dS.n[2] - dS.n[0] - dS.n[1]
        flow = self.rate * np.sqrt(abs(z.n[0] * z.n[1] * z.n[2])) * 2 * np.sinh(force / 2)
        return {"n": np.array([-flow, -flow, flow])}

    def temperature(self, z, dE, dS):
        return 1 / dS.u

    def measures(self, z):
        return z.n


def scenario(rare, rate):
    initial = {"n": [1.0, rare, 0.02], "u": 2.0}
    return Scenario("bound", Bound, {"rate": rate, "binding": 1.5, "c": 1.5}, initial=initial, t_end=8.0, dt=0.1)


CASES = [(m, *of) for m in ("tc_monolithic", "tc_gonzalez", "midpoint_entropy") for of in ((0.2, 1.0), (0.05, 3.0))]


@pytest.mark.parametrize(("method", "rare", "rate"), tiers(CASES, CASES[:1]))
def test_an_amount_that_is_used_up_is_a_limit_of_its_own(method, rare, rate):
    row = measure(tcbench.integrators()[method], scenario(rare, rate), {})
    assert row["limit"] == "positivity", (row["limit"], row["dt_stable"], row["cause"])
