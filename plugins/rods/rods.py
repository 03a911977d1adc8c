"""Masses on rigid rods: pendulums of n links, closed loops, rigid bodies. Joints rub and conduct; dimensionless."""

from __future__ import annotations

from typing import Any

import numpy as np

from tcbench import Scenario
from tcbench.systems.canonical import Canonical

from .sources import BETSCH

GRAVITY = 9.81
ANGULAR = "angular_momentum_"


class Rods(Canonical):
    """Each rod joins two masses, or a mass and a fixed point; each joint is a pair of masses that share a neighbour."""

    name = "rods"
    variables = {"q": ("node", 3), "p": ("node", 3), "s": ("node",)}
    multipliers = {"lam": "rod"}
    tables = {"ends": ("rod", 2, "node+anchor"), "pairs": ("joint", 2, "node")}
    constants = {
        "mass": ("node",), "anchors": ("anchor", 3), "length": ("rod",), "gravity": (3,), "conductivity": (),
        "friction": (), "heat_capacity": (), "lowest": (),
    }  # fmt: skip
    positive = ("mass", "length", "heat_capacity")
    non_negative = ("conductivity", "friction")
    reference_temperature = 1.0

    def energy(self, z: Any) -> Any:
        heat = self.heat_capacity * (np.exp(z.s / self.heat_capacity) - 1)
        return (z.p**2 / (2 * self.mass[:, None])).sum() - (self.mass * (z.q @ self.gravity)).sum() + heat.sum()

    def constraints(self, z: Any) -> Any:
        x = np.concatenate([z.q, self.anchors])[self.ends]
        return {"lam": (((x[:, 1] - x[:, 0]) ** 2).sum(axis=1) - self.length**2) / 2}

    def irreversible(self, z: Any, dE: Any, dS: Any) -> Any:
        """A joint that closes or opens rubs, along the line between the masses, and heats both."""
        (a, b), v, x = dE.s[self.pairs].T, dE.p[self.pairs], z.q[self.pairs]
        line = x[:, 1] - x[:, 0]
        rate = ((v[:, 1] - v[:, 0]) * line).sum(axis=1)
        push, power = (self.friction * rate)[:, None] * line, self.friction * rate**2 / 2
        flow = self.conductivity * (b - a)
        heat = np.stack([(power + flow) / a, (power - flow) / b], axis=1)
        return {"p": self.pairs.sums(np.stack([push, -push], axis=1)), "s": self.pairs.sums(heat)}

    def exergy_offset(self) -> Any:
        """Minus the energy of the state of rest at temperature 1, or less: `lowest`."""
        return -self.lowest

    def points(self, z: Any) -> Any:
        """The rods, seen along y."""
        x = np.concatenate([z.q, self.anchors])[self.ends]
        return np.stack([x[:, :, 0], x[:, :, 2]], axis=-1)


class Hanging(Rods):
    """Under gravity: what turns about the vertical is kept."""

    name = "hanging_rods"

    def invariants(self, z: Any) -> dict[str, Any]:
        (x, y, _), (u, v, _) = z.q.T, z.p.T
        return {ANGULAR + "z": (x * v - y * u).sum()}


class Free(Rods):
    """Without gravity and fixed points: both momenta are kept."""

    name = "free_rods"

    def invariants(self, z: Any) -> dict[str, Any]:
        spin, push = np.cross(z.q, z.p).sum(axis=0), z.p.sum(axis=0)
        return {ANGULAR + axis: spin[k] for k, axis in enumerate("xyz")} | {
            "momentum_" + axis: push[k] for k, axis in enumerate("xyz")
        }


def scenario(name: str, q: Any, p: Any, s: Any, ends: Any, pairs: Any, mass: Any, hangs: bool, **more: Any) -> Scenario:
    """Of masses at q; the rods are as long as these are apart."""
    q, anchors = np.asarray(q, dtype=float), np.zeros((int(hangs), 3))
    x = np.concatenate([q, anchors])[ends]
    reach = np.arange(1, len(q) + 1) if hangs else np.zeros(len(q))
    constants = {
        "ends": ends, "pairs": np.asarray(pairs, dtype=int).reshape(-1, 2), "mass": mass, "anchors": anchors,
        "length": np.sqrt(((x[:, 1] - x[:, 0]) ** 2).sum(axis=1)), "gravity": [0, 0, -GRAVITY * hangs],
        "conductivity": 0.3, "friction": 0.1, "heat_capacity": 2.0, "lowest": -GRAVITY * float(np.dot(mass, reach)),
    }  # fmt: skip
    return Scenario(
        name=name, system=Hanging if hangs else Free, constants=constants, initial={"q": q, "p": p, "s": s},
        dt=0.02, source=BETSCH, **more,
    )  # fmt: skip


def chain(n: int) -> Scenario:
    """A pendulum of n links of length 1, laid out in steps in the horizontal plane and let go with a kick."""
    k, nodes = np.arange(n), np.r_[n, np.arange(n)]
    ways = np.where((k % 2 == 0)[:, None], [1.0, 0, 0], [0, 1.0, 0])
    return scenario(
        f"rods_{n}", np.cumsum(ways, axis=0), np.stack([0 * k, 0 * k, np.cos(k)], axis=1), 0.2 * np.cos(k),
        np.stack([nodes[:-1], nodes[1:]], axis=1), np.stack([k[:-2], k[2:]], axis=1) if n > 2 else [], np.ones(n), True,
        t_end=5.0, shows="rigid rods: a pendulum of n links whose joints rub and warm",
    )  # fmt: skip


def loop(n: int) -> Scenario:
    """A regular polygon of rods, which spins about an axis across it and bends."""
    k = np.arange(n)
    a = 2 * np.pi * k / n
    q = np.stack([np.cos(a), np.sin(a), 0 * a], axis=1)
    return scenario(
        f"rod_loop_{n}", q, np.cross([0.2, -0.3, 0.9], q) + 0.4 * np.stack([0 * a, 0 * a, np.cos(2 * a)], axis=1),
        0.2 * np.cos(k), np.stack([k, (k + 1) % n], axis=1), np.stack([k, (k + 2) % n], axis=1), np.ones(n), False,
        t_end=5.0, shows="a closed loop of rigid rods, which rubs itself stiff",
    )  # fmt: skip


def four_masses(spin: float) -> Scenario:
    """A tetrahedron of rods, which flies and turns; heat evens out between two pairs of its corners."""
    q = np.array([[0, 0, 0], [1, 0, 0], [0.2, 1, 0], [0.3, 0.2, 1.1]])
    mass = np.array([1.0, 2.0, 1.5, 0.7])
    v = spin * np.cross([0.3, 1.1, -0.7], q) + [0.1, 0, 0.2]
    return scenario(
        "four_masses", q, mass[:, None] * v, 0.1 * np.arange(4), [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]],
        [[0, 1], [2, 3]], mass, False, t_end=5.0, shows="a rigid body: four masses and six rigid rods",
    )  # fmt: skip
