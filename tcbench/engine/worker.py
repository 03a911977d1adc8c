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
import importlib
import io
import json
import multiprocessing
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from .. import inputs
from ..errors import ChangedError, MachineError
from ..store.encoding import encode_values

DIED = "Fatal Python error"  # what faulthandler writes first
MESSAGE_LIMIT = 2000  # characters kept of an exception's message, and of the ends of its traceback and of the output
ROW_LIMIT = 64 * 2**20  # bytes of JSON a row may have
# Cells run side by side, one a core: threads inside them would only get in each other's way and blur timings.
ONE_THREAD = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMEXPR_NUM_THREADS",
)

NOT_FINAL = (OSError, ImportError, MemoryError, MachineError, ChangedError)  # another day they are not raised
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EMFILE, errno.ENFILE)  # no cell's fault
_settings: dict[str, Any] = {}
_told: set[str] = set()  # identities of inputs that the parent has


def start(settings: dict[str, Any]) -> None:
    """Prepare the process (the pool's initializer): limits, signals, output."""
    _settings.update(settings)
    for name in ONE_THREAD:
        os.environ.setdefault(name, "1")
    _lead_a_group()
    # pebble installs a Python handler, which a hang inside C code never reaches
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    _die_with_parent()
    _redirect(Path(settings["logs"]) / f"start-{settings['slot']}.log")
    _own_streams()
    _settings["folder"] = os.getcwd()
    inputs.leave_out(settings["logs"])
    with contextlib.suppress(Exception):
        # a segfault then leaves its Python traceback in the output; other threads are the engine's own
        faulthandler.enable(file=2, all_threads=False)
    if settings.get("memory_limit"):
        _limit_memory(int(settings["memory_limit"]))


def warm_up() -> None:
    """Import the measuring code before the first clock starts. An error is left to the cells' rows."""
    with contextlib.suppress(BaseException):
        resolve(_settings["measure"])


def ping() -> None:
    """Answer, which proves that whatever was sent to this worker earlier is over."""


def run_cell(key: str, cell: dict[str, Any], extra: dict[str, Any]) -> str:
    """Measure one cell and return its row as JSON text (with "nonfinite", see `tcbench.encoding`).

    extra : entries to add to the row (timed, order, ...).
    """
    log = Path(_settings["logs"]) / f"{key}.log"
    _undo_leftovers(log)
    row = complete_row(
        lambda: resolve(_settings["measure"])(cell, _settings["context"]), extra,
        caught=(BaseException,),  # SystemExit and KeyboardInterrupt of a plugin are that plugin's failures too
        also=lambda: {"output_tail": _own_tail(log)},
    )  # fmt: skip
    text = _encode(row | _what_was_read())
    _redirect(None)
    with contextlib.suppress(OSError):
        log.unlink()
    return text


def _what_was_read() -> dict[str, Any]:
    """The identity of what this worker has read for plugins that are not tcbench's own; the first time, all of it."""
    watched = inputs.recorder()
    if watched is None:
        return {}
    name, text = watched.collected()
    told = {} if name in _told else {"_inputs": json.loads(text)}
    _told.add(name)
    return {"inputs": name, "_plugins": sorted(watched.plugins), **told}


def complete_row(
    measure: Callable[[], Mapping[str, Any]], extra: Mapping[str, Any],
    caught: tuple[type[BaseException], ...] = (Exception, SystemExit), also: Callable[[], dict[str, Any]] = dict,
) -> dict[str, Any]:  # fmt: skip
    """What `measure` returns, with status, failure and times; or the row of the exception that it ends with.

    extra : entries of every row. also : entries of the row of an exception.
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
        row = exception_row(error) | also()
    return row | {"cell_time_s": time.perf_counter() - began} | dict(extra)


def resolve(name: str) -> Callable[[dict[str, Any], dict[str, Any]], Mapping[str, Any]]:
    """The function called `package.module:function`."""
    module, _, function = name.partition(":")
    found: Callable[[dict[str, Any], dict[str, Any]], Mapping[str, Any]] = getattr(
        importlib.import_module(module), function
    )
    return found


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


def tail(text: str, limit: int = MESSAGE_LIMIT) -> str:
    """The end of a text; of an interpreter that died, the end of what it said before and the innermost frames."""
    said, died, frames = text.partition(DIED)
    if died:
        return tail(said, limit) + cut(died + frames, limit)
    return text if len(text) <= limit else "..." + text[-limit:]


def read_tail(path: Path, limit: int = MESSAGE_LIMIT) -> str:
    """The end of an output file as text; empty when there is none."""
    try:
        with open(path, "rb") as file:
            file.seek(max(0, os.fstat(file.fileno()).st_size - 10 * limit))  # faulthandler gives up to 100 frames
            return tail(file.read(10 * limit).decode(errors="replace").replace("\0", ""), limit)
    except OSError:
        return ""


def _encode(row: Mapping[str, Any]) -> str:
    text = json.dumps(encode_values({"row": dict(row)}), allow_nan=False)
    if len(text) > ROW_LIMIT:
        raise ValueError(f"the row has {len(text) / 2**20:.0f} MiB of JSON; the limit is {ROW_LIMIT // 2**20} MiB")
    return text


def _undo_leftovers(log: Path) -> None:
    """Output to the cell's own file; streams and working directory as before any cell ran."""
    _redirect(log)
    ours = (_settings["stdout"], _settings["stderr"])
    if (sys.stdout, sys.stderr) != ours or any(stream.closed for stream in ours):
        _own_streams()
    with contextlib.suppress(OSError):
        os.chdir(_settings["folder"])


