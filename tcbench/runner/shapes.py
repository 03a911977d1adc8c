"""What the files of a run folder say, as far as it is what tcbench writes: they may be damaged, or somebody else's."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

NUMBER = (int, float)
NUMBERS = [NUMBER]
METHOD = {
    "family": str, "kind": str, "order": (*NUMBER, type(None)), "claims": [str], "tags": [str], "source": str,
    "plugin": str, "description": str, "formula": str,
}  # fmt: skip
SCENARIO = {
    "system": str, "plugin": str, "shows": str, "source": str, "constants": {}, "t_end": NUMBER, "dt": NUMBER,
    "t_converge": NUMBER, "blowup_factor": NUMBER, "initial_exergy": NUMBER, "initial_energy": NUMBER,
    "ladder": NUMBERS, "positions": NUMBERS, "momenta": NUMBERS, "temperatures": NUMBERS, "initial": {},
    "invariants": [str], "links": [NUMBERS], "joints": [object], "faces": [NUMBERS],
}  # fmt: skip
DECLARED = {
    "integrators": {str: METHOD}, "scenarios": {str: SCENARIO}, "absent": {str: str},
    "metrics": {str: {"unit": str, "description": str, "label": str, "worse": str}}, "tables": {str: [{}]},
}  # fmt: skip
MANIFEST = {
    "git": ({}, type(None)), "machine": {}, "packages": {}, "threads": {}, "command": [str], "tables": [str],
    "started": str, "ended": str, "cells": int, "interrupted": bool, "python": str, "tcbench": (str, type(None)),
}  # fmt: skip


def fits(value: Any, kind: Any) -> bool:
    """Is a value of JSON of a kind: a type or alternatives, [kind of all items], {str: kind of all values}, or a
    mapping by name, whose names may be absent?"""
    if isinstance(kind, tuple):
        return any(fits(value, one) for one in kind)
    if isinstance(kind, list):
        return isinstance(value, list) and all(fits(item, kind[0]) for item in value)
    if isinstance(kind, dict):
        return isinstance(value, dict) and all(
            (str in kind and fits(v, kind[str])) or (str not in kind and (k not in kind or fits(v, kind[k])))
            for k, v in value.items()
        )
    return isinstance(value, kind) and (kind in (bool, object) or not isinstance(value, bool))


def fitting(data: Mapping[str, Any], kinds: Mapping[str, Any], misfits: list[str], path: str = "") -> dict[str, Any]:
    """The parts of the data that are of their kinds; what is left out is appended to `misfits`, by its place."""
    parts = {}
    for name, value in data.items():
        kind = kinds.get(name, kinds.get(str, object))  # type: ignore[call-overload]
        if isinstance(kind, dict) and str in kind and isinstance(value, dict):
            parts[name] = fitting(value, kind, misfits, f"{path}{name}.")
        elif fits(value, kind):
            parts[name] = value
        else:
            misfits.append(f"{path}{name}")
    return parts
