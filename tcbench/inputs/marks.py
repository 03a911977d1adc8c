"""What an input was, as a hash: of a file, a folder's names, a package; and where it may be now."""

from __future__ import annotations

import hashlib
import importlib.metadata
import importlib.util
import os
import site
import sys
import sysconfig
from collections.abc import Callable, Mapping
from functools import cache
from importlib.machinery import EXTENSION_SUFFIXES

# known by their versions, which are part of every key, or without any influence on a number
KNOWN = frozenset({"numpy", "scipy", "llvmlite", "pluggy", "platformdirs", "rich", "click", "tcbench"})


def _folders(*paths: str) -> tuple[str, ...]:
    return tuple(dict.fromkeys(p + os.sep for path in paths for p in (path, os.path.realpath(path))))


# installed packages, also those of the Python that a virtual environment was made from; what comes first is found first
SITE = _folders(*map(sysconfig.get_path, ("purelib", "platlib")), *site.getsitepackages([sys.prefix, sys.base_prefix]))
PYTHON = _folders(*map(sysconfig.get_path, ("stdlib", "platstdlib")))
OWN = tuple(
    os.path.dirname(spec.origin) + os.sep
    for name in ("tcbench", "tcbench_plugins")
    if (spec := importlib.util.find_spec(name)) and spec.origin
)
INSTALLED = (*SITE, *PYTHON, *OWN)


def nowhere(path: str) -> bool:
    """Is it what the system shows as files? (Shared memory holds files as others are.)"""
    return path.startswith(("/proc/", "/sys/", "/dev/")) and not path.startswith("/dev/shm/")


def text_hash(text: str | bytes | None) -> str | None:
    """Of a text; None of what is not there."""
    if text is None:
        return None
    data = text.encode("utf-8", "surrogateescape") if isinstance(text, str) else text
    return hashlib.sha256(data).hexdigest()[:20]


A_FOLDER, A_STREAM = "a folder", "a pipe or a device"
SIZES = "/*"  # behind a folder's name: its names and how large each is
DATABASE = b"SQLite format 3\0"


def file_hash(path: str) -> str | None:
    """Of a file's content, of Python with the line ends of Unix, of a database with what is still to be written into
    it; None where there is none to read."""
    if not os.path.isfile(path) and os.path.exists(path):
        return A_FOLDER if os.path.isdir(path) else A_STREAM
    try:
        with open(path, "rb") as file:
            data = file.read()
        if data.startswith(DATABASE) and os.path.exists(log := path + "-wal"):
            with open(log, "rb") as file:
                data += file.read()
    except (OSError, ValueError):
        return None
    return text_hash(data.replace(b"\r\n", b"\n") if path.endswith(".py") else data)


def folder_hash(path: str) -> str | None:
    """Of the names in a folder and of what is a folder among them; of FOLDER/* the sizes of files and what is a link,
    too."""
    try:
        with os.scandir(path.removesuffix(SIZES)) as found:
            names = sorted(_entry(one, path.endswith(SIZES)) for one in found if one.name != "__pycache__")
    except OSError:
        return None
    return text_hash("\0".join(names))


def _entry(one: os.DirEntry[str], sized: bool) -> str:
    name = f"{one.name}@" if sized and one.is_symlink() else one.name
    if one.is_dir():
        return f"{name}/"
    return f"{name} {one.stat(follow_symlinks=os.path.exists(one.path)).st_size}" if sized else name


def link_mark(path: str) -> str | None:
    """Of where a link leads; None of what is none."""
    try:
        return text_hash(os.readlink(path))
    except OSError:
        return None


def mode_mark(path: str) -> str | None:
    """What a file is and who may use it; None where there is none."""
    try:
        return f"{os.stat(path).st_mode:o}"
    except OSError:
        return None


def module_mark(path: str) -> str | None:
    """By which file an import finds FOLDER/NAME, or would; None if by none."""
    for kind in ("/__init__.py", *EXTENSION_SUFFIXES, ".py", ".pyc"):
        if os.path.isfile(path + kind):
            return kind
    return A_FOLDER if os.path.isdir(path) else None


# by what is noted of a path
LOOKS: dict[str, Callable[[str], str | None]] = {
    "files": file_hash, "folders": folder_hash, "links": link_mark, "modes": mode_mark, "lookups": module_mark,
}  # fmt: skip


OTHER = "not among the installed packages"


@cache
def distributions_of() -> dict[str, list[str]]:
    """Name in site-packages -> the distributions that bring it."""
    return {name: list(found) for name, found in importlib.metadata.packages_distributions().items()}


def package_mark(name: str) -> str | None:
    """Version of a distribution, and hash of its RECORD, which has the hash of every file that was installed; OTHER of
    one that is elsewhere, whose files are noted."""
    try:
        found = importlib.metadata.distribution(name)
    except (importlib.metadata.PackageNotFoundError, ValueError):
        return None
    if not str(found.locate_file("x")).startswith(SITE):
        return OTHER
    lines = (found.read_text("RECORD") or "").splitlines()
    kept = sorted(line for line in lines if "__pycache__" not in line and "/bin/" not in line)
    return f"{found.version} {text_hash(chr(10).join(kept))}"


@cache
def installed_version(package: str) -> str | None:
    """Version of a package, by its name as it is installed or imported; nothing is imported. None: it is absent.

    "" for what can be imported and has no version, such as a folder on the path.
    """
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "" if package.isidentifier() and importlib.util.find_spec(package) else None


def placed(path: str, folders: Mapping[str, str]) -> str:
    """Where a portable path may be now, given the folders of the plugins by label; "" if its plugin is absent."""
    if path.startswith("<>/"):
        places = [start + path[3:] for start in SITE]
        return next(filter(os.path.exists, places), places[0])
    if path.startswith("<"):
        label, _, relative = path[1:].partition(">/")
        return os.path.normpath(os.path.join(folders[label], relative)) if label in folders else ""
    return os.path.expanduser(path)


def top(path: str) -> str:
    """The name in site-packages that a path is of."""
    start = next(start for start in SITE if path.startswith(start))
    return path[len(start) :].partition(os.sep)[0].partition(".")[0].partition("-")[0]
