"""Rows in memory, the latest of each cell; which of them are final, and in what order tables have them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .encoding import canonical_json

# What the machine or the user's limits did to a cell, not the cell itself: worth another attempt on resume.
UNFINISHED_STATUSES = frozenset({"crash", "timeout"})
UNFINISHED_ERRORS = frozenset({"MemoryError", "ChangedError", "MachineError"})


def is_finished(row: Mapping[str, Any]) -> bool:
    """Whether the row is final: any but crash, timeout, exhausted memory or disk, a package or file that is absent, and
    code that is not as it was."""
    gone = row.get("status") in UNFINISHED_STATUSES or row.get("exception_type") in UNFINISHED_ERRORS
    return not (gone or row.get("of_the_machine"))


def _place(line: Mapping[str, Any]) -> tuple[Any, ...]:
    """By study, scenario, integrator and options: numbers by size, anything else as text."""
    cell = line["cell"]
    options = sorted(dict(cell.get("options", {})).items())
    sized = [(n, 0, v, "") if isinstance(v, int | float) else (n, 1, 0.0, canonical_json(v)) for n, v in options]
    return *(str(cell.get(name)) for name in ("study", "scenario", "integrator")), sized, line["key"]


Values = Mapping[str, Any]  # by name, as JSON has them


class Rows:
    """Rows in memory, latest per key; a store of its own where nothing goes to disk."""

    def __init__(self) -> None:
        self._lines: dict[str, dict[str, Any]] = {}
        self._inputs: dict[str, dict[str, Any]] = {}
        self.problems: list[str] = []

    def append(self, key: str, row: Values, cell: Values | None = None, provenance: str | None = None) -> None:
        """Keep the row of a cell; an earlier row of the same key is replaced.

        Rows that have read the same name it in `inputs`; the first of them brings it along, as `_inputs`.
        """
        row = dict(row)
        if (noted := row.pop("_inputs", None)) is not None:
            self._inputs[row["inputs"]] = noted
        self._lines.pop(key, None)
        self._lines[key] = {"key": key, "cell": dict(cell or {}), "row": row, "provenance": provenance or ""}

    def inputs(self, name: str) -> dict[str, Any] | None:
        """What rows that name it have read (`tcbench.inputs`); None where that is lost."""
        return self._inputs.get(name)

    def rows(self) -> dict[str, dict[str, Any]]:
        """The latest row of each key."""
        return {key: line["row"] for key, line in self._lines.items()}

    def lines(self) -> list[dict[str, Any]]:
        """The latest line of each key: key, cell, row, provenance."""
        return list(self._lines.values())

    def records(self, study: str | None = None) -> list[dict[str, Any]]:
        """Flat dicts for tables: study, integrator, scenario, the options, the row, and the key.

        In an order of their own: tables must not depend on which worker was the first to end.
        """
        chosen = [line for line in self._lines.values() if study is None or line["cell"].get("study") == study]
        return [
            {name: line["cell"].get(name) for name in ("study", "integrator", "scenario")}
            | dict(line["cell"].get("options", {}))
            | line["row"]
            | {"key": line["key"]}
            for line in sorted(chosen, key=_place)
        ]
