"""A <-> B in a closed, insulated vessel: the energy is a variable, the entropy a nonlinear function of all of them.

n are the amounts, u the energy; each molecule has the heat capacity c and binds the energy `binding` of its kind.
"""

import numpy as np

from tcbench import Scenario, System, hookimpl

SOURCE = "mass action as a gradient flow of the entropy: Mielke (2011), Nonlinearity 24: 1329-1346"


class Reaction(System):
    name = "reaction"
    source = SOURCE
    variables = {"n": (2,), "u": ()}
    constants = {"speed": (), "heat_capacity": (), "binding": (2,)}
    positive = ("heat_capacity",)
    non_negative = ("speed",)

    def energy(self, z):
        return z.u

    def entropy(self, z):
        """Entropy of mixing and of heat, the energy that is not bound: u - binding . n = c n theta."""
        n, c = z.n.sum(), self.heat_capacity
        return c * n * np.log((z.u - self.binding @ z.n) / (c * n)) - (z.n * np.log(z.n)).sum()

    def irreversible(self, z, dE, dS):
        flow = self.speed * np.sqrt(z.n[0] * z.n[1]) * (dS.n[1] - dS.n[0])
        return {"n": np.array([-flow, flow])}

    def temperature(self, z, dE, dS):
        return 1 / dS.u

    def measures(self, z):
        return z.n

    def invariants(self, z):
        return {"matter": z.n.sum()}

    def points(self, z):
        """A column for each kind."""
        return [[(0, 0), (0, z.n[0])], [(1, 0), (1, z.n[1])]]


@hookimpl
def tcbench_scenarios():
    return [
        Scenario(
            name="reaction",
            system=Reaction,
            constants={"speed": 0.7, "heat_capacity": 1.5, "binding": (0, -1)},
            initial={"n": [0.9, 0.1], "u": 3},
            t_end=20,
            dt=0.2,
            shows="no motion at all: E is a variable, all of the dynamics is M dS, and heat drives the reaction back",
            source=SOURCE,
        )
    ]
