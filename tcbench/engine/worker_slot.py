"""A slot: one worker process at a time, one cell at a time, and a row for every way in which that can end.

Each slot is a `pebble.ProcessPool` of one worker, because the workers of a shared pool share a pipe and a
lock: one that dies while it holds them stalls the others for a minute and then takes innocent cells with it.
Three more things that pebble (5.2) leaves open are closed here: a worker that leaves with exit code 0 in the
middle of a task is noticed (a ping queued behind the cell is answered by its successor), a pool that breaks
is replaced and its cell gets a second chance, and deadlines follow the monotonic clock, so that a laptop's
sleep is not counted as computing.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from multiprocessing import resource_tracker
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..store.cells import Cell
from ..store.encoding import restore_nonfinite
from .starting import Context, Process, safe_path
from .worker import cut, exception_row, kill_with_all, ping, read_tail, run_cell, start, tail, warm_up

if TYPE_CHECKING:
    from pebble import ProcessFuture, ProcessPool

START_LIMIT_S = 120.0  # a worker that has not imported the measuring code by then never will
START_ATTEMPTS = 3  # failures to start in a row, over all slots, before the remaining cells are given up
PING_AFTER_S = 0.3
REAP_S = 0.01  # between looks at workers that are being killed
LOST_AFTER_S = 30.0  # a cell that a live, idle worker has not taken up by then was lost on the way
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
    discarded: list[list[Process]] = field(default_factory=list)  # workers that may still be dying
    seen: dict[tuple[str, str], set[str]] = field(default_factory=dict)  # plugins that cells of these have imported

    def needs(self, cell: Cell) -> set[str]:
        """Whose code a cell runs beside tcbench's own, as far as was planned or has been seen."""
        return needed(self.settings["context"], cell) | self.seen.get((cell.integrator, cell.scenario), set())

    def wait_for_the_dead(self, limit: float = 10.0) -> None:
        """Return when every discarded worker is gone, or after `limit` seconds."""
        end = time.monotonic() + limit
        while self.discarded and time.monotonic() < end:
            self.discarded = [workers for workers in self.discarded if any(worker.is_alive() for worker in workers)]
            time.sleep(REAP_S if self.discarded else 0.0)


