"""A net of nx by ny masses in the plane, joined by thermoelastic springs; two corners are tied to fixed points."""

from __future__ import annotations

from typing import Any

import numpy as np

from tcbench import Scenario
from tcbench.systems.spring_network import SpringNetwork, springs_of
from tcbench.systems.viscous_springs import with_dashpots

SPACING = 1.1


class Net(SpringNetwork):
    """Springs between points of the plane."""

    name = "net"


def joined(nx: int, ny: int) -> Any:
    """The two points that each spring joins; mass (i, j) is number i * ny + j."""
    number = np.arange(nx * ny).reshape(nx, ny)
    along = np.stack([number[:-1].ravel(), number[1:].ravel()], axis=1)
    across = np.stack([number[:, :-1].ravel(), number[:, 1:].ravel()], axis=1)
    corners = [(0, nx * ny), ((nx - 1) * ny, nx * ny + 1)]  # tied to the fixed points beyond the last mass
    return np.concatenate([along, across, corners])


def net(nx: int, ny: int, **changes: Any) -> Scenario:
    """A stretched net with a hot patch that is let go: heat spreads while it swings; changes as for replace()."""
    ends, fixed = joined(nx, ny), SPACING * np.array([[-1.0, 0.0], [nx, 0.0]])
    i, j = (x.ravel() for x in np.meshgrid(np.arange(nx), np.arange(ny), indexing="ij"))
    places = SPACING * np.stack([i, j], axis=1)
    middle = np.concatenate([places, fixed])[ends].mean(axis=1)
    distance = ((middle - SPACING * np.array([nx - 1, ny - 1]) / 2) ** 2).sum(axis=1)
    speed = 0.3 * np.stack([np.sin(0.7 * (j + 1)), np.sin(0.9 * (i + 1))], axis=1)
    scenario = Scenario(
        name=f"net_{nx}x{ny}",
        system=Net,
        constants=springs_of(ends, fixed),
        positions=tuple(places.ravel()),
        momenta=tuple(speed.ravel()),
        temperatures=tuple(300 + 60 * np.exp(-distance / (0.1 * max(nx, ny) ** 2 + 1.0))),
        t_end=25.0,
        dt=0.1,
        shows="cost against size, in the plane",
        source="Romero (2009), section 4, with the masses and springs of a net",
    )
    return scenario.replace(**changes) if changes else scenario


def dashed_net(nx: int, ny: int, viscosity: float | None = None) -> Scenario:
    """A net with dashpots of this viscosity beside its springs."""
    return with_dashpots(net(nx, ny), viscosity)
