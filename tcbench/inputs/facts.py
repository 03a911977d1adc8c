"""What a process finds around it without opening a file: its machine, its current folder, its variables."""

from __future__ import annotations

import contextlib
import locale
import os
import platform
import re
from collections.abc import Callable, Iterable, Mapping
from importlib.machinery import PathFinder

from .marks import SITE, file_hash, text_hash

# variables that say where things are on a machine: what is read there is noted itself
PLACES = re.compile(
    r"(PATH|HOME|TMPDIR|TEMP|TMP|PWD|OLDPWD|USER|LOGNAME|SHELL|LANG|LC_.*|XDG_.*|TERM|COLUMNS|LINES|_)\Z"
)
# and those of one login, which change from window to window
SESSION = re.compile(
    r"(SSH|DBUS|GPG|GNOME|KDE|VTE|VSCODE|TMUX|TERM|COLOR|WINDOW|SESSION|DESKTOP|JOURNAL|INVOCATION|HIST|LS_|PS[1-4]\Z|"
    r"STY\Z|SHLVL\Z|DISPLAY\Z|WAYLAND_DISPLAY\Z|PYTEST_CURRENT_TEST\Z)"
)
AT_START = ("sitecustomize", "usercustomize")  # modules that Python imports before anything else
ENCODING = locale.getpreferredencoding(False).lower()  # before any plugin could change it

CURRENT, NAMES, VARIABLES = "(current folder)", "(names of all)", "(all variables)"
MACHINE, CORES, UMASK, TEXT = "(machine)", "(cores)", "(umask)", "(encoding)"
STARTED_WITH, PACKAGES = "(code at start)", "(packages)"
Variables = Mapping[str, str]


def names_of(variables: Iterable[str]) -> list[str]:
    """The names of variables, as far as they may be inputs."""
    return sorted(name for name in variables if not PLACES.match(name))


def _all(variables: Variables) -> str:
    """What C code may be told by the environment."""
    return "\0".join(f"{name}={variables[name]}" for name in names_of(variables) if not SESSION.match(name))


def _umask() -> str:
    found = os.umask(0o077)
    os.umask(found)
    return f"{found:o}"


def _cores() -> str:
    """Those that this process may use."""
    return str(sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count())


def _at_start() -> str:
    """Code that Python runs before anything else: in .pth files, and the two modules."""
    lines = [str(file_hash(spec.origin)) for n in AT_START if (spec := PathFinder.find_spec(n)) and spec.origin]
    for path in path_files():
        with contextlib.suppress(OSError), open(path, encoding="utf-8", errors="replace") as file:
            lines += [line for line in file if line.startswith(("import ", "import\t"))]
    return "".join(lines)


def path_files() -> list[str]:
    """The .pth files among installed packages, but those of editable installs."""
    return [folder + n for folder in SITE for n in _names(folder) if n.endswith(".pth") and not n.startswith("__edit")]


def _packages() -> str:
    return "\0".join(n for folder in SITE for n in _names(folder) if n != "__pycache__")


def _names(folder: str) -> list[str]:
    with contextlib.suppress(OSError):
        return sorted(os.listdir(folder))
    return []


FACTS: dict[str, Callable[[Variables, str], str]] = {
    CURRENT: lambda variables, folder: folder,
    NAMES: lambda variables, folder: "\0".join(names_of(variables)),
    VARIABLES: lambda variables, folder: _all(variables),
    MACHINE: lambda variables, folder: repr((*platform.uname(), os.cpu_count())),
    CORES: lambda variables, folder: _cores(),
    UMASK: lambda variables, folder: _umask(),
    TEXT: lambda variables, folder: ENCODING,
    STARTED_WITH: lambda variables, folder: _at_start(),
    PACKAGES: lambda variables, folder: _packages(),
}


def fact_mark(name: str, variables: Variables, folder: str) -> str | None:
    """Of a variable, or of what else a process finds around it. folder: the one it was started in."""
    found = FACTS.get(name)
    return text_hash(variables.get(name) if found is None else found(variables, folder))
