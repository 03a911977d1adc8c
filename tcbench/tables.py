"""The tables of a run folder as they are now, whether the run has ended or not."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from .cells import identity_of
from .errors import TcbenchError
from .store import Store

if TYPE_CHECKING:
    from pandas import DataFrame


def read_tables(source: str | Path | Store) -> dict[str, DataFrame]:
    """Every table of a run by name, in the order of the studies.

    Made from the rows where there are rows (the latest of each cell: a folder may hold rows of older sources too), read
    from `tables/` otherwise, as in a published run that keeps its tables only.
    """
    from .runner import make_tables
    from .studies import studies

    store = source if isinstance(source, Store) else Store.read(source)
    latest = {identity_of(line["cell"]): line["key"] for line in store.lines() if line["cell"]}
    tables: dict[str, DataFrame] = {}
    for study in studies().values():
        try:
            tables |= make_tables([study], store, set(latest.values()))
        except (KeyError, ValueError, TypeError) as error:  # rows of another version of the study
            store.problems.append(f"The rows of study {study.name!r} cannot be tabulated: {error!r}.")
    for name in store.tables():
        if name not in tables:
            try:
                tables[name] = store.read_table(name)
            except TcbenchError as error:
                store.problems.append(str(error))
    return {name: table for name, table in tables.items() if len(table)}
