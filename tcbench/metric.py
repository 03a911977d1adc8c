"""`Metric`: one further number of each trajectory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .simulation.trajectory import Trajectory


@dataclass(frozen=True)
class Metric:
    """A further column: `compute(trajectory)` -> float. `unit` is shown beside its name."""

    name: str
    compute: Callable[[Trajectory], float]
    unit: str = ""
    description: str = ""
    plugin: str = ""
