"""Inside a worker process: the cells of one integrator, one at a time, each to a row, whatever happens.

What Python can catch (exceptions, SystemExit, values that are not JSON) becomes a row here; what it cannot (hangs,
segfaults, `os._exit`, kill -9) is seen and recorded by the parent (`child`). Rows travel as JSON text.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import faulthandler
import io
import os
import pkgutil
import queue
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, NoReturn

from ..errors import ChangedError, MachineError
from .child import READY, descendants
from .codec import from_json, row_bytes

if TYPE_CHECKING:
    from ..integrator import Integrator
    from ..systems.scenario import Scenario

MEASURE = f"{__name__}:measure_cell"
DIED = "Fatal Python error"  # what faulthandler writes first
MESSAGE_LIMIT = 2000  # characters kept of an exception's message, and of the ends of its traceback and of the output
ROW_LIMIT = 64 * 2**20  # bytes of JSON a row may have
NOT_FINAL = (OSError, ImportError, MemoryError, MachineError, ChangedError)  # another day they are not raised
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EMFILE, errno.ENFILE)  # no cell's fault
_settings: dict[str, Any] = {}


def main(settings: str) -> NoReturn:
    """Measure the cells that come on standard input, and answer on what was standard output. settings : a file."""
    calls, answers, own = os.fdopen(os.dup(0), "rb"), os.dup(1), os.getpid()
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)
    sys.argv[:] = [""]
    if sys.platform == "linux":  # a killed parent must not leave a process behind, least of all one that hangs in C
        with contextlib.suppress(Exception):
            ctypes.CDLL(None).prctl(1, int(signal.SIGKILL), 0, 0, 0)  # 1 = PR_SET_PDEATHSIG
            ctypes.CDLL(None).prctl(36, 1, 0, 0, 0)  # PR_SET_CHILD_SUBREAPER: what its children leave is its own
    waiting: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    threading.Thread(target=_hear, args=(calls, waiting.put), name="tcbench-calls", daemon=True).start()
    start(from_json(Path(settings).read_bytes()))
    answer = READY
    while True:
        if os.getpid() != own:
            os._exit(0)  # a copy that foreign code has forked and that came back from it
        while answer:
            answer = answer[os.write(answers, answer) :]
        answer = run_cell(*from_json(waiting.get())) + b"\n"


def _hear(calls: IO[bytes], put: Callable[[bytes], None]) -> None:
    for line in calls:
        put(line)
    if hasattr(os, "killpg"):  # the parent is gone: this process and what its cells have started end
        for pid in descendants(os.getpid()):
            with contextlib.suppress(OSError):
                os.kill(pid, signal.SIGKILL)
        os.killpg(0, signal.SIGKILL)
    os._exit(1)


def start(settings: dict[str, Any]) -> None:
    """Prepare the process: output, limits; the measuring code and the plugins are imported before any clock starts. An
    error of these imports is left to the cells' rows."""
    _settings.update(settings)
    _settings["output"] = os.dup(2)  # the file that the parent reads; C code prints into it, too
    _own_streams()
    _settings["folder"] = os.getcwd()
    with contextlib.suppress(Exception):
        faulthandler.enable(file=2, all_threads=False)  # a segfault then leaves its Python traceback in the output
    if settings.get("memory_limit"):
        _limit_memory(int(settings["memory_limit"]))
    with contextlib.suppress(BaseException):
        pkgutil.resolve_name(settings["measure"])
    if "folders" in settings["context"]:
        from .. import plugins

        plugins.use_folders(settings["context"]["folders"])
        plugins.use_only(settings["brought_by"])
        plugins.registry()


def run_cell(cell: dict[str, Any], extra: dict[str, Any]) -> bytes:
    """Measure one cell and return its row as JSON. extra : entries to add to the row (timed, order, ...)."""
    _undo_leftovers()
    measure = pkgutil.resolve_name  # an import that fails is the row's
    row = complete_row(
        lambda: measure(_settings["measure"])(cell, _settings["context"]), extra,
        (BaseException,),  # SystemExit and KeyboardInterrupt of a plugin are that plugin's failures too
    )  # fmt: skip
    _flush()
    return row


