"""Rows of a study as a table."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ..table import Table
from .columns import column

if TYPE_CHECKING:
    from pandas import DataFrame

PAIR = ("scenario", "integrator")


def rows_in(
    records: Iterable[Mapping[str, Any]], name: str, keys: Sequence[str] = ("integrator", "scenario")
) -> list[dict[str, Any]]:
    """The rows that records keep under a name, each with these values of its record."""
    return [{key: record.get(key) for key in keys} | row for record in records for row in record.get(name) or ()]


def spread(
    records: Iterable[Mapping[str, Any]], name: str, *without: str,
    failed: Callable[[Mapping[str, Any]], dict[str, Any]] | None = None,
) -> list[dict[str, Any]]:  # fmt: skip
    """The rows that records keep under a name, each with all else of its record but what it is `without`; of a record
    that keeps none what `failed` says of it."""
    rows = []
    for record in records:
        origin = {k: v for k, v in record.items() if k not in (name, *without)}
        rows += [origin | row for row in record.get(name) or ([failed(record)] if failed else [])]
    return rows


def table_of(rows: Iterable[Mapping[str, Any]], schema: Table, by: Sequence[str] = PAIR) -> DataFrame:
    """The columns of the table, but for optional ones that no row has, then the others that rows have; in the order of
    the columns `by`, then as they came."""
    import pandas as pd

    table = pd.DataFrame(list(rows))
    first = [name for name in schema.names if name in table or not column(name, schema).optional]
    table = table.reindex(columns=[*first, *(c for c in table.columns if c not in first)])
    return table.sort_values(list(by), kind="stable", ignore_index=True) if by else table
