"""A ring in the plane that rotates and bends, `ring[n=24]`: links between neighbours, bending by second differences.

All is written with squares of differences of places: so discrete gradients keep both momenta, linear and angular.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tcbench import Scenario
from tcbench.systems.canonical import Canonical, conduction


class Ring(Canonical):
    """q, p: places and momenta of the nodes; s: entropies of the links."""

    name = "ring"
    variables = {"q": ("node", 2), "p": ("node", 2), "s": ("link",)}
    tables = {"ends": ("link", 2, "node"), "beside": ("node", 3, "node"), "pairs": ("joint", 2, "link")}
    constants = {
        "mass": ("node",), "length": ("link",), "around": ("node",), "stiffness": (), "bending": (), "capacity": (),
        "expansion": (), "conductivity": (), "theta0": (),
    }  # fmt: skip
    positive = ("mass", "length", "around", "capacity", "theta0")
    non_negative = ("conductivity",)
    reference_temperature = "theta0"

    def energy(self, z: Any) -> Any:
        ends, three = z.q[self.ends], z.q[self.beside]
        e = np.log(((ends[:, 1] - ends[:, 0]) ** 2).sum(axis=1) / self.length**2) / 2
        bend = three[:, 0] - 2 * three[:, 1] + three[:, 2]
        c, warm = self.capacity, self.theta0
        heat = warm * (self.expansion * e + c * (np.exp((z.s / self.length - self.expansion * e) / c) - 1))
        bent = (self.bending / 2 * (bend**2).sum(axis=1) / self.around**3).sum()
        return (
            (z.p**2 / (2 * self.mass[:, None])).sum() + (self.length * (self.stiffness / 2 * e**2 + heat)).sum() + bent
        )

    def irreversible(self, z: Any, dE: Any, dS: Any) -> Any:
        return {"s": conduction(dE.s, self.pairs, self.conductivity / self.length[self.pairs].mean(axis=1))}

    def invariants(self, z: Any) -> Any:
        push = z.p.sum(axis=0)
        spin = (z.q[:, 0] * z.p[:, 1] - z.q[:, 1] * z.p[:, 0]).sum()
        return {"spin": spin, "push_x": push[0], "push_y": push[1]}

    def points(self, z: Any) -> Any:
        return z.q[self.ends]


def ring(n: int, **changes: Any) -> Scenario:
    """A ring of radius 1 that spins and is squeezed, warm on one side; changes as for replace()."""
    k = np.arange(n)
    after, before, angle = (k + 1) % n, (k - 1) % n, 2 * np.pi * k / n
    places = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    length = np.linalg.norm(places[after] - places, axis=1)
    mass = np.full(n, 2 * np.pi / n)
    speed = np.stack([-places[:, 1], places[:, 0]], axis=1) + 0.5 * places * np.array([1.0, -1.0])
    constants = {
        "ends": np.stack([k, after], axis=1), "beside": np.stack([before, k, after], axis=1),
        "pairs": np.stack([before, k], axis=1), "mass": mass, "length": length, "around": length, "stiffness": 50.0,
        "bending": 0.5, "capacity": 1.0, "expansion": 0.3, "conductivity": 0.05, "theta0": 1.0,
    }  # fmt: skip
    start = {"q": places, "p": mass[:, None] * speed, "s": length * np.log(1 + 0.2 * np.cos(angle))}
    scenario = Scenario(
        f"ring_{n}", Ring, constants, initial=start, t_end=10.0, dt=0.05,
        shows="bending and spin over many turns, all momenta exact",
        source="rotating ring with bending, by squared lengths and second differences",
    )  # fmt: skip
    return scenario.replace(**changes) if changes else scenario
