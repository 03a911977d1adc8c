"""A shear-flexible rod in the plane, `rod[n=20]`: places and angles of its sections.

Angles are few numbers and need no constraints, but rotations are not linear in them: of the momenta the discrete
gradient keeps the linear ones, and the angular one to the order of the method.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tcbench import Scenario
from tcbench.systems.canonical import Canonical, conduction


class Rod(Canonical):
    """q, a: places and angles of the nodes; p, l: their momenta; s: entropies of the elements, of one point each."""

    name = "rod"
    variables = {"q": ("node", 2), "a": ("node",), "p": ("node", 2), "l": ("node",), "s": ("element",)}
    tables = {"ends": ("element", 2, "node"), "pairs": ("joint", 2, "element")}
    constants = {
        "mass": ("node",), "inertia": ("node",), "length": ("element",), "axial": (), "shear": (), "bending": (),
        "capacity": (), "expansion": (), "conductivity": (), "theta0": (),
    }  # fmt: skip
    positive = ("mass", "inertia", "length", "capacity", "theta0")
    non_negative = ("conductivity",)
    reference_temperature = "theta0"

    def strains(self, z: Any) -> Any:
        """Along, across, and the curvature."""
        ends, angles = z.q[self.ends], z.a[self.ends]
        x, y = ((ends[:, 1] - ends[:, 0]) / self.length[:, None]).T
        a = angles.mean(axis=1)
        along, across = np.cos(a) * x + np.sin(a) * y - 1, np.cos(a) * y - np.sin(a) * x
        return along, across, (angles[:, 1] - angles[:, 0]) / self.length

    def energy(self, z: Any) -> Any:
        along, across, curvature = self.strains(z)
        c, warm = self.capacity, self.theta0
        heat = c * warm * (np.exp((z.s / self.length - self.expansion * along) / c) - 1)
        stored = self.axial * along**2 + self.shear * across**2 + self.bending * curvature**2
        moving = (z.p**2 / (2 * self.mass[:, None])).sum() + (z.l**2 / (2 * self.inertia)).sum()
        return moving + (self.length * (stored / 2 + heat + warm * self.expansion * along)).sum()

    def reversible(self, z: Any, dE: Any, dS: Any) -> Any:
        return {"q": dE.p, "a": dE.l, "p": -dE.q, "l": -dE.a}

    def irreversible(self, z: Any, dE: Any, dS: Any) -> Any:
        return {"s": conduction(dE.s, self.pairs, self.conductivity / self.length[self.pairs].mean(axis=1))}

    def invariants(self, z: Any) -> Any:
        spin = (z.q[:, 0] * z.p[:, 1] - z.q[:, 1] * z.p[:, 0] + z.l).sum()
        push = z.p.sum(axis=0)
        return {"push_x": push[0], "push_y": push[1], "spin": spin}

    def points(self, z: Any) -> Any:
        return z.q[self.ends]


def rod(n: int, **changes: Any) -> Scenario:
    """A straight rod that is thrown, turning, its ends against each other, one half warm; changes as for replace()."""
    k, length = np.arange(n), np.full(n, 2.0 / n)
    mass = np.full(n + 1, 2.0 / n)
    mass[[0, -1]] /= 2
    x = np.linspace(-1, 1, n + 1)
    theta = 1 + 0.2 * np.tanh(4 * (k + 0.5 - n / 2) / n)
    places = np.stack([x, 0 * x], axis=1)
    constants = {
        "ends": np.stack([k, k + 1], axis=1), "pairs": np.stack([k[:-1], k[1:]], axis=1), "mass": mass,
        "inertia": 0.01 * mass, "length": length, "axial": 100.0, "shear": 40.0, "bending": 1.0, "capacity": 1.0,
        "expansion": 0.3, "conductivity": 0.05, "theta0": 1.0,
    }  # fmt: skip
    start = {
        "q": places, "a": 0 * x, "p": mass[:, None] * np.stack([0 * x + 0.5, 2 * x + x**2], axis=1), "l": 0.02 * mass,
        "s": length * np.log(theta),
    }  # fmt: skip
    scenario = Scenario(
        f"rod_{n}", Rod, constants, initial=start, t_end=4.0, dt=0.02,
        shows="an angle as a variable: energy is exact, the angular momentum is not",
        source="shear-flexible rod: Reissner (1972), ZAMP 23:795; Simo and Vu-Quoc (1986), J. Appl. Mech. 53:849",
    )  # fmt: skip
    return scenario.replace(**changes) if changes else scenario
