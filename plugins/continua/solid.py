"""Thermoelastic solids in space by finite elements: an L-shaped block, pushed and heated, that turns, bends and flies.

Entropies belong to nodes. Conduction is that of finite elements, in a form that keeps the energy for any covector. The
energy is written with C = F^T F: so discrete gradients keep the three angular momenta.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from tcbench import Scenario
from tcbench.fem import needed, tabulate
from tcbench.systems.canonical import Canonical


class Solid(Canonical):
    """q, p, s: places, momenta and entropies of the nodes. Neo-Hookean, coupled to heat through the volume."""

    variables = {"q": ("node", 3), "p": ("node", 3), "s": ("node",)}
    constants = {
        "weight": ("gauss",), "volume": ("node",), "mass": ("node",), "shear": (), "bulk": (), "capacity": (),
        "expansion": (), "conductivity": (), "theta0": (),
    }  # fmt: skip
    positive: ClassVar[tuple[str, ...]] = ("volume", "mass", "weight", "capacity", "theta0")
    non_negative = ("conductivity",)
    reference_temperature = "theta0"

    def stretch(self, z: Any) -> Any:
        """C = F^T F at each point."""
        F = np.einsum("gai,gaj->gij", z.q[self.of], self.slopes)
        return F.mT @ F

    def stored(self, z: Any, C: Any, J: Any) -> Any:
        """Elastic energy per volume; J: logarithm of the volume."""
        return self.shear / 2 * (np.trace(C, axis1=1, axis2=2) - 3 - 2 * J) + self.bulk / 2 * J**2

    def energy(self, z: Any) -> Any:
        C = self.stretch(z)
        J = np.log(np.linalg.det(C)) / 2
        s = ((z.s / self.volume)[self.of] * self.shape).sum(axis=1)
        c = self.capacity
        heat = self.theta0 * (self.expansion * J + c * (np.exp((s - self.expansion * J) / c) - 1))
        return (z.p**2 / (2 * self.mass[:, None])).sum() + (self.weight * (self.stored(z, C, J) + heat)).sum()

    def at_points(self, theta: Any) -> Any:
        """Temperature at each point."""
        return (theta[self.of] * self.shape).sum(axis=1)

    def irreversible(self, z: Any, dE: Any, dS: Any) -> Any:
        slope = np.einsum("ga,gai->gi", dE.s[self.of], self.slopes) / self.at_points(dE.s)[:, None]
        flux = self.conductivity * slope
        along = np.einsum("gi,gai->ga", flux, self.slopes)
        heat = (flux * slope).sum(axis=1)
        return {"s": self.of.sums(self.weight[:, None] * (heat[:, None] * self.shape - along))}

    def invariants(self, z: Any) -> Any:
        m, p = np.cross(z.q, z.p).sum(axis=0), z.p.sum(axis=0)
        return {"spin_x": m[0], "spin_y": m[1], "spin_z": m[2], "push_x": p[0], "push_y": p[1], "push_z": p[2]}


class Viscous(Solid):
    """With a second spring beside each, that relaxes: A is its stretch, a tensor at each point."""

    variables = Solid.variables | {"A": ("gauss", 3, 3)}
    constants = Solid.constants | {"stiffness": (), "viscosity": ()}
    positive: ClassVar[tuple[str, ...]] = (*Solid.positive, "viscosity")

    def stored(self, z: Any, C: Any, J: Any) -> Any:
        return super().stored(z, C, J) + self.stiffness / 8 * ((C - z.A) ** 2).sum(axis=(1, 2))

    def irreversible(self, z: Any, dE: Any, dS: Any) -> Any:
        rate = -dE.A / (self.viscosity * self.weight[:, None, None])
        heat = -(rate * dE.A).sum(axis=(1, 2)) / self.at_points(dE.s)
        conducted = super().irreversible(z, dE, dS).s
        return {"A": rate, "s": conducted + self.of.sums(heat[:, None] * self.shape)}


def _class(base: Any, corners: int, name: str) -> Any:
    more = {"slopes": ("gauss", corners, 3), "shape": ("gauss", corners)}
    own = {"name": name, "tables": {"of": ("gauss", corners, "node")}, "constants": base.constants | more,
           "__module__": __name__, "__qualname__": name}  # fmt: skip
    return type(name, (base,), own)


Tets, Hexes = _class(Solid, 4, "Tets"), _class(Solid, 8, "Hexes")
ViscousTets, ViscousHexes = _class(Viscous, 4, "ViscousTets"), _class(Viscous, 8, "ViscousHexes")


def l_block(n: int, element: str) -> Any:
    """scikit-fem's mesh of an L of three cubes of side 1, each n x n x n elements (or as many times five or six)."""
    skfem = needed("skfem", "scikit-fem")
    x, z = np.linspace(0, 2, 2 * n + 1), np.linspace(0, 1, n + 1)
    mesh = (skfem.MeshHex if element == "hex" else skfem.MeshTet).init_tensor(x, x, z)
    middle = mesh.p[:, mesh.t].mean(axis=1)
    return mesh.restrict(np.flatnonzero((middle[0] < 1) | (middle[1] < 1)))


def solid(n: int, element: str = "tet", viscosity: float | None = None, **changes: Any) -> Scenario:
    """The block as after two tractions that have ended, with one arm hot; changes as for replace()."""
    skfem = needed("skfem", "scikit-fem")
    fem = tabulate(l_block(n, element), skfem.ElementHex1() if element == "hex" else skfem.ElementTetP1())
    X, volume = fem.places, fem.volume
    velocity = np.cross([0.3, 0.5, 1.0], X - X.mean(axis=0)) + 0.5 * np.array([0, 0, 1.0]) * (X[:, :1] > 1.5)
    theta = 1 + 0.2 * np.tanh(4 * (X[:, 0] - 1))
    constants = fem.constants | {
        "mass": volume, "shear": 10.0, "bulk": 20.0, "capacity": 1.0, "expansion": 0.3, "conductivity": 0.05,
        "theta0": 1.0,
    }  # fmt: skip
    start = {"q": X, "p": volume[:, None] * velocity, "s": volume * np.log(theta)}
    classes = {"tet": (Tets, ViscousTets), "hex": (Hexes, ViscousHexes)}[element]
    if viscosity is not None:
        constants |= {"stiffness": 5.0, "viscosity": viscosity}
        start["A"] = np.broadcast_to(np.eye(3), (len(fem.weight), 3, 3))
    scenario = Scenario(
        f"solid_{element}_{n}" + ("" if viscosity is None else "_viscous"), classes[viscosity is not None], constants,
        initial=start, t_end=2.0, dt=0.1, shows="large rotations of a solid in space that conducts",
        source="L-shaped block: Simo and Tarnow (1992), ZAMP 43:757; Romero (2010), IJNME 84:588",
    )  # fmt: skip
    return scenario.replace(**changes) if changes else scenario
