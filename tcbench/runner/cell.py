"""The unit of work, of failure and of reuse: a study, a method and a scenario, with the study's options."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any

import orjson

from ..errors import TcbenchError
from .codec import PACKED, canonical_json, digest, to_json

STORAGE = ("sweep",)  # options that decide what a row keeps, and nothing that it measures


@dataclass(frozen=True)
class Cell:
    """One measurement to make: a study, an integrator, a scenario and the study's options (JSON values).

    timed : the row holds a timing: the cell runs alone on the machine, after all the others.
    """

    study: str
    integrator: str
    scenario: str
    options: Mapping[str, Any] = field(default_factory=dict)
    timed: bool = False

    def __post_init__(self) -> None:
        try:
            text = to_json(dict(self.options))
            if f'{{"{PACKED}":'.encode() in text:
                raise TypeError("not every number is finite")
            options = orjson.loads(text)
        except TypeError as error:
            raise TcbenchError(
                f"The options of a cell of study {self.study!r} ({self.integrator}, {self.scenario}) are not JSON: "
                f"{error}. Use finite numbers, strings, lists and dicts with string keys."
            ) from error
        object.__setattr__(self, "options", options)

    @cached_property
    def key(self) -> str:
        """Sha256 of all fields: of two rows of one key the last counts."""
        return digest(self.as_dict())

    def as_dict(self) -> dict[str, Any]:
        return {f.name: getattr(self, f.name) for f in fields(self)}

    def __hash__(self) -> int:
        return hash(self.key)


def identity_of(cell: Mapping[str, Any]) -> str:
    """What a cell measures, whatever its row keeps."""
    return canonical_json({**cell, "options": {k: v for k, v in cell.get("options", {}).items() if k not in STORAGE}})
