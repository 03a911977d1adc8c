"""A slot: one worker process at a time, one cell at a time, and a row for every way in which that can end.

Each worker has pipes of its own (`child`), so one that dies while it writes takes nobody with it. Deadlines follow the
monotonic clock, so that a laptop's sleep is not counted as computing.
"""

from __future__ import annotations

import contextlib
import json
import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..errors import TcbenchError
from ..store.cells import Cell
from ..store.encoding import plain, restore_nonfinite
from .child import READY, Child, how_it_died, signal_name
from .worker import cut, exception_row, read_tail, tail

START_LIMIT_S = 120.0  # a worker that has not imported the measuring code by then never will
START_ATTEMPTS = 3  # failures to start in a row, over all slots, before the remaining cells are given up
REAP_S = 0.01  # between looks at workers that are being killed
GONE_S = 10.0  # in which they are gone
LOG_LIMIT = 2**20  # bytes of output a cell may have; the file is emptied when it grows beyond


def needed(context: Mapping[str, Any], cell: Cell) -> set[str]:
    """The plugins, not tcbench's own, that a cell was planned to import."""
    names = (cell.integrator, cell.scenario, f"study {cell.study}")
    return {label for name in names for label in context.get("needs", {}).get(name, ())}


@dataclass(eq=False)
class Crew:
    """What the slots of one run share: the workers' settings, deadlines, and the memory of failed starts."""

    settings: dict[str, Any]
    timeout: float
    failed_starts: int = 0
    start_failure: dict[str, Any] = field(default_factory=dict)
    discarded: list[Child] = field(default_factory=list)  # workers that may still be dying
    seen: dict[tuple[str, str], set[str]] = field(default_factory=dict)  # plugins that cells of these have imported

    def __post_init__(self) -> None:
        self.told = Path(self.settings["logs"]) / "settings.json"
        try:
            self.told.write_text(json.dumps(self.settings, default=plain), encoding="utf-8")
        except OSError as error:
            raise TcbenchError(
                f"Temporary files cannot be written to {self.told.parent} ({error.strerror}): free some space there, "
                "or set TMPDIR to another folder."
            ) from error

    def needs(self, cell: Cell) -> set[str]:
        """Whose code a cell runs beside tcbench's own, as far as was planned or has been seen."""
        return needed(self.settings["context"], cell) | self.seen.get((cell.integrator, cell.scenario), set())

    def wait_for_the_dead(self) -> None:
        """Return when every discarded worker is gone, or after some seconds."""
        end = time.monotonic() + GONE_S
        while self.discarded and time.monotonic() < end:
            self.discarded = [worker for worker in self.discarded if worker.is_alive()]
            time.sleep(REAP_S if self.discarded else 0.0)


