"""A free rigid body that relaxes at constant energy: L(m) = m x, S a function of |m|^2, which L keeps."""

import numpy as np

from tcbench import Scenario, System, hookimpl

SOURCE = "Morrison (1986), Physica D 18: 410-419, doi 10.1016/0167-2789(86)90209-5"


class RigidBody(System):
    name = "rigid_body"
    source = SOURCE
    variables = {"m": (3,)}
    constants = {"inertia": (3,), "damping": ()}
    positive = ("inertia",)
    non_negative = ("damping",)

    def energy(self, z):
        return (z.m**2 / self.inertia).sum() / 2

    def entropy(self, z):
        r = z.m @ z.m
        return -r / 2 + r**2 / 20

    def reversible(self, z, dE, dS):
        return {"m": np.cross(z.m, dE.m)}

    def irreversible(self, z, dE, dS):
        return {"m": self.damping * ((dE.m @ dE.m) * dS.m - dE.m * (dE.m @ dS.m))}

    def points(self, z):
        """The angular momentum, in the plane of the first and the last axis of the body."""
        return [[(0, 0), (z.m[0], z.m[2])]]


@hookimpl
def tcbench_scenarios():
    return [
        Scenario(
            name="rigid_body",
            system=RigidBody,
            constants={"inertia": (1, 2, 3.5), "damping": 0.2},
            initial={"m": [0.6, 0.9, 0.5]},
            t_end=60,
            dt=0.3,
            shows="a bracket that depends on the state, an entropy that is not a variable, and no temperature at all",
            source=SOURCE,
        )
    ]
