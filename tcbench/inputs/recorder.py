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
import functools
import importlib.metadata
import importlib.util
import os
import sys
from collections.abc import Callable, Iterable
from typing import Any
from urllib.parse import unquote, urlsplit

from . import marks
from .callers import FOUND_BY_PYTHON, caller, directly, foreign, imported
from .facts import CORES, CURRENT, MACHINE, PACKAGES, PLACES, UMASK, VARIABLES
from .marks import A_FOLDER, INSTALLED, KNOWN, OTHER, OWN, PYTHON, SITE, SIZES, nowhere, package_mark, top
from .seen import CHANGED, SET_HERE, Seen, stat_of

PROCESSES = ("subprocess.Popen", "os.system", "os.exec", "os.posix_spawn", "os.spawn", "os.fork", "os.forkpty")
NETWORK = ("socket.connect", "socket.getaddrinfo", "socket.gethostbyname", "socket.gethostbyaddr", "socket.bind",
           "socket.sendto", "urllib.Request")  # fmt: skip
STARTED, CONNECTED = "a process was started", "the network was used"
BY_DESCRIPTOR, STATE = "a file was named by an open folder", "the state of the machine was read"
# they raise where nothing is, or where something is
TOUCHES = ("os.mkdir", "os.remove", "os.rmdir", "os.rename", "os.link", "os.utime", "os.chmod", "os.chown",
           "os.truncate", "os.chdir")  # fmt: skip
STREAM, ATTRIBUTES = "a pipe or a device was read", "attributes of a file were read"
SYSTEM_CALLS, OPENS = "C functions of the system were called", "opens files in C"
# packages that open files in C, where Python sees nothing; those of the second kind open them in Python for pandas
READERS = frozenset({"h5py", "netCDF4", "tables", "polars", "lxml", "duckdb", "cv2", "osgeo", "rasterio", "pyreadstat"})
OWN_READERS = frozenset(
    {f"pyarrow.{n}" for n in ("parquet", "csv", "json", "feather", "orc", "dataset", "fs")} | {"cffi", "psutil"}
)
LOCALE = ("LC_ALL", "LC_CTYPE", "LC_NUMERIC", "LC_TIME", "LC_COLLATE", "LC_MONETARY", "LC_MESSAGES", "LANG", "LANGUAGE")
ABOUT = {"uname": (MACHINE,), "cpu_count": (MACHINE,), "process_cpu_count": (MACHINE, CORES),
         "sched_getaffinity": (CORES,), "umask": (UMASK,), "setlocale": LOCALE}  # fmt: skip
STATES = ("statvfs", "getloadavg", "sysconf")
LIMITS = ("getrlimit", "prlimit")  # of `resource`
TELLING = ("which", "getuser", "get_terminal_size")  # functions of Python that say what a variable says
LEFT_OUT: list[str] = []  # folders of tcbench's own, whose files are no inputs
METADATA = os.path.dirname(importlib.metadata.__file__) + os.sep  # which lists all packages to find one


def noting(what: str) -> Callable[[Callable[..., object]], Callable[..., None]]:
    """A method that notes something, unless it is done on behalf of another note; never in the way of what is
    measured. what : that may not be noted then, with the method's first argument in it."""

    def decorated(note: Callable[..., object]) -> Callable[..., None]:
        @functools.wraps(note)
        def noted(self: Recorder, *arguments: Any, **named: Any) -> None:
            if getattr(self.looking, "now", False):
                return
            self.looking.now = True
            try:
                note(self, *arguments, **named)
            except Exception as error:
                failure = f"{what.format(*arguments)} could not be noted ({type(error).__name__})"
                self.unseen.setdefault(failure)
            finally:
                self.looking.now = False

        return noted

    return decorated


