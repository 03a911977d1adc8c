"""A bar in space, clamped at one end: nx by ny by nz masses, springs along edges and across faces."""

from __future__ import annotations

import re
from functools import cache
from typing import Any

import numpy as np

from tcbench import Scenario, TcbenchError
from tcbench.systems.spring_network import SpringNetwork, whole_number

MOST = 200  # masses along an edge
NEIGHBOURS = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (1, 0, 1), (0, 1, 1), (1, -1, 0), (1, 0, -1), (0, 1, -1)]


class Truss(SpringNetwork):
    """Springs between points of space. See `truss_system`."""

    name = "truss3d"


@cache
def truss_system(nx: int, ny: int, nz: int) -> type[SpringNetwork]:
    """The class of bars with nx by ny by nz masses, in front of nx by ny fixed points at z = -1."""
    sizes, free = np.array([nx, ny, nz + 1]), nx * ny * nz
    place = np.stack(np.meshgrid(*map(np.arange, sizes), indexing="ij"), axis=-1).reshape(-1, 3)
    place = np.concatenate([place[place[:, 2] > 0], place[place[:, 2] == 0]])  # the fixed points behind the masses
    number = {tuple(p): k for k, p in enumerate(place.tolist())}
    pairs = [
        (k, number[other]) for k, p in enumerate(place.tolist()) for step in NEIGHBOURS
        if (other := tuple(a + b for a, b in zip(p, step, strict=True))) in number and min(k, number[other]) < free
    ]  # fmt: skip
    names = {"__module__": __name__, "__qualname__": f"Truss{nx}x{ny}x{nz}", "__doc__": f"A bar of {free} masses."}
    return Truss.over(pairs, place[free:] - [0, 0, 1], **names)


def truss(nx: int, ny: int, nz: int, **changes: Any) -> Scenario:
    """A clamped bar that is bent and heated at its free end, and let go; changes as for replace()."""
    kind = truss_system(nx, ny, nz)
    m = kind.n_elements
    places = np.stack(np.meshgrid(*map(np.arange, (nx, ny, nz)), indexing="ij"), axis=-1).reshape(-1, 3).astype(float)
    ends = np.concatenate([places.ravel(), kind.anchors])[kind.elements].reshape(m, 2, 3)  # type: ignore[attr-defined]
    lengths, height = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1), ends[:, :, 2].mean(axis=1)
    momenta = np.zeros_like(places)
    momenta[:, 0] = 0.5 * (places[:, 2] + 1) / nz
    scenario = Scenario(
        name=f"truss3d_{nx}x{ny}x{nz}",
        system=kind,
        constants={
            "masses": np.ones(len(places)), "stiffness": np.full(m, 10.0), "natural_lengths": lengths,
            "conductivity": 2.0, "reference_temperature": 300.0, "coupling": 0.2, "heat_capacity": 5.0,
        },
        positions=tuple(places.ravel()),
        momenta=tuple(momenta.ravel()),
        temperatures=tuple(300 + 40 * (height + 1) / nz),
        t_end=25.0,
        dt=0.1,
        shows="cost against size, in space",
        source="Romero (2009), section 4, with the masses and springs of a bar",
    )  # fmt: skip
    return scenario.replace(**changes) if changes else scenario


def truss_of(nx: str, ny: str, nz: str) -> Scenario:
    """`truss` for the command line: sizes in words."""
    for size in (nx, ny, nz):
        if whole_number(size, 1, MOST) is None:
            raise TcbenchError(
                f"A bar has 1 to {MOST} masses along each edge, not {size[:30]!r}: truss3d[nx=2,ny=2,nz=8]."
            )
    if min(int(nx), int(ny)) < 2:
        raise TcbenchError("A bar has at least 2 by 2 masses across: truss3d[nx=2,ny=2,nz=8].")
    return truss(int(nx), int(ny), int(nz))


def __getattr__(name: str) -> Any:
    """Truss2x2x8, ...: workers look the class of a scenario up by its name."""
    found = re.fullmatch(r"Truss([1-9]\d*)x([1-9]\d*)x([1-9]\d*)", name)
    if found is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return truss_system(*map(int, found.groups()))
