"""Inside a worker process: measure one cell at a time and turn whatever happens into a row.

A worker runs code that other people wrote. What Python can catch (exceptions, SystemExit, values that are
not JSON) becomes a row here; what it cannot (hangs, segfaults, `os._exit`, kill -9) is seen and recorded by
the parent. Rows travel as JSON text, so nothing that a plugin made is ever unpickled in the parent.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import faulthandler
import io
import json
import os
import pkgutil
import sys
import time
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ..errors import ChangedError, MachineError
from ..inputs import watching
from ..store.encoding import json_text

DIED = "Fatal Python error"  # what faulthandler writes first
MESSAGE_LIMIT = 2000  # characters kept of an exception's message, and of the ends of its traceback and of the output
ROW_LIMIT = 64 * 2**20  # bytes of JSON a row may have
NOT_FINAL = (OSError, ImportError, MemoryError, MachineError, ChangedError)  # another day they are not raised
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EMFILE, errno.ENFILE)  # no cell's fault
_settings: dict[str, Any] = {}
_told: set[str] = set()  # identities of inputs that the parent has


def start(settings: dict[str, Any]) -> None:
    """Prepare the process (a `child.Child`): limits, output; the measuring code is imported before any clock starts.

    An error of that import is left to the cells' rows.
    """
    _settings.update(settings)
    _keep_offspring()
    _settings["output"] = os.dup(2)  # the file that the parent reads; C code prints into it, too
    _own_streams()
    _settings["folder"] = os.getcwd()
    watching.leave_out(settings["logs"])
    with contextlib.suppress(Exception):
        # a segfault then leaves its Python traceback in the output; other threads are the engine's own
        faulthandler.enable(file=2, all_threads=False)
    if settings.get("memory_limit"):
        _limit_memory(int(settings["memory_limit"]))
    with contextlib.suppress(BaseException):
        pkgutil.resolve_name(settings["measure"])


def run_cell(cell: dict[str, Any], extra: dict[str, Any]) -> str:
    """Measure one cell and return its row as JSON text (with "nonfinite", see `tcbench.encoding`).

    extra : entries to add to the row (timed, order, ...).
    """
    _undo_leftovers()
    row = complete_row(
        lambda: pkgutil.resolve_name(_settings["measure"])(cell, _settings["context"]), extra,
        caught=(BaseException,),  # SystemExit and KeyboardInterrupt of a plugin are that plugin's failures too
    )  # fmt: skip
    text = _encode(row | _what_was_read())
    _flush()
    return text


def _what_was_read() -> dict[str, Any]:
    """The identity of what this worker has read for plugins that are not tcbench's own; the first time, all of it."""
    watched = watching.recorder()
    if watched is None:
        return {}
    name, text = watched.collected()
    told = {} if name in _told else {"_inputs": json.loads(text)}
    _told.add(name)
    return {"inputs": name, "_plugins": sorted(watched.plugins), **told}


def complete_row(
    measure: Callable[[], Mapping[str, Any]], extra: Mapping[str, Any],
    caught: tuple[type[BaseException], ...] = (Exception, SystemExit),
) -> dict[str, Any]:  # fmt: skip
    """What `measure` returns, with status, failure and times; or the row of the exception that it ends with.

    extra : entries of every row.
    """
    began = time.perf_counter()
    try:
        found = measure()
        if not isinstance(found, Mapping):
            raise TypeError(f"the measurement returned {type(found).__name__}, not a dict")
        row = {str(name): value for name, value in found.items()}
        row.setdefault("status", "ok")
        row.setdefault("failure", "")
        row.setdefault("wall_time_s", time.perf_counter() - began)
        _encode(row)
    except caught as error:
        row = exception_row(error)
    return row | {"cell_time_s": time.perf_counter() - began} | dict(extra)


def exception_row(error: BaseException) -> dict[str, Any]:
    """The row of a cell that raised: type, message and end of the traceback, each cut to a bounded length."""
    try:
        message = str(error)
    except BaseException as second:  # an exception may fail to print itself
        message = f"(its message cannot be printed: {type(second).__name__})"
    name = type(error).__name__
    short = cut(message)
    try:
        lines = "".join(traceback.format_tb(error.__traceback__))  # without the message, which may be megabytes
    except BaseException:
        lines = ""
    first = short.splitlines()[0][:300] if short else ""
    disk = isinstance(error, OSError) and error.errno in FULL
    return {
        "status": "exception",
        **({"of_the_machine": True} if isinstance(error, NOT_FINAL) else {}),
        "failure": f"{name}: {first}" if first else name,
        "exception_type": MachineError.__name__ if disk else name,
        "exception_message": short,
        "traceback_tail": tail(lines),
    }


def cut(text: str, limit: int = MESSAGE_LIMIT) -> str:
    """The start of a text, with a note of how much was left out."""
    return text if len(text) <= limit else f"{text[:limit]}... ({len(text) - limit} more characters)"


def tail(text: str) -> str:
    """The end of a text; of an interpreter that died, the end of what it said before and the innermost frames."""
    said, died, frames = text.partition(DIED)
    if died:
        return tail(said) + cut(died + frames)
    return text if len(text) <= MESSAGE_LIMIT else "..." + text[-MESSAGE_LIMIT:]


def read_tail(path: Path) -> str:
    """The end of an output file as text; empty when there is none."""
    try:
        with open(path, "rb") as file:
            file.seek(max(0, os.fstat(file.fileno()).st_size - 10 * MESSAGE_LIMIT))  # faulthandler: up to 100 frames
            return tail(file.read(10 * MESSAGE_LIMIT).decode(errors="replace").replace("\0", ""))
    except OSError:
        return ""


def _encode(row: Mapping[str, Any]) -> str:
    text = json_text({"row": dict(row)})
    if len(text) > ROW_LIMIT:
        raise ValueError(f"the row has {len(text) / 2**20:.0f} MiB of JSON; the limit is {ROW_LIMIT // 2**20} MiB")
    return text


def _undo_leftovers() -> None:
    """Streams and working directory as before any cell ran."""
    _flush()
    with contextlib.suppress(OSError):
        for target in (1, 2):
            os.dup2(_settings["output"], target)
    ours = (_settings["stdout"], _settings["stderr"])
    if (sys.stdout, sys.stderr) != ours or any(stream.closed for stream in ours):
        _own_streams()
    with contextlib.suppress(OSError):
        os.chdir(_settings["folder"])


def _own_streams() -> None:
    sys.stdout = _settings["stdout"] = _utf8_text(1)
    sys.stderr = _settings["stderr"] = _utf8_text(2)


def _flush() -> None:
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(Exception):  # a plugin may have closed or replaced them
            stream.flush()


def _utf8_text(descriptor: int) -> io.TextIOWrapper:
    raw = io.FileIO(descriptor, "w", closefd=False)
    return io.TextIOWrapper(io.BufferedWriter(raw), encoding="utf-8", errors="backslashreplace", line_buffering=True)


def _keep_offspring() -> None:
    """What a cell starts ends with its worker: on Linux what leaves the worker's group stays its descendant."""
    if sys.platform == "linux":
        with contextlib.suppress(Exception):
            ctypes.CDLL(None).prctl(36, 1, 0, 0, 0)  # 36 = PR_SET_CHILD_SUBREAPER


def _limit_memory(limit: int) -> None:
    """Cap the address space (bytes); allocating more raises MemoryError. Does nothing on Windows."""
    try:
        import resource
    except ImportError:  # pragma: no cover -- Windows
        return
    with contextlib.suppress(ValueError, OSError):  # a lower hard limit is in force already
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
