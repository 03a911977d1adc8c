"""What a process has read, as data: paths relative to the folders of plugins, each with what it was."""

from __future__ import annotations

import hashlib
import json
import os
import sys
import threading
from collections.abc import Sized
from typing import Any

from .facts import STARTED_WITH, TEXT, fact_mark
from .marks import KNOWN, LOOKS, OWN, PYTHON, SITE, distributions_of, package_mark, top

KINDS = (*LOOKS, "environment", "packages")
SET_HERE = "set by the cell itself"
CHANGED = "changed while it was measured"


class Seen:
    """What a process was seen to read, by kind: path or name, and its mark then.

    Of paths the kinds are those of `marks.LOOKS`; `environment` has variables and what else `facts` knows.
    """

    def __init__(self) -> None:
        self.start = os.getcwd()
        self.variables = dict(os.environ)
        self.noted: dict[str, dict[str, str | None]] = {kind: {} for kind in KINDS}
        self.files, self.folders, self.links, self.modes = (self.noted[kind] for kind in KINDS[:4])
        self.lookups, self.environment, self.packages = (self.noted[kind] for kind in KINDS[4:])
        self.modules: dict[str, None] = {}
        self.unseen: dict[str, None] = {}
        self.plugins: dict[str, str] = {}  # label -> its folder, of the plugins that were imported
        self.looking = threading.local()  # a thread that is noting something: its own reads are no inputs
        self.stats: dict[str, Any] = {}
        self._size: tuple[int, ...] = ()
        self._known: tuple[str, str] = "", ""
        self._before = frozenset(sys.modules)
        for name in ("TZ", TEXT, STARTED_WITH):  # read by every process
            self.fact(name)

    def fact(self, name: str) -> None:
        """A variable, or what `facts` has by that name, was read, as it was when the process began."""
        if name not in self.environment:
            self.environment[name] = fact_mark(name, self.variables, self.start)

    def full(self, path: str) -> str:
        """Where a path is that was named from the folder that the run was started in."""
        return os.path.join(self.start, path[2:]) if path.startswith("./") else path

    def taken(self) -> dict[str, Any]:
        """All of it, for another worker of this machine that uses what this one has made."""
        return {**self.noted, "plugins": self.plugins, "unseen": list(self.unseen)}

    def take(self, other: dict[str, Any]) -> None:
        """Add what another worker has read."""
        for path, mark in other["files"].items():
            if self.files.setdefault(path, mark) != mark:
                self.unseen.setdefault(f"{path} {CHANGED}")
        for kind, noted in self.noted.items():
            noted.update(other[kind] | noted)
        self.unseen.update(dict.fromkeys(other["unseen"]))
        self.plugins.update(other["plugins"])

    def collected(self) -> tuple[str, str]:
        """Identity and JSON text of what was seen so far."""
        self.looking.now = True
        try:
            for path, then in list(self.stats.items()):
                if not path.startswith(SITE) and then != stat_of(self.full(path)):
                    self.unseen.setdefault(f"{self.portable(path)} {CHANGED}")
            for path, mark in list(self.folders.items()):
                if LOOKS["folders"](self.full(path)) != mark:
                    self.unseen.setdefault(f"{self.portable(path)} {CHANGED}")
            parts: tuple[Sized, ...] = (*self.noted.values(), self.modules, self.unseen, self.plugins)
            size = tuple(map(len, parts))
            if size != self._size:
                text = json.dumps(self._as_data(), sort_keys=True)
                self._size, self._known = size, (hashlib.sha256(text.encode()).hexdigest()[:20], text)
            return self._known
        finally:
            self.looking.now = False

    def _as_data(self) -> dict[str, Any]:
        noted = {kind: dict(found) for kind, found in self.noted.items()}  # threads may add
        tops = {top(path) for path in noted["files"] if path.startswith(SITE)}
        brought = {name for one in tops if one not in KNOWN for name in distributions_of().get(one, ())}
        return {
            **{kind: {self.portable(path): mark for path, mark in noted[kind].items()} for kind in LOOKS},
            "plugins": sorted(self.plugins),
            "environment": {n: mark for n, mark in noted["environment"].items() if mark != SET_HERE},
            "packages": noted["packages"] | {name: package_mark(name) for name in brought},
            "modules": self._found_modules(),
            "unseen": sorted(self.unseen),
        }

    def _found_modules(self) -> dict[str, str | None]:
        """The file that an import of each name found, None where it found none."""
        modules: dict[str, str | None] = {}
        for name in set(self.modules) - self._before - KNOWN:
            module = sys.modules.get(name)
            file = getattr(module, "__file__", None)
            if module is None:
                modules[name] = None
            elif file and (file.startswith(SITE) or not os.path.abspath(file).startswith((*PYTHON, *OWN))):
                modules[name] = self.portable(os.path.abspath(file))
        return modules

    def portable(self, path: str) -> str:
        """A path relative to a plugin's folder, or to the one above; to site-packages; to the user's home."""
        if path.startswith("./"):
            return path
        for above in (False, True):
            for label, folder in sorted(self.plugins.items()):
                start = os.path.dirname(folder) if above else folder
                if path.startswith(start + os.sep) and (not above or os.path.dirname(start) != start):
                    return f"<{label}>/" + os.path.relpath(path, folder).replace(os.sep, "/")
        for start in SITE:
            if path.startswith(start):
                return "<>/" + path[len(start) :].replace(os.sep, "/")
        home = os.path.expanduser("~") + os.sep
        return "~/" + path[len(home) :] if path.startswith(home) else path


def stat_of(path: str) -> Any:
    """What a write changes, whatever time its writer gives the file."""
    try:
        found = os.stat(path)
    except OSError:
        return None
    return found.st_size, found.st_mtime_ns, found.st_ctime_ns, found.st_ino
