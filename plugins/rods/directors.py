"""Directors, kept rigid by orthonormality: a body with a liquid core, and a rod that bends; dimensionless."""

from __future__ import annotations

from typing import Any

import numpy as np

from tcbench import Scenario, System

from .rods import ANGULAR
from .sources import DIRECTORS

INERTIA = (0.1, 0.2, 0.3)  # Euler's, of each director; about its axis the body has the sum of the two others


class DirectorBody(System):
    """d, pi: directors and their momenta; l, s: angular momentum and entropy of a liquid core that drags the body."""

    name = "director_body"
    variables = {"d": (3, 3), "pi": (3, 3), "l": (3,), "s": ()}
    multipliers = {"stress": (6,)}
    constants = {"inertia": (3,), "core_inertia": (), "friction": (), "heat_capacity": ()}
    positive = ("inertia", "core_inertia", "heat_capacity")
    non_negative = ("friction",)
    reference_temperature = 1.0

    def energy(self, z: Any) -> Any:
        kinetic = (z.pi**2 / self.inertia[:, None]).sum() + (z.l**2).sum() / self.core_inertia
        return kinetic / 2 + self.heat_capacity * (np.exp(z.s / self.heat_capacity) - 1)

    def constraints(self, z: Any) -> Any:
        a, b, c = z.d
        return {"stress": np.array([(a @ a - 1) / 2, (b @ b - 1) / 2, (c @ c - 1) / 2, a @ b, b @ c, c @ a])}

    def entropy(self, z: Any) -> Any:
        return z.s

    def reversible(self, z: Any, dE: Any, dS: Any) -> Any:
        return {"d": dE.pi, "pi": -dE.d}

    def irreversible(self, z: Any, dE: Any, dS: Any) -> Any:
        """The torque of the core on the body, by forces on the directors; its power is heat."""
        slip = self.turned(z.d, dE.l) - np.cross(z.d, dE.pi).sum(axis=0) / 2  # sum d_i x v_i = 2 omega
        torque = self.friction * slip
        return {"pi": np.cross(torque, z.d) / 2, "l": -self.turned(z.d, torque), "s": torque @ slip / dE.s}

    def turned(self, d: Any, x: Any) -> Any:
        """sum d_i x (x x d_i)/2: x, where the directors are orthonormal; with it momentum is kept elsewhere, too."""
        return np.cross(d, np.cross(x, d)).sum(axis=0) / 2

    def temperature(self, z: Any, dE: Any, dS: Any) -> Any:
        return dE.s

    def invariants(self, z: Any) -> dict[str, Any]:
        spin = np.cross(z.d, z.pi).sum(axis=0) + z.l
        return {ANGULAR + axis: spin[k] for k, axis in enumerate("xyz")}

    def points(self, z: Any) -> Any:
        """The directors, seen along y."""
        return [[(0.0, 0.0), (z.d[k][0], z.d[k][2])] for k in range(3)]