def measure_cell(cell: dict[str, Any], context: dict[str, Any]) -> dict[str, Any]:
    """Look the names up and call the study; ChangedError where they are not what the run was planned with."""
    from .. import plugins
    from ..simulation import shared_runs
    from ..solver import foresight
    from ..studies.base import find_study
    from .cell import Cell
    from .hashes import made_by

    method, study = plugins.find_integrator(cell["integrator"]), find_study(cell["study"])
    custom = context["scenarios"].get(cell["scenario"])
    scenario = rebuilt(custom) if custom else plugins.find_scenario(cell["scenario"])
    planned = context["made_by"][Cell(**cell).key]
    if made_by(method, scenario, study, custom) != planned.partition("+")[0]:
        raise ChangedError(
            f"What {method.name} on {scenario.name} is measured with is not what the run was planned with: files were "
            "edited meanwhile, the plugin writes beside its own file, or this machine has another version. Run again, "
            "and what they say now is measured."
        )
    with foresight.within(context.get("timeout")), shared_runs.shared_in(context.get("shared_runs")):
        return measured(method, scenario, cell) | {"shared_runs": shared_runs.reads()}


def measured(method: Integrator, scenario: Scenario, cell: Mapping[str, Any]) -> dict[str, Any]:
    """The row of a cell, and where it comes from."""
    from .. import plugins
    from ..packages import installed_version
    from ..studies.base import find_study
    from .provenance import machine_name

    row = find_study(cell["study"]).measured(method, scenario, cell["options"])
    origin = plugins.registry().origins.get(method.plugin)
    return row | {
        "plugin": str(origin) if origin and origin.distribution else method.plugin,
        "scenario_hash": scenario.hash,
        "tcbench_version": installed_version("tcbench") or None,
        **({"machine": machine_name()} if cell["timed"] else {}),
    }


def rebuilt(data: Mapping[str, Any]) -> Scenario:
    """A scenario that no plugin brings, from `plan.scenario_data`."""
    from ..compiler.formula_hash import formula_hash
    from ..systems.scenario import Scenario

    system: Any = pkgutil.resolve_name(data["system"])
    if formula_hash(system) != data["code"]:
        raise ChangedError(
            f"The system {data['system']} is not what its file says: it was changed in the session that started the "
            "run, or its file was edited after it was imported. Start Python anew, or give the system to tcbench.run "
            "from a script or notebook cell."
        )
    return Scenario(**{k: v for k, v in data.items() if k not in ("system", "code", "folder")}, system=system)


def complete_row(
    measure: Callable[[], Mapping[str, Any]], extra: Mapping[str, Any],
    caught: tuple[type[BaseException], ...] = (Exception, SystemExit),
) -> bytes:  # fmt: skip
    """What `measure` returns, with status, failure and times, as JSON; or the row of the exception that it ends with.

    extra : entries of every row.
    """
    began = time.perf_counter()
    try:
        numbers = measure()
        took = time.perf_counter() - began
        if not isinstance(numbers, Mapping):
            raise TypeError(f"the measurement returned {type(numbers).__name__}, not a dict")
        row = {"status": "ok", "failure": "", "wall_time_s": took} | {str(k): v for k, v in numbers.items()}
        if not isinstance(row["status"], str):
            raise TypeError(f"the measurement returned the status {row['status']!r}, not a word")
        text = row_bytes(row | {"cell_time_s": took} | dict(extra))
        if len(text) > ROW_LIMIT:
            raise ValueError(f"the row has {len(text) / 2**20:.0f} MiB of JSON; the limit is {ROW_LIMIT // 2**20} MiB")
        return text
    except caught as error:
        return row_bytes(exception_row(error) | {"cell_time_s": time.perf_counter() - began} | dict(extra))


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


def _limit_memory(limit: int) -> None:
    """Cap the address space (bytes); allocating more raises MemoryError. Does nothing on Windows."""
    try:
        import resource
    except ImportError:  # pragma: no cover -- Windows
        return
    with contextlib.suppress(ValueError, OSError):  # a lower hard limit is in force already
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
