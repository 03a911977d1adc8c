"""A pendulum whose friction heats a bath of constant temperature: E = p^2/(2 m) - k cos q + T s, S = s.

`linear_oscillator` is the same on a linear spring, U = k q^2/2: a family, which runs only where it is named.
"""

import numpy as np

from tcbench import Scenario, ScenarioFamily, System, hookimpl

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


class LinearOscillator(DampedOscillator):
    name = "linear_oscillator"
    source = SOURCE.replace("-cos q", "q^2/2")

    def energy(self, z):
        return z.p**2 / (2 * self.mass) + self.stiffness * z.q**2 / 2 + self.reference_temperature * z.s

    def exergy_offset(self):
        return 0.0

    def points(self, z):
        """The spring."""
        return [[(0, 0), (z.q, 0)]]


def linear(friction):
    return Scenario(
        name="linear_oscillator",
        system=LinearOscillator,
        constants={"mass": 1, "stiffness": 1, "friction": friction, "reference_temperature": 1},
        initial={"q": 2, "p": 0, "s": 0},
        t_end=200,
        dt=0.3,
        shows="friction that is linear in the momentum: the area of (q, p) shrinks by the same factor everywhere",
        source=LinearOscillator.source,
    )


@hookimpl
def tcbench_scenarios():
    return [
        ScenarioFamily(
            "linear_oscillator", make=linear, defaults={"friction": "0.01"}, shows="friction on a linear spring",
            source=LinearOscillator.source, takes={"friction": float},
        ),
        Scenario(
            name="damped_oscillator",
            system=DampedOscillator,
            constants={"mass": 1, "stiffness": 1, "friction": 0.01, "reference_temperature": 1},
            initial={"q": 2, "p": 0, "s": 0},
            t_end=180,
            dt=0.3,
            shows="the smallest system with friction: a hundred small losses of energy, all of them found in the bath",
            source=SOURCE,
        ),
    ]  # fmt: skip
