"""Cells to rows: run what is not finished yet, each cell in a worker process, under a deadline, one row each.

Ordinary cells run side by side on `jobs` workers. Timed cells run afterwards, one at a time, in one of these, which
has traced and loaded most of what they need (those of a further `turn` in another, after all of the one before), and
in an order shuffled by a seeded generator, while no other worker has anything to do; their rows say so (`timed`,
`shuffle_order`, `shuffle_seed`). The parent is the only writer: it appends each row as it comes, so nothing finished
is lost with a process.

What becomes of a misbehaving cell (all others are unaffected):

- a hang: `timeout`, killed `timeout` seconds after it started in the worker;
- an exception, SystemExit, a row that is not JSON: `exception`, with type, message (cut), end of the traceback;
- memory beyond `memory_limit`: `exception` of type MemoryError, or `crash` where C code gives up;
- a segfault, `os._exit`, kill -9: `crash`, with exit code, signal and the end of what the cell printed;
- printing without end: only the end is kept, no terminal or disk fills up.

A cell that kills a worker in which others have run before gets a second try in a new one, so that it is not
blamed for a thread or a leak that an earlier cell left behind.

On resume `crash`, `timeout`, MemoryError and MachineError (a full disk) run again, for they depend on the machine and
the limits; everything else is final.
"""

from __future__ import annotations

import contextlib
import os
import queue
import random
import shutil
import stat
import tempfile
import time
from collections import Counter, deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..errors import TcbenchError
from ..store.cells import Cell
from ..store.cores import usable_cores
from ..store.disk import hold_lock
from ..store.rows import Rows, is_finished
from .child import Child
from .reuse import Reuse
from .worker_slot import Crew, Slot, needed

TICK_S = 0.05  # how often deadlines are looked at
SEED = 0  # of the order of timed cells
STOPPED_S = 2.0  # between two looks: this process was stopped, and with it perhaps the workers


