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
USED_S = 3600.0  # how fine the time of the last use is told
WRITES = 256  # between two looks at the limit; the first file that a process writes is followed by one
KEPT_SHARE = 0.8  # of the limit that pruning leaves
UNFINISHED_S = 3600.0  # what a killed process left half written
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
    asked = os.environ.get(FOLDER)
    if asked:
        return Path(asked).expanduser().absolute()
    from platformdirs import user_cache_dir

    return Path(user_cache_dir("tcbench", appauthor=False))


@functools.cache
def sources(package: str) -> str:
    """Hash of the files of a package, as they are when it is first asked for: part of the keys of what they make."""
    found = hashlib.sha256()
    for path in sorted(Path(str(sys.modules[package].__file__)).parent.rglob("*.py")):
        found.update(path.name.encode() + b"\0" + path.read_bytes())
    return found.hexdigest()


def limit() -> int:
    """Bytes that the cache may hold: $TCBENCH_CACHE_LIMIT, in MiB, or 512 MiB."""
    asked = os.environ.get(LIMIT, "")
    try:
        found = float(asked or MEBIBYTES)
    except ValueError:
        found = -1.0
    if not 0 <= found < float("inf"):
        raise TcbenchError(f"{LIMIT} is {asked!r}; it takes a number of MiB, {MEBIBYTES} by default.")
    return int(found * 2**20)


_TRUSTED: set[Path] = set()
LOOKS = 20  # at a folder that others may remove meanwhile, again and again


def folder(part: str) -> Path:
    """The folder of one of `PARTS`, made where there is none; refused where others may write to it."""
    here = root() / part
    if here not in _TRUSTED or not here.is_dir():
        for left in reversed(range(LOOKS)):
            try:
                for path in (here.parent, here):
                    _make(path)
                    _trust(path)
                break
            except MachineError:  # it may have been removed between two looks; what is wrong for good is so again
                if not left:
                    raise
        _TRUSTED.add(here)
    return here


def _make(path: Path) -> None:
    try:
        if not path.is_dir():
            path.parent.mkdir(parents=True, exist_ok=True)
            with contextlib.suppress(FileExistsError):
                path.mkdir(mode=0o700)
                path.chmod(0o700)  # whatever the umask
    except OSError as error:
        raise MachineError(
            f"The cache folder {str(path)!r} cannot be made: {error.strerror or error}. Make it, {CURE}"
        ) from None


def _trust(path: Path) -> None:
    """What lies in the cache is run: nobody else may write there."""
    try:
        found = path.stat()
    except OSError as error:
        raise MachineError(f"The cache folder {str(path)!r} cannot be read: {error.strerror or error}.") from None
    if not stat.S_ISDIR(found.st_mode):
        raise MachineError(f"The cache folder {str(path)!r} is no folder: remove it, {CURE}")
    if not hasattr(os, "getuid"):  # pragma: no cover -- Windows, where the user's folder is the user's
        return
    if found.st_uid != os.getuid():
        raise MachineError(f"The cache folder {str(path)!r} belongs to another user and is not trusted: {CURE[3:]}")
    if found.st_mode & 0o022:
        raise MachineError(
            f"Other users may write to the cache folder {str(path)!r}, so that it is not trusted: "
            f"chmod go-w {str(path)!r}, {CURE}"
        )
    if not os.access(path, os.W_OK | os.X_OK):
        raise MachineError(f"The cache folder {str(path)!r} cannot be written: allow it, {CURE}")


# files --------------------------------------------------------------------------------------------------------------


def _checksum(name: str, content: bytes) -> bytes:
    """With the file's name: another file, whole as it may be, is not taken for this one."""
    return hashlib.sha256(name.encode() + b"\n" + content).digest()


def unsealed(name: str, data: bytes) -> bytes | None:
    """What was sealed under this name; None if it is damaged."""
    seal, check, content = data[: len(SEAL)], data[len(SEAL) : len(SEAL) + 32], data[len(SEAL) + 32 :]
    return content if seal == SEAL and _checksum(name, content) == check else None


