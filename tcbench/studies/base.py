"""The studies that there are: one in each file beside this one that has a STUDY, and those of plugins."""

from __future__ import annotations

import importlib
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from ..errors import TcbenchError, is_pattern, matching, unknown_name
from ..study import Row, Study
from ..table import Column, Table, from_dict

if TYPE_CHECKING:
    from ..integrator import Integrator

EMPTY: Mapping[str, Any] = MappingProxyType({})

# plugins are imported where they are asked for: `tcbench run --help` names studies, and has nothing to wait for


def studies() -> dict[str, Study]:
    """Every study by name, in the order of their places."""
    from .. import plugins

    refuse_doubles(plugins.registry().studies.values())
    return in_order([*own_studies(), *plugins.registry().studies.values()])


def table_owners() -> dict[str, str]:
    """The tables of tcbench's own studies, and of which study each is."""
    return {table.name: study.name for study in own_studies() for table in study.tables}


def own_studies() -> list[Study]:
    """Those of tcbench."""
    return [find_study(name) for name in study_names()]


def refuse_doubles(brought: Collection[Study]) -> None:
    """Raise TcbenchError for a plugin's study that is called like another, or whose table is another's: of two things
    with one name one would be lost without a word."""
    taken = table_owners() if brought else {}
    for study in brought:
        if study.name in study_names():
            raise TcbenchError(f"{study.plugin} registers the study {study.name!r}, which tcbench has. Rename it.")
        for table in study.table_names:
            if taken.setdefault(table, study.name) != study.name:
                raise TcbenchError(
                    f"The table {table!r} of the study {study.name!r} ({study.plugin}) is one of the study "
                    f"{taken[table]!r}, too. Rename it."
                )


def in_order(chosen: Iterable[Study]) -> dict[str, Study]:
    """These by name, in the order of their places."""
    return {study.name: study for study in sorted(chosen, key=lambda study: (study.place, study.name))}


def default_studies() -> dict[str, Study]:
    """Those that a run does where none is named."""
    return {name: study for name, study in studies().items() if study.by_default}


@cache
def study_names() -> tuple[str, ...]:
    """Names of the files beside this one that define a STUDY; none is imported to find out."""
    files = sorted(Path(__file__).parent.glob("*.py"))
    return tuple(file.stem for file in files if "\nSTUDY = " in file.read_text(encoding="utf-8"))


def expand_studies(names: Iterable[str]) -> list[str]:
    """The studies of these names, each once; a pattern such as `con*` is every one run by default whose name fits."""
    defaults = default_studies()
    chosen = [
        one for name in map(str, names) for one in (matching("study", name, defaults) if is_pattern(name) else [name])
    ]
    return list(dict.fromkeys(chosen))


def find_study(name: str) -> Study:
    """The study in the file of this name beside this one, imported when it is first asked for; else a plugin's."""
    if name in study_names():
        study: Study = importlib.import_module(f".{name}", __package__).STUDY
        return study
    from .. import plugins

    brought = plugins.registry().studies
    if name not in brought:
        raise unknown_name("study", name, [*study_names(), *brought], *plugins.cure())
    return brought[name]


def settings(integrator: Integrator, steps: Iterable[float], tolerances: Iterable[float]) -> list[Row]:
    """Options of a method's cells: a step in each; of an adaptive solver, which has no dt, a tolerance."""
    adaptive = integrator.kind == "adaptive"
    return [{"tolerance": value} for value in tolerances] if adaptive else [{"dt": value} for value in steps]


def tables_by_study(declared: Mapping[str, Any] = EMPTY) -> dict[str, tuple[Table, ...]]:
    """The tables of tcbench's studies, and of those that a run folder declares. Its metrics are columns of
    `conservation`."""
    facts = declared.get("metrics", {}).items()
    metrics = tuple(Column(n, m.get("label", ""), unit=m.get("unit", ""), worse=m.get("worse", "")) for n, m in facts)
    own: dict[str, tuple[Table, ...]] = {study.name: study.tables for study in own_studies()}
    first, *others = own["conservation"]
    own["conservation"] = (replace(first, columns=(*first.columns, *metrics)), *others)
    brought = {name: tuple(filter(None, map(from_dict, data))) for name, data in declared.get("tables", {}).items()}
    return brought | own


def table_schemas(declared: Mapping[str, Any] = EMPTY) -> dict[str, Table]:
    """The same by the name of the table."""
    return {table.name: table for tables in tables_by_study(declared).values() for table in tables}
