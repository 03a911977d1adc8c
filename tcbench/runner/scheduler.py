"""Cells to rows: what is not finished yet, each integrator's cells in a process of its own, under a deadline.

Ordinary cells run side by side on `jobs` processes, one an integrator; a process that has nothing left takes half of
what another has. Timed cells run afterwards, one at a time and nothing beside them, the methods and the cells of each
in an order shuffled by a seeded generator (`shuffle_order`, `shuffle_seed` in their rows). The parent is the only
writer: it appends each row as it comes, so nothing finished is lost with a process.

A cell that hangs is killed at the deadline (`timeout`); what Python catches is `exception`; a process that dies is
`crash`, with exit code, signal and the end of what it printed. All others are unaffected. On resume crash, timeout and
what the machine did (memory, disk) run again; everything else is final.
"""

from __future__ import annotations

import contextlib
import os
import queue
import random
import shutil
import tempfile
import time
from collections import Counter, defaultdict, deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from ..errors import TcbenchError
from .cell import Cell
from .child import READY, Child, how_it_died, signal_name
from .codec import from_json, row_bytes, to_json
from .ledger import Event, Ledger, Summary, check_limits, plan
from .provenance import usable_cores
from .rows import Rows, Store
from .worker import cut, read_tail

TICK_S = 0.05  # how often deadlines are looked at
SEED = 0  # of the order of timed cells
STOPPED_S = 2.0  # between two looks: this process was stopped, and with it perhaps the workers
START_LIMIT_S = 120.0  # a worker that has not imported the measuring code by then never will
START_ATTEMPTS = 2  # failures to start in a row before the other cells of an integrator are given up
LOG_LIMIT = 2**20  # bytes of output a worker may have; the file is emptied when it grows beyond
IDLE = 8  # processes that wait, idle, for the timed cells of their integrators
SPLIT = 4  # cells that an integrator must have left for a second process to take half of them


def run_cells(
    cells: Iterable[Cell], measure: str, context: Mapping[str, Any], store: Rows, *, jobs: int | None = None,
    timeout: float = 60.0, memory_limit: int | None = None, on_event: Callable[[Event], None] | None = None,
    retry_failed: bool = False, machine: str = "",
) -> Summary:  # fmt: skip
    """Run every cell that has no final row in `store` yet, and append exactly one row for each.

    measure : "package.module:function", called in a worker as `function(cell: dict, context: dict) -> dict`.
    context : JSON values passed to every call (`plan.Context`). jobs : processes; the usable cores by default.
    timeout : seconds a cell may take, from its start in the worker; imports are not counted.
    memory_limit : bytes of address space a worker may have. retry_failed : whatever has a status other than ok.

    Ctrl-C kills the workers, keeps what is done and returns with `interrupted`. Raises `TcbenchError` when a row cannot
    be written; the workers are dead by then and the rows before it are safe.
    """
    jobs = usable_cores() if jobs is None else jobs
    check_limits(jobs, timeout, memory_limit)
    module, colon, function = measure.partition(":")
    if not (module and colon and function):
        raise TcbenchError(f"measure is {measure!r}; write it as 'package.module:function'.")
    began = time.monotonic()
    to_run, summary = plan(cells, store, retry_failed, context.get("made_by"), machine=machine)
    if not to_run:
        return summary
    with _work_folder(store) as work:
        context = {**context, "timeout": timeout, "shared_runs": work}  # which a cell may want to know of itself
        settings = {"measure": measure, "context": context, "memory_limit": memory_limit}
        ledger = Ledger(store, summary, on_event, len(to_run), context.get("made_by", {}))
        crew = Crew(ledger, settings, timeout, Path(work))
        try:
            crew.later = {cell.integrator for cell in to_run if cell.timed}
            crew.all([cell for cell in to_run if not cell.timed], jobs)
            crew.later = set()
            crew.all([cell for cell in to_run if cell.timed], 1, random.Random(SEED))
        except KeyboardInterrupt:
            summary.interrupted = True
        finally:
            crew.end()
    summary.elapsed_s = time.monotonic() - began
    return summary


@contextlib.contextmanager
def _work_folder(store: Rows) -> Iterator[str]:
    """For what workers print and share: in the run's folder, where the next run removes what a killed one has left."""
    if isinstance(store, Store):
        store.work.mkdir(exist_ok=True)
        yield str(store.work.resolve())
        shutil.rmtree(store.work, ignore_errors=True)
    else:
        with tempfile.TemporaryDirectory(prefix="tcbench-", ignore_cleanup_errors=True) as folder:
            yield folder


