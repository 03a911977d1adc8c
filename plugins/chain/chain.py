"""A chain of n masses in the plane and n thermoelastic springs, the first tied to the origin; the pendulum is n = 2.

A family of scenarios that shows cost against size: its formulas are traced on arrays, whatever their length.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tcbench import Scenario, TcbenchError
from tcbench.systems.spring_network import SpringNetwork, springs_of
from tcbench.systems.viscous_springs import with_dashpots


class Chain(SpringNetwork):
    """Masses in a row, each tied to the next."""

    name = "chain"

    def invariants(self, q: Any, p: Any) -> dict[str, Any]:  # type: ignore[override]
        (x, y), (u, v) = q[self.places].T, p[self.places].T
        return {"angular_momentum": (x * v - y * u).sum()}


def chain(n: int, **changes: Any) -> Scenario:
    """The scenario `chain_n`: a stretched line of n masses that swings, heated in waves; changes as for replace()."""
    if n < 2:
        raise TcbenchError(f"A chain has at least 2 masses, not {n}.")
    i = np.arange(n)
    joined = np.stack([np.r_[n, : n - 1], i], axis=1)  # the origin is point n
    scenario = Scenario(
        name=f"chain_{n}",
        system=Chain,
        constants=springs_of(joined, np.zeros((1, 2))),
        positions=tuple(np.stack([1.1 * (i + 1), 0 * i], axis=1).ravel()),
        momenta=tuple(np.stack([0 * i, 0.5 * np.sin(0.7 * (i + 1))], axis=1).ravel()),
        temperatures=tuple(300 + 20 * np.cos(i)),
        t_end=25.0,
        dt=0.1,
        shows="cost against size",
        source="Romero (2009), section 4, with n masses instead of 2",
    )
    return scenario.replace(**changes) if changes else scenario


def dashed_chain(n: int, viscosity: float | None = None) -> Scenario:
    """A chain with dashpots of this viscosity beside its springs."""
    return with_dashpots(chain(n), viscosity)
