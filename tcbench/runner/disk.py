"""Files of a run folder: written completely or not at all, errors of the system as sentences, one writer a folder.

The lock is one that the operating system drops when its holder dies, however it dies. On network file systems flock is
as good as the server's lock manager; on Lustre it needs the mount option `flock`.
"""

from __future__ import annotations

import errno
import os
import socket
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager
from io import FileIO
from pathlib import Path
from tempfile import TemporaryFile

from ..errors import TcbenchError
from ..files import replacing


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
        sync_folder(path.parent)


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
            f"No space is left for the run in {folder} ({error.strerror}). The rows finished so far are "
            "intact: "
            "free some space and run the same command again; it goes on where it stopped."
        )
    in_the_way = error.errno in (errno.EEXIST, errno.ENOTDIR)
    return TcbenchError(
        f"Cannot write to the run folder {folder}: {'a file is in the way' if in_the_way else error.strerror or error}."
        f" Choose another folder{'' if in_the_way else ' or change its permissions'}."
    )


def hold_lock(path: Path) -> FileIO:
    """Hold the lock file; `TcbenchError` naming the holder when another process has it.

    The file is emptied, so a link is not followed: in a folder that others write to it may lead anywhere.
    """
    flags = os.O_RDWR | os.O_APPEND | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    file = open(os.open(path, flags | getattr(os, "O_BINARY", 0), 0o666), "a+b", buffering=0)  # noqa: SIM115 -- held
    try:
        if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise OSError(errno.EINVAL, "not a regular file", str(path))
        _lock_file(file)
    except (BlockingIOError, PermissionError) as error:
        holder = next(_holder(path), "another process")
        file.close()
        raise TcbenchError(
            f"Another run is writing to {path.parent} ({holder}). Wait until it ends, or give this run another folder."
        ) from error
    except OSError:
        file.close()
        raise
    file.seek(0)
    file.truncate()
    since = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
    file.write(f"process {os.getpid()} on {socket.gethostname()}, since {since}".encode())
    file.flush()
    return file


def _holder(path: Path) -> Iterator[str]:
    try:
        if text := path.read_text(errors="replace").strip()[:200]:
            yield text
    except OSError:  # Windows locks the bytes against reading too
        return


if os.name == "nt":  # pragma: no cover -- Windows

    def _lock_file(file: FileIO) -> None:
        import msvcrt

        file.seek(1 << 20)  # far beyond the text, which stays readable
        msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]

    def sync_folder(folder: Path) -> None:
        """Folders cannot be synced on Windows; the rename is still atomic."""

else:

    def _lock_file(file: FileIO) -> None:
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)

    def sync_folder(folder: Path) -> None:
        """Make a rename in the folder survive a power cut."""
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
