"""What foreign code reads, noted while it runs: a row is used again only while all of that is as it was.

A worker begins to watch before it imports the first plugin that is not tcbench's own, and goes on to its end: files,
files that are asked for and absent, libraries, listed folders, where links lead, environment variables, modules asked
for by name, installed packages. What a worker has seen
belongs to every cell that it measures from then on. `engine.reuse` compares it with what is there now.

Paths are kept relative to the folder of a plugin that the cell uses, so that a folder may be moved. What cannot be seen
(what C code reads by itself, the clock) is said in docs/running.md.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib.util
import json
import os
import re
import sys
import threading
from collections.abc import Callable, Iterable
from importlib.machinery import EXTENSION_SUFFIXES
from typing import Any
from urllib.parse import unquote, urlsplit

from .marks import (
    A_FOLDER,
    INSTALLED,
    KNOWN,
    NOWHERE,
    OWN,
    PYTHON,
    SITE,
    SIZES,
    distributions_of,
    file_hash,
    folder_hash,
    package_mark,
    text_hash,
    top,
)

# variables that say where things are on a machine: what is read there is noted itself
PLACES = re.compile(
    r"(PATH|HOME|TMPDIR|TEMP|TMP|PWD|OLDPWD|USER|LOGNAME|SHELL|LANG|LC_.*|XDG_.*|TERM|COLUMNS|LINES|_)\Z"
)
PROCESSES = ("subprocess.Popen", "os.system", "os.exec", "os.posix_spawn", "os.spawn", "os.fork", "os.forkpty")
NETWORK = ("socket.connect", "socket.getaddrinfo", "socket.bind", "urllib.Request")
STARTED, CONNECTED = "a process was started", "the network was used"
BY_DESCRIPTOR, MACHINE = "a file was named by an open folder", "the state of the machine was read"
CURRENT, NAMES = "(current folder)", "(names of all)"  # among the variables
SET_HERE = "set by the cell itself"
LEFT_OUT: list[str] = []  # folders of tcbench's own, whose files are no inputs
HERE = os.path.dirname(os.path.abspath(__file__)) + os.sep


class Recorder:
    """What one process has read since it began to watch."""

    def __init__(self) -> None:
        self.files: dict[str, str | None] = {}
        self.folders: dict[str, str | None] = {}
        self.environment: dict[str, str | None] = {}
        self.modules: dict[str, None] = {}
        self.links: dict[str, str | None] = {}
        self.unseen: dict[str, None] = {}
        self.plugins: dict[str, str] = {}  # label -> its folder, of the plugins that were imported
        self.loaded_libraries = False
        self.start = os.getcwd()
        self._stats: dict[str, Any] = {}
        self._written: set[str] = set()
        self._looking = threading.local()  # a thread that is noting something: its own reads are no inputs
        self._size: tuple[int, ...] = ()
        self._known: tuple[str, str] = "", ""
        self._before = frozenset(sys.modules)
        self.handlers: dict[str, Callable[[str, tuple[Any, ...]], object]] = {
            "open": self._open, "import": self._import,
            "ctypes.dlopen": self._library, "sqlite3.connect": self._library,
            "os.listdir": self._list, "os.scandir": self._list, "os.putenv": self._put, "os.unsetenv": self._put,
            **dict.fromkeys(PROCESSES, lambda event, arguments: self.unseen.setdefault(STARTED)),
            **dict.fromkeys(NETWORK, lambda event, arguments: self.unseen.setdefault(CONNECTED)),
        }  # fmt: skip

    def heard(self, event: str, arguments: tuple[Any, ...]) -> None:
        """An audit event of Python."""
        handler = self.handlers.get(event)
        if handler is None or getattr(self._looking, "now", False):
            return
        self._looking.now = True
        try:
            handler(event, arguments)
        except Exception as error:  # never in the way of what is measured
            self.unseen.setdefault(f"{event} could not be noted ({type(error).__name__})")
        finally:
            self._looking.now = False

    # -- events

    def _open(self, event: str, arguments: tuple[Any, ...]) -> None:
        path, mode, flags = arguments
        if path is None or isinstance(path, int):
            return
        path = self.named(path)
        if path.startswith(("/proc/", "/sys/")) and foreign(installed=False):
            self.unseen.setdefault(MACHINE)
        if isinstance(mode, str):
            writes, reads = any(c in mode for c in "wxa"), "r" in mode or "+" in mode
        else:
            writes, reads = bool(flags & (os.O_WRONLY | os.O_RDWR | os.O_TRUNC)), not flags & os.O_WRONLY
        if writes and not reads and path not in self.files:
            self._written.add(path)
        elif reads:
            self.note(path)
            if writes and self.files.get(path, "") is None:  # made by this open
                del self.files[path]
                self._written.add(path)

    def named(self, path: Any) -> str:
        """The absolute path of a file; one that is named from the folder that the run was started in begins with ./"""
        name = os.fsdecode(path)
        full = os.path.abspath(name)
        if os.path.isabs(name) or os.getcwd() != self.start:
            return full
        return "./" + os.path.relpath(full, self.start)

    def _full(self, path: str) -> str:
        return os.path.join(self.start, path[2:]) if path.startswith("./") else path

    def _import(self, event: str, arguments: tuple[Any, ...]) -> None:
        if arguments[1]:  # of an extension module
            self._library(event, arguments[1:2])

    def _library(self, event: str, arguments: tuple[Any, ...]) -> None:
        name = os.fsdecode(arguments[0] or "")
        if name.startswith("file:"):  # a database
            name = unquote(urlsplit(name).path)
        if os.sep in name:
            self.note(self.named(name))
            self.loaded_libraries = self.loaded_libraries or not name.startswith((*SITE, *PYTHON, *OWN))

    def _list(self, event: str, arguments: tuple[Any, ...]) -> None:
        caller = sys._getframe(3).f_code.co_filename
        if isinstance(arguments[0], int):
            if not caller.startswith(("<frozen", *PYTHON)) and foreign():
                self.unseen.setdefault(BY_DESCRIPTOR)
            return
        path = self.named(arguments[0] or ".")
        where, imports = self._full(path) + os.sep, caller.startswith("<frozen importlib")
        if not imports and not where.startswith((*NOWHERE, *LEFT_OUT, *PYTHON, *SITE, *OWN)) and foreign():
            if event == "os.scandir" and not caller.startswith(PYTHON):  # who may ask each entry for its size
                path += SIZES
            self.folders.setdefault(path, folder_hash(self._full(path)))

    def _put(self, event: str, arguments: tuple[Any, ...]) -> None:
        self.environment.setdefault(os.fsdecode(arguments[0]), SET_HERE)

    def looked(self, function: str, path: Any, descriptor: Any) -> None:
        """Foreign code asks `os` whether a file is there, where a link leads or what the current folder is."""
        if getattr(self._looking, "now", False) or isinstance(path, int) or not foreign():
            return
        self._looking.now = True
        try:
            if descriptor is not None:
                self.unseen.setdefault(BY_DESCRIPTOR)
            elif function.startswith("getcwd"):
                if os.getcwd() == self.start:
                    self.environment.setdefault(CURRENT, text_hash(self.start))
            elif function != "open":
                path = self.named(path)
                link = link_mark(self._full(path))
                if link is not None or function == "lstat":
                    self.links.setdefault(path, link)
                if function != "readlink":
                    self.note(path, asked=True)
        except Exception as error:
            self.unseen.setdefault(f"os.{function} could not be noted ({type(error).__name__})")
        finally:
            self._looking.now = False

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> None:
        """A module is looked for: the first of Python's finders, which finds nothing and notes the name."""
        if "." not in name:
            self.modules.setdefault(name)
        elif path is not None and not getattr(self._looking, "now", False):
            self._looking.now = True
            try:
                self._submodule(name.rpartition(".")[2], list(path))
            finally:
                self._looking.now = False

    def _submodule(self, name: str, folders: Iterable[Any]) -> None:
        """What an import of it finds first in the folders of its package, or would if it were there."""
        kinds = (os.sep + "__init__.py", *EXTENSION_SUFFIXES, ".py", "")
        for folder in (f for f in folders if isinstance(f, str) and not (f + os.sep).startswith(INSTALLED)):
            for kind in kinds:
                path = self.named(os.path.join(folder, name + kind))
                self.note(path, asked=True)
                if self.files.get(path) is not None:
                    return

    def asked(self, name: Any) -> None:
        """An environment variable was read."""
        if getattr(self._looking, "now", False) or not isinstance(name, str | bytes):
            return
        self._looking.now = True
        try:
            name = os.fsdecode(name)
            if name not in self.environment and not PLACES.match(name) and foreign():
                value = os.environ._data.get(os.fsencode(name))  # type: ignore[attr-defined]
                self.environment[name] = text_hash(value)
        finally:
            self._looking.now = False

    def names(self) -> None:
        """The environment was read as a whole: a variable that comes is an input, too."""
        if not getattr(self._looking, "now", False) and foreign():
            given = (os.fsdecode(name) for name in os.environ._data)  # type: ignore[attr-defined]
            kept = names_of(name for name in given if self.environment.get(name) != SET_HERE)
            self.environment.setdefault(NAMES, text_hash(kept))

    def note(self, path: str, asked: bool = False) -> None:
        """A file is about to be read: its content now. asked: whether there is one."""
        if path.endswith(".pyc"):
            with contextlib.suppress(ValueError, NotImplementedError):
                path = importlib.util.source_from_cache(path)
                if not os.path.exists(full := self._full(path)):  # a source of another kind has left it
                    folder, stem = os.path.split(os.path.splitext(full)[0])
                    with contextlib.suppress(OSError):
                        for name in os.listdir(folder):
                            if name.startswith(stem + "."):
                                self.note(self.named(os.path.join(folder, name)))
        full = self._full(path)
        if path in self.files or path in self._written or full.startswith((*NOWHERE, *LEFT_OUT, *OWN)):
            return
        if full.startswith(SITE):
            if top(full) in KNOWN or full.endswith("-info/entry_points.txt"):  # of all that is installed
                return
        elif full.startswith((*PYTHON, os.path.join(sys.base_prefix, "lib", "python"))):
            return  # Python's own, known by its version
        if os.path.isdir(full):
            if asked and not any(
                (folder + os.sep).startswith(full.rstrip(os.sep) + os.sep) for folder in self._homes()
            ):
                self.files[path] = A_FOLDER
        elif not os.path.exists(full) or os.path.isfile(full):
            self._stats[path] = _stat(full)
            self.files[path] = file_hash(full)

    def _homes(self) -> Iterable[str]:
        """Folders that are there wherever the plugins are."""
        return (self.start, os.path.expanduser("~"), *self.plugins.values())

    # -- what was seen

    def taken(self) -> dict[str, Any]:
        """All of it, for another worker of this machine that uses what this one has made."""
        return {"files": self.files, "folders": self.folders, "links": self.links, "environment": self.environment,
                "unseen": list(self.unseen), "plugins": self.plugins}  # fmt: skip

    def take(self, other: dict[str, Any]) -> None:
        """Add what another worker has read."""
        for path, mark in other["files"].items():
            if self.files.setdefault(path, mark) != mark:
                self.unseen.setdefault(f"{path} changed while it was measured")
        for kind in ("folders", "links", "environment"):
            for name, mark in other[kind].items():
                getattr(self, kind).setdefault(name, mark)
        self.unseen.update(dict.fromkeys(other["unseen"]))
        self.plugins.update(other["plugins"])

    def collected(self) -> tuple[str, str]:
        """Identity and JSON text of what was seen so far."""
        self._looking.now = True
        try:
            if self.loaded_libraries:
                self._mapped()
            for path, then in self._stats.items():
                if not path.startswith(SITE) and then != _stat(self._full(path)):
                    self.unseen.setdefault(f"{self.portable(path)} changed while it was measured")
            for path, mark in self.folders.items():
                if folder_hash(self._full(path)) != mark:
                    self.unseen.setdefault(f"{self.portable(path)} changed while it was measured")
            parts = self.files, self.folders, self.links, self.environment, self.modules, self.unseen, self.plugins
            size = tuple(len(part) for part in parts)
            if size != self._size:
                text = json.dumps(self._as_data(), sort_keys=True)
                self._size, self._known = size, (hashlib.sha256(text.encode()).hexdigest()[:20], text)
            return self._known
        finally:
            self._looking.now = False

    def _as_data(self) -> dict[str, Any]:
        tops = {top(path) for path in self.files if path.startswith(SITE)}
        packages = {name for top in tops if top not in KNOWN for name in distributions_of().get(top, ())}
        modules: dict[str, str | None] = {}
        for name in set(self.modules) - self._before:
            module = sys.modules.get(name)
            file = getattr(module, "__file__", None)
            if name in KNOWN:
                continue
            if module is None:
                modules[name] = None
            elif file and (file.startswith(SITE) or not os.path.abspath(file).startswith((*PYTHON, *OWN))):
                modules[name] = self.portable(os.path.abspath(file))
        return {
            "plugins": sorted(self.plugins),
            "files": {self.portable(path): mark for path, mark in self.files.items()},
            "folders": {self.portable(path): mark for path, mark in self.folders.items()},
            "links": {self.portable(path): mark for path, mark in self.links.items()},
            "environment": {n: mark for n, mark in self.environment.items() if mark != SET_HERE},
            "packages": {name: package_mark(name) for name in packages},
            "modules": modules,
            "unseen": sorted(self.unseen),
        }

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

    def _mapped(self) -> None:
        """Libraries that libraries have loaded, and what C code has mapped to read (Linux); what is shared and
        written to is a memory of several processes, as a database of theirs has one."""
        try:
            with open("/proc/self/maps", encoding="utf-8", errors="replace") as file:
                paths = {line.split(None, 5)[5].rstrip("\n") for line in file if "/" in line and " rw-s " not in line}
        except (OSError, IndexError):
            return
        for path in paths:
            if path.startswith("/") and not path.startswith(("/usr/lib", "/lib", "/memfd", "/SYSV", sys.base_prefix)):
                self.note(path)


def link_mark(path: str) -> str | None:
    """Of where a link leads; None of what is none."""
    try:
        return text_hash(os.readlink(path))
    except OSError:
        return None


def names_of(environment: Iterable[str]) -> str:
    """The names of variables, as far as they may be inputs."""
    return "\0".join(sorted(name for name in environment if not PLACES.match(name)))


def _stat(path: str) -> Any:
    try:
        found = os.stat(path)
    except OSError:
        return None
    return found.st_size, found.st_mtime_ns, found.st_ino


def foreign(installed: bool = True) -> bool:
    """Is the nearest caller that is not of Python itself no code of tcbench's? installed: or of a package."""
    frame: Any = sys._getframe(2)
    while frame is not None:
        file = frame.f_code.co_filename
        if not file.startswith(HERE) and not (file.startswith(("<frozen", *PYTHON)) and not file.startswith(SITE)):
            return not file.startswith(OWN) and not (file.startswith(SITE) and (not installed or top(file) in KNOWN))
        frame = frame.f_back
    return False
