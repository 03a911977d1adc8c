"""A chain of n masses in the plane and n thermoelastic springs, the first tied to the origin; the pendulum is n = 2.

A family of scenarios that shows cost against size, and a `Network`: formulas are traced on one spring for all.
"""

from __future__ import annotations

import re
from functools import cache
from typing import Any

import numpy as np

from tcbench import Scenario, TcbenchError
from tcbench.systems.spring_network import SpringNetwork, whole_number

MOST_MASSES = 100_000  # the arrays of one state of more would hardly be meant


class Chain(SpringNetwork):
    """Subclasses fix n: see `chain_system`."""

    name = "chain"

    def point_invariants(self, q: Any, p: Any) -> dict[str, Any]:
        return {"angular_momentum": q[0] * p[1] - q[1] * p[0]}


@cache
def chain_system(n: int) -> type[SpringNetwork]:
    """The class of chains with n masses."""
    if n < 2:
        raise TcbenchError(f"A chain has at least 2 masses, not {n}.")
    pairs = np.stack([np.r_[n, : n - 1], np.arange(n)], axis=1)  # the origin is point n
    names = {"__module__": __name__, "__qualname__": f"Chain{n}", "__doc__": f"A chain of {n} masses."}
    return Chain.over(pairs, np.zeros((1, 2)), **names)


def chain(n: int, **changes: Any) -> Scenario:
    """The scenario `chain_n`: a stretched line of n masses that swings, heated in waves; changes as for replace()."""
    i = np.arange(n)
    scenario = Scenario(
        name=f"chain_{n}",
        system=chain_system(n),
        constants={
            "masses": np.ones(n),
            "stiffness": np.full(n, 10.0),
            "natural_lengths": np.ones(n),
            "conductivity": 10.0,
            "reference_temperature": 300.0,
            "coupling": 0.2,
            "heat_capacity": 5.0,
        },
        positions=tuple(np.stack([1.1 * (i + 1), 0 * i], axis=1).ravel()),
        momenta=tuple(np.stack([0 * i, 0.5 * np.sin(0.7 * (i + 1))], axis=1).ravel()),
        temperatures=tuple(300 + 20 * np.cos(i)),
        t_end=25.0,
        dt=0.1,
        shows="cost against size",
        source="Romero (2009), section 4, with n masses instead of 2",
    )
    return scenario.replace(**changes) if changes else scenario


def chain_of(n: str) -> Scenario:
    """`chain` for the command line: n in words."""
    masses = whole_number(n, 2, MOST_MASSES)
    if masses is None:
        raise TcbenchError(
            f"A chain has a whole number of masses, at least 2 and at most {MOST_MASSES}, not {n[:30]!r}: chain[n=8]."
        )
    return chain(masses)


def __getattr__(name: str) -> Any:
    """Chain2, Chain3, ...: workers look the class of a scenario up by its name."""
    found = re.fullmatch(r"Chain([1-9]\d*)", name)
    if found is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return chain_system(int(found[1]))
