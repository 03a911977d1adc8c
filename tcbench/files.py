"""Files that are written completely or not at all."""

from __future__ import annotations

import os
import re
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

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
    """`replacing`, of a file that the user has named: of a link it is the file that it leads to, and a pipe or a device
    is written as it is."""
    if path.exists() and not path.is_file():
        yield path
    else:
        with replacing(path.resolve()) as temporary:
            yield temporary
