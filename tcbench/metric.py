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
    """A further column of the conservation table: one number a run.

    Parameters
    ----------
    name : str
        Of the column.
    compute : function
        compute(trajectory) -> float, from states of shape (m, n).
    unit : str
        Shown beside the name on the page; "" if dimensionless.
    description : str
        A sentence, shown on the page under How it was measured.
    label : str
        On the axes of charts; the name if there is none.
    worse : str
        Which values are worse, for `tcbench compare`: as of a `Column`.
    plugin : str
        Filled in by the registry.

    Raises
    ------
    TcbenchError
        Not here: an exception in `compute` is told in the row.

    References
    ----------
    docs/measures.md.
    """

    name: str
    compute: Callable[[Trajectory], float]
    unit: str = ""
    description: str = ""
    label: str = ""
    worse: str = ""
    plugin: str = ""


@dataclass(frozen=True)
class Observable:
    """A further quantity over time, for `Trajectory.to_frame`, `plot` and `observe`.

        Observable("kinetic", lambda run: (run.z[:, 4:8] ** 2).sum(axis=1) / 2)

    Parameters
    ----------
    name : str
        Of the column.
    compute : function
        compute(trajectory) -> numbers, one for each recorded time, shape (m,).
    unit : str
        Shown beside the name; "" if dimensionless.
    description : str
        A sentence.

    Raises
    ------
    TcbenchError
        When it is used, if its values do not have shape (m,).

    References
    ----------
    docs/measures.md.
    """

    name: str
    compute: Callable[[Trajectory], NDArray[np.float64]]
    unit: str = ""
    description: str = ""
