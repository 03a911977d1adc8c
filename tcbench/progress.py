"""Whatever takes longer than two seconds says so: a bar on a terminal and in Jupyter, a line a minute in a pipe.

All of it goes to stderr, so that what a command prints can be piped on.
"""

from __future__ import annotations

import html
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from .errors import LOUD

if TYPE_CHECKING:
    from .runner.eta import Remaining
    from .runner.ledger import Event

AFTER_S = 2.0  # a wait as short as this needs no word
GROUND = 0.1  # of a wait whose parts are alike tells how long the rest takes
EVERY_S = 60.0  # between the lines in a pipe
FAILURES_SHOWN = 5

# True: also in a pipe; False: never; None: where someone is looking. The command line sets it, for it speaks in pipes.
default: bool | None = None
_open: Meter | None = None


class Meter:
    """How far a wait has come. `text`, `done` and `total` (None: not known) may be set at any time, from any thread.

    `left` gives the seconds still to go, None where nothing is known of them; without it they follow from `done`.
    """

    def __init__(self, text: str) -> None:
        self.text, self.done, self.total = text, 0, None  # type: str, int, int | None
        self.began = time.monotonic()
        self.left: Callable[[], float | None] | None = None
        self._face: _Terminal | _Jupyter | _Pipe | None = None
        self._lock = threading.Lock()

    def line(self) -> str:
        """What is being waited for, how far it is, since when, and for how long still, as plain text."""
        count = f"{self.done} of {self.total}" if self.total else ""
        passed = f"{_duration(time.monotonic() - self.began)} so far"
        return ", ".join(filter(None, (self.text, count, passed, self.remaining())))

    def remaining(self) -> str:
        """For how long still, in words; "" while there is no ground for a number."""
        if self.left is not None:
            seconds = self.left()
        elif self.total and GROUND * self.total <= self.done < self.total:
            seconds = (time.monotonic() - self.began) * (self.total - self.done) / self.done
        else:
            seconds = None
        return "" if seconds is None else f"about {_duration(seconds)} left"

    def tell(self, text: str) -> None:
        """Another text, which shows at once where the wait does."""
        with self._lock:
            self.text = text
            if self._face is not None:
                self._face.draw(self)

    def say(self, sentence: str) -> None:
        """A line that stays, above the bar where there is one."""
        with self._lock:
            if isinstance(self._face, _Terminal):
                self._face.bar.print(sentence, soft_wrap=True, markup=False, highlight=False)
            else:
                sys.stderr.write(sentence + "\n")

    def _watch(self, face: _Terminal | _Jupyter | _Pipe, end: threading.Event) -> None:
        """In a thread: begin to draw when the wait is no longer short, and go on until it ends."""
        if end.wait(AFTER_S):
            return
        with self._lock:
            face.open(self)
            self._face = face
        while not end.wait(face.every):
            with self._lock:
                face.draw(self)
        with self._lock:
            self._face = None
            face.close(self)


@contextmanager
def waiting(text: str, show: bool | None = None) -> Iterator[Meter]:
    """Show `text`, and how far it has come, for as long as the block takes beyond two seconds.

    show : True, also in a pipe; False, not at all; None, on a terminal and in Jupyter (or what the command line set).
    A wait within another one is part of that.
    """
    global _open
    meter, face, outer = Meter(text), _face(default if show is None else show), _open
    if face is None or outer is not None:
        yield meter
        return
    end = threading.Event()
    thread = threading.Thread(target=meter._watch, args=(face, end), name="tcbench-progress", daemon=True)
    _open = meter
    thread.start()
    try:
        yield meter
    finally:
        end.set()
        thread.join()
        _open = None


@contextmanager
def part(text: str) -> Iterator[Meter]:
    """A part of what is being waited for, said behind it while it lasts; a wait of its own where there is none."""
    outer = _open
    if outer is None:
        with waiting(text) as meter:
            yield meter
        return
    before = outer.text, outer.done, outer.total
    outer.text = f"{outer.text}: {text}" if text else outer.text
    try:
        yield outer
    finally:
        outer.text, outer.done, outer.total = before


