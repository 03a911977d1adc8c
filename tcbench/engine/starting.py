"""How a worker is started: afresh (spawn, on every system), with this process's path and environment and no more."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Iterator
from multiprocessing.context import SpawnContext, SpawnProcess
from typing import Any

from ..plugin_loading import environment


class Process(SpawnProcess):
    """A spawned process that leaves the parent's main module alone, and the current folder.

    Workers get everything by name from `tcbench.worker`. Without this every worker would run the user's
    script again, unless it has an `if __name__ == "__main__"`.
    """

    _main = threading.Lock()

    @staticmethod
    def _Popen(process_obj: Any) -> Any:  # the name that multiprocessing calls
        with Process._main, _hidden_main(), before_plugins(), safe_path(), _no_interrupts():
            return SpawnProcess._Popen(process_obj)


@contextlib.contextmanager
def _hidden_main() -> Iterator[None]:
    """What multiprocessing would find the main module by, away for a moment."""
    main = sys.modules["__main__"]
    kept = {name: getattr(main, name, None) for name in ("__spec__", "__file__")}
    try:
        for name in kept:
            setattr(main, name, None)
        yield
    finally:
        for name, value in kept.items():
            setattr(main, name, value)


@contextlib.contextmanager
def safe_path() -> Iterator[None]:
    """Processes that start meanwhile (by `python -c`) do not import signal.py and the like from the current folder."""
    before = os.environ.get("PYTHONSAFEPATH")
    os.environ["PYTHONSAFEPATH"] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ["PYTHONSAFEPATH"]
        else:
            os.environ["PYTHONSAFEPATH"] = before


@contextlib.contextmanager
def before_plugins() -> Iterator[None]:
    """Processes that start meanwhile have the environment that was there before any plugin changed it."""
    now = dict(os.environ)
    try:
        for name, value in environment().items():
            if now.get(name) != value:
                os.environ[name] = value
        for name in now.keys() - environment().keys():
            del os.environ[name]
        yield
    finally:
        for name, value in now.items():
            if os.environ.get(name) != value:
                os.environ[name] = value


@contextlib.contextmanager
def _no_interrupts() -> Iterator[None]:
    """Processes that start meanwhile never see Ctrl-C: it is the parent who ends them."""
    if not hasattr(signal, "pthread_sigmask"):  # pragma: no cover -- Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class Context(SpawnContext):
    """Start processes afresh (spawn, on every system) as `Process`, and know them."""

    def __init__(self) -> None:
        super().__init__()
        self.started: list[Process] = []

    def Process(self, *arguments: Any, **named: Any) -> Process:  # type: ignore[override]  # the name that pebble calls
        self.started.append(Process(*arguments, **named))
        return self.started[-1]
