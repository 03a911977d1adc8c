"""Who asks for what is noted: a plugin, a package, or Python and tcbench themselves."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from typing import Any

from .marks import KNOWN, OWN, PYTHON, SITE, top

HERE = os.path.dirname(os.path.abspath(__file__)) + os.sep
FOUND_BY_PYTHON = "<frozen importlib"


def _callers() -> Iterator[tuple[str, str]]:
    """File and function of who is running, from the innermost out."""
    frame: Any = sys._getframe(1)
    while frame is not None:
        yield frame.f_code.co_filename, frame.f_code.co_name
        frame = frame.f_back


def foreign(installed: bool = True) -> bool:
    """Is the nearest caller that is not of Python itself no code of tcbench's? installed: or of a package, also where
    one that is known by its version calls for it."""
    for file, _ in _callers():
        if not _passes_on(file) and not (installed and file.startswith(SITE) and top(file) in KNOWN):
            return not file.startswith(OWN) and not (not installed and file.startswith(SITE))
    return False


def directly(names: tuple[str, ...]) -> bool:
    """Is the caller no code of Python's own but functions of these names, and of no package?"""
    for file, name in _callers():
        if not file.startswith((HERE, "<frozen os", os.__file__, "<frozen _collections_abc")) and not (
            name in (*names, "get", "getenv") and _passes_on(file)
        ):
            return not file.startswith(OWN) and not _passes_on(file) and not file.startswith(SITE)
    return False


def imported() -> bool:
    """Is what is read now read by Python's own import?"""
    return caller().startswith(FOUND_BY_PYTHON)


def caller() -> str:
    """The file of who has called what is noted."""
    return next((file for file, _ in _callers() if not file.startswith(HERE)), "")


def _passes_on(file: str) -> bool:
    """Is a file of Python's own, or of this package, which act for others?"""
    return file.startswith(HERE) or (file.startswith(("<frozen", *PYTHON)) and not file.startswith(SITE))
