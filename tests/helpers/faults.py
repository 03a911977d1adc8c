"""Measure functions that behave well, and deliberately bad ones: what the fault suite runs."""

from __future__ import annotations

import ctypes
import importlib
import math
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path


def measure(cell: dict, context: dict) -> dict:
    """The good one, or the fault that the cell's integrator names."""
    return globals().get(f"fault_{cell['integrator']}", good)(cell, context)


def good(cell: dict, context: dict) -> dict:
    n = cell["options"].get("n", 0)
    time.sleep(cell["options"].get("sleep", 0.0))
    return {"value": math.sin(n + 0.1) ** 3, "list": [1.0 / (k + n + 1) for k in range(3)], "status": "ok"}


def pid(cell: dict, context: dict) -> dict:
    began = time.monotonic()
    time.sleep(0.02)
    return {"pid": os.getpid(), "began": began, "seen": time.monotonic()}


def fault_hang(cell, context):
    print("hanging", flush=True)
    while True:
        time.sleep(10)


def fault_hang_in_c(cell, context):
    print("hanging", flush=True)
    ctypes.PyDLL(None).sleep(1000)  # PyDLL keeps the GIL: no Python signal handler ever runs


def fault_segfault(cell, context):
    print("about to read address 0", file=sys.stderr)
    ctypes.string_at(0)


def fault_os_exit(cell, context):
    os._exit(3)


def fault_os_exit_zero(cell, context):
    os._exit(0)


def fault_kill(cell, context):
    os.kill(os.getpid(), signal.SIGKILL)


def fault_system_exit(cell, context):
    sys.exit("leaving")


def fault_exception(cell, context):
    raise ValueError("x" * 10_000_000)


class UnprintableError(Exception):
    def __str__(self):
        raise RuntimeError("no")


def fault_unprintable(cell, context):
    raise UnprintableError


def fault_nan(cell, context):
    return {
        "value": math.nan,
        "list": [math.inf, -math.inf, 1.0],
        "nested/~": {"a": [math.nan]},
        "status": "nonfinite",
    }


def fault_wrong_shape(cell, context):
    return [1, 2, 3]


def fault_not_json(cell, context):
    return {"value": object()}


def fault_memory(cell, context):
    return {"value": len(bytearray(20 * 2**30))}


def fault_prints(cell, context):
    line = "all work and no play " * 50
    while True:
        print(line)


def fault_import_error(cell, context):
    import a_module_that_does_not_exist  # noqa: F401


def fault_syntax_error(cell, context):
    folder = Path(context["folder"])
    (folder / "bad_syntax.py").write_text("def step(:\n")
    sys.path.insert(0, str(folder))
    importlib.import_module("bad_syntax")


def fault_slow_import(cell, context):
    folder = Path(context["folder"])
    (folder / "slow_module.py").write_text("import time\ntime.sleep(0.6)\nVALUE = 42.0\n")
    sys.path.insert(0, str(folder))
    return {"value": importlib.import_module("slow_module").VALUE}


def fault_closes_stdout(cell, context):
    sys.stdout.close()
    sys.stderr = None
    os.close(1)
    os.close(2)
    return {"value": 1.0}


def fault_time_bomb(cell, context):
    """Ends well, but leaves a thread behind that kills the worker while it is idle or runs another cell."""
    threading.Timer(0.05, os._exit, (7,)).start()
    return {"value": 2.0}


def fault_spins(cell, context):
    """Leaves two processes behind, one in a session of its own."""
    code = "import time; time.sleep(300)"
    children = [subprocess.Popen([sys.executable, "-c", code], start_new_session=own) for own in (False, True)]
    return {"pids": [child.pid for child in children]}


def fault_huge_row(cell, context):
    return {"value": "x" * (80 * 2**20)}