def _at_once(path: str, flags: int) -> int:
    """Opens a file; of a pipe it does not wait for the other end."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def read(part: str, name: str) -> bytes | None:
    """The content of a file; None if it is missing, damaged, or not this user's alone to write."""
    path = folder(part) / name
    try:
        with open(path, "rb", opener=_at_once) as file:
            found = os.fstat(file.fileno())
            if not stat.S_ISREG(found.st_mode):
                return None
            if hasattr(os, "getuid") and (found.st_uid != os.getuid() or found.st_mode & 0o022):
                return None
            content = unsealed(name, file.read())
    except OSError:
        return None
    if content is not None and time.time() - found.st_mtime > USED_S:
        with contextlib.suppress(OSError):
            os.utime(path)
    return content


_written = 0


def write(part: str, name: str, content: bytes) -> None:
    """Write a file; others see it whole or not at all. (After a power cut the checksum tells what was lost.)"""
    global _written
    try:
        for _ in range(LOOKS):  # at last the file is made another time
            with contextlib.suppress(FileNotFoundError):
                _write(folder(part) / name, content)
                break
    except OSError as error:
        raise MachineError(
            f"The cache folder {str(root() / part)!r} cannot be written: {error.strerror or error}. "
            f"Make room there, {CURE}"
        ) from error
    if _written % WRITES == 0:
        prune()
    _written += 1


def _write(path: Path, content: bytes) -> None:
    with replacing(path) as temporary:
        descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), 0o600)
        with os.fdopen(descriptor, "wb") as file:
            temporary.chmod(0o600)  # whatever the umask
            file.write(SEAL + _checksum(path.name, content) + content)


def kept(part: str, name: str, make: Callable[[], bytes]) -> bytes:
    """The content of a file; made and written where there is none."""
    content = read(part, name)
    if content is None:
        content = make()
        write(part, name, content)
    return content


# what there is, and what goes ----------------------------------------------------------------------------------------


def usage() -> Usage:
    """Where the cache is, what it holds, and what it may hold."""
    sizes = [found.st_size for _, found in _files()]
    return Usage(root(), len(sizes), sum(sizes), limit())


def clear() -> Usage:
    """Remove every file of the cache; returns what was there. MachineError where files cannot be removed."""
    before = usage()
    refused = [error for path, _ in _files() if (error := _remove(path))]
    _remove_leftovers()
    if refused:
        raise MachineError(
            f"{len(refused)} of {before.files} files in the cache folder {str(root())!r} cannot be removed: "
            f"{refused[0].strerror or refused[0]}."
        )
    return before


def prune() -> None:
    """Remove what was not used for longest, until the cache is within its limit."""
    _remove_leftovers()
    most = limit()
    found = sorted(_files(), key=lambda one: one[1].st_mtime)
    total = sum(state.st_size for _, state in found)
    wanted = most if total <= most else KEPT_SHARE * most
    for path, state in found:
        if total <= wanted:
            break
        _remove(path)
        total -= state.st_size


def _remove_leftovers() -> None:
    """What killed processes left half written."""
    now = time.time()
    for part in PARTS:
        for path, state in _listed(root() / part, HALF_WRITTEN):
            if now - state.st_mtime > UNFINISHED_S:
                _remove(path)


def _remove(path: Path) -> OSError | None:
    """What prevents it: not that somebody else did."""
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        return error
    return None


def _files() -> Iterator[tuple[Path, os.stat_result]]:
    """All files of the cache, and nothing that is not its own."""
    for part in PARTS:
        yield from _listed(root() / part, FILES)


def _listed(place: Path, names: re.Pattern[str]) -> Iterator[tuple[Path, os.stat_result]]:
    with contextlib.suppress(OSError), os.scandir(place) as entries:
        for entry in entries:
            if names.match(entry.name):
                with contextlib.suppress(OSError):
                    yield Path(entry.path), entry.stat(follow_symlinks=False)
