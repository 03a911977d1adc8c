"""A worker's process as its parent sees it: JSON lines on two pipes, the same on every system.

A call is a cell, the answer the text of its row, so that nothing that foreign code made is unpickled here. The process
starts afresh, with this one's path, flags and environment, one thread unless the user says more, and no arguments,
standard input or terminal. It ends when this process ends, however that goes: its pipe is closed then (and on Linux
the kernel ends it, wherever it hangs).
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import IO, Any

from .codec import to_json

# the path comes first: tcbench itself may be on it, and -P keeps a json.py of the current folder from being run
START = (
    "import sys, json; launch = json.loads(sys.argv[1]); sys.path[:] = launch['path']; "
    "from tcbench.runner.worker import main; main(launch['settings'])"
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
    settings : the JSON file of what `worker.start` is given. output : where what it prints goes.
    """

    def __init__(self, heard: Callable[[Child, bytes | None], None], settings: Path, output: IO[bytes]) -> None:
        path = [os.fspath(p) or os.getcwd() for p in sys.path]
        launch = json.dumps({"path": path, "settings": os.fspath(settings)})
        flags = [flag for name, flag in FLAGS.items() for _ in range(int(getattr(sys.flags, name)))]
        flags += ["-B"] if sys.dont_write_bytecode and "-B" not in flags else []
        group: dict[str, Any] = {"process_group": 0}  # Ctrl-C is the parent's, who ends this one
        if os.name == "nt":  # pragma: no cover
            group = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}  # type: ignore[attr-defined]
        self._heard = heard
        self.process = subprocess.Popen(
            [sys.executable, *flags, "-P", "-c", START, launch], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=output, env=dict.fromkeys(ONE_THREAD, "1") | os.environ, **group,
        )  # fmt: skip
        threading.Thread(target=self._listen, name="tcbench-child", daemon=True).start()

    def call(self, cell: Mapping[str, Any], extra: Mapping[str, Any]) -> None:
        """Have it measure a cell; of one that has died meanwhile the end is on its way to `heard`."""
        assert self.process.stdin is not None
        with contextlib.suppress(OSError):
            self.process.stdin.write(to_json([cell, extra]) + b"\n")
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
    pids: list[int] = []
    for path in Path(f"/proc/{pid}/task").glob("*/children"):
        with contextlib.suppress(OSError):
            own = list(map(int, path.read_text().split()))
            pids += own + [each for one in own for each in descendants(one)]
    return pids


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
