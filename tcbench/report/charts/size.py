"""Cost against size: a row of panels for each family of systems that grow."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...chart import Chart, Panel, Series, Sheet
from ...studies.columns import column as column_named
from ...studies.size import GROWING
from .render import chart
from .style import finite, names, ok

if TYPE_CHECKING:
    from pandas import DataFrame


@chart
def size(table: DataFrame, fits: DataFrame | None = None, y: Sequence[str] | None = None) -> Sheet:
    """Time to the first step, time a step and memory against the numbers in a state, a row of panels a family.

    table : rows of `size`; fits : rows of `size_exponents`; y : other columns of `size`. The number at the end of a
    line is its exponent. Runs that failed are left out.
    """
    columns = list(y or GROWING)
    shown = [_lines(table[ok(table)], fits, family, column) for family in names(table, "family") for column in columns]
    return Sheet(shown, len(columns), (3.3, 2.7))


def _lines(rows: DataFrame, fits: DataFrame | None, family: str, column: str) -> Panel:
    rows = rows[rows["family"].astype(str) == family]
    fit = None if fits is None or "family" not in fits else fits[fits["family"].astype(str) == family]
    good = rows[np.isfinite(finite(rows["numbers"])) & (finite(rows[column]) > 0)]
    series = []
    for key, mine in good.groupby(["integrator", "dt"], sort=False):
        mine, slope = mine.sort_values("numbers"), _exponent(fit, key, column)
        text = f"{slope:.2f}" if np.isfinite(slope) else ""
        series.append(Series(str(key[0]), finite(mine["numbers"]), finite(mine[column]), text=text))
    note = "" if series else "no completed run has a value here"
    return Panel(series, column_named("numbers").label, column_named(column).label, title=family, note=note)


def _exponent(fits: DataFrame | None, key: Any, column: str) -> float:
    """The exponent of a method's column, NaN if none is known."""
    if fits is None or column not in GROWING or GROWING[column] not in fits:
        return np.nan
    mine = fits[(fits["integrator"].astype(str) == key[0]) & (fits["dt"] == key[1])]
    return float(finite(mine[GROWING[column]])[0]) if len(mine) else np.nan


CHARTS = (
    Chart("size", "Times and memory against the size of a system; the number at a line's end is its exponent.",
          ("size",), size, ("size_exponents",), by_scenario=False, options=("y",), study="size"),
)  # fmt: skip
