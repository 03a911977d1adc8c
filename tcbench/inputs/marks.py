"""What an input was, as a hash: of a file, a folder's names, a package; and where it may be now."""

from __future__ import annotations

import hashlib
import importlib.metadata
import importlib.util
import os
import sysconfig
from functools import cache

# known by their versions, which are part of every key, or without any influence on a number
KNOWN = frozenset({"numpy", "scipy", "llvmlite", "pluggy", "platformdirs", "rich", "click", "tcbench"})
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


A_FOLDER = "a folder"
SIZES = "/*"  # behind a folder's name: its names and how large each is


def file_hash(path: str) -> str | None:
    """Of a file's content; None where there is none to read."""
    if os.path.isdir(path):
        return A_FOLDER
    try:
        with open(path, "rb") as file:
            return text_hash(file.read())
    except (OSError, ValueError):
        return None


def folder_hash(path: str) -> str | None:
    """Of the names in a folder and of what is a folder among them; of FOLDER/* the sizes of files, too."""
    sized = path.endswith(SIZES)
    try:
        with os.scandir(path.removesuffix(SIZES)) as found:
            names = sorted(
                f"{one.name}/" if one.is_dir() else f"{one.name} {one.stat().st_size}" if sized else one.name
                for one in found
                if one.name != "__pycache__"
            )
    except OSError:
        return None
    return text_hash("\0".join(names))


@cache
def distributions_of() -> dict[str, list[str]]:
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


def placed(path: str, folders: dict[str, str]) -> list[str]:
    """Where a portable path may be now, given the folders of the plugins by label; none if its plugin is absent."""
    if path.startswith("<>/"):
        return [start + path[3:] for start in SITE]
    if path.startswith("<"):
        label, _, relative = path[1:].partition(">/")
        return [os.path.normpath(os.path.join(folders[label], relative))] if label in folders else []
    return [os.path.expanduser(path)]


def top(path: str) -> str:
    """The name in site-packages that a path is of."""
    start = next(start for start in SITE if path.startswith(start))
    return path[len(start) :].partition(os.sep)[0].partition(".")[0].partition("-")[0]
