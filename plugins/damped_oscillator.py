"""A pendulum whose friction heats a bath of constant temperature: E = p^2/(2 m) - k cos q + T s, S = s."""

import numpy as np

from tcbench import Scenario, System, hookimpl

SOURCE = "Shang and Ottinger (2020), Proc. R. Soc. A 476: 20190446, with U = -cos q"


class DampedOscillator(System):
    name = "damped_oscillator"
    source = SOURCE
    variables = {"q": (), "p": (), "s": ()}
    constants = {"mass": (), "stiffness": (), "friction": (), "reference_temperature": ()}
    positive = ("mass", "stiffness", "reference_temperature")
    non_negative = ("friction",)

    def energy(self, z):
        return z.p**2 / (2 * self.mass) - self.stiffness * np.cos(z.q) + self.reference_temperature * z.s

    def entropy(self, z):
        return z.s

    def reversible(self, z, dE, dS):
        return {"q": dE.p, "p": -dE.q}

    def irreversible(self, z, dE, dS):
        force = self.friction * dE.p
        return {"p": -force, "s": force * dE.p / dE.s}

    def temperature(self, z, dE, dS):
        return dE.s

    def exergy_offset(self):
        return self.stiffness

    def points(self, z):
        """The rod."""
        return [[(0, 0), (np.sin(z.q), -np.cos(z.q))]]


@hookimpl
def tcbench_scenarios():
    return [
        Scenario(
            name="damped_oscillator",
            system=DampedOscillator,
            constants={"mass": 1, "stiffness": 1, "friction": 0.01, "reference_temperature": 1},
            initial={"q": 2, "p": 0, "s": 0},
            t_end=180,
            dt=0.3,
            shows="the smallest system with friction: a hundred small losses of energy, all of them found in the bath",
            source=SOURCE,
        )
    ]