Work = tuple[Cell, dict[str, Any]]  # and what its row says beside what is measured


class Crew:
    """The processes of a run."""

    def __init__(self, ledger: Ledger, settings: Mapping[str, Any], timeout: float, folder: Path) -> None:
        self.ledger, self.settings, self.timeout, self.folder = ledger, settings, timeout, folder
        self.messages: queue.SimpleQueue[tuple[Worker, Child, bytes | None]] = queue.SimpleQueue()
        self.busy: list[Worker] = []
        self.later: set[str] = set()  # integrators whose timed cells are still to come
        self.idle: dict[str, Worker] = {}
        self.failed_starts: Counter[str] = Counter()  # in a row, by integrator
        self.given_up: dict[str, str] = {}  # and why
        self.started = 0

    def all(self, cells: Collection[Cell], jobs: int, shuffled: random.Random | None = None) -> None:
        """Run the cells, those of each integrator in one process."""
        groups = defaultdict(list)
        for cell in cells:
            groups[cell.integrator].append(cell)
        order = sorted(groups.values(), key=len, reverse=True)[
            ::-1
        ]  # taken from the end: the longest, the first of them
        if shuffled:
            order = shuffled.sample(order, len(order))
            order = [shuffled.sample(group, len(group)) for group in order]
        number = iter(range(len(cells)))
        shuffles = {"timed": True, "shuffle_seed": SEED}
        waiting = [
            deque((c, shuffles | {"shuffle_order": next(number)} if shuffled else {"timed": False}) for c in group)
            for group in order
        ]
        if shuffled:
            waiting.reverse()
        last_look = time.monotonic()
        while waiting or self.busy:
            self._staff(waiting, jobs)
            with contextlib.suppress(queue.Empty):
                worker, child, line = self.messages.get(timeout=TICK_S)
                worker.hear(child, line)
            since, last_look = time.monotonic() - last_look, time.monotonic()
            for worker in self.busy:
                worker.check(since if since > STOPPED_S else 0.0)
            self.busy = [worker for worker in self.busy if worker.cell is not None]

    def _staff(self, waiting: list[deque[Work]], jobs: int) -> None:
        while len(self.busy) < jobs:
            if not waiting:
                longest = max((w.left for w in self.busy), key=len, default=deque[Work]())
                if len(longest) < SPLIT:
                    return
                waiting.append(deque(reversed([longest.pop() for _ in range(len(longest) // 2)])))
            left = waiting.pop()
            worker = self.idle.pop(left[0][0].integrator, None) or Worker(self, left)
            worker.left = left
            self.busy.append(worker)
            worker.next()
            if worker.cell is None:
                self.busy.remove(worker)

    def running(self) -> int:
        return sum(worker.cell is not None for worker in self.busy)

    def end(self) -> None:
        for worker in (*self.busy, *self.idle.values()):
            worker.discard()


class Worker:
    """The cells of one integrator in one process at a time; a row for every way in which a cell can end."""

    def __init__(self, crew: Crew, left: deque[Work]) -> None:
        self.crew, self.left = crew, left
        self.cell: Cell | None = None
        self._extra: dict[str, Any] = {}
        self._child: Child | None = None
        self._ready = self._was_cut = False
        self._opened = self._began = 0.0
        crew.started += 1
        self._log = crew.folder / f"output-{crew.started}"

    def next(self) -> None:
        """Begin the next cell; where none is left the process ends."""
        before, self.cell = self.cell, None
        while self.left and self.cell is None:
            self.cell, self._extra = self.left.popleft()
            self.crew.ledger.start(self.cell, self.crew.running())
            if self._give_up():
                self.cell = None
                continue
            if self.cell.study in self.crew.settings["context"].get("fresh", ()):
                self.discard()
            try:
                if self._child is None:
                    self._start()
                elif self._ready:  # what the cell before has printed
                    os.truncate(self._log, 0)
            except OSError as error:
                self._write({"status": "crash", "failure": f"No worker could be started: {cut(str(error), 300)}"})
                self.cell = None
                continue
            assert self._child is not None
            self._began = time.monotonic()
            self._child.call(self.cell.as_dict(), self._extra)
        if self.cell is None:
            crew = self.crew
            if before and self._child and self._ready and before.integrator in crew.later and len(crew.idle) < IDLE:
                crew.idle.setdefault(before.integrator, self)
            if self not in crew.idle.values():
                self.discard()

    def hear(self, child: Child, line: bytes | None) -> None:
        """What the process says (None: that it is dead)."""
        if child is not self._child or self.cell is None:
            return  # of one that was discarded
        if line == READY:
            self._ready, self._began = True, time.monotonic()
            self.crew.failed_starts.pop(self.cell.integrator, None)
        elif line is None:
            code = child.process.returncode
            self.discard()
            if self._ready:
                self._end(crash_row(code) | {"cell_time_s": time.monotonic() - self._began})
            else:
                self._start_failed(how_it_died(code))
        else:
            self._end(line)

    def check(self, stopped: float) -> None:
        """The clock. stopped : seconds that this process did not run (a laptop's sleep), which are not the cell's."""
        self._began, self._opened, now = self._began + stopped, self._opened + stopped, time.monotonic()
        with contextlib.suppress(OSError):
            if self._log.stat().st_size > LOG_LIMIT:
                kept = read_tail(self._log)
                os.truncate(self._log, 0)
                self._log.write_text(kept, errors="replace")
                self._was_cut = True
        if self._child is None or self.cell is None:
            return
        if not self._child.is_alive():
            self._child.kill()  # something that it has started holds its pipe open
        if self._ready and self._overdue(now):
            self.discard()
            failure = f"The cell did not end within {self.crew.timeout:g} s and was stopped."
            self._end({"status": "timeout", "failure": failure, "cell_time_s": now - self._began})
        elif not self._ready and now - self._opened > START_LIMIT_S:
            self.discard()
            self._start_failed(f"it took more than {START_LIMIT_S:g} s")

    def _overdue(self, now: float) -> bool:
        return now - self._began > self.crew.timeout

    def discard(self) -> None:
        """Kill the process, whatever it is doing."""
        child, self._child = self._child, None
        if child is not None:
            child.kill()
            child.process.wait()  # the next timing does not share the machine with it

    def _start(self) -> None:
        assert self.cell is not None
        context = self.crew.settings["context"]
        brought = context.get("brought_by", {}).get(self.cell.integrator, [])
        settings = self._log.with_suffix(".json")
        settings.write_bytes(to_json({**self.crew.settings, "brought_by": brought}))
        self._opened, self._ready = time.monotonic(), False
        with open(self._log, "wb"):
            pass
        with open(self._log, "ab") as output:  # appending: after it was emptied writing goes on at its beginning
            self._child = Child(lambda c, line: self.crew.messages.put((self, c, line)), settings, output)

    def _start_failed(self, how: str) -> None:
        """Try again; after some attempts all that is left of this integrator is given up."""
        assert self.cell is not None
        name = self.cell.integrator
        self.crew.failed_starts[name] += 1
        if self.crew.failed_starts[name] < START_ATTEMPTS:
            self.left.appendleft((self.cell, self._extra))
        else:
            self.crew.given_up[name] = f"No worker could be started: importing its code ended it ({how})."
            self._give_up()
        self.next()

    def _give_up(self) -> bool:
        """Write the row of a cell whose integrator has been given up, if it has."""
        assert self.cell is not None
        if failure := self.crew.given_up.get(self.cell.integrator, ""):
            self._write({"status": "crash", "failure": failure, "output_tail": read_tail(self._log)})
        return bool(failure)

    def _end(self, row: bytes | dict[str, Any]) -> None:
        if isinstance(row, bytes) and b'"exception_type"' in row:
            row = from_json(row)
        if isinstance(row, dict):
            row |= {"output_tail": read_tail(self._log)}
            if row.get("exception_type") == "MemoryError":
                self.discard()  # who knows what it still holds
        cell, extra = self.cell, self._extra
        self.next()  # first: the process computes while the row is being written
        self._write(row, cell, extra)

    def _write(
        self, row: bytes | dict[str, Any], cell: Cell | None = None, extra: Mapping[str, Any] | None = None
    ) -> None:
        cell, extra = cell or self.cell, self._extra if extra is None else extra
        assert cell is not None
        content = row.rstrip(b"\n") if isinstance(row, bytes) else row_bytes(row | dict(extra))
        self.crew.ledger.write(cell, content, self.crew.running())


def crash_row(code: int | None) -> dict[str, Any]:
    """The row of a cell whose worker died: exit code and signal (None where unknown), and a sentence."""
    failure = f"The worker process died while it ran this cell ({how_it_died(code)})."
    return {"status": "crash", "failure": failure, "exit_code": code, "signal": signal_name(code)}
