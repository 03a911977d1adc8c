"""`SpringNetwork`: masses joined by thermoelastic springs, as many as you like, in the plane or in space."""

from __future__ import annotations

from collections import defaultdict
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from .canonical import conduction
from .pendulum import Springs


class SpringNetwork(Springs):
    """Springs as in the pendulum; each two that share a mass conduct heat. `springs_of` are a net's constants."""

    dimension: ClassVar[int] = 2
    constants = {
        "masses": ("point",), "stiffness": ("element",), "natural_lengths": ("element",), "anchors": ("anchor",),
        "conductivity": (), "reference_temperature": (), "coupling": (), "heat_capacity": (),
    }  # fmt: skip
    # of springs the coordinates of their ends, of links the springs, of coordinates the mass, of masses the coordinates
    tables = {
        "ends": ("element", 4, "position+anchor"), "pairs": ("link", 2, "element"), "owner": ("position", "point"),
        "places": ("point", 2, "position"),
    }  # fmt: skip

    def inertia(self) -> Any:
        return self.masses[self.owner]

    def shape(self, q: Any) -> Any:
        """Squared lengths of the springs."""
        ends = np.concatenate([q, self.anchors])[self.ends]
        return ((ends[:, self.dimension :] - ends[:, : self.dimension]) ** 2).sum(axis=1)

    def conduction(self, theta: Any) -> Any:
        """Eq. (22) for each two springs that share a mass."""
        return conduction(theta, self.pairs, self.conductivity)

    def points(self, q: Any) -> Any:
        """The ends of the springs in the plane; of one in space x and z."""
        d = self.dimension
        return np.concatenate([q, self.anchors])[self.ends].reshape(-1, 2, d)[:, :, [0, d - 1]]


def springs_of(pairs: ArrayLike, anchors: ArrayLike, **changes: Any) -> dict[str, Any]:
    """The tables and constants of the net with these springs, all alike but for the changes.

    pairs : numbers (m, 2) of the points that each joins: masses first, then the fixed `anchors` (k, d).
    """
    joined, fixed = np.asarray(pairs), np.asarray(anchors, dtype=float)
    d, m = fixed.shape[1], len(joined)
    n = int(joined.max()) + 1 - len(fixed)
    return {
        "ends": (d * joined[:, :, None] + np.arange(d)).reshape(-1, 2 * d), "pairs": _meeting(joined, n),
        "owner": np.repeat(np.arange(n), d), "places": np.arange(d * n).reshape(n, d), "anchors": fixed.ravel(),
        "masses": np.ones(n), "stiffness": np.full(m, 10.0), "natural_lengths": np.ones(m), "conductivity": 10.0,
        "reference_temperature": 300.0, "coupling": 0.2, "heat_capacity": 5.0,
    } | changes  # fmt: skip


def _meeting(pairs: Any, n_masses: int) -> Any:
    """Each two springs that share a mass: numbers (n_links, 2)."""
    springs: dict[int, list[int]] = defaultdict(list)
    links: list[tuple[int, int]] = []
    for k, ends in enumerate(pairs.tolist()):
        for mass in ends:
            if mass < n_masses:
                links += [(other, k) for other in springs[mass]]
                springs[mass].append(k)
    return np.array(links, dtype=np.int64).reshape(-1, 2)