def _own_streams() -> None:
    sys.stdout = _settings["stdout"] = _utf8_text(1)
    sys.stderr = _settings["stderr"] = _utf8_text(2)


def _redirect(path: Path | None) -> None:
    """Send the process's own stdout and stderr (file descriptors, so C code too) to a file, or nowhere."""
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(Exception):  # a plugin may have closed or replaced them
            stream.flush()
    # O_APPEND: the parent truncates the file when it grows too long, and writing goes on at the new end
    flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND
    try:
        descriptor = os.open(os.devnull, os.O_WRONLY) if path is None else os.open(path, flags, 0o600)
    except OSError:  # no room for output is no reason not to compute
        descriptor = os.open(os.devnull, os.O_WRONLY)
    for target in (1, 2):
        os.dup2(descriptor, target)
    if descriptor > 2:
        os.close(descriptor)


def _own_tail(log: Path) -> str:
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(Exception):
            stream.flush()
    return read_tail(log)


def _utf8_text(descriptor: int) -> io.TextIOWrapper:
    raw = io.FileIO(descriptor, "w", closefd=False)
    return io.TextIOWrapper(io.BufferedWriter(raw), encoding="utf-8", errors="backslashreplace", line_buffering=True)


def _lead_a_group() -> None:
    """What a cell starts ends with its worker: all in one process group; on Linux what leaves it stays a descendant."""
    if hasattr(os, "setpgid"):
        with contextlib.suppress(OSError):  # it leads one already
            os.setpgid(0, 0)
    if sys.platform == "linux":
        with contextlib.suppress(Exception):
            ctypes.CDLL(None).prctl(36, 1, 0, 0, 0)  # 36 = PR_SET_CHILD_SUBREAPER


def kill_with_all(worker: int) -> None:
    """Kill a worker and every process that its cells have started (those that left its group: on Linux only)."""
    if not hasattr(os, "killpg"):  # pragma: no cover -- Windows
        return
    for pid in (*_descendants(worker), worker):
        with contextlib.suppress(OSError):
            os.kill(pid, signal.SIGKILL)
    with contextlib.suppress(OSError):  # none of that group is left, or it does not lead one yet
        os.killpg(worker, signal.SIGKILL)


def _descendants(ancestor: int) -> set[int]:
    """Children of a process, and theirs, from /proc."""
    parents: dict[int, int] = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError, ValueError, IndexError):
            parents[int(stat.parent.name)] = int(stat.read_text(errors="replace").rpartition(")")[2].split()[1])
    found: set[int] = set()
    newer = {ancestor}
    while newer := {pid for pid, parent in parents.items() if parent in newer} - found:
        found |= newer
    return found


def _die_with_parent() -> None:
    """A killed parent must not leave workers behind, least of all one that hangs."""
    if sys.platform == "linux":  # also reaches a worker that is stuck in C code
        with contextlib.suppress(Exception):
            ctypes.CDLL(None).prctl(1, int(signal.SIGKILL), 0, 0, 0)  # 1 = PR_SET_PDEATHSIG
    parent = multiprocessing.parent_process()
    if parent is not None:

        def follow() -> None:
            parent.join()
            if hasattr(os, "killpg"):
                os.killpg(0, signal.SIGKILL)
            os._exit(1)

        threading.Thread(target=follow, name="tcbench-parent-watch", daemon=True).start()


def _limit_memory(limit: int) -> None:
    """Cap the address space (bytes); allocating more raises MemoryError. Does nothing on Windows."""
    try:
        import resource
    except ImportError:  # pragma: no cover -- Windows
        return
    with contextlib.suppress(ValueError, OSError):  # a lower hard limit is in force already
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
