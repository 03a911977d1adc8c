"""`Metric`: one further number of each trajectory. `Observable`: one further number of each of its states."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

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


@dataclass(frozen=True)
class Observable:
    """A further quantity over time: `compute(trajectory)` -> numbers, one for each recorded time, shape (m,).

    For `Trajectory.to_frame`, `plot` and `observe`. `unit` is shown beside its name.

        Observable("kinetic", lambda run: (run.z[:, 4:8] ** 2).sum(axis=1) / 2)
    """

    name: str
    compute: Callable[[Trajectory], NDArray[np.float64]]
    unit: str = ""
    description: str = ""
