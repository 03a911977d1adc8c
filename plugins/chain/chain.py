"""A chain of n masses in the plane and n thermoelastic springs, the first tied to the origin; the pendulum is n = 2.

A family of scenarios that shows cost against size. For small n it is a System like any other, and formulas are traced
for it. Tracing a step with thousands of unknowns is no use: for large n, `banded.py` has the monolithic method with a
banded Newton.
"""

from __future__ import annotations

import re
from functools import cache
from typing import Any

import numpy as np

from tcbench.errors import TcbenchError
from tcbench.systems.pendulum import Springs
from tcbench.systems.scenario import Scenario
from tcbench.systems.system import System

MOST_MASSES = 100_000  # the arrays of one state of more would hardly be meant
LONGEST_TRACED = 30  # masses; code and its compilation grow faster than n


class Chain(Springs):
    """Springs as in the pendulum; heat is conducted between neighbours. Subclasses fix n: see `chain_system`."""

    name = "chain"

    def springs(self, q: Any) -> Any:
        """Vectors along the springs, shape (n, 2)."""
        r = np.asarray(q).reshape(-1, 2)
        return np.concatenate([r[:1], r[1:] - r[:-1]])

    def shape(self, q: Any) -> Any:
        """Squared lengths of the springs."""
        r = self.springs(q)
        return r[:, 0] * r[:, 0] + r[:, 1] * r[:, 1]

    def conduction(self, theta: Any) -> Any:
        """Eq. (22) for each pair of neighbours."""
        theta = np.asarray(theta)
        gap = theta[1:] - theta[:-1]
        gained = np.concatenate([gap / theta[:-1], [0.0]]) - np.concatenate([[0.0], gap / theta[1:]])
        return self.conductivity * gained

    def invariants(self, q: Any, p: Any) -> dict[str, Any]:
        return {"angular_momentum": sum(q[0::2] * p[1::2] - q[1::2] * p[0::2])}

    def element_slopes(self, pi: Any, s: Any) -> tuple[Any, Any]:
        """In closed form for numbers; long chains are not traced."""
        if np.asarray(pi).dtype == object:
            return super().element_slopes(pi, s)
        theta = self.reference_temperature * np.exp((s - self.coupling * self.log_strain(pi)) / self.heat_capacity)
        stress = self.stiffness * self.log_strain(pi) - self.coupling * (theta - self.reference_temperature)
        return stress / (2 * pi), theta


@cache
def chain_system(n: int) -> type[System]:
    """The class of chains with n masses."""
    if n < 2:
        raise TcbenchError(f"A chain has at least 2 masses, not {n}.")
    each = dict.fromkeys(("masses", "stiffness", "natural_lengths"), (n,))
    common = dict.fromkeys(("conductivity", "reference_temperature", "coupling", "heat_capacity"), ())
    body = {"n_positions": 2 * n, "n_elements": n, "constants": each | common, "__module__": __name__}
    body["by_arrays"] = n > LONGEST_TRACED
    return type(f"Chain{n}", (Chain,), body | {"__doc__": f"A chain of {n} masses.", "__qualname__": f"Chain{n}"})


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
    if not (n.isascii() and n.isdecimal() and len(n) < 8 and int(n) <= MOST_MASSES):
        raise TcbenchError(
            f"A chain has a whole number of masses, at least 2 and at most {MOST_MASSES}, not {n[:30]!r}: chain[n=8]."
        )
    return chain(int(n))


def __getattr__(name: str) -> Any:
    """Chain2, Chain3, ...: workers look the class of a scenario up by its name."""
    found = re.fullmatch(r"Chain([1-9]\d*)", name)
    if found is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return chain_system(int(found[1]))
