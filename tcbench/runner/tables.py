"""The tables of a run folder as they are now, whether the run has ended or not."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import TcbenchError, UnknownNameError, matching
from ..studies.base import find_study, in_order, study_names, table_schemas
from ..study import Study
from ..table import Table
from .cell import identity_of
from .rows import Rows, Store

if TYPE_CHECKING:
    from pandas import DataFrame


def read_tables(source: str | Path | Store) -> dict[str, DataFrame]:
    """Every table of a run by name, in the order of the studies.

    Made from the rows; read from `tables/` where there are none, as in a published run that keeps its tables only, or
    where rows cannot be tabulated.
    """
    from_rows, from_files = tables_by_source(source if isinstance(source, Store) else Store.read(source))
    return from_rows | from_files


def tables_by_source(store: Store) -> tuple[dict[str, DataFrame], dict[str, DataFrame]]:
    """The tables that the rows give, and those of which only the files are there; empty ones are in neither."""
    latest, older = latest_rows(store)
    store.problems += older
    chosen, others = _studies(store)
    own_names = [name for study in chosen for name in study.table_names]
    written = store.manifest().get("tables", [])
    names = [name for name in store.tables() if not latest or (others and name not in own_names and name in written)]
    store.problems += [f"No study is called {name!r} here: its tables are those that were written." for name in others]
    tables, failed = make_tables(chosen, store, latest)
    names += [name for study in failed for name in store.tables() if name in study.table_names]
    from_files, schemas = dict[str, "DataFrame"](), table_schemas(store.declared()) if names else {}
    for name in [name for name in dict.fromkeys(names) if name not in tables]:
        try:
            table = store.read_table(name)
        except TcbenchError as error:
            store.problems.append(str(error))
            continue
        lacking = _asked_for(schemas.get(name)).difference(table)
        if lacking and len(table):
            store.problems.append(f"The table {name} has no column {', '.join(sorted(lacking))}: it is left out.")
        elif len(table):
            from_files[name] = table
    return {name: table for name, table in tables.items() if len(table)}, from_files


def _asked_for(table: Table | None) -> set[str]:
    """The columns by which whoever reads a table tells its rows: of methods on scenarios, and of single runs."""
    if table is None or "claim" in table.key:
        return set()
    return {"integrator", "scenario", *(["status"] if {"dt", "control"}.intersection(table.key) else [])}.intersection(
        table.names
    )


def _studies(store: Rows) -> tuple[list[Study], list[str]]:
    """tcbench's own studies and those of plugins that have rows, in their order; and the names that no study has."""
    rows = {str(line["cell"].get("study")) for line in store.raw() if line["cell"]}
    studies, others = [find_study(name) for name in study_names() if name in rows], []
    for name in sorted(rows.difference(study_names())):
        try:
            studies.append(find_study(name))
        except UnknownNameError:
            others.append(name)
    return [*in_order(studies).values()], others


def latest_rows(store: Rows) -> tuple[set[str], list[str]]:
    """The keys of the rows that tables are made of, and sentences on those that are left out.

    In one table there is one tcbench, one version of each method, and one of each scenario: those of its last rows.
    """
    cells = {identity_of(line["cell"]): line for line in store.raw()}
    now: dict[str, str] = {}
    keys: set[str] = set()
    older: Counter[tuple[str, str]] = Counter()
    for line in reversed(cells.values()):
        cell, parts = line["cell"], line["made_by"].split("+")[0].split("-")
        method, scenario = str(cell.get("integrator")), str(cell.get("scenario"))
        names = ("another tcbench", f"an older {method}", f"another scenario {scenario}")
        marks = dict(zip(names, parts, strict=False)) if len(parts) == 3 else {}
        if other := [name for name, mark in marks.items() if now.get(name, mark) != mark]:
            older[method, other[0]] += 1
        else:
            now |= marks
            keys.add(line["key"])
    return keys, [
        f"{count} row{'s' * (count > 1)} of {method} measured with {cause} {'are' if count > 1 else 'is'} not in the "
        "tables (cells.jsonl still has them); the command that measured them measures what is there now."
        for (method, cause), count in sorted(older.items())
    ]


def make_tables(chosen: Iterable[Study], store: Store, keys: set[str]) -> tuple[dict[str, DataFrame], list[Study]]:
    """Tables of the rows of these keys; and the studies that cannot make theirs (`store.problems` says why)."""
    tables, failed = dict[str, "DataFrame"](), []
    by_study: dict[str, list[str]] = {}
    for line in store.raw():
        if line["key"] in keys:
            by_study.setdefault(str(line["cell"].get("study")), []).append(line["key"])
    for study in chosen:
        records = store.records(study.name, by_study.get(study.name, ()))
        if records:
            try:
                tables |= study.tabulated([{k: v for k, v in r.items() if k not in ("study", "key")} for r in records])
            except TcbenchError as error:
                store.problems.append(str(error))
                failed.append(study)
    return tables, failed


def only(tables: Mapping[str, DataFrame], column: str, names: Sequence[str]) -> dict[str, DataFrame]:
    """The rows of these names in the tables that have the column, the other tables as they are; all if none is named.

    A table need not have rows of each (that of blow-ups has the methods that failed); a name that none has is an error.
    A name may be a pattern, as in "tc_*".
    """
    values = {str(value) for table in tables.values() if column in table for value in table[column].dropna()}
    if not names:
        return dict(tables)
    chosen = [one for name in names for one in matching(f"{column} of this run", name, values)]
    return {
        key: table[table[column].astype(str).isin(chosen)] if column in table else table
        for key, table in tables.items()
    }
