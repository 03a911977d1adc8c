"""How long a run will still take, from what cells like those that are left have taken; nothing where none have."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any

from .cell import Cell

GROUND = 0.5  # of the cells that are left have had one of their study and method, or there is no ground for a number


class Remaining:
    """Seconds to go of cells on `jobs` workers; timed ones run alone. Other studies, and other methods of a study, may
    cost a thousand times as much, so a mean over all cells says nothing."""

    def __init__(self, cells: Iterable[Cell], jobs: int, earlier: Iterable[Mapping[str, Any]] = ()) -> None:
        """earlier : lines of the store, whose rows tell what cells took in runs before."""
        self._left = Counter((cell.study, cell.integrator, cell.timed) for cell in cells)
        self._jobs, self._estimate, self._at = jobs, None, time.monotonic()  # type: int, float | None, float
        self._times: dict[tuple[str, ...], tuple[float, int]] = {}  # sum and count
        for line in earlier:
            if line["cell"]:
                self._learn(str(line["cell"].get("study")), str(line["cell"].get("integrator")), line["row"])
        self._estimate = self._sum()

    def finished(self, cell: Cell, row: Mapping[str, Any]) -> None:
        """A cell has ended with this row."""
        self._left[cell.study, cell.integrator, cell.timed] -= 1
        self._learn(cell.study, cell.integrator, row)
        self._estimate, self._at = self._sum(), time.monotonic()

    def seconds(self) -> float | None:
        """Seconds still to go; None without ground for a number, and when the time that was told is over."""
        left = None if self._estimate is None else self._estimate - (time.monotonic() - self._at)
        return left if left is not None and left > 0 else None

    def _learn(self, study: str, integrator: str, row: Mapping[str, Any]) -> None:
        taken = row.get("cell_time_s")
        if isinstance(taken, int | float):
            for names in ((study,), (study, integrator)):
                total, count = self._times.get(names, (0.0, 0))
                self._times[names] = total + float(taken), count + 1

    def _sum(self) -> float | None:
        total, seen = 0.0, 0
        for (study, integrator, timed), count in (+self._left).items():
            own = self._times.get((study, integrator))
            times = own or self._times.get((study,))
            if times is None:
                return None
            seen += count if own else 0
            total += count * times[0] / times[1] / (1 if timed else self._jobs)
        return total if seen >= GROUND * (+self._left).total() else None
