"""Rows of a study as a table."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pandas import DataFrame

PAIR = ("scenario", "integrator")


def table_of(rows: Iterable[Mapping[str, Any]], columns: Iterable[str], by: Sequence[str] = PAIR) -> DataFrame:
    """These columns, then the others that rows have; in the order of the columns `by`, then as they came."""
    import pandas as pd

    table, first = pd.DataFrame(list(rows)), list(columns)
    table = table.reindex(columns=[*first, *(c for c in table.columns if c not in first)])
    return table.sort_values(list(by), kind="stable", ignore_index=True) if by else table
