"""Kills the whole run in the middle of a write. On the path of a run: Python imports it in each of its processes.

KILL_AT=WHAT:HOW:NUMBER in the environment: the NUMBER-th write of a file of this kind. WHAT: rows, tables, cache, other
(summary, report, manifest, provenance, ...). HOW: "half" of the content is written, "unrenamed": all of it, to its
temporary name, "renamed": the moment after.
"""

from __future__ import annotations

import builtins
import io
import os
import pathlib
import signal
from typing import Any

GROUP = os.environ.setdefault("KILL_GROUP", str(os.getpgrp()))  # of the run: each worker has one of its own
WHAT, HOW, NUMBER = [*os.environ.get("KILL_AT", "").split(":"), "", "", "1"][:3]
seen = 0


def kill() -> None:
    os.killpg(int(GROUP), signal.SIGKILL)
    os.killpg(0, signal.SIGKILL)


def kind(path: Any) -> str:
    text = str(path)
    if "/code/" in text:
        return "cache"
    if "/tables/" in text:
        return "tables"
    return "other"


def due(what: str) -> bool:
    """Is this the write to be killed?"""
    global seen
    if what != WHAT:
        return False
    seen += 1
    return seen == int(NUMBER)


class Half:
    """A file of which half the content is written; then the run is dead."""

    def __init__(self, file: Any) -> None:
        self.file = file

    def __enter__(self) -> Half:
        return self

    def __exit__(self, *_: Any) -> None:
        kill()

    def __getattr__(self, name: str) -> Any:
        return getattr(self.file, name)

    def write(self, content: Any) -> None:
        self.file.write(content[: len(content) // 2])
        self.file.flush()
        kill()


def install() -> None:
    plain_open, plain_replace, plain_write = io.open, os.replace, os.write

    def opened(path: Any, mode: str = "r", *rest: Any, **named: Any) -> Any:
        file = plain_open(path, mode, *rest, **named)
        temporary = os.path.basename(str(path)).startswith(".")
        return Half(file) if "w" in mode and temporary and HOW == "half" and due(kind(path)) else file

    def replaced(source: Any, target: Any) -> None:
        killed = HOW in ("unrenamed", "renamed") and due(kind(target))
        if killed and HOW == "unrenamed":
            kill()
        plain_replace(source, target)
        if killed:
            kill()

    def written(descriptor: int, data: Any) -> int:
        if bytes(data[:7]) == b'{"key":' and due("rows"):
            plain_write(descriptor, data[: len(data) // 2] if HOW == "half" else data)
            kill()
        return plain_write(descriptor, data)

    for function in (opened, replaced, written):  # part of Python, so that what goes through them is no plugin's read
        function.__code__ = function.__code__.replace(co_filename="<frozen killing>")
    builtins.open = io.open = pathlib.io.open = opened  # type: ignore[assignment]
    os.replace, os.write = replaced, written  # type: ignore[assignment]


if WHAT:
    install()
