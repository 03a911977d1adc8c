"""What a run has to measure and what it has written: which cells are left, the row of each, and who is told."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from ..errors import TcbenchError
from .cell import Cell
from .rows import Rows, is_finished


@dataclass(frozen=True, eq=False)
class Event:
    """Something a progress display may want to show.

    kind : "started", "finished" (status ok) or "failed" (any other status).
    done, failed, total : of the cells that this run has to run; `failed` of them ended with another status than ok.
    """

    kind: str
    cell: Cell
    row: Mapping[str, Any] | None
    done: int
    failed: int
    total: int
    running: int


@dataclass(eq=False)
class Summary:
    """What a run did. `statuses` counts the rows written by this run; `interrupted` is set after Ctrl-C."""

    planned: int = 0
    already_finished: int = 0
    run: int = 0
    statuses: Counter[str] = field(default_factory=Counter)
    interrupted: bool = False
    elapsed_s: float = 0.0

    @property
    def left(self) -> int:
        """Planned cells without a row: 0 unless the run was interrupted."""
        return self.planned - self.already_finished - self.run


def plan(
    cells: Iterable[Cell], store: Rows, retry_failed: bool = False, made_by: Mapping[str, str] | None = None,
    local: Collection[str] = (), machine: str = "",
) -> tuple[list[Cell], Summary]:  # fmt: skip
    """Which cells would run, and what is known of the run before it. made_by : by key what they would be made by.

    A final row is used again if it was made by the same, and on the same `machine` if it is a timing. Cells whose keys
    are in `local` are measured each time. Duplicate cells count once.
    """
    unique = list({cell.key: cell for cell in cells}.values())

    def is_kept(cell: Cell) -> bool:
        line = store.line(cell.key)
        if line is None or cell.key in local or line["made_by"] != (made_by or {}).get(cell.key, ""):
            return False
        row = line["row"]
        final = row.get("status") == "ok" if retry_failed else is_finished(row)
        return final and not (machine and cell.timed and row.get("machine", machine) != machine)

    to_run = [cell for cell in unique if not is_kept(cell)]
    return to_run, Summary(planned=len(unique), already_finished=len(unique) - len(to_run))


@dataclass
class Ledger:
    """Where the rows of a run go: each is written, counted and shown. made_by : by key what they are made by."""

    store: Rows
    summary: Summary
    on_event: Callable[[Event], None] | None
    total: int
    made_by: Mapping[str, str] = field(default_factory=dict)

    def start(self, cell: Cell, running: int) -> None:
        self._tell("started", cell, None, running)

    def write(self, cell: Cell, row: bytes, running: int, provenance: str | None = None) -> None:
        """Write the row of a cell; `TcbenchError` when that is not possible."""
        self.store.append(cell.key, row, cell.as_dict(), provenance, self.made_by.get(cell.key, ""))
        line = self.store.line(cell.key)
        assert line is not None
        status = str(line["row"].get("status"))
        self.summary.run += 1
        self.summary.statuses[status] += 1
        self._tell("finished" if status == "ok" else "failed", cell, line["row"], running)

    def _tell(self, kind: str, cell: Cell, row: Mapping[str, Any] | None, running: int) -> None:
        if self.on_event is not None:
            done, good = self.summary.run, self.summary.statuses["ok"]
            self.on_event(Event(kind, cell, row, done, done - good, self.total, running))


def check_limits(jobs: Any, timeout: Any, memory_limit: Any) -> None:
    """TcbenchError where one of them is no limit: known before anything is written, or earlier rows are set aside."""
    if jobs is not None and not (isinstance(jobs, int) and jobs >= 1):
        raise TcbenchError(f"jobs is {jobs!r}; it is a whole number, and at least one worker is needed.")
    if not timeout > 0:
        raise TcbenchError(f"timeout is {timeout}; give the seconds that a cell may take, for example 60.")
    if memory_limit is not None and memory_limit < 64 * 2**20:
        raise TcbenchError(f"memory_limit is {memory_limit} bytes; a worker needs at least 64 MiB to start.")