class Slot:
    """Runs cells one by one in a reused worker; `submit` one, then `check` until it returns the row."""

    def __init__(self, number: int, crew: Crew, wake: Callable[[Slot], None], exclusive: bool = False) -> None:
        self.cell: Cell | None = None
        self._crew = crew
        self._number = number
        self._wake = wake  # called from another thread when there is something to check
        self._exclusive = exclusive  # wait for a discarded worker's death before starting the next one
        self._logs = Path(crew.settings["logs"])
        self._pool: ProcessPool | None = None
        self._context = Context()
        self._warm: ProcessFuture[None] | None = None
        self._future: ProcessFuture[str] | None = None
        self._ping: ProcessFuture[None] | None = None
        self._opened = self._sent = 0.0
        self._began: float | None = None
        self._attempts = 0
        self._served = 0  # cells that the present worker has ended
        self._kept_output = ""
        self._code: set[str] = set()  # plugins that the present worker has imported, beside tcbench's own

    def submit(self, cell: Cell, extra: dict[str, Any]) -> dict[str, Any] | None:
        """Hand a cell to the worker. Returns its row at once when workers cannot be started, else None.

        A worker that has run a plugin's code, which may have patched numpy, serves cells of that plugin only, and has
        run nothing else before; a cell of a study that is "fresh" has a worker to itself.
        """
        code = self._crew.needs(cell)
        fresh = cell.study in self._crew.settings["context"].get("fresh", ())
        if self._served > 0 and (fresh or bool(self._code) != bool(code) or not self._code <= code):
            self.discard()
        self.cell, self._extra, self._attempts, self._kept_output = cell, extra, 0, ""
        if self._crew.failed_starts >= START_ATTEMPTS:
            return self._end(self._crew.start_failure)
        return self._launch()

    def check(self) -> dict[str, Any] | None:
        """The row of the cell when it has ended, whichever way; else None. Enforces the deadline."""
        if self.cell is None or self._pool is None or self._future is None or self._warm is None:
            return None
        now = time.monotonic()
        if not self._warm.done():
            if now - self._opened <= START_LIMIT_S and self._pool.active:
                return None
            slow = now - self._opened > START_LIMIT_S
            return self._start_failed(f"took more than {START_LIMIT_S:g} s" if slow else "broke the pool", slow)
        if problem := self._warm.exception():
            return self._start_failed(_how_it_ended(problem), False)
        self._crew.failed_starts = 0
        if self._future.done():
            return self._conclude()
        if self._began is None:
            if self._future.running():
                self._began = now
            elif now - self._sent > LOST_AFTER_S or not self._pool.active:
                return self._broken()
            return None
        self._cap_output()
        return self._overdue(now)

    def was_stopped(self, seconds: float) -> None:
        """This process did not run for so long (a laptop's sleep, SIGSTOP): that is not counted as the cell's time."""
        self._began = self._began and self._began + seconds
        self._opened, self._sent = self._opened + seconds, self._sent + seconds

    def discard(self) -> None:
        """Kill the worker, whatever it is doing, and what its cells have started."""
        pool, self._pool, self._future, self._warm, self._ping = self._pool, None, None, None, None
        if pool is None:
            return
        self._served, self._code = 0, set()
        for worker in self._context.started:
            if worker.pid:
                kill_with_all(worker.pid)
        pool.stop()
        threading.Thread(target=_join, args=(pool,), name="tcbench-reaper", daemon=True).start()
        self._crew.discarded.append(self._context.started)
        if self._exclusive:
            self._crew.wait_for_the_dead()

    # -- the ways a cell can go

    def _launch(self) -> dict[str, Any] | None:
        from pebble import ProcessPool

        assert self.cell is not None
        for fresh in (False, True):
            try:
                if self._pool is None:
                    with Process._main, safe_path():  # locks start it, and it is a process of its own
                        resource_tracker.ensure_running()
                    settings = self._crew.settings | {"slot": self._number}
                    self._context = Context()
                    self._pool = ProcessPool(1, initializer=start, initargs=(settings,), context=self._context)
                    self._opened = time.monotonic()
                    self._warm = self._pool.schedule(warm_up)
                    self._warm.add_done_callback(self._notify)
                self._future = self._pool.schedule(run_cell, (self.cell.key, self.cell.as_dict(), self._extra))
                break
            except Exception as error:  # the old worker died while idle, or the system cannot start another
                self.discard()
                if fresh:
                    return self._start_failed(f"{type(error).__name__}: {cut(str(error), 300)}", False)
        assert self._future is not None
        self._future.add_done_callback(self._notify)
        self._began, self._ping, self._sent = None, None, time.monotonic()
        return None

    def _notify(self, _: object) -> None:
        self._wake(self)

    def _conclude(self) -> dict[str, Any] | None:
        from pebble import ProcessExpired

        assert self._future is not None
        try:
            data = json.loads(self._future.result())
            restore_nonfinite(data, data["nonfinite"])
            row = data["row"]
            self._code = set(row.pop("_plugins", ()))
            self._crew.seen[self.cell.integrator, self.cell.scenario] = self._code  # type: ignore[union-attr]
        except ProcessExpired as error:
            return self._crashed(error.exitcode)
        except (
            RuntimeError,
            OSError,
        ):  # BrokenProcessPool: the pool failed, which need not be the cell's fault
            return self._broken()
        except Exception as error:
            row = exception_row(error) | {"output_tail": self._output()}
        if row.get("exception_type") == "MemoryError":
            if self._second_chance():
                return self._launch()
            self.discard()  # who knows what the worker still holds
        self._served += 1
        return self._end(row)

    def _overdue(self, now: float) -> dict[str, Any] | None:
        assert self._began is not None and self._pool is not None and self._future is not None
        elapsed = now - self._began
        if self._ping is not None and self._ping.done():
            if self._future.done():  # the cell ended between the two looks
                return self._conclude()
            return self._crashed(0) if self._ping.exception() is None else self._broken()
        if elapsed > self._crew.timeout:
            self.discard()
            failure = f"The cell did not end within {self._crew.timeout:g} s and was stopped."
            row = {
                "status": "timeout",
                "failure": failure,
                "cell_time_s": elapsed,
                "output_tail": self._output(),
            }
            return self._end(row)
        if self._ping is None and elapsed > PING_AFTER_S:
            try:
                self._ping = self._pool.schedule(ping)
                self._ping.add_done_callback(self._notify)
            except RuntimeError:
                return self._broken()
        return None

    def _crashed(self, code: int | None) -> dict[str, Any] | None:
        if self._second_chance():
            return self._launch()
        row = crash_row(code) | {"output_tail": self._output()}
        if self._began is not None:
            row["cell_time_s"] = time.monotonic() - self._began
        self.discard()
        return self._end(row)

    def _second_chance(self) -> bool:
        """Whether a cell that killed its worker goes again, in a new one.

        A thread or a timer of an earlier cell may have killed the worker, or its leaks filled the memory. In
        a new worker, once, the blame is certain.
        """
        if self._served == 0 or self._attempts > 0:
            return False
        self._attempts += 1
        self.discard()
        self._output()  # of the first attempt: dropped
        return True

    def _broken(self) -> dict[str, Any] | None:
        """Try the cell once more in a new pool: what broke need not have been the cell."""
        if self._attempts > 0:
            self._served = 0
            return self._crashed(None)
        self._attempts += 1
        self.discard()
        return self._launch()

    def _start_failed(self, how: str, slow: bool) -> dict[str, Any] | None:
        self._crew.failed_starts += 1
        self.discard()
        if self._crew.failed_starts < START_ATTEMPTS:
            return self._launch()
        self._crew.start_failure = {
            "status": "timeout" if slow else "crash",
            "failure": f"No worker could be started: importing {self._crew.settings['measure']!r} {how}.",
            "output_tail": read_tail(self._logs / f"start-{self._number}.log"),
        }
        return self._end(self._crew.start_failure)

    def _end(self, row: dict[str, Any]) -> dict[str, Any]:
        self.cell, self._future = None, None
        return row | self._extra

    # -- the cell's output

    def _log(self) -> Path:
        assert self.cell is not None
        return self._logs / f"{self.cell.key}.log"

    def _cap_output(self) -> None:
        path = self._log()
        with contextlib.suppress(OSError):
            if path.stat().st_size > LOG_LIMIT:
                self._kept_output = read_tail(path)
                os.truncate(path, 0)

    def _output(self) -> str:
        """The end of what the cell printed; the file is removed."""
        path = self._log()
        text = tail(self._kept_output + read_tail(path))
        with contextlib.suppress(OSError):
            path.unlink()
        return text


def crash_row(code: int | None) -> dict[str, Any]:
    """The row of a cell whose worker died: exit code and signal (None where unknown), and a sentence."""
    name = None
    if code is not None and code < 0:
        try:
            name = signal.Signals(-code).name
        except ValueError:
            name = f"signal {-code}"
    how = f"killed by {name}" if name else "lost" if code is None else f"exit code {code}"
    failure = f"The worker process died while it ran this cell ({how})."
    return {"status": "crash", "failure": failure, "exit_code": code, "signal": name}


def _how_it_ended(problem: BaseException) -> str:
    code = getattr(problem, "exitcode", None)
    return (
        f"killed the worker ({crash_row(code)['failure'].rpartition('(')[2]}"
        if code is not None
        else f"failed: {problem}"
    )


def _join(pool: ProcessPool) -> None:
    with contextlib.suppress(Exception):
        pool.join()
