"""What foreign code reads, noted while it runs: a row is used again only while all of that is as it was.

A worker begins to watch before it imports the first plugin that is not tcbench's own, and goes on to its end: files,
libraries, listed folders, environment variables, modules asked for by name, installed packages. What a worker has seen
belongs to every cell that it measures from then on. `engine.reuse` compares it with what is there now.

Paths are kept relative to the folder of a plugin that the cell uses, so that a folder may be moved. What cannot be seen
(what C code reads by itself, whether a file exists, the clock) is said in docs/running.md.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib.metadata
import importlib.util
import json
import os
import re
import sys
import sysconfig
import threading
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

_posixsubprocess: Any
try:
    import _posixsubprocess
except ImportError:  # Windows
    _posixsubprocess = None

# variables that say where things are on a machine: what is read there is noted itself
PLACES = re.compile(
    r"(PATH|HOME|TMPDIR|TEMP|TMP|PWD|OLDPWD|USER|LOGNAME|SHELL|LANG|LC_.*|XDG_.*|TERM|COLUMNS|LINES|_)\Z"
)
PROCESSES = ("subprocess.Popen", "os.system", "os.exec", "os.posix_spawn", "os.spawn", "os.fork", "os.forkpty")
NETWORK = ("socket.connect", "socket.getaddrinfo", "socket.bind", "urllib.Request")
STARTED, CONNECTED = "a process was started", "the network was used"
# known by their versions, which are part of every key, or without any influence on a number
KNOWN = frozenset({"numpy", "scipy", "llvmlite", "pebble", "pluggy", "platformdirs", "rich", "click", "tcbench"})
NOWHERE = ("/proc/", "/sys/", "/dev/")


def _folders(*names: str) -> tuple[str, ...]:
    paths = [sysconfig.get_path(name) for name in names]
    return tuple(dict.fromkeys(p + os.sep for path in paths for p in (path, os.path.realpath(path))))


SITE = _folders("purelib", "platlib")
PYTHON = _folders("stdlib", "platstdlib")
OWN = tuple(
    os.path.dirname(spec.origin) + os.sep
    for name in ("tcbench", "tcbench_plugins")
    if (spec := importlib.util.find_spec(name)) and spec.origin
)
INSTALLED = (*SITE, *PYTHON, *OWN)


def text_hash(text: str | bytes | None) -> str | None:
    """Of a text, or of a file's content with the line ends of Unix; None of what is not there."""
    if text is None:
        return None
    data = text.encode("utf-8", "surrogateescape") if isinstance(text, str) else text
    if b"\r\n" in data and b"\0" not in data:
        data = data.replace(b"\r\n", b"\n")
    return hashlib.sha256(data).hexdigest()[:20]


def file_hash(path: str) -> str | None:
    """Of a file's content; None where there is none to read."""
    try:
        with open(path, "rb") as file:
            return text_hash(file.read())
    except (OSError, ValueError):
        return None


def folder_hash(path: str) -> str | None:
    """Of the names in a folder."""
    try:
        return text_hash("\0".join(sorted(name for name in os.listdir(path) if name != "__pycache__")))
    except OSError:
        return None


@cache
def _packages() -> dict[str, list[str]]:
    """Name in site-packages -> the distributions that bring it."""
    return {name: list(found) for name, found in importlib.metadata.packages_distributions().items()}


def package_mark(name: str) -> str | None:
    """Version of a distribution, and hash of its RECORD, which has the hash of every file that was installed."""
    try:
        found = importlib.metadata.distribution(name)
    except importlib.metadata.PackageNotFoundError:
        return None
    lines = (found.read_text("RECORD") or "").splitlines()
    kept = sorted(line for line in lines if "__pycache__" not in line and "/bin/" not in line)
    return f"{found.version} {text_hash(chr(10).join(kept))}"


