"""The tables of a run folder as they are now, whether the run has ended or not."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import TcbenchError, matching
from ..studies.base import Study, studies
from .cells import identity_of
from .store import Rows, Store

if TYPE_CHECKING:
    from pandas import DataFrame


def read_tables(source: str | Path | Store) -> dict[str, DataFrame]:
    """Every table of a run by name, in the order of the studies.

    Made from the rows (the latest of each cell: a folder may hold rows of older sources too); read from `tables/` where
    there are none, as in a published run that keeps its tables only, or where rows cannot be tabulated.
    """
    store = source if isinstance(source, Store) else Store.read(source)
    latest = latest_keys(store)
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


def latest_keys(store: Store) -> set[str]:
    """The key of the last row of each cell."""
    return set({identity_of(line["cell"]): line["key"] for line in store.lines() if line["cell"]}.values())


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
