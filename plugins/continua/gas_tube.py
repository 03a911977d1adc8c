"""A gas in a tube, `gas_tube[n=100]`: Sod's shock tube in Lagrangian form, viscous and conducting.

Cells of fixed mass between nodes that move. What viscosity takes from the motion heats the cell: entropy is made in the
shock and nowhere else, and neither energy nor momentum is lost.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tcbench import Scenario
from tcbench.systems.canonical import Canonical, conduction

GAMMA = 1.4


class GasTube(Canonical):
    """x, p: places and momenta of the nodes; s: entropies of the cells."""

    name = "gas_tube"
    variables = {"x": ("node",), "p": ("node",), "s": ("cell",)}
    tables = {"ends": ("cell", 2, "node+wall"), "faces": ("face", 2, "cell")}
    constants = {"mass": ("node",), "wall": ("wall",), "gas": ("cell",), "viscosity": ("cell",), "conductivity": ()}
    positive = ("mass", "gas")
    non_negative = ("viscosity", "conductivity")
    source = "Sod (1978), J. Comput. Phys. 27:1"

    def widths(self, x: Any) -> Any:
        ends = np.concatenate([x, self.wall])[self.ends]
        return ends[:, 1] - ends[:, 0]

    def energy(self, z: Any) -> Any:
        """e = v^(1 - gamma) exp(s (gamma - 1)) / (gamma - 1) of volume and entropy per mass: p = rho e (gamma - 1)."""
        v, s = self.widths(z.x) / self.gas, z.s / self.gas
        inner = np.exp((GAMMA - 1) * (s - np.log(v))) / (GAMMA - 1)
        return (z.p**2 / (2 * self.mass)).sum() + (self.gas * inner).sum()

    def reversible(self, z: Any, dE: Any, dS: Any) -> Any:
        return {"x": dE.p, "p": -dE.x}

    def irreversible(self, z: Any, dE: Any, dS: Any) -> Any:
        speeds = np.concatenate([dE.p, 0.0 * self.wall])[self.ends]
        opening = speeds[:, 1] - speeds[:, 0]
        stress = self.viscosity * opening / self.widths(z.x)
        force = self.ends.sums(np.stack([stress, -stress], axis=1))
        apart = self.widths(z.x)[self.faces].mean(axis=1)
        return {"p": force, "s": stress * opening / dE.s + conduction(dE.s, self.faces, self.conductivity / apart)}

    def measures(self, z: Any) -> Any:
        return self.widths(z.x)


def gas_tube(n: int, **changes: Any) -> Scenario:
    """Dense gas at high pressure beside thin gas at low pressure, let go; changes as for replace()."""
    k, width = np.arange(n), 1.0 / n
    left = (k + 0.5) * width < 0.5
    density, pressure = np.where(left, 1.0, 0.125), np.where(left, 1.0, 0.1)
    gas = density * width
    nodes = np.r_[n - 1, k[:-1], n]  # those that move come first, the two walls behind them
    ends = np.stack([nodes[:-1], nodes[1:]], axis=1)
    constants = {
        "ends": ends, "faces": np.stack([k[:-1], k[1:]], axis=1), "mass": (gas[:-1] + gas[1:]) / 2,
        "wall": [0.0, 1.0], "gas": gas, "viscosity": 1.5 * density * width, "conductivity": 0.1 * width,
    }  # fmt: skip
    start = {"x": width * (k[:-1] + 1), "p": np.zeros(n - 1),
             "s": gas * np.log(pressure / density**GAMMA) / (GAMMA - 1)}  # fmt: skip
    scenario = Scenario(
        f"gas_tube_{n}", GasTube, constants, initial=start, t_end=0.2, dt=0.2 / n,
        shows="a shock: entropy is made where the gas is compressed",
        source="Sod (1978), J. Comput. Phys. 27:1, in Lagrangian form with viscosity and conduction",
    )  # fmt: skip
    return scenario.replace(**changes) if changes else scenario