@dataclass(frozen=True, eq=False)
class Event:
    """Something a progress display may want to show.

    kind : "started", "finished" (status ok) or "failed" (any other status).
    done, failed, total : of the cells that this run has to run; `failed` of them ended with another status
        than ok.
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
    cells: Iterable[Cell], store: Rows, retry_failed: bool = False,
    context: Mapping[str, Any] | None = None, here: Collection[str] = (), machines: Collection[str] = (),
) -> tuple[list[Cell], Summary]:  # fmt: skip
    """Which cells would run, and what is known of the run before it: how many are planned, and how many finished.

    A final row is used again where what it read is as it was (`reuse`; context: of the job), and where a timing is of
    the cell's machine, or of one of `machines`. Cells whose keys are in `here` are measured each time. Duplicate cells
    count once.
    """
    unique = list({cell.key: cell for cell in cells}.values())
    rows = store.rows()
    reuse = Reuse(store, context or {})

    def is_kept(cell: Cell, row: Mapping[str, Any]) -> bool:
        final = row.get("status") == "ok" if retry_failed else is_finished(row)
        own = row.get("machine", cell.machine) in {cell.machine, *machines}
        return final and own and cell.key not in here and not reuse.reason(cell, row)

    finished = {cell.key for cell in unique if cell.key in rows and is_kept(cell, rows[cell.key])}
    to_run = [cell for cell in unique if cell.key not in finished]
    return to_run, Summary(planned=len(unique), already_finished=len(unique) - len(to_run))


def run_cells(
    cells: Iterable[Cell],
    measure: str,
    context: Mapping[str, Any],
    store: Rows,
    *,
    jobs: int | None = None,
    timeout: float = 60.0,
    memory_limit: int | None = None,
    on_event: Callable[[Event], None] | None = None,
    retry_failed: bool = False,
) -> Summary:
    """Run every cell that has no final row in `store` yet, and append exactly one row for each.

    Parameters
    ----------
    measure : "package.module:function", called in a worker as `function(cell: dict, context: dict) -> dict`.
    context : JSON values passed to every call. "needs" names by integrator, scenario or study the plugins, not
        tcbench's own, that their cells import: a worker that has imported one serves no cell without it. "fresh" names
        studies whose cells each have a new worker. "marks" are what rows say of what measured them.
    store : an open `Store`, or `Rows` to keep the rows in memory.
    jobs : worker processes; the cores this process may use by default.
    timeout : seconds a cell may take, from its start in the worker; importing `measure` is not counted.
    memory_limit : bytes of address space a worker may have (not on Windows; macOS does not enforce it).
    retry_failed : run again whatever has a status other than ok.

    Each row gets `status`, `failure` (a sentence, empty when ok), `cell_time_s` (wall time in the worker),
    `wall_time_s` (the same unless `measure` gives its own) and `timed`. Ctrl-C kills the workers, keeps what
    is done and returns with `interrupted`. Raises `TcbenchError` when a row cannot be written; the workers
    are dead by then and the rows before it are safe.
    """
    jobs = usable_cores() if jobs is None else jobs
    check_limits(jobs, timeout, memory_limit)
    module, colon, function = measure.partition(":")
    if not (module and colon and function):
        raise TcbenchError(f"measure is {measure!r}; write it as 'package.module:function'.")
    began = time.monotonic()
    to_run, summary = plan(cells, store, retry_failed, context)
    if not to_run:
        return summary
    # cells of one plugin in a row: its worker is used for nothing else
    ordered = sorted(compiled_once(to_run), key=lambda cell: sorted(needed(context, cell)))
    together = [(cell, {"timed": False}) for cell in ordered if not cell.timed]
    alone = [cell for cell in to_run if cell.timed]
    random.Random(SEED).shuffle(alone)
    one_by_one = [
        (cell, {"timed": True, "shuffle_order": order, "shuffle_seed": SEED}) for order, cell in enumerate(alone)
    ]
    marks = context.get("marks", {})
    with _log_folder() as logs:
        known = {**context, "timeout": timeout, "shared_runs": logs}  # which a cell may want to know of itself
        settings = {"measure": measure, "context": known, "memory_limit": memory_limit, "logs": logs}
        turns = sorted({cell.options.get("turn", 1) for cell in alone})
        ledger = Ledger(store, summary, on_event, len(to_run), marks)
        run = _Run(ledger, Crew(settings, timeout), max(jobs, len(turns)))
        try:
            run.all(together, run.slots[:jobs])
            run.keep_for_timing(len(turns))
            for turn, slot in zip(turns, run.slots, strict=False):  # each in a process of its own
                run.all([work for work in one_by_one if work[0].options.get("turn", 1) == turn], [slot])
                slot.discard()
        except KeyboardInterrupt:
            summary.interrupted = True
        finally:
            run.end()
    summary.elapsed_s = time.monotonic() - began
    return summary


def compiled_once(cells: Sequence[Cell]) -> list[Cell]:
    """The cells in an order in which neighbours compile different things, so that two workers seldom compile the same.

    First one cell of each integrator, then one on each of its scenarios, then all the others, which find every kernel
    in the cache.
    """
    turns: list[list[Cell]] = [[], [], []]
    seen: set[tuple[str, ...]] = set()
    for cell in cells:
        pair = (cell.integrator, cell.scenario)
        turns[0 if pair[:1] not in seen else 1 if pair not in seen else 2].append(cell)
        seen |= {pair[:1], pair}
    return [cell for turn in turns for cell in turn]


LOGS = "tcbench-logs-"  # beginning of the names of temporary folders


@contextlib.contextmanager
def _log_folder() -> Iterator[str]:
    """A temporary folder for what cells print; those of runs that were killed are removed.

    Each holds the lock of its folder, which the system drops when its process dies. A folder is a minute old before
    others look at it, so that none is taken between its making and its locking.
    """
    owner = getattr(os, "getuid", lambda: 0)()
    for old in Path(tempfile.gettempdir()).glob(f"{LOGS}*"):
        with contextlib.suppress(OSError, TcbenchError):
            found = old.lstat()
            if found.st_uid != owner or not stat.S_ISDIR(found.st_mode):
                continue  # of another user, who may have put anything there
            if time.time() - found.st_mtime > 60 and (old / ".lock").exists():
                with hold_lock(old / ".lock"):
                    shutil.rmtree(old, ignore_errors=True)
    with (
        tempfile.TemporaryDirectory(prefix=LOGS, ignore_cleanup_errors=True) as folder,
        hold_lock(Path(folder) / ".lock"),
    ):
        yield folder


@dataclass
class Ledger:
    """Where the rows of a run go: each is written, counted and shown.

    total : cells that the run has to run. marks : what rows say of what measured them, those of crashes, too: of the
        code under all, and by name of integrators and scenarios.
    """

    store: Rows
    summary: Summary
    on_event: Callable[[Event], None] | None
    total: int
    marks: Mapping[str, Any] = field(default_factory=dict)

    def start(self, cell: Cell, running: int) -> None:
        """Show that a cell begins."""
        self._tell("started", cell, None, running)

    def write(self, cell: Cell, row: dict[str, Any], running: int, provenance: str | None = None) -> None:
        """Write the row of a cell; `TcbenchError` when that is not possible."""
        if self.marks:
            row["source_hash"] = self.marks["integrators"].get(cell.integrator, "")
            row["scenario_fields"] = self.marks["scenarios"].get(cell.scenario, "")
            row["measured_by"] = self.marks["code"]
        self.store.append(cell.key, row, cell.as_dict(), provenance)
        status = str(row.get("status"))
        self.summary.run += 1
        self.summary.statuses[status] += 1
        self._tell("finished" if status == "ok" else "failed", cell, row, running)

    def _tell(self, kind: str, cell: Cell, row: Mapping[str, Any] | None, running: int) -> None:
        if self.on_event is not None:
            done, good = self.summary.run, self.summary.statuses["ok"]
            self.on_event(Event(kind, cell, row, done, done - good, self.total, running))


class _Run:
    """The state of one `run_cells`: so many slots, kept busy."""

    def __init__(self, ledger: Ledger, crew: Crew, slots: int) -> None:
        self.ledger, self.crew = ledger, crew
        self.running = 0
        self.said: queue.SimpleQueue[tuple[Slot, Child, bytes | None]] = queue.SimpleQueue()
        self.slots = [Slot(number, crew, lambda *words: self.said.put(words)) for number in range(slots)]

    def all(self, work: Sequence[tuple[Cell, dict[str, Any]]], slots: Sequence[Slot]) -> None:
        """Run the cells on these slots, whose workers stay."""
        waiting = deque(work)
        for slot in slots:
            self._feed(slot, waiting)
        last_look = time.monotonic()
        while self.running:
            with contextlib.suppress(queue.Empty):
                slot, child, line = self.said.get(timeout=TICK_S)
                self._done(slot, slot.cell, slot.hear(child, line), waiting)
            if (since := time.monotonic() - last_look) > TICK_S:
                last_look = time.monotonic()
                for slot in slots:
                    if since > STOPPED_S:
                        slot.was_stopped(since)
                    self._done(slot, slot.cell, slot.check(), waiting)

    def keep_for_timing(self, count: int) -> None:
        """So many workers stay, idle, if nobody else's code is in them; all others are gone on return."""
        for i, slot in enumerate(self.slots):
            slot.exclusive = True
            if i >= count or slot.code:
                slot.discard()
        self.crew.wait_for_the_dead()

    def end(self) -> None:
        """No worker is left."""
        for slot in self.slots:
            slot.exclusive = False
            slot.discard()
        self.crew.wait_for_the_dead()

    def _done(
        self, slot: Slot, cell: Cell | None, row: dict[str, Any] | None, waiting: deque[tuple[Cell, dict[str, Any]]]
    ) -> None:
        if row is not None and cell is not None:
            # feed first: the worker computes while the row is being written
            self.running -= 1
            self._feed(slot, waiting)
            self.ledger.write(cell, row, self.running)

    def _feed(self, slot: Slot, waiting: deque[tuple[Cell, dict[str, Any]]]) -> None:
        while waiting:
            cell, extra = waiting.popleft()
            self.running += 1
            self.ledger.start(cell, self.running)
            row = slot.submit(cell, extra)
            if row is None:
                return
            self.running -= 1
            self.ledger.write(cell, row, self.running)


def check_limits(jobs: Any, timeout: Any, memory_limit: Any) -> None:
    """TcbenchError where one of them is no limit: known before anything is written, or earlier rows are set aside."""
    if jobs is not None and not (isinstance(jobs, int) and jobs >= 1):
        raise TcbenchError(f"jobs is {jobs!r}; it is a whole number, and at least one worker is needed.")
    if not timeout > 0:
        raise TcbenchError(f"timeout is {timeout}; give the seconds that a cell may take, for example 60.")
    if memory_limit is not None and memory_limit < 64 * 2**20:
        raise TcbenchError(f"memory_limit is {memory_limit} bytes; a worker needs at least 64 MiB to start.")