@contextmanager
def of_cells(show: bool | None = None, remaining: Remaining | None = None) -> Iterator[Callable[[Event], None]]:
    """Progress of a run: what it yields takes the engine's events. Alarming failures are printed as they come.

    remaining : is told of each cell that ends, and tells how long the others will take.
    """
    silent = _face(default if show is None else show) is None
    loud, printed = 0, set[str]()
    with waiting("starting workers", show) as meter:
        meter.left = remaining.seconds if remaining is not None else lambda: None

        def on_event(event: Event) -> None:
            nonlocal loud
            first = "" if event.done else f": {event.cell.integrator} is compiled for {event.cell.scenario}"
            meter.text, meter.done, meter.total = event.cell.study + first, event.done, event.total
            if event.row is not None and remaining is not None:
                remaining.finished(event.cell, event.row)
            if event.kind == "failed" and event.row is not None and event.row.get("status") in LOUD:
                loud += 1
                text = f"{event.cell.integrator} on {event.cell.scenario}: {event.row.get('failure')}"
                if text not in printed and len(printed) < FAILURES_SHOWN and not silent:
                    printed.add(text)
                    meter.say(text)

        yield on_event
    if loud > len(printed) and not silent:
        more = loud - len(printed)
        sys.stderr.write(f"... and {more} more failure{'s' * (more > 1)} of this kind; see the tables.\n")


def _face(show: bool | None) -> _Terminal | _Jupyter | _Pipe | None:
    """Where progress is drawn; None: nowhere."""
    if show is False:
        return None
    if _in_jupyter():
        return _Jupyter()
    if sys.stderr is not None and sys.stderr.isatty() and os.environ.get("TERM") != "dumb":
        return _Terminal()
    return _Pipe() if show else None


def _in_jupyter() -> bool:
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return getattr(shell, "kernel", None) is not None


class _Terminal:
    """A live bar, gone when the wait is over."""

    every = 0.1

    def open(self, meter: Meter) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn

        console = Console(stderr=True, highlight=False, emoji=False, markup=False)
        columns = BarColumn(10), TextColumn("{task.description}", markup=False)
        self.bar = Progress(*columns, console=console, auto_refresh=False, transient=True, redirect_stdout=False)
        self.task = self.bar.add_task("", total=None)
        self.bar.start()
        self.draw(meter)

    def draw(self, meter: Meter) -> None:
        self.bar.update(self.task, description=meter.line(), completed=meter.done, total=meter.total, refresh=True)

    def close(self, meter: Meter) -> None:
        self.bar.stop()


class _Jupyter:
    """A bar in the cell's output, which needs no widgets; the line stays."""

    every = 0.5

    def open(self, meter: Meter) -> None:
        from IPython.display import display

        self.handle = display(self._data(meter), raw=True, display_id=True)

    def draw(self, meter: Meter) -> None:
        self.handle.update(self._data(meter), raw=True)

    def close(self, meter: Meter) -> None:
        self.draw(meter)

    def _data(self, meter: Meter) -> dict[str, Any]:
        line = meter.line()
        share = f' value="{meter.done}" max="{meter.total}"' if meter.total else ""
        return {"text/plain": line, "text/html": f"<progress{share}></progress> {html.escape(line)}"}


class _Pipe:
    """A line when it becomes long, and one a minute."""

    every = EVERY_S

    def open(self, meter: Meter) -> None:
        self.draw(meter)

    def draw(self, meter: Meter) -> None:
        sys.stderr.write(meter.line() + "\n")
        sys.stderr.flush()

    def close(self, meter: Meter) -> None:
        pass


def _duration(seconds: float) -> str:
    whole = round(seconds)
    return f"{whole} s" if whole < 100 else f"{whole // 60} min {whole % 60:02d} s"
