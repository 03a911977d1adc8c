"""`Canonical`: systems of positions q, momenta p and entropies s, as most continua are."""

from __future__ import annotations

from typing import Any

import numpy as np

from .system import System


class Canonical(System):
    """Hamilton's equations in q and p, entropies s that add up, and dE.s as temperatures; see `System`.

    A subclass declares its variables, of any shapes, and writes `energy` and `irreversible`. Source: Romero (2009),
    eqs. (15)-(19).
    """

    def entropy(self, z: Any) -> Any:
        return np.sum(z.s)

    def reversible(self, z: Any, dE: Any, dS: Any) -> Any:
        return {"q": dE.p, "p": -dE.q}

    def temperature(self, z: Any, dE: Any, dS: Any) -> Any:
        return dE.s


def conduction(theta: Any, pairs: Any, conductance: Any) -> Any:
    """Rates of entropies, shape (n,), by heat that flows between pairs of bodies; theta . rates is 0.

    theta : temperatures, shape (n,). pairs : table (m, 2) of bodies. conductance : a number or shape (m,), heat over
    time and difference of temperatures. Source: Romero (2009), eq. (22).
    """
    a, b = theta[pairs].T
    return pairs.sums(np.stack([conductance * ((b - a) / a), conductance * ((a - b) / b)], axis=1))
