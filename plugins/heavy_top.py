"""A heavy top whose friction heats it: m the angular momentum, g the direction of gravity, both in axes of the body."""

import numpy as np

from tcbench import Scenario, System, hookimpl

SOURCE = "Lie-Poisson bracket of e(3)*: Marsden and Ratiu (1999), Introduction to Mechanics and Symmetry, 1.4"


class HeavyTop(System):
    name = "heavy_top"
    source = SOURCE
    variables = {"m": (3,), "g": (3,), "s": ()}
    constants = {"inertia": (3,), "weight": (), "friction": (), "heat_capacity": (), "reference_temperature": ()}
    positive = ("inertia", "heat_capacity", "reference_temperature")
    non_negative = ("weight", "friction")

    def energy(self, z):
        heat = self.heat_capacity * self.reference_temperature * np.exp(z.s / self.heat_capacity)
        return (z.m**2 / self.inertia).sum() / 2 + self.weight * z.g[2] + heat

    def entropy(self, z):
        return z.s

    def reversible(self, z, dE, dS):
        return {"m": np.cross(z.m, dE.m) + np.cross(z.g, dE.g), "g": np.cross(z.g, dE.m)}

    def irreversible(self, z, dE, dS):
        """Against the part of the angular velocity that is not about the vertical: m . g stays."""
        torque = dE.m - z.g * ((dE.m @ z.g) / (z.g @ z.g))
        return {"m": -self.friction * torque, "s": self.friction * (dE.m @ torque) / dE.s}

    def temperature(self, z, dE, dS):
        return dE.s

    def invariants(self, z):
        return {"vertical": z.g @ z.g, "vertical_momentum": z.m @ z.g}

    def exergy_offset(self):
        """Minus the least of E - theta_ref S, for a unit vector g: at rest, hanging, at theta_ref."""
        return self.weight - self.heat_capacity * self.reference_temperature

    def points(self, z):
        """The axis of the body, as seen against gravity: its height, and its distance from the vertical."""
        return [[(0, 0), (np.hypot(z.g[0], z.g[1]), z.g[2])]]


@hookimpl
def tcbench_scenarios():
    return [
        Scenario(
            name="heavy_top",
            system=HeavyTop,
            constants={
                "inertia": (1, 1.4, 2), "weight": 0.8, "friction": 0.15, "heat_capacity": 1, "reference_temperature": 1,
            },
            initial={"m": [0.5, 0.7, 1], "g": [0.36, 0.48, 0.8], "s": 0},
            t_end=60,
            dt=0.2,
            shows="two Casimirs, which must survive friction and heat; it ends hanging, turning about the vertical",
            source=SOURCE,
        )
    ]  # fmt: skip