class Recorder(Seen):
    """What one process has read since it began to watch."""

    def __init__(self) -> None:
        super().__init__()
        self.loaded_libraries = False
        self._written: set[str] = set()
        self._path = frozenset(sys.path)
        unseen = self.unseen.setdefault
        self.handlers: dict[str, Callable[[str, tuple[Any, ...]], object]] = {
            "open": self._open, "import": self._import, "mmap.__new__": self._mapping,
            "ctypes.dlopen": self._library, "sqlite3.connect": self._library,
            "os.listdir": self._list, "os.scandir": self._list, "os.putenv": self._put, "os.unsetenv": self._put,
            "socket.gethostname": self._name_of_host, "ctypes.dlsym": self._symbol,
            **dict.fromkeys(TOUCHES, self._touch),
            **dict.fromkeys(("os.getxattr", "os.listxattr"), lambda event, arguments: unseen(ATTRIBUTES)),
            **dict.fromkeys(PROCESSES, lambda event, arguments: unseen(STARTED)),
            **dict.fromkeys(NETWORK, lambda event, arguments: unseen(CONNECTED)),
        }  # fmt: skip

    @noting("{}")
    def heard(self, event: str, arguments: tuple[Any, ...]) -> None:
        """An audit event of Python."""
        self.handlers[event](event, arguments)

    # -- events

    def _open(self, event: str, arguments: tuple[Any, ...]) -> None:
        path, mode, flags = arguments
        if path is None or isinstance(path, int):
            self._mapping(event, (-1 if path is None else path,))
            return
        path = self.named(path)
        if path.startswith(("/proc/", "/sys/", "/dev/fd/")) and foreign(installed=False):
            self.unseen.setdefault(STATE)
        if isinstance(mode, str):
            writes, reads, new = any(c in mode for c in "wxa+"), "r" in mode or "+" in mode, "x" in mode
        else:
            writes, reads = bool(flags & (os.O_WRONLY | os.O_RDWR | os.O_TRUNC)), not flags & os.O_WRONLY
            new = bool(flags & os.O_EXCL)
        if writes and self.files.get(path) is not None:
            self.unseen.setdefault(f"{self.portable(path)} {CHANGED}")
        if new and not reads:
            self._touch(event, arguments)
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
        if ".." in name.split(os.sep) and self._links_before_up(os.path.join(os.getcwd(), name)):
            full = os.path.join(os.path.realpath(os.path.dirname(name)), os.path.basename(name))
        if os.path.isabs(name) or os.getcwd() != self.start:
            return full
        return "./" + os.path.relpath(full, self.start)

    def _links_before_up(self, path: str) -> bool:
        """Are there links in a path before "..", which is then the folder above that to which the link leads?"""
        parts = path.split(os.sep)
        tops = [os.sep.join(parts[:n]) for n in range(2, len(parts)) if ".." in parts[n:]]
        found = {before: link for before in tops if (link := marks.link_mark(before)) is not None}
        for before, link in found.items():
            self.links.setdefault(os.path.abspath(before), link)
        return bool(found)

    def _import(self, event: str, arguments: tuple[Any, ...]) -> None:
        if arguments[1]:  # of an extension module
            self._library(event, arguments[1:2])

    def _library(self, event: str, arguments: tuple[Any, ...]) -> None:
        name = os.fsdecode(arguments[0] or "")
        if name.startswith("file:"):  # a database
            name = unquote(urlsplit(name).path)
        base = event.startswith("sqlite3")
        if os.sep in name or (base and name not in ("", ":memory:")):
            self.note(path := self.named(name))
            if not base and not self.full(path).startswith(INSTALLED):
                self.loaded_libraries = True
                self.fact(VARIABLES)
        elif event == "ctypes.dlopen" and foreign(installed=False):
            self.unseen.setdefault(SYSTEM_CALLS)

    def _symbol(self, event: str, arguments: tuple[Any, ...]) -> None:
        if getattr(arguments[0], "_name", "") is None and foreign(installed=False):  # ctypes.pythonapi
            self.unseen.setdefault(SYSTEM_CALLS)

    def _touch(self, event: str, arguments: tuple[Any, ...]) -> None:
        """Whether something is there, whatever it has in it; what the cell itself has made is no input."""
        if isinstance(arguments[0], int) or not foreign(installed=False):
            return
        path = self.named(arguments[0])
        if path in self._written:
            return
        mark = marks.mode_mark(self.full(path))
        if os.path.isdir(self.full(path)):
            self.note(path, asked=True)
        elif event != "os.mkdir" or not caller().startswith(PYTHON):  # makedirs(exist_ok=True), a temporary folder
            self.modes.setdefault(path, mark)
        if event == "os.mkdir" and mark is None:
            self._written.add(path)
        if (link := marks.link_mark(self.full(path))) is not None:
            self.links.setdefault(path, link)

    def _mapping(self, event: str, arguments: tuple[Any, ...]) -> None:
        """What a descriptor is of (Linux): shared memory, or a file that C code has opened."""
        with contextlib.suppress(OSError):
            path = os.readlink(f"/proc/self/fd/{arguments[0]}")
            if path.startswith("/") and not path.endswith(" (deleted)") and path not in self.files:
                self.note(self.named(path))

    def _list(self, event: str, arguments: tuple[Any, ...]) -> None:
        asker = caller()
        if isinstance(arguments[0], int):
            if (not asker.startswith(("<frozen", *PYTHON)) or asker in ("<frozen os>", os.__file__)) and foreign():
                self.unseen.setdefault(BY_DESCRIPTOR)
            return
        path = self.named(arguments[0] or ".")
        if self.full(path) + os.sep in SITE and not asker.startswith(METADATA) and foreign(installed=False):
            self.fact(PACKAGES)
        where, imports = self.full(path) + os.sep, asker.startswith(FOUND_BY_PYTHON)
        if not imports and not nowhere(where) and not where.startswith((*LEFT_OUT, *INSTALLED)) and foreign():
            if event == "os.scandir" and not asker.startswith(PYTHON):  # who may ask each entry for its size
                path += SIZES
            self.folders.setdefault(path, marks.folder_hash(self.full(path)))

    def _name_of_host(self, event: str, arguments: tuple[Any, ...]) -> None:
        if foreign(installed=False):
            self.fact(MACHINE)

    def _put(self, event: str, arguments: tuple[Any, ...]) -> None:
        name = os.fsdecode(arguments[0])
        if event == "os.unsetenv":
            self.fact(name)  # `del os.environ[name]` raises where it was not set
        self.environment.setdefault(name, SET_HERE)

    # -- questions that no event tells of (`watching`)

    @noting("os.{}")
    def looked(
        self, function: str, path: Any = "", *_: Any, dir_fd: Any = None, follow_symlinks: Any = True, **__: Any
    ) -> None:
        """Foreign code asks `os` whether a file is there, where a link leads or what the current folder is."""
        if isinstance(path, int) or (function == "open" and dir_fd is None) or not foreign():
            return
        if dir_fd is not None:
            self.unseen.setdefault(BY_DESCRIPTOR)
        elif function.startswith("getcwd"):
            if os.getcwd() == self.start:
                self.fact(CURRENT)
        else:
            path = self.named(path)
            if nowhere(path) and foreign(installed=False):
                self.unseen.setdefault(STATE)
            link = marks.link_mark(self.full(path))
            if link is not None or function in ("lstat", "readlink") or follow_symlinks is False:
                self.links.setdefault(path, link)
            if function != "readlink":
                self.note(path, asked=True)
            if function in ("stat", "access") and directly(("stat",)):
                self.modes.setdefault(path, marks.mode_mark(self.full(path)))

    @noting("{}")
    def about(self, function: str, *_: Any, **__: Any) -> None:
        """Foreign code asks what machine this is, or how the process was started."""
        if foreign(installed=False):
            if function in (*STATES, *LIMITS) and (function != "sysconf" or directly(())):  # asyncio asks, too
                self.unseen.setdefault(STATE)
            for name in ABOUT.get(function, ()):
                self.fact(name)

    @noting("a package")
    def package(self, name: str | None) -> None:
        """A package is looked for among those that are installed; None: all of them are."""
        if name is None and foreign(installed=False):
            self.fact(PACKAGES)
        elif isinstance(name, str) and name not in KNOWN and foreign() and (mark := package_mark(name)) is not OTHER:
            self.packages.setdefault(name, mark)

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> None:
        """A module is looked for: the first of Python's finders, which finds nothing and notes the name."""
        if name in OWN_READERS and foreign(installed=False):
            self.unseen.setdefault(f"{name} {OPENS}")
        if "." not in name:
            self.modules.setdefault(name)
            path = [f for f in sys.path if f not in self._path and f not in self.plugins.values()]
        if path is not None:
            self._looked_up(name.rpartition(".")[2], list(path))

    @noting("an import")
    def _looked_up(self, name: str, folders: Iterable[Any]) -> None:
        """What an import of it finds first in these folders, or would if it were there."""
        for folder in (f for f in folders if isinstance(f, str) and not (f + os.sep).startswith(INSTALLED)):
            if not os.path.isdir(self.full(place := self.named(folder))):
                self.note(place, asked=True)  # an archive of modules, or where one may come
            path = self.named(os.path.join(folder, name))
            mark = self.lookups[path] = self.lookups.get(path, marks.module_mark(self.full(path)))
            if mark not in (None, A_FOLDER):
                return

    @noting("a variable")
    def asked(self, name: Any) -> None:
        """An environment variable was read, or (`facts.NAMES`) the names of all."""
        if not isinstance(name, str | bytes) or (known := os.fsdecode(name)) in self.environment:
            return
        if foreign() and (not PLACES.match(known) or directly(TELLING)):
            self.fact(known)

    # -- files

    def note(self, path: str, asked: bool = False) -> None:
        """A file is about to be read: its content now. asked: whether there is one."""
        if path.endswith(".pyc"):
            path = self._source(path)
        full = self.full(path)
        if path in self.files or path in self._written or nowhere(full) or full.startswith((*LEFT_OUT, *OWN)):
            return
        if full.startswith(SITE):
            if top(full) in KNOWN or full.endswith("-info/entry_points.txt"):  # of all that is installed
                return
        elif full.startswith((*PYTHON, os.path.join(sys.base_prefix, "lib", "python"))):
            return  # Python's own, known by its version
        if os.path.isdir(full):
            if asked and not any((home + os.sep).startswith(full.rstrip(os.sep) + os.sep) for home in self._homes()):
                self.files[path] = A_FOLDER
        elif asked or not os.path.exists(full) or os.path.isfile(full):
            self.stats[path] = stat_of(full)
            self.files[path] = marks.file_hash(full)
        else:
            self.unseen.setdefault(STREAM)

    def _source(self, path: str) -> str:
        """What byte code was made from, if that is there; a source of another kind is noted beside it."""
        with contextlib.suppress(ValueError, NotImplementedError):
            source = importlib.util.source_from_cache(path)
            if os.path.exists(full := self.full(source)):
                return source if imported() else path
            folder, stem = os.path.split(os.path.splitext(full)[0])
            with contextlib.suppress(OSError):
                others = [name for name in os.listdir(folder) if name.startswith(stem + ".")]
                for name in others:
                    self.note(self.named(os.path.join(folder, name)))
                return source if others else path
        return path

    def _homes(self) -> Iterable[str]:
        """Folders that are there wherever the plugins are."""
        return (self.start, os.path.expanduser("~"), *self.plugins.values())

    def collected(self) -> tuple[str, str]:
        """As `Seen.collected`, with what C code has mapped."""
        if self.loaded_libraries or "_cffi_backend" in sys.modules:
            self._mapped()
        for name in READERS.intersection(self.modules, sys.modules):
            self.unseen.setdefault(f"{name} {OPENS}")
        return super().collected()

    @noting("what libraries load")
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
                if not path.startswith(INSTALLED):
                    self.fact(VARIABLES)