class Recorder:
    """What one process has read since it began to watch."""

    def __init__(self) -> None:
        self.files: dict[str, str | None] = {}
        self.folders: dict[str, str | None] = {}
        self.environment: dict[str, str | None] = {}
        self.modules: dict[str, None] = {}
        self.unseen: dict[str, None] = {}
        self.plugins: dict[str, str] = {}  # label -> its folder, of the plugins that were imported
        self.loaded_libraries = False
        self.fork_exec: Any = None
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
        path = os.path.abspath(os.fsdecode(path))
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

    def _import(self, event: str, arguments: tuple[Any, ...]) -> None:
        if arguments[1]:  # of an extension module
            self._library(event, arguments[1:2])

    def _library(self, event: str, arguments: tuple[Any, ...]) -> None:
        name = os.fsdecode(arguments[0] or "")
        if os.sep in name:
            self.note(name)
            self.loaded_libraries = self.loaded_libraries or not name.startswith((*SITE, *PYTHON, *OWN))

    def _list(self, event: str, arguments: tuple[Any, ...]) -> None:
        path = os.path.abspath(os.fsdecode(arguments[0] or ".")) if not isinstance(arguments[0], int) else "/"
        imports = sys._getframe(3).f_code.co_filename.startswith("<frozen importlib")
        if not imports and not (path + os.sep).startswith((*NOWHERE, *_LEFT_OUT, *PYTHON, *SITE, *OWN)) and _foreign():
            self.folders.setdefault(path, folder_hash(path))

    def _put(self, event: str, arguments: tuple[Any, ...]) -> None:
        self.environment.setdefault(os.fsdecode(arguments[0]), "set by the cell itself")

    def started(self, *arguments: Any) -> Any:
        """In the place of `fork_exec`: a process is started."""
        self.unseen.setdefault(STARTED)
        return self.fork_exec(*arguments)

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> None:
        """A module is looked for: the first of Python's finders, which finds nothing and notes the name."""
        if "." not in name:
            self.modules.setdefault(name)

    def asked(self, name: Any) -> None:
        """An environment variable was read."""
        if getattr(self._looking, "now", False) or not isinstance(name, str | bytes):
            return
        self._looking.now = True
        try:
            name = os.fsdecode(name)
            if name not in self.environment and not PLACES.match(name) and _foreign():
                value = os.environ._data.get(os.fsencode(name))  # type: ignore[attr-defined]
                self.environment[name] = text_hash(value)
        finally:
            self._looking.now = False

    def note(self, path: str) -> None:
        """A file is about to be read: its content now."""
        path = os.path.abspath(path)
        if path.endswith(".pyc"):
            with contextlib.suppress(ValueError, NotImplementedError):
                path = importlib.util.source_from_cache(path)
        if path in self.files or path in self._written or path.startswith((*NOWHERE, *_LEFT_OUT, *OWN)):
            return
        if path.startswith(SITE):
            if _top(path) in KNOWN or path.endswith("-info/entry_points.txt"):  # of all that is installed
                return
        elif path.startswith((*PYTHON, os.path.join(sys.base_prefix, "lib", "python"))):
            return  # Python's own, known by its version
        if not os.path.isdir(path) and (not os.path.exists(path) or os.path.isfile(path)):
            self._stats[path] = _stat(path)
            self.files[path] = file_hash(path)

    # -- what was seen

    def taken(self) -> dict[str, Any]:
        """All of it, for another worker of this machine that uses what this one has made."""
        return {"files": self.files, "folders": self.folders, "environment": self.environment,
                "unseen": list(self.unseen), "plugins": self.plugins}  # fmt: skip

    def take(self, other: dict[str, Any]) -> None:
        """Add what another worker has read."""
        for path, mark in other["files"].items():
            if self.files.setdefault(path, mark) != mark:
                self.unseen.setdefault(f"{path} changed while it was measured")
        for mine, theirs in ((self.folders, other["folders"]), (self.environment, other["environment"])):
            for name, mark in theirs.items():
                mine.setdefault(name, mark)
        self.unseen.update(dict.fromkeys(other["unseen"]))
        self.plugins.update(other["plugins"])

    def collected(self) -> tuple[str, str]:
        """Identity and JSON text of what was seen so far."""
        self._looking.now = True
        try:
            if self.loaded_libraries:
                self._mapped()
            for path, then in self._stats.items():
                if not path.startswith(SITE) and then != _stat(path):
                    self.unseen.setdefault(f"{self.portable(path)} changed while it was measured")
            for path, mark in self.folders.items():
                if folder_hash(path) != mark:
                    self.unseen.setdefault(f"{self.portable(path)} changed while it was measured")
            parts = self.files, self.folders, self.environment, self.modules, self.unseen, self.plugins
            size = tuple(len(part) for part in parts)
            if size != self._size:
                text = json.dumps(self._as_data(), sort_keys=True)
                self._size, self._known = size, (hashlib.sha256(text.encode()).hexdigest()[:20], text)
            return self._known
        finally:
            self._looking.now = False

    def _as_data(self) -> dict[str, Any]:
        tops = {_top(path) for path in self.files if path.startswith(SITE)}
        packages = {name for top in tops if top not in KNOWN for name in _packages().get(top, ())}
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
            "environment": {n: mark for n, mark in self.environment.items() if mark != "set by the cell itself"},
            "packages": {name: package_mark(name) for name in packages},
            "modules": modules,
            "unseen": sorted(self.unseen),
        }

    def portable(self, path: str) -> str:
        """A path relative to a plugin's folder, or to the one above; to site-packages; to the user's home."""
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
        """Libraries that libraries have loaded, and what C code has mapped (Linux)."""
        try:
            with open("/proc/self/maps", encoding="utf-8", errors="replace") as file:
                paths = {line.split(None, 5)[5].rstrip("\n") for line in file if "/" in line}
        except (OSError, IndexError):
            return
        for path in paths:
            if path.startswith("/") and not path.startswith(("/usr/lib", "/lib", "/memfd", "/SYSV", sys.base_prefix)):
                self.note(path)


