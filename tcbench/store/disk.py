"""Files of a run folder: written completely or not at all, and errors of the system as sentences."""

from __future__ import annotations

import errno
import os
from pathlib import Path

from ..errors import TcbenchError
from ..files import replacing
from .lock import sync_folder


def replace_file(path: Path, content: bytes, folder: Path) -> None:
    """Write a file of a run folder, completely or not at all, and return when it is on the disk.

    Raises `TcbenchError` when that is not possible.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as temporary, open(temporary, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        sync_folder(path.parent)
    except OSError as error:
        raise cure(error, folder) from error


def cure(error: OSError, folder: Path) -> TcbenchError:
    """The sentence for an operating-system error while writing."""
    if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
        return TcbenchError(
            f"No space is left for the run in {folder} ({error.strerror}). The rows finished so far are "
            "intact: "
            "free some space and run the same command again; it goes on where it stopped."
        )
    return TcbenchError(
        f"Cannot write to the run folder {folder}: {error.strerror or error}. Choose another folder or "
        "change its permissions."
    )