class DirectorRod(System):
    """Nodes with places x and directors d, of rigid cross-sections; elements with an entropy between them.

    Strains are products of directors with the line to the next node and with each other, C = F^T F in one dimension:
    DE then keeps momenta. Each element is warm, expands, conducts, and rubs as the angles between its sections change.
    """

    name = "director_rod"
    variables = {"x": ("node", 3), "d": ("node", 3, 3), "p": ("node", 3), "pi": ("node", 3, 3), "s": ("element",)}
    multipliers = {"stress": ("node", 6)}
    tables = {"ends": ("element", 2, "node"), "faces": ("face", 2, "element")}
    constants = {
        "mass": ("node",), "inertia": ("node", 3), "length": ("element",), "shear": (), "tension": (),
        "bending": (), "twist": (),
        "expansion": (), "friction": (), "conductivity": (), "heat_capacity": (),
    }  # fmt: skip
    positive = ("mass", "inertia", "length", "heat_capacity")
    non_negative = ("friction", "conductivity")
    reference_temperature = 1.0

    def energy(self, z: Any) -> Any:
        x, d, c = z.x[self.ends], z.d[self.ends], self.heat_capacity
        along = (x[:, 1] - x[:, 0]) / self.length[:, None]
        d_mid, d_rate = (d[:, 0] + d[:, 1]) / 2, (d[:, 1] - d[:, 0]) / self.length[:, None, None]
        strain = [(d_mid[:, k] * along).sum(axis=1) for k in range(3)]
        bend = [((d_mid[:, a] * d_rate[:, b]).sum(axis=1) - (d_mid[:, b] * d_rate[:, a]).sum(axis=1)) / 2
                for a, b in ((1, 2), (2, 0), (0, 1))]  # fmt: skip
        stretch = strain[2] - 1
        stored = self.shear * (strain[0] ** 2 + strain[1] ** 2) + self.tension * stretch**2
        stored = stored + self.bending * (bend[0] ** 2 + bend[1] ** 2) + self.twist * bend[2] ** 2
        heat = c * (np.exp((z.s / self.length - self.expansion * stretch) / c) - 1) + self.expansion * stretch
        kinetic = (z.p**2 / self.mass[:, None]).sum() + (z.pi**2 / self.inertia[:, :, None]).sum()
        return kinetic / 2 + (self.length * (stored / 2 + heat)).sum()

    def constraints(self, z: Any) -> Any:
        a, b, c = z.d[:, 0], z.d[:, 1], z.d[:, 2]
        pairs = ((a, a), (b, b), (c, c), (a, b), (b, c), (c, a))
        return {"stress": np.stack([(x * y).sum(axis=1) - float(x is y) for x, y in pairs], axis=1)}

    def entropy(self, z: Any) -> Any:
        return z.s.sum()

    def reversible(self, z: Any, dE: Any, dS: Any) -> Any:
        return {"x": dE.p, "d": dE.pi, "p": -dE.x, "pi": -dE.d}

    def irreversible(self, z: Any, dE: Any, dS: Any) -> Any:
        d, v = z.d[self.ends], dE.pi[self.ends]
        one, other = d[:, 0], d[:, 1]
        rate = (v[:, 0] * other + one * v[:, 1]).sum(axis=2)  # of the cosines between the sections
        push = (self.friction * rate)[:, :, None]
        a, b = dE.s[self.faces].T
        flow = self.conductivity * (b - a)
        conduction = self.faces.sums(np.stack([flow / a, -flow / b], axis=1))
        heat = self.friction * (rate**2).sum(axis=1) / dE.s
        return {"pi": self.ends.sums(np.stack([-push * other, -push * one], axis=1)), "s": heat + conduction}

    def temperature(self, z: Any, dE: Any, dS: Any) -> Any:
        return dE.s

    def invariants(self, z: Any) -> dict[str, Any]:
        spin = sum(np.cross(x, p).sum(axis=0) for x, p in ((z.x, z.p), *((z.d[:, k], z.pi[:, k]) for k in range(3))))
        push = z.p.sum(axis=0)
        return {ANGULAR + axis: spin[k] for k, axis in enumerate("xyz")} | {
            "momentum_" + axis: push[k] for k, axis in enumerate("xyz")
        }

    def points(self, z: Any) -> Any:
        """The line of centres, seen along y."""
        x = z.x[self.ends]
        return np.stack([x[:, :, 0], x[:, :, 2]], axis=-1)


def body(spin: float) -> Scenario:
    """Thrown about its axis of middle inertia, a little off, with the core at rest."""
    omega, d, inertia = spin * np.array([0.1, 3.0, 0.2]), np.eye(3), np.array(INERTIA)
    return Scenario(
        name="director_body",
        system=DirectorBody,
        constants={"inertia": inertia, "core_inertia": 0.1, "friction": 0.02, "heat_capacity": 2.0},
        initial={"d": d, "pi": inertia[:, None] * np.cross(omega, d), "l": np.zeros(3), "s": 0.0},
        t_end=30.0,
        dt=0.05,
        shows="a rigid body in directors, which a liquid core turns to its axis of largest inertia",
        source=DIRECTORS,
    )


def rod(n: int) -> Scenario:
    """A free straight rod of length 1 along x, thrown, bent and twisted; one half is warm."""
    k, length = np.arange(n + 1), np.full(n, 1.0 / n)
    mass = np.convolve(length, [0.5, 0.5])
    u, inertia = k / n - 0.5, mass[:, None] * [0.02, 0.03, 0.04]
    d = np.tile(np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]]), (n + 1, 1, 1))
    omega = np.stack([0.8 * np.sin(np.pi * u), -1.5 * u, 0.5 + 0 * u], axis=1)
    v = np.stack([0.1 + 0 * u, 0.5 * u, 0.3 * np.cos(2 * np.pi * u)], axis=1)
    return Scenario(
        name=f"director_rod_{n}",
        system=DirectorRod,
        constants={
            "ends": np.stack([k[:-1], k[1:]], axis=1), "faces": np.stack([k[:-2], k[1:-1]], axis=1), "mass": mass,
            "inertia": inertia, "length": length, "shear": 30.0, "tension": 50.0, "bending": 1.0, "twist": 0.8,
            "expansion": 0.1, "friction": 0.02, "conductivity": 0.05, "heat_capacity": 1.0,
        },
        initial={
            "x": np.stack([u, 0 * u, 0 * u], axis=1), "d": d, "p": mass[:, None] * v,
            "pi": inertia[:, :, None] * np.cross(omega[:, None], d), "s": length * 0.1 * (k[:-1] >= n / 2),
        },
        t_end=2.0,
        dt=0.02,
        shows="a warm rod in directors bends and twists",
        source=DIRECTORS,
    )  # fmt: skip
