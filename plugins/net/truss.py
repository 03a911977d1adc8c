"""A bar in space, clamped at one end: nx by ny by nz masses, springs along edges and across faces."""

from __future__ import annotations

from typing import Any

import numpy as np

from tcbench import Scenario
from tcbench.systems.spring_network import SpringNetwork, springs_of
from tcbench.systems.viscous_springs import with_dashpots

NEIGHBOURS = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (1, 0, 1), (0, 1, 1), (1, -1, 0), (1, 0, -1), (0, 1, -1)]


class Truss(SpringNetwork):
    """Springs between points of space."""

    name = "truss3d"
    dimension = 3
    tables = SpringNetwork.tables | {"ends": ("element", 6, "position+anchor"), "places": ("point", 3, "position")}


def joined(nx: int, ny: int, nz: int) -> tuple[Any, Any]:
    """The points, masses first, then nx by ny fixed ones at z = -1; and the two that each spring joins."""
    sizes, free = np.array([nx, ny, nz + 1]), nx * ny * nz
    place = np.stack(np.meshgrid(*map(np.arange, sizes), indexing="ij"), axis=-1).reshape(-1, 3)
    place = np.concatenate([place[place[:, 2] > 0], place[place[:, 2] == 0]])
    number = {tuple(p): k for k, p in enumerate(place.tolist())}
    pairs = [
        (k, number[other]) for k, p in enumerate(place.tolist()) for step in NEIGHBOURS
        if (other := tuple(a + b for a, b in zip(p, step, strict=True))) in number and min(k, number[other]) < free
    ]  # fmt: skip
    return place - [0, 0, 1], np.array(pairs)


def truss(nx: int, ny: int, nz: int, **changes: Any) -> Scenario:
    """A clamped bar that is bent and heated at its free end, and let go; changes as for replace()."""
    free = nx * ny * nz
    points, pairs = joined(nx, ny, nz)
    places, ends = points[:free].astype(float), points[pairs]
    lengths, height = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1), ends[:, :, 2].mean(axis=1)
    momenta = np.zeros_like(places)
    momenta[:, 0] = 0.5 * (places[:, 2] + 1) / nz
    scenario = Scenario(
        name=f"truss3d_{nx}x{ny}x{nz}",
        system=Truss,
        constants=springs_of(pairs, points[free:], natural_lengths=lengths, conductivity=2.0),
        positions=tuple(places.ravel()),
        momenta=tuple(momenta.ravel()),
        temperatures=tuple(300 + 40 * (height + 1) / nz),
        t_end=25.0,
        dt=0.1,
        shows="cost against size, in space",
        source="Romero (2009), section 4, with the masses and springs of a bar",
    )
    return scenario.replace(**changes) if changes else scenario


def dashed_truss(nx: int, ny: int, nz: int, viscosity: float | None = None) -> Scenario:
    """A truss with dashpots of this viscosity beside its springs."""
    return with_dashpots(truss(nx, ny, nz), viscosity)
