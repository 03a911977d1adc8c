"""Error messages for formulas that cannot be traced: the author's line, and what to write instead."""

from __future__ import annotations

import sys
from pathlib import Path
from types import FrameType

from ..errors import TraceError
from .ops import formulas_may_call

ELEMENTARY = (
    f"Formulas must be branch-free numpy (arithmetic, **, @, {formulas_may_call()}, "
    "where, maximum, minimum, clip, sign)"
)
_REMEDY = f"{ELEMENTARY}; of methods, not of systems, others are registered with step= (plain Python) instead of flows="


def where_in_user_code() -> str:
    """File and line of the innermost frame outside tcbench and numpy."""
    frame: FrameType | None = sys._getframe(1)
    while frame is not None:
        module = frame.f_globals.get("__name__", "")
        if not module.startswith(("tcbench.", "numpy", "functools")) or module.startswith("tcbench.systems.pendulum"):
            return f"{Path(frame.f_code.co_filename).name}, line {frame.f_lineno}"
        frame = frame.f_back
    return "the formula"


def refused(what: str, remedy: str = _REMEDY, where: str = "") -> TraceError:
    """An error that names the line of the formula."""
    return TraceError(f"{where or where_in_user_code()}: {what}. {remedy}.")
