"""`SpringNetwork`: masses joined by thermoelastic springs, in a space of any dimension."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .network import Network
from .pendulum import Springs


class SpringNetwork(Network, Springs):
    """Springs as in the pendulum; each two that share a mass conduct heat. `over` gives the class of one net."""

    constants = {
        "masses": "point", "stiffness": "element", "natural_lengths": "element", "conductivity": (),
        "reference_temperature": (), "coupling": (), "heat_capacity": (),
    }  # fmt: skip

    @classmethod
    def over(cls, pairs: ArrayLike, anchors: ArrayLike, **body: str) -> type[SpringNetwork]:
        """The class of the net with these springs.

        pairs : numbers (m, 2) of the points that each joins: masses first, then the fixed `anchors` (k, d).
        body : `__module__`, `__qualname__` and `__doc__` of the class.
        """
        joined, fixed = np.asarray(pairs), np.asarray(anchors, dtype=float)
        d = fixed.shape[1]
        n = int(joined.max()) + 1 - len(fixed)
        tables = {
            "n_positions": d * n, "points": np.arange(d * n).reshape(n, d), "anchors": fixed.ravel(),
            "elements": (d * joined[:, :, None] + np.arange(d)).reshape(-1, 2 * d), "links": _meeting(joined, n),
        }  # fmt: skip
        return type(body["__qualname__"], (cls,), tables | body)

    def inertia(self) -> Any:
        return self.per_position(self.masses)

    def element_shape(self, q: Any) -> Any:
        """Squared length of a spring, from the coordinates of its two ends."""
        d = len(q) // 2
        first, *others = (q[d + k] - q[k] for k in range(d))
        return sum((x * x for x in others), first * first)

    def link(self, a: Any, b: Any) -> tuple[Any, Any]:
        """Eq. (22) for two springs."""
        return self.conductivity * ((b - a) / a), self.conductivity * ((a - b) / b)


def _meeting(pairs: NDArray[Any], n_masses: int) -> NDArray[Any]:
    """Each two springs that share a mass: numbers (n_links, 2)."""
    springs: dict[int, list[int]] = defaultdict(list)
    links = []
    for k, ends in enumerate(pairs.tolist()):
        for mass in ends:
            if mass < n_masses:
                links += [(other, k) for other in springs[mass]]
                springs[mass].append(k)
    return np.array(links)


def whole_number(text: str, least: int, most: int) -> int | None:
    """The number that a word of the command line is; None if it is none from `least` to `most`."""
    known = text.isascii() and text.isdecimal() and len(text) <= len(str(most))
    return int(text) if known and least <= int(text) <= most else None
