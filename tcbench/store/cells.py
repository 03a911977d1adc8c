"""The unit of work, of failure and of reuse: a cell, and its key.

Two cells with the same key give the same row, so a finished key never runs again; everything that can change a row is
therefore part of the key.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any

from ..errors import TcbenchError
from .encoding import canonical_json, plain

KEPT = ("sweep",)  # options that decide what a row keeps, and nothing that it measures
UNHASHABLE = "unhashable"  # source_hash of what has no hash: never the same twice


@dataclass(frozen=True)
class Cell:
    """One measurement to make: a study, an integrator, a scenario and the study's options.

    Attributes
    ----------
    options : the study's parameters (dt, rtol, ...); JSON values. NumPy scalars and tuples are made plain.
    timed : the row holds a timing: the cell runs alone on the machine, after all the others.
    fingerprint : hash of everything else that the row depends on (sources, scenario data, versions).
    machine : the kind of machine that a timing belongs to; empty for cells whose row is the same everywhere.

    Raises `TcbenchError` when an option is not JSON (a function, an array, a NaN-keyed dict, ...).
    """

    study: str
    integrator: str
    scenario: str
    options: Mapping[str, Any] = field(default_factory=dict)
    timed: bool = False
    fingerprint: str = ""
    machine: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "options", _plain_options(self.options, self))

    @cached_property
    def key(self) -> str:
        """Sha256, hexadecimal, of the canonical JSON of all fields."""
        return hashlib.sha256(canonical_json(self.as_dict()).encode()).hexdigest()

    def as_dict(self) -> dict[str, Any]:
        """The fields as plain JSON values."""
        return {f.name: getattr(self, f.name) for f in fields(self)}

    def __hash__(self) -> int:
        return hash(self.key)


def identity_of(cell: Mapping[str, Any]) -> str:
    """The canonical JSON of what a cell is, without the code (fingerprint) and machine that measured it."""
    options = {k: v for k, v in (cell.get("options") or {}).items() if k not in KEPT}
    return canonical_json({k: v for k, v in cell.items() if k not in ("fingerprint", "machine")} | {"options": options})


def _plain_options(options: Mapping[str, Any], cell: Cell) -> dict[str, Any]:
    try:
        found: dict[str, Any] = json.loads(json.dumps(dict(options), default=plain, sort_keys=True))
        return found
    except (TypeError, ValueError) as error:
        raise TcbenchError(
            f"The options of a cell of study {cell.study!r} ({cell.integrator}, {cell.scenario}) are not "
            f"JSON: {error}. "
            "Use numbers, strings, lists and dicts with string keys."
        ) from error
