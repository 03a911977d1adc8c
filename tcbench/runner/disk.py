"""Files of a run folder: written completely or not at all, errors of the system as sentences, one writer a folder."""

from __future__ import annotations

import errno
import os
import shutil
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryFile

from filelock import FileLock, Timeout

from ..errors import TcbenchError
from ..files import replacing

WORK = ".work"  # what belongs to the run under way: who writes, what workers print and share


def replace_file(path: Path, content: bytes, folder: Path) -> None:
    """Write a file of a run folder, completely or not at all, and return when it is on the disk.

    Raises `TcbenchError` when that is not possible.
    """
    with cured(folder):
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as temporary, open(temporary, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        _sync_folder(path.parent)


def could_write(folder: Path) -> None:
    """`TcbenchError` where a run folder can be neither made nor written to; nothing is left of the trial."""
    with cured(folder):
        path = Path(os.path.realpath(folder))
        with TemporaryFile(dir=next(place for place in (path, *path.parents) if place.exists())):
            pass


@contextmanager
def cured(folder: Path) -> Iterator[None]:
    """What hinders writing to a run folder, as a sentence."""
    try:
        yield
    except OSError as error:
        raise cure(error, folder) from error
    except ValueError as error:  # a null byte, half of a surrogate pair
        raise TcbenchError(f"{str(folder)!r} cannot be the name of a folder: {error}.") from error


def cure(error: OSError, folder: Path) -> TcbenchError:
    """The sentence for an operating-system error while writing."""
    if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
        return TcbenchError(
            f"No space is left for the run in {folder} ({error.strerror}). The rows finished so far are intact: "
            "free some space and run the same command again; it goes on where it stopped."
        )
    in_the_way = error.errno in (errno.EEXIST, errno.ENOTDIR)
    return TcbenchError(
        f"Cannot write to the run folder {folder}: {'a file is in the way' if in_the_way else error.strerror or error}."
        f" Choose another folder{'' if in_the_way else ' or change its permissions'}."
    )


def hold_lock(folder: Path) -> FileLock:
    """Hold the folder's lock; `TcbenchError` naming the holder when another process has it.

    The operating system drops it when its holder dies, however it dies.
    """
    lock, writer = FileLock(folder / ".lock", timeout=0), folder / WORK / "writer"
    try:
        lock.acquire()
    except Timeout:
        try:
            holder = writer.read_text("utf-8")[:200]
        except OSError:  # it has just begun, or is just ending
            holder = "another process"
        raise TcbenchError(
            f"Another run is writing to {folder} ({holder}). Wait until it ends, or give this run another folder."
        ) from None
    shutil.rmtree(writer.parent, ignore_errors=True)
    writer.parent.mkdir()  # before hours of computing: the folder takes new files
    since = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
    writer.write_text(f"process {os.getpid()} on {socket.gethostname()}, since {since}", "utf-8")
    return lock


def _sync_folder(folder: Path) -> None:
    """Make a rename in the folder survive a power cut; Windows has no such call."""
    if os.name != "nt":
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