def placed(path: str, folders: dict[str, str]) -> list[str]:
    """Where a portable path may be now, given the folders of the plugins by label; none if its plugin is absent."""
    if path.startswith("<>/"):
        return [start + path[3:] for start in SITE]
    if path.startswith("<"):
        label, _, relative = path[1:].partition(">/")
        return [os.path.normpath(os.path.join(folders[label], relative))] if label in folders else []
    return [os.path.expanduser(path)]


def _top(path: str) -> str:
    """The name in site-packages that a path is of."""
    start = next(start for start in SITE if path.startswith(start))
    return path[len(start) :].partition(os.sep)[0].partition(".")[0].partition("-")[0]


def _stat(path: str) -> Any:
    try:
        found = os.stat(path)
    except OSError:
        return None
    return found.st_size, found.st_mtime_ns, found.st_ino


def _foreign() -> bool:
    """Is the nearest caller that is not of Python itself no code of tcbench's?"""
    frame: Any = sys._getframe(2)
    while frame is not None:
        file = frame.f_code.co_filename
        if file != __file__ and not (file.startswith(("<frozen", *PYTHON)) and not file.startswith(SITE)):
            return not file.startswith(OWN) and not (file.startswith(SITE) and _top(file) in KNOWN)
        frame = frame.f_back
    return False


_RECORDER: Recorder | None = None
_HOOKED = False
_LEFT_OUT: list[str] = []  # folders of tcbench's own, whose files are no inputs
_ENVIRONMENT = type(os.environ)


class _Watched(_ENVIRONMENT):  # type: ignore[valid-type,misc]
    """The environment, which says what is asked of it."""

    def __getitem__(self, name: Any) -> Any:
        if _RECORDER is not None:
            _RECORDER.asked(name)
        return super().__getitem__(name)

    def __contains__(self, name: Any) -> bool:
        if _RECORDER is not None:
            _RECORDER.asked(name)
        return bool(super().__contains__(name))

    def __iter__(self) -> Any:
        if _RECORDER is not None:
            for name in list(self._data):
                _RECORDER.asked(self.decodekey(name))
        return super().__iter__()


def begin() -> Recorder:
    """Watch this process from now on; what it has done before is not looked at."""
    global _RECORDER, _HOOKED
    if _RECORDER is None:
        for folder in [f for f in sys.path_importer_cache if not (f + os.sep).startswith(INSTALLED)]:
            del sys.path_importer_cache[folder]  # its modules are read as they are written now (`plugin_files`)
        _RECORDER = Recorder()
        _RECORDER.fork_exec = _posixsubprocess and _posixsubprocess.fork_exec
        if _posixsubprocess:  # multiprocessing starts its processes by it, and no audit event says so
            _posixsubprocess.fork_exec = _RECORDER.started
        sys.meta_path.insert(0, _RECORDER)
        for environment in (os.environ, getattr(os, "environb", os.environ)):
            environment.__class__ = _Watched
        if not _HOOKED:  # a hook stays for the life of a process
            _HOOKED = True
            sys.addaudithook(_hook)
    return _RECORDER


def end() -> None:
    """Watch no longer."""
    global _RECORDER
    if _RECORDER is not None:
        sys.meta_path.remove(_RECORDER)
        if _posixsubprocess:
            _posixsubprocess.fork_exec = _RECORDER.fork_exec
    _RECORDER = None
    for environment in (os.environ, getattr(os, "environb", os.environ)):
        environment.__class__ = _ENVIRONMENT


def recorder() -> Recorder | None:
    """Of what this process reads, if it is watched."""
    return _RECORDER


def leave_out(folder: str | Path) -> None:
    """What is read in this folder is tcbench's own: logs, caches."""
    path = os.path.abspath(folder) + os.sep
    if path not in _LEFT_OUT:
        _LEFT_OUT.append(path)


def _hook(event: str, arguments: tuple[Any, ...]) -> None:
    if _RECORDER is not None and event in _RECORDER.handlers:
        _RECORDER.heard(event, arguments)