class Slot:
    """Runs cells one by one in a reused worker: `submit` one, then give `hear` what the worker says, and `check` the
    clock, until one of them returns the row."""

    def __init__(self, number: int, crew: Crew, wake: Callable[[Slot, Child, bytes | None], None]) -> None:
        self.cell: Cell | None = None
        self.exclusive = False  # wait for a discarded worker's death before starting the next one
        self.code: set[str] = set()  # plugins that the present worker has imported, beside tcbench's own
        self._crew = crew
        self._wake = wake  # called from another thread when a worker says something, or ends
        self._log = Path(crew.settings["logs"]) / f"output-{number}"  # of the present worker, and of one cell at a time
        self._child: Child | None = None
        self._ready = False
        self._opened = 0.0
        self._began: float | None = None
        self._attempts = 0
        self._served = 0  # cells that the present worker has ended
        self._kept_output = ""

    def submit(self, cell: Cell, extra: dict[str, Any]) -> dict[str, Any] | None:
        """Hand a cell to the worker. Returns its row at once when workers cannot be started, else None.

        A worker that has run a plugin's code, which may have patched numpy, serves cells of that plugin only, and has
        run nothing else before; a cell of a study that is "fresh" has a worker to itself.
        """
        code = self._crew.needs(cell)
        fresh = cell.study in self._crew.settings["context"].get("fresh", ())
        if self._served > 0 and (fresh or bool(self.code) != bool(code) or not self.code <= code):
            self.discard()
        self.cell, self._extra, self._attempts, self._kept_output = cell, extra, 0, ""
        if self._crew.failed_starts >= START_ATTEMPTS:
            return self._end(self._crew.start_failure)
        return self._launch()

    def hear(self, child: Child, line: bytes | None) -> dict[str, Any] | None:
        """The row of the cell, if what a worker says (None: that it is dead) makes one."""
        if child is not self._child:
            return None  # of one that was discarded
        if line is None:
            return self._died()
        if line == READY:
            self._ready, self._crew.failed_starts = True, 0
            self._began = time.monotonic() if self.cell else None
            return None
        return self._conclude(line) if self.cell else None

    def check(self) -> dict[str, Any] | None:
        """The row of a cell that has had its time, or whose worker has had its time to start; else None."""
        if self._child is None:
            return None
        self._cap_output()
        if self.cell is None:
            return None
        if not self._child.is_alive():
            self._child.kill()  # something that it has started holds its pipe open
        now = time.monotonic()
        if not self._ready:
            slow = now - self._opened > START_LIMIT_S
            return self._start_failed(f"took more than {START_LIMIT_S:g} s", slow) if slow else None
        return self._overdue(now)

    def was_stopped(self, seconds: float) -> None:
        """This process did not run for so long (a laptop's sleep, SIGSTOP): that is not counted as the cell's time."""
        self._began = self._began and self._began + seconds
        self._opened += seconds

    def discard(self) -> None:
        """Kill the worker, whatever it is doing, and what its cells have started."""
        child, self._child = self._child, None
        if child is None:
            return
        self._served, self.code = 0, set()
        child.kill()
        self._crew.discarded.append(child)
        if self.exclusive:
            self._crew.wait_for_the_dead()

    # -- the ways a cell can go

    def _launch(self) -> dict[str, Any] | None:
        assert self.cell is not None
        while self._child is None or not self._child.is_alive():
            self.discard()
            try:
                self._start()
            except OSError as error:  # the system cannot start another
                row = self._start_failed(f"{type(error).__name__}: {cut(str(error), 300)}", False, again=False)
                if row is not None:
                    return row
        if self._ready:  # what the cell before has printed
            with contextlib.suppress(OSError):
                os.truncate(self._log, 0)
        self._began = time.monotonic() if self._ready else None
        assert self._child is not None
        self._child.call("tcbench.engine.worker:run_cell", self.cell.as_dict(), self._extra)
        return None

    def _start(self) -> None:
        self._opened, self._ready = time.monotonic(), False
        with contextlib.suppress(OSError):  # one that is being killed may still write
            self._log.unlink()
        with open(self._log, "ab") as output:  # appending: after it was emptied writing goes on at its beginning
            self._child = Child(
                lambda child, line: self._wake(self, child, line), "tcbench.engine.worker:start", str(self._crew.told),
                output,
            )  # fmt: skip

    def _conclude(self, line: bytes) -> dict[str, Any] | None:
        assert self.cell is not None
        try:
            data = json.loads(line)
            if "raised" in data:
                raise RuntimeError(data["sentence"] or data["raised"])
            restore_nonfinite(data, data["nonfinite"])
            row = data["row"]
            self.code = set(row.pop("_plugins", ()))
            self._crew.seen[self.cell.integrator, self.cell.scenario] = self.code
        except Exception as error:
            row = exception_row(error)
        if "exception_type" in row:
            row["output_tail"] = self._output()
        if row.get("exception_type") == "MemoryError":
            if self._second_chance():
                return self._launch()
            self.discard()  # who knows what the worker still holds
        self._served += 1
        return self._end(row)

    def _overdue(self, now: float) -> dict[str, Any] | None:
        if self._began is None or now - self._began <= self._crew.timeout:
            return None
        self.discard()
        failure = f"The cell did not end within {self._crew.timeout:g} s and was stopped."
        row = {"status": "timeout", "failure": failure, "cell_time_s": now - self._began}
        return self._end(row | {"output_tail": self._output()})

    def _died(self) -> dict[str, Any] | None:
        assert self._child is not None
        code = self._child.process.returncode
        if self.cell is None:  # while it had nothing to do: nobody's fault
            self.discard()
            return None
        if not self._ready:
            return self._start_failed(f"killed the worker ({how_it_died(code)})", False)
        if self._second_chance():
            return self._launch()
        self.discard()
        row = crash_row(code) | {"output_tail": self._output()}
        return self._end(row | ({"cell_time_s": time.monotonic() - self._began} if self._began else {}))

    def _second_chance(self) -> bool:
        """Whether a cell that killed its worker goes again, in a new one.

        A thread or a timer of an earlier cell may have killed the worker, or its leaks filled the memory. In
        a new worker, once, the blame is certain.
        """
        if self._served == 0 or self._attempts > 0:
            return False
        self._attempts += 1
        self.discard()
        self._kept_output = ""
        return True

    def _start_failed(self, how: str, slow: bool, again: bool = True) -> dict[str, Any] | None:
        self._crew.failed_starts += 1
        self.discard()
        if self._crew.failed_starts < START_ATTEMPTS:
            return self._launch() if again else None
        self._crew.start_failure = {
            "status": "timeout" if slow else "crash",
            "failure": f"No worker could be started: importing {self._crew.settings['measure']!r} {how}.",
            "output_tail": read_tail(self._log),
        }
        return self._end(self._crew.start_failure)

    def _end(self, row: dict[str, Any]) -> dict[str, Any]:
        self.cell = None
        return row | self._extra

    # -- the cell's output

    def _cap_output(self) -> None:
        with contextlib.suppress(OSError):
            if self._log.stat().st_size > LOG_LIMIT:
                self._kept_output = read_tail(self._log)
                os.truncate(self._log, 0)

    def _output(self) -> str:
        """The end of what the cell printed."""
        return tail(self._kept_output + read_tail(self._log))


def crash_row(code: int | None) -> dict[str, Any]:
    """The row of a cell whose worker died: exit code and signal (None where unknown), and a sentence."""
    failure = f"The worker process died while it ran this cell ({how_it_died(code)})."
    return {"status": "crash", "failure": failure, "exit_code": code, "signal": signal_name(code)}
