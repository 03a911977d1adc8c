"""Files that are written completely or not at all."""

from __future__ import annotations

import os
import re
import sys
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

HALF_WRITTEN = re.compile(r"\..+\.[0-9a-f]{12}(\.\w+)?\Z")  # names of files that a killed process was writing


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A file beside `path`, of the same suffix, that takes its place when the block ends; gone where the block fails.

    Several processes may write the same file at once: each has its own until it is renamed.
    """
    temporary = path.with_name(f".{path.stem}.{uuid.uuid4().hex[:12]}{path.suffix}")
    try:
        yield temporary
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def written(path: Path) -> Iterator[Path]:
    """`replacing`, of a file that the user has named: of a link it is the file that it leads to; a pipe or a device is
    written as it is, and what is this process's own output is added to it."""
    stream = next((s for s in (sys.stdout, sys.stderr) if _is(path, s)), None)
    if stream is not None:
        from tempfile import TemporaryDirectory

        with TemporaryDirectory() as folder:
            yield (temporary := Path(folder) / f"written{path.suffix}")
            stream.flush()
            with open(stream.fileno(), "wb", closefd=False) as target:
                target.write(temporary.read_bytes())
    elif path.exists() and not path.is_file():
        yield path
    else:
        with replacing(Path(os.path.realpath(path))) as temporary:
            yield temporary


def _is(path: Path, stream: Any) -> bool:
    """Does the path lead to what the stream writes to?"""
    try:
        state = path.stat()
        return state.st_ino != 0 and os.path.samestat(state, os.fstat(stream.fileno()))  # 0: Windows, of any device
    except (OSError, ValueError, AttributeError):  # no such file; a stream that is closed, or none of the system's
        return False
