"""Momenta p changed as little as possible, in the kinetic energy norm, to given values of invariants linear in p."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..compiler import derivatives as trace
from ..compiler.array_states import entries
from ..errors import TcbenchError
from .element_system import ElementSystem


def lengthening(p: Any, x: Any) -> Any:
    """What makes p (n,) carry 1 + x times its kinetic energy: sqrt(1 + x) - 1 with its digits, times p."""
    return p * (x / (1.0 + np.sqrt(1.0 + x)))


def restored_momenta(z0: Any, system: ElementSystem, invariants: dict[str, Any]) -> tuple[Any, Any]:
    """p (n_positions,) with these values of the invariants, and the part of it (n_positions,) that carries none.

    Raises TcbenchError for invariants that are not linear in the momenta.
    """
    inertia, p = system.inertia(), z0.p
    directions: list[tuple[Any, Any]] = []
    symbols = system.fresh("p", "position")
    for name, before in invariants.items():
        gradient = system.slopes(system.invariants(z0.q, symbols)[name], symbols)
        if trace.depends_on(entries(gradient), entries(symbols)) & {x.number for x in entries(gradient)}:
            raise TcbenchError(f"The invariant {name!r} is not linear in the momenta, which the projection needs.")
        direction = inertia * gradient
        for other, norm in directions:  # orthogonal in the kinetic energy: earlier invariants stay
            direction = direction - other * (np.sum(other * direction / inertia) / norm)
        norm = np.sum(direction * direction / inertia)
        p = p + direction * ((before - system.invariants(z0.q, p)[name]) / norm)
        directions.append((direction, norm))
    free = p
    for direction, norm in directions:
        free = free - direction * (np.sum(direction * free / inertia) / norm)
    return p, free
