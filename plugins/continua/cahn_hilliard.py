"""Phases that part, `cahn_hilliard[n=16]`: Cahn and Hilliard's equation on a square of n by n cells, with heat.

The square is periodic. Nothing moves: a concentration flows from high to low chemical potential, and what that sets
free heats the cells on both sides. Mean concentration and energy are kept; diffusion of fourth order is stiff.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tcbench import Scenario
from tcbench.systems.canonical import Canonical


class CahnHilliard(Canonical):
    """c, s: concentration, from -1 to 1, and entropy of each cell."""

    name = "cahn_hilliard"
    variables = {"c": ("cell",), "s": ("cell",)}
    tables = {"sides": ("face", 2, "cell")}
    constants = {
        "area": ("cell",),
        "width": (),
        "well": (),
        "interface": (),
        "mobility": (),
        "capacity": (),
        "conductivity": (),
        "theta0": (),
    }
    positive = ("area", "width", "capacity", "mobility", "theta0")
    reference_temperature = "theta0"
    non_negative = ("conductivity",)
    source = "Cahn and Hilliard (1958), J. Chem. Phys. 28:258"

    def energy(self, z: Any) -> Any:
        a, b = z.c[self.sides].T
        wells = self.area * (
            self.well / 4 * (z.c**2 - 1) ** 2
            + self.capacity * self.theta0 * (np.exp(z.s / (self.area * self.capacity)) - 1)
        )
        return wells.sum() + (self.interface / 2 * (b - a) ** 2).sum()

    def reversible(self, z: Any, dE: Any, dS: Any) -> Any:
        return {}

    def irreversible(self, z: Any, dE: Any, dS: Any) -> Any:
        potential, theta = dE.c[self.sides], dE.s[self.sides]
        (first, second), (a, b) = potential.T, theta.T
        flow = self.mobility * (first - second) / self.width**2
        heat, lost = flow * (first - second) / 2, self.conductivity * (a - b)
        warmed = self.sides.sums(np.stack([(heat - lost) / a, (heat + lost) / b], axis=1))
        return {"c": self.sides.sums(np.stack([-flow, flow], axis=1)), "s": warmed}

    def invariants(self, z: Any) -> Any:
        return {"substance": (self.area * z.c).sum()}


def cahn_hilliard(n: int, **changes: Any) -> Scenario:
    """A mixture that is nearly even, and parts; changes as for replace()."""
    number = np.arange(n * n).reshape(n, n)
    sides = [np.stack([number.ravel(), np.roll(number, -1, axis).ravel()], axis=1) for axis in (0, 1)]
    width, cells = 1.0 / n, np.arange(n * n)
    constants = {
        "sides": np.concatenate(sides), "area": np.full(n * n, width**2), "width": width, "well": 1.0,
        "interface": 0.002, "mobility": 1.0, "capacity": 2.0, "conductivity": 0.1,
        "theta0": 1.0,
    }  # fmt: skip
    start = {"c": 0.1 * np.sin(1.7 * cells) + 0.05 * np.cos(0.3 * cells), "s": np.zeros(n * n)}
    scenario = Scenario(
        f"cahn_hilliard_{n}", CahnHilliard, constants, initial=start, t_end=0.2, dt=0.002,
        shows="stiff diffusion without motion: phases part and the heat stays",
        source="Cahn and Hilliard (1958), J. Chem. Phys. 28:258, with heat",
    )  # fmt: skip
    return scenario.replace(**changes) if changes else scenario
