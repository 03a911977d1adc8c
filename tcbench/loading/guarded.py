"""While a plugin's file runs: it ends in time, and what everybody uses is afterwards as it was before."""

from __future__ import annotations

import builtins
import contextlib
import json
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from .files import RefusedError

IMPORT_S = 120.0  # seconds: the largest packages take a few on an idle machine
AGAIN_S = 1.0  # until the deadline is told once more to a file that swallows whatever is raised
SHARED = (json, os, builtins)  # modules whose functions no file may replace
STANDARD, HIGH = (0, 1, 2), 700  # descriptors; from which number on copies lie, out of the reach of most


@contextlib.contextmanager
def guarded() -> Iterator[None]:
    """RefusedError for a file that does not end within IMPORT_S, replaces functions of SHARED, or closes a standard
    stream; its alarms and its numpy.seterr are undone without a word. The deadline is one of the main thread."""
    functions = [dict(vars(module)) for module in SHARED]
    settings, streams = np.geterr(), _copies()
    replaced: list[str] = []
    try:
        with _deadline():
            yield
    finally:
        np.seterr(**settings)
        for module, before in zip(SHARED, functions, strict=True):
            for name, value in before.items():
                if not name.startswith("_") and vars(module).get(name) is not value:
                    setattr(module, name, value)
                    replaced.append(f"{module.__name__}.{name}")
        closed = _reopened(streams)
    if replaced:
        raise RefusedError(f"it replaces {', '.join(replaced)}, which all others use. Give your function another name")
    if closed:
        raise RefusedError("it closes standard input, output or error, which are not its own")


@contextlib.contextmanager
def _deadline() -> Iterator[None]:
    if threading.current_thread() is not threading.main_thread() or sys.platform == "win32":
        yield
        return
    began = time.monotonic()

    def end(*_: Any) -> None:
        raise _Alarm

    before, left = signal.signal(signal.SIGALRM, end), signal.setitimer(signal.ITIMER_REAL, IMPORT_S, AGAIN_S)
    try:
        yield
    except _Alarm:
        late = time.monotonic() - began >= IMPORT_S
        raise RefusedError(
            f"its import did not end within {IMPORT_S:g} s. What takes long belongs into a function that is called "
            "when it is needed" if late else "it sets an alarm, which goes off while it is imported"
        ) from None  # fmt: skip
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
        if left[0]:
            signal.setitimer(signal.ITIMER_REAL, max(1e-3, left[0] - (time.monotonic() - began)), left[1])


class _Alarm(BaseException):
    """The clock has gone off; no Exception, which files may catch."""


def _copies() -> dict[int, int]:
    """Copies of the standard streams that are open."""
    copies = {}
    for stream in STANDARD:
        with contextlib.suppress(OSError):
            if sys.platform == "win32":
                copies[stream] = os.dup(stream)
            else:
                import fcntl

                copies[stream] = fcntl.fcntl(stream, fcntl.F_DUPFD_CLOEXEC, HIGH)
    return copies


def _reopened(copies: dict[int, int]) -> bool:
    """Whether one of them had been closed; they are open again."""
    closed = False
    for stream, copy in copies.items():
        with contextlib.suppress(OSError):  # the copies may be closed, too
            try:
                os.fstat(stream)
            except OSError:
                closed = True
                os.dup2(copy, stream)
            os.close(copy)
    return closed
