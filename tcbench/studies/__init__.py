"""The studies by name; one file each. Heavy imports stay inside their functions."""

from __future__ import annotations

import importlib

from ..errors import unknown_name
from .base import Study

NAMES = ("conservation",)


def studies() -> dict[str, Study]:
    """Every study by name, in the order in which they run."""
    return {name: importlib.import_module(f".{name}", __name__).STUDY for name in NAMES}


def find_study(name: str) -> Study:
    if name not in NAMES:
        raise unknown_name("study", name, NAMES)
    return studies()[name]
