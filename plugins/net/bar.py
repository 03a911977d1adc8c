"""A bar of n elements, `bar[n=20]`: a thermo-visco-elastic continuum in one dimension, by linear finite elements.

Clamped at the left, pulled and let go. In each element a standard linear solid (a spring beside a spring and a dashpot
in a row), whose dissipation heats it, and which cools as it is stretched; heat flows to the neighbours.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tcbench import Scenario
from tcbench.systems.canonical import Canonical, conduction


class Bar(Canonical):
    """u, p: displacements and momenta of the nodes; s, alpha: entropies and viscous strains of the elements."""

    name = "bar"
    variables = {"u": ("node",), "p": ("node",), "s": ("element",), "alpha": ("element",)}
    tables = {"ends": ("element", 2, "node+wall"), "faces": ("face", 2, "element")}
    constants = {
        "mass": ("node",), "wall": ("wall",), "length": ("element",), "modulus": (), "viscous_modulus": (),
        "viscosity": (), "expansion": (), "heat_capacity": (), "conductivity": (), "reference_temperature": (),
    }  # fmt: skip
    positive = ("mass", "length", "viscosity", "heat_capacity", "reference_temperature")
    non_negative = ("modulus", "viscous_modulus", "conductivity")

    def strain(self, u: Any) -> Any:
        ends = np.concatenate([u, self.wall])[self.ends]
        return (ends[:, 1] - ends[:, 0]) / self.length

    def energy(self, z: Any) -> Any:
        e, c, warm = self.strain(z.u), self.heat_capacity, self.reference_temperature
        stored = self.modulus / 2 * e**2 + self.viscous_modulus / 2 * (e - z.alpha) ** 2
        heat = warm * (self.expansion * e + c * (np.exp((z.s / self.length - self.expansion * e) / c) - 1.0))
        return (z.p**2 / (2 * self.mass)).sum() + (self.length * (stored + heat)).sum()

    def reversible(self, z: Any, dE: Any, dS: Any) -> Any:
        return {"u": dE.p, "p": -dE.u}

    def irreversible(self, z: Any, dE: Any, dS: Any) -> Any:
        conducted = conduction(dE.s, self.faces, 2 * self.conductivity / self.length[self.faces].sum(axis=1))
        flow = -dE.alpha / (self.viscosity * self.length)
        return {"alpha": flow, "s": conducted - flow * dE.alpha / dE.s}

    def points(self, z: Any) -> Any:
        """The elements, stretched, side by side."""
        x = np.concatenate([np.cumsum(self.length) + z.u, self.wall])[self.ends]
        return np.stack([x, np.zeros_like(x)], axis=-1)


def bar(n: int, **changes: Any) -> Scenario:
    """A bar of length 1, stretched by a tenth with a warm right half, and let go; changes as for replace()."""
    k, length = np.arange(n), np.full(n, 1.0 / n)
    middle = (k + 0.5) / n
    mass = np.full(n, 1.0 / n)
    mass[-1] /= 2.0
    theta, strain, c = 300.0 + 30.0 * (middle > 0.5), 0.1, 2.0
    scenario = Scenario(
        name=f"bar_{n}",
        system=Bar,
        constants={
            "ends": np.stack([np.r_[n, k[:-1]], k], axis=1), "faces": np.stack([k[:-1], k[1:]], axis=1),
            "mass": mass, "wall": np.zeros(1), "length": length, "modulus": 10.0, "viscous_modulus": 5.0,
            "viscosity": 2.0, "expansion": 0.05, "heat_capacity": c, "conductivity": 0.5,
            "reference_temperature": 300.0,
        },
        initial={
            "u": strain * (k + 1) / n, "p": np.zeros(n), "alpha": np.zeros(n),
            "s": length * (0.05 * strain + c * np.log(theta / 300.0)),
        },
        t_end=5.0,
        dt=0.02,
        shows="a continuum: waves in a bar that relaxes and conducts",
        source="standard linear solid with heat conduction, linear finite elements; dimensionless",
    )  # fmt: skip
    return scenario.replace(**changes) if changes else scenario
