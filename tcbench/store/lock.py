"""One writer a folder: a lock that the operating system drops when its holder dies, however it dies.

On network file systems flock is as good as the server's lock manager; on Lustre it needs the mount option
`flock`.
"""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from ..errors import TcbenchError


def hold_lock(path: Path) -> BinaryIO:
    """Hold the lock file; `TcbenchError` naming the holder when another process has it."""
    file = open(path, "a+b")  # noqa: SIM115 -- held open as long as the run
    try:
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

    def _lock_file(file: BinaryIO) -> None:
        import msvcrt

        file.seek(1 << 20)  # far beyond the text, which stays readable
        msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]

    def sync_folder(folder: Path) -> None:
        """Folders cannot be synced on Windows; the rename is still atomic."""

else:

    def _lock_file(file: BinaryIO) -> None:
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)

    def sync_folder(folder: Path) -> None:
        """Make a rename in the folder survive a power cut."""
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
