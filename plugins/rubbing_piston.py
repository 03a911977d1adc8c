"""Two gases and a wall between them that rubs and conducts; friction heats both alike. Everything is dimensionless."""

import numpy as np

from tcbench import Scenario, System, hookimpl

from .gas_containers import SOURCE


class RubbingPiston(System):
    name = "rubbing_piston"
    source = SOURCE + ", with friction"
    variables = {"q": (), "p": (), "s": (2,)}
    constants = {"mass": (), "conductivity": (), "friction": (), "reference_temperature": ()}
    positive = ("mass", "reference_temperature")
    non_negative = ("conductivity", "friction")

    def measures(self, z):
        """The volumes."""
        return np.array([z.q, 2 - z.q])

    def energy(self, z):
        return z.p**2 / (2 * self.mass) + ((np.exp(z.s) / self.measures(z)) ** (2 / 3)).sum()

    def entropy(self, z):
        return z.s.sum()

    def reversible(self, z, dE, dS):
        return {"q": dE.p, "p": -dE.q}

    def irreversible(self, z, dE, dS):
        v, (a, b) = dE.p, dE.s
        heat, flow = self.friction * v**2 / 2, self.conductivity * (b - a)
        return {"p": -self.friction * v, "s": np.array([(heat + flow) / a, (heat - flow) / b])}

    def temperature(self, z, dE, dS):
        return dE.s

    def exergy_offset(self):
        """Minus the least of E - theta_ref S: equal volumes, both gases at theta_ref."""
        reference = self.reference_temperature
        return 3 * reference * np.log(1.5 * reference) - 3 * reference

    def points(self, z):
        """Each gas as the line from its end of the cylinder to the wall."""
        return [[(0, 0), (z.q, 0)], [(2, 0), (z.q, 0)]]


@hookimpl
def tcbench_scenarios():
    return [
        Scenario(
            name="rubbing_piston",
            system=RubbingPiston,
            constants={"mass": 1, "conductivity": 0.5, "friction": 0.2, "reference_temperature": 4 / 3},
            initial={"q": 1, "p": 2, "s": [np.log(2) * 1.5, np.log(2) * 1.5]},  # both gases at theta = 4/3
            t_end=30,
            dt=0.1,
            shows="two kinds of dissipation at once: conduction moves heat between the gases, friction makes it",
            source=SOURCE + ", with friction",
        )
    ]
