"""Files that are made again when they are missing: compiled code, references. Where they are, how large they may get.

    from tcbench import cache
    cache.usage()      # folder, files, bytes, limit
    cache.clear()      # forgets everything

A file is written whole, with a checksum, by and for this user alone: one that is damaged, or that somebody else may
write, counts as missing. When the limit is passed those go first that have not been used for longest. Any file may go
at any time: who wants it then makes it again.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import re
import stat
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from .errors import MachineError, TcbenchError
from .files import HALF_WRITTEN, replacing

FOLDER, LIMIT = "TCBENCH_CACHE_DIR", "TCBENCH_CACHE_LIMIT"
MEBIBYTES = 512  # by default
PARTS = ("code", "references")
SEAL = b"tcbench file 3\n"  # then the SHA-256 of the name and of what follows
USED_S = 3600.0  # how fine the time of the last use is told, and after which what is half written was left by the dead
WRITES = 256  # between two looks at the limit; the first file that a process writes is followed by one
KEPT_SHARE = 0.8  # of the limit that pruning leaves
FILES = re.compile(r"[0-9a-f]{32,64}\.(o|text|json|failed)\Z")  # text: of earlier versions
CURE = f"or set {FOLDER} to a folder of your own."


@dataclass(frozen=True)
class Usage:
    """What the cache holds. folder: where; files, bytes: how many, how large; limit: in bytes."""

    folder: Path
    files: int
    bytes: int
    limit: int


def root() -> Path:
    """Where everything is kept: $TCBENCH_CACHE_DIR, or the user's cache folder."""
    if asked := os.environ.get(FOLDER):
        return Path(asked).expanduser().absolute()
    from platformdirs import user_cache_dir

    return Path(user_cache_dir("tcbench", appauthor=False))


@functools.cache
def sources(package: str) -> str:
    """Hash of the files of a package, as they are when it is first asked for: part of the keys of what they make."""
    sha = hashlib.sha256()
    for path in sorted(Path(str(sys.modules[package].__file__)).parent.rglob("*.py")):
        sha.update(path.name.encode() + b"\0" + path.read_bytes())
    return sha.hexdigest()


def limit() -> int:
    """Bytes that the cache may hold: $TCBENCH_CACHE_LIMIT, in MiB, or 512 MiB."""
    asked = os.environ.get(LIMIT, "")
    try:
        mebibytes = float(asked or MEBIBYTES)
    except ValueError:
        mebibytes = -1.0
    if not 0 <= mebibytes < float("inf"):
        raise TcbenchError(f"{LIMIT} is {asked!r}; it takes a number of MiB, {MEBIBYTES} by default.")
    return int(mebibytes * 2**20)


_TRUSTED: set[Path] = set()


def folder(part: str) -> Path:
    """The folder of one of `PARTS`, made where there is none; MachineError where it cannot be, or others may write to
    it: what lies in the cache is run."""
    here = root() / part
    if here in _TRUSTED and here.is_dir():
        return here
    for path in (here.parent, here):
        name = f"The cache folder {str(path)!r}"
        try:
            if not path.exists():
                path.mkdir(mode=0o700, parents=True, exist_ok=True)
                path.chmod(0o700)  # whatever the umask
            state = path.stat()
        except OSError as error:
            raise MachineError(f"{name} cannot be made: {error.strerror or error}. Make it, {CURE}") from None
        if not stat.S_ISDIR(state.st_mode):
            raise MachineError(f"{name} is no folder: remove it, {CURE}")
        if not _is_own(state):
            raise MachineError(f"{name} belongs to another user and is not trusted: {CURE[3:]}")
        if hasattr(os, "getuid") and state.st_mode & 0o022:
            distrust = f"Other users may write to the cache folder {str(path)!r}, so that it is not trusted"
            raise MachineError(f"{distrust}: chmod go-w {str(path)!r}, {CURE}")
        if not os.access(path, os.W_OK | os.X_OK):
            raise MachineError(f"{name} cannot be written: allow it, {CURE}")
    _TRUSTED.add(here)
    return here


def _is_own(state: os.stat_result) -> bool:
    """On Windows the user's folder is the user's."""
    return not hasattr(os, "getuid") or state.st_uid == os.getuid()


def _sealed(name: str, content: bytes) -> bytes:
    """With the file's name: another file, whole as it may be, is not taken for this one."""
    return SEAL + hashlib.sha256(name.encode() + b"\n" + content).digest() + content


def read(part: str, name: str) -> bytes | None:
    """The content of a file; None if it is missing, damaged, or not this user's alone to write."""
    path = folder(part) / name
    try:
        state = path.stat()
        alone = _is_own(state) and not (hasattr(os, "getuid") and state.st_mode & 0o022)
        data = path.read_bytes() if alone and stat.S_ISREG(state.st_mode) else b""
        if time.time() - state.st_mtime > USED_S:
            os.utime(path)
    except OSError:
        return None
    content = data[len(SEAL) + 32 :]
    return content if data == _sealed(name, content) else None


_written = 0


def write(part: str, name: str, content: bytes) -> None:
    """Write a file; others see it whole or not at all. (After a power cut the checksum tells what was lost.)"""
    global _written
    path = folder(part) / name
    try:
        with replacing(path) as temporary:
            flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
            with os.fdopen(os.open(temporary, flags, 0o600), "wb") as file:
                temporary.chmod(0o600)  # whatever the umask
                file.write(_sealed(name, content))
    except FileNotFoundError:  # somebody has removed the folder meanwhile; the file is made another time
        return
    except OSError as error:
        raise MachineError(
            f"The cache folder {str(path.parent)!r} cannot be written: {error.strerror or error}. Make room there, "
            f"{CURE}"
        ) from error
    if _written % WRITES == 0:
        prune()
    _written += 1


def kept(part: str, name: str, make: Callable[[], bytes]) -> bytes:
    """The content of a file; made and written where there is none."""
    content = read(part, name)
    if content is None:
        content = make()
        write(part, name, content)
    return content


def usage() -> Usage:
    """Where the cache is, what it holds, and what it may hold."""
    sizes = [state.st_size for _, state in _listed(FILES)]
    return Usage(root(), len(sizes), sum(sizes), limit())


def clear() -> Usage:
    """Remove every file of the cache; returns what was there. MachineError where files cannot be removed."""
    before = usage()
    refused = [error for path, _ in _listed(FILES) if (error := _remove(path))]
    if refused:
        raise MachineError(
            f"{len(refused)} of {before.files} files in the cache folder {str(root())!r} cannot be removed: "
            f"{refused[0].strerror or refused[0]}."
        )
    return before


def prune() -> None:
    """Remove what killed processes left half written, and what was not used for longest, until the rest is within the
    limit."""
    for path, state in _listed(HALF_WRITTEN):
        if time.time() - state.st_mtime > USED_S:
            _remove(path)
    files = sorted(_listed(FILES), key=lambda one: one[1].st_mtime)
    total, most = sum(state.st_size for _, state in files), limit()
    for path, state in files if total > most else ():
        if total <= KEPT_SHARE * most:
            break
        _remove(path)
        total -= state.st_size


def _remove(path: Path) -> OSError | None:
    """What prevents it: not that somebody else did."""
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        return error
    return None


def _listed(names: re.Pattern[str]) -> Iterator[tuple[Path, os.stat_result]]:
    """Files of the cache with such names, and nothing that is not its own."""
    for part in PARTS:
        with contextlib.suppress(OSError):
            for entry in os.scandir(root() / part):
                if names.match(entry.name):
                    with contextlib.suppress(OSError):
                        yield Path(entry.path), entry.stat(follow_symlinks=False)
