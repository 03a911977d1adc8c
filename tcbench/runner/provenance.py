"""Where rows come from: versions, commit, machine, command line. Imports nothing heavy."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from functools import lru_cache
from pathlib import Path
from typing import Any

from ..packages import installed_version

# a new version of these may change digits, so it changes keys
NUMERICAL_PACKAGES = ("numpy", "scipy", "llvmlite")
PACKAGES = (*NUMERICAL_PACKAGES, "pandas", "dask", "distributed")
THREAD_VARIABLES = (
    "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "TCBENCH_PLAIN", "TCBENCH_TARGET",
)  # fmt: skip


def provenance(command: Sequence[str] | None = None, packages: Sequence[str] = ()) -> dict[str, Any]:
    """Everything needed to repeat a run, as JSON values.

    Parameters
    ----------
    packages : whose versions count beside tcbench's own: those that the methods of the run require.
    command : the command line; `sys.argv` by default. The home directory in it becomes `~`.
    """
    return {
        "tcbench": installed_version("tcbench") or None,
        "git": git_state(Path(__file__).parent),
        "python": platform.python_version(),
        "implementation": platform.python_implementation(),
        "packages": versions(dict.fromkeys((*PACKAGES, *packages))),
        "machine": machine() | {"usable_cores": usable_cores()},
        "threads": {name: os.environ[name] for name in THREAD_VARIABLES if name in os.environ},
        "command": _command(sys.argv if command is None else command),
    }


def _command(words: Sequence[str]) -> list[str]:
    """The command line without what belongs to one machine: where the program is installed, the home directory."""
    return [Path(word).name if i == 0 else without_home(word) for i, word in enumerate(words)]


def utc_now() -> str:
    """The time now in UTC, to the second, as in 2025-01-31T12:00:00Z."""
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def versions(names: Iterable[str] = NUMERICAL_PACKAGES) -> dict[str, str]:
    """Installed versions by name, read from package metadata; absent packages are left out."""
    return {name: text for name in names if (text := installed_version(name))}


@lru_cache(maxsize=1)
def machine() -> dict[str, Any]:
    """CPU model, logical cores, architecture and operating system; no host name."""
    return {
        "cpu": cpu_model(),
        "cores": os.cpu_count(),
        "architecture": platform.machine(),
        "system": platform.system(),
    }


def machine_name(kind: Any = None) -> str:
    """The kind of machine that a timing belongs to (`Cell.machine`): equal on equal machines. This one by default."""
    if kind is None:
        kind = machine()
    elif not isinstance(kind, Mapping):  # of a damaged file
        kind = {}
    return "{cpu}, {cores} cores, {architecture} {system}".format_map({**dict.fromkeys(machine(), "?"), **kind})


def usable_cores() -> int:
    """The cores that this process may keep busy: its affinity, and the quota of the container that it runs in."""
    from loky import cpu_count

    return int(cpu_count())


def cpu_model() -> str:
    """The CPU's marketing name, as the operating system tells it."""
    try:
        for line in Path("/proc/cpuinfo").read_text(errors="replace").splitlines():
            name, _, value = line.partition(":")
            if name.strip().lower() in ("model name", "cpu model", "hardware") and value.strip():
                return value.strip()
    except OSError:
        pass
    if sys.platform == "darwin":
        return _output(["sysctl", "-n", "machdep.cpu.brand_string"]) or platform.machine()
    return platform.processor() or platform.machine() or "unknown"


def git_state(folder: Path) -> dict[str, Any] | None:
    """Commit, branch and whether tracked files differ from it; None outside a checkout or without git.

    A folder that git ignores or does not track (an installed package inside somebody's checkout) is outside.
    """
    commit = _output(["git", "-C", str(folder), "rev-parse", "HEAD"])
    if not commit or not _output(["git", "-C", str(folder), "ls-files", "--", "."]):
        return None
    changes = _output(["git", "-C", str(folder), "status", "--porcelain", "--untracked-files=no"], strip=False)
    branch = _output(["git", "-C", str(folder), "rev-parse", "--abbrev-ref", "HEAD"])
    return {"commit": commit, "dirty": None if changes is None else bool(changes.strip()), "branch": branch}


def without_home(text: str) -> str:
    """The text with the user's home directory replaced by `~`: manifests are published."""
    home = os.path.expanduser("~")
    return text.replace(home, "~") if len(home) > 1 else text


def _output(command: list[str], strip: bool = True) -> str | None:
    """What a short command prints, None when it is absent, fails, or takes more than five seconds."""
    # GIT_OPTIONAL_LOCKS: `git status` must not write to an index that the user may be using
    environment = os.environ | {"GIT_OPTIONAL_LOCKS": "0", "LC_ALL": "C"}
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=5, env=environment, check=False)
    except (OSError, subprocess.SubprocessError):
        return None
    if done.returncode != 0:
        return None
    return done.stdout.strip() if strip else done.stdout
