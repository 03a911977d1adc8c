"""The studies by name; one file each. Heavy imports stay inside their functions."""

from __future__ import annotations

import importlib

from ..errors import unknown_name
from .base import Study

NAMES = (
    "conservation",
    "convergence",
    "equilibrium",
    "claims",
    "stability",
    "work_precision",
)  # what `run` does by default
OTHERS = ("map",)  # has a command of its own


def studies() -> dict[str, Study]:
    """Every study by name, in the order in which they run."""
    return {name: find_study(name) for name in NAMES}


def find_study(name: str) -> Study:
    if name not in NAMES + OTHERS:
        raise unknown_name("study", name, NAMES)
    study: Study = importlib.import_module(f".{name}", __name__).STUDY
    return study
