"""The tables of a run folder as they are now, whether the run has ended or not."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import TcbenchError, matching
from ..studies.base import Study, studies
from .cells import UNHASHABLE, identity_of
from .store import Rows, Store

if TYPE_CHECKING:
    from pandas import DataFrame


def read_tables(source: str | Path | Store) -> dict[str, DataFrame]:
    """Every table of a run by name, in the order of the studies.

    Made from the rows (the latest of each cell: a folder may hold rows of older sources too); read from `tables/` where
    there are none, as in a published run that keeps its tables only, or where rows cannot be tabulated.
    """
    store = source if isinstance(source, Store) else Store.read(source)
    latest, older = latest_rows(store)
    store.problems += older
    tables: dict[str, DataFrame] = {}
    kept = [] if latest else store.tables()
    for study in studies().values():
        try:
            tables |= make_tables([study], store, latest)
        except (KeyError, ValueError, TypeError) as error:  # rows of another version of the study
            store.problems.append(f"The rows of study {study.name!r} cannot be tabulated: {error!r}.")
            kept += [name for name in store.tables() if name in study.tables]
    for name in kept:
        if name not in tables:
            try:
                tables[name] = store.read_table(name)
            except TcbenchError as error:
                store.problems.append(str(error))
    return {name: table for name, table in tables.items() if len(table)}


def latest_rows(store: Rows) -> tuple[set[str], list[str]]:
    """The keys of the rows that tables are made of, the last of each cell but for those of older formulas; and a
    sentence for each method that has such.

    A folder has the rows of all runs into it, and rows of two formulas under one name would be judged as one method: so
    a method is what measured its last row (`source_hash`), whatever the cell. What has no hash cannot be told apart.
    """
    cells = {identity_of(line["cell"]): line for line in store.lines() if line["cell"]}
    marks = {line["cell"]["integrator"]: mark for line in store.lines() if line["cell"] and (mark := _mark(line))}
    older = [line for line in cells.values() if _mark(line) not in ("", marks.get(line["cell"]["integrator"]))]
    keys = {line["key"] for line in cells.values()} - {line["key"] for line in older}
    counts = Counter(line["cell"]["integrator"] for line in older)
    return keys, [_told(name, count) for name, count in sorted(counts.items())]


def _told(name: str, count: int) -> str:
    rows, are, them = ("rows", "are", "them") if count > 1 else ("row", "is", "it")
    return (
        f"{count} {rows} of {name} that an older version of its formula measured {are} not in the tables (cells.jsonl "
        f"still has {them}); the command that measured them measures the formula as it is now."
    )


def _mark(line: Mapping[str, Any]) -> str:
    mark = str(line["row"].get("source_hash") or "")
    return "" if mark == UNHASHABLE else mark


def make_tables(chosen: Iterable[Study], store: Rows, keys: set[str] | None = None) -> dict[str, DataFrame]:
    """Tables of the rows in the store; of these keys only, when given."""
    tables: dict[str, DataFrame] = {}
    for study in chosen:
        records = [r for r in store.records(study.name) if keys is None or r["key"] in keys]
        if records:
            tables |= study.tabulate([{k: v for k, v in r.items() if k not in ("study", "key")} for r in records])
    return tables


def only(tables: Mapping[str, DataFrame], column: str, names: Sequence[str]) -> dict[str, DataFrame]:
    """The rows of these names in the tables that have the column, the other tables as they are; all if none is named.

    A table need not have rows of each (that of blow-ups has the methods that failed); a name that none has is an error.
    A name may be a pattern, as in "tc_*".
    """
    known = {str(value) for table in tables.values() if column in table for value in table[column].dropna()}
    if not names:
        return dict(tables)
    chosen = [one for name in names for one in matching(f"{column} of this run", name, known)]
    return {
        key: table[table[column].astype(str).isin(chosen)] if column in table else table
        for key, table in tables.items()
    }
