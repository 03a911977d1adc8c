"""A process of its own that answers calls one by one: JSON lines on two pipes, the same on every system.

`Child` is the parent's half, `main` the other. A call names a function and has JSON arguments; the answer is the text
that the function returns, so that nothing that foreign code made is unpickled here. The process starts afresh, with
this one's path, flags and environment, one thread unless the user says more, and no arguments, standard input or
terminal. It ends when this process ends, however that goes: its pipe is closed then (and on Linux the kernel ends it,
wherever it hangs).
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import pkgutil
import queue
import signal
import subprocess
import sys
import threading
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import IO, Any

from ..errors import TcbenchError
from .codec import from_json, to_json

# the path comes first: tcbench itself may be on it, and -P keeps a json.py of the current folder from being run
START = (
    "import sys, json; told = json.loads(sys.argv[1]); sys.path[:] = told['path']; "
    "from tcbench.runner.child import main; main(told)"
)
FLAGS = {"dont_write_bytecode": "-B", "optimize": "-O", "no_user_site": "-s", "ignore_environment": "-E"}
# Cells run side by side, one a core: threads inside them would only get in each other's way and blur timings.
ONE_THREAD = (
    "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS", "NUMEXPR_NUM_THREADS",
)  # fmt: skip
READY = b"ready\n"


class Child:
    """A process that answers calls in their order.

    heard : called in another thread with this object and READY, then each answer, and None when the process has ended.
    begin : function that it calls first, with the JSON that the file `settings` holds. output : where
        what it prints goes, this process's stderr by default.
    """

    def __init__(
        self, heard: Callable[[Child, bytes | None], None], begin: str = "", settings: str = "",
        output: IO[bytes] | None = None,
    ) -> None:  # fmt: skip
        path = [os.fspath(p) or os.getcwd() for p in sys.path]
        told = json.dumps({"path": path, "begin": begin, "settings": settings})
        flags = [flag for name, flag in FLAGS.items() for _ in range(int(getattr(sys.flags, name)))]
        flags += ["-B"] if sys.dont_write_bytecode and "-B" not in flags else []
        group: dict[str, Any] = {"process_group": 0}  # Ctrl-C is the parent's, who ends this one
        if os.name == "nt":  # pragma: no cover
            group = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}  # type: ignore[attr-defined]
        self._heard = heard
        self.process = subprocess.Popen(
            [sys.executable, *flags, "-P", "-c", START, told], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=output, env=dict.fromkeys(ONE_THREAD, "1") | os.environ, **group,
        )  # fmt: skip
        threading.Thread(target=self._listen, name="tcbench-child", daemon=True).start()

    def call(self, function: str, *arguments: Any) -> None:
        """Have it call "package.module:function"; of one that has died meanwhile the end is on its way to `heard`."""
        assert self.process.stdin is not None
        with contextlib.suppress(OSError):
            self.process.stdin.write(to_json([function, arguments]) + b"\n")
            self.process.stdin.flush()

    def kill(self) -> None:
        """End it, whatever it is doing, and what it has started."""
        started = descendants(self.process.pid)
        self.process.kill()
        if hasattr(os, "killpg"):
            with contextlib.suppress(OSError):  # none of its group is left
                os.killpg(self.process.pid, signal.SIGKILL)
            for pid in started:  # in sessions of their own, too
                with contextlib.suppress(OSError):
                    os.kill(pid, signal.SIGKILL)

    def is_alive(self) -> bool:
        return self.process.poll() is None

    def _listen(self) -> None:
        assert self.process.stdout is not None and self.process.stdin is not None
        with contextlib.suppress(OSError, ValueError), self.process.stdout as lines:
            for line in lines:
                self._heard(self, line)
        self.process.wait()
        with contextlib.suppress(OSError):
            self.process.stdin.close()
        self._heard(self, None)


def descendants(pid: int) -> list[int]:
    """The processes that a process has started, and those that these have (on Linux; elsewhere none are seen)."""
    found: list[int] = []
    for path in Path(f"/proc/{pid}/task").glob("*/children"):
        with contextlib.suppress(OSError):
            own = list(map(int, path.read_text().split()))
            found += own + [each for one in own for each in descendants(one)]
    return found


def how_it_died(code: int | None) -> str:
    """Of an exit code: "exit code 3", "killed by SIGSEGV", "lost"."""
    name = signal_name(code)
    return f"killed by {name}" if name else "lost" if code is None else f"exit code {code}"


def signal_name(code: int | None) -> str | None:
    """The signal that an exit code tells of, if it does."""
    if code is None or code >= 0:
        return None
    try:
        return signal.Signals(-code).name
    except ValueError:
        return f"signal {-code}"


# -- the other half


def main(told: Mapping[str, Any]) -> None:
    """Answer the calls that come on standard input, on what was standard output; return never."""
    calls, answers, own = os.fdopen(os.dup(0), "rb"), os.dup(1), os.getpid()
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)
    sys.argv[:] = [""]
    _end_with_the_parent()
    waiting: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    threading.Thread(target=_hear, args=(calls, waiting.put), name="tcbench-calls", daemon=True).start()

    def say(data: bytes) -> None:
        if os.getpid() != own:
            os._exit(0)  # a copy that foreign code has forked and that came back from it
        while data:
            data = data[os.write(answers, data) :]

    if told["begin"]:
        pkgutil.resolve_name(told["begin"])(from_json(Path(told["settings"]).read_bytes()))
    say(READY)
    while True:
        function, arguments = from_json(waiting.get())
        try:
            text = pkgutil.resolve_name(function)(*arguments)
        except BaseException as error:
            kind = type(error).__name__ if isinstance(error, TcbenchError) else ""
            raised = "".join(traceback.format_exception(error))
            text = to_json({"raised": raised, "kind": kind, "sentence": str(error) if kind else ""})
        say((text if isinstance(text, bytes) else text.encode()) + b"\n")


def _hear(calls: IO[bytes], put: Callable[[bytes], None]) -> None:
    for line in calls:
        put(line)
    if hasattr(os, "killpg"):  # the parent is gone: this process and what its cells have started end
        for pid in descendants(os.getpid()):
            with contextlib.suppress(OSError):
                os.kill(pid, signal.SIGKILL)
        os.killpg(0, signal.SIGKILL)
    os._exit(1)


def _end_with_the_parent() -> None:
    """A killed parent must not leave a process behind, least of all one that hangs in C code."""
    if sys.platform == "linux":
        with contextlib.suppress(Exception):
            ctypes.CDLL(None).prctl(1, int(signal.SIGKILL), 0, 0, 0)  # 1 = PR_SET_PDEATHSIG
            ctypes.CDLL(None).prctl(36, 1, 0, 0, 0)  # PR_SET_CHILD_SUBREAPER: what its children leave behind is its own
