"""Is a row still what would be measured? Its inputs, as they were noted, against what is there now."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.machinery import PathFinder
from typing import Any

from ..inputs import marks
from ..inputs.facts import fact_mark
from ..store.rows import Rows
from .child import given

NOT_NOTED = "what it read was not noted"
CALLED = {"environment": "the variable ", "packages": "the package "}


class Reuse:
    """Verdicts on rows of one store; each file is looked at once.

    context : of the run (`planning.Job`): `anchors`, the folders of plugins by label, and `needs`, the plugins that
        integrators and scenarios come from, by name.
    """

    def __init__(self, store: Rows, context: Mapping[str, Any]) -> None:
        self._store = store
        self._folders: Mapping[str, str] = context.get("anchors", {})
        self._needs: Mapping[str, Any] = context.get("needs", {})
        variables, start = given(), os.getcwd()
        looks = marks.LOOKS | {"environment": lambda n: fact_mark(n, variables, start), "packages": marks.package_mark}
        self._looks = {kind: cache(look) for kind, look in looks.items()}
        self._verdicts: dict[str, str] = {}
        # a plugin file's folder comes last on the path, as in `loading.files`
        self._path = [p for p in sys.path if p not in self._folders.values()]

    def reason(self, cell: Any, row: Mapping[str, Any]) -> str:
        """Why the row of a cell is not to be used again; "" when all that it read is as it was."""
        name = str(row.get("inputs") or "")
        needed = {label for item in (cell.integrator, cell.scenario) for label in self._needs.get(item, ())}
        if not name:
            return NOT_NOTED if needed else ""
        if name not in self._verdicts:
            noted = self._store.inputs(name)
            self._verdicts[name] = NOT_NOTED if noted is None else self._look(noted)
        if not self._verdicts[name] and not needed <= set((self._store.inputs(name) or {}).get("plugins", ())):
            return "it was measured with another plugin of that name"
        return self._verdicts[name]

    def _look(self, noted: Mapping[str, Any]) -> str:
        try:
            if noted["unseen"]:
                return "; ".join(noted["unseen"])
            for kind, look in self._looks.items():
                for name, mark in noted[kind].items():
                    place = marks.placed(name, self._folders) if kind in marks.LOOKS else name
                    if not place or look(place) != mark:
                        return CALLED.get(kind, "") + str(name)
            for name, path in noted["modules"].items():
                if not self._same_module(name, path, noted["plugins"]):
                    return f"the module {name}"
        except (KeyError, TypeError, AttributeError):
            return NOT_NOTED
        return ""

    def _same_module(self, name: str, path: str | None, labels: Any) -> bool:
        """Does an import find the file that it found then, and nothing where it found nothing?

        What only a plugin's own changes of `sys.path` find is known by its content.
        """
        folders = [self._folders[label] for label in labels if label in self._folders]
        spec = _found_by(sys.meta_path, name, [*self._path, *folders])
        if spec is None or not spec.origin:
            return True
        place = marks.placed(path, self._folders) if path else ""
        return bool(place) and os.path.realpath(spec.origin) == os.path.realpath(place)


def _found_by(finders: Sequence[Any], name: str, path: list[str]) -> Any:
    """What an import with this path would find; editable installs have finders of their own."""
    for finder in finders:
        with contextlib.suppress(Exception):
            spec = finder.find_spec(name, path if finder is PathFinder else None)
            if spec is not None:
                return spec
    return None
