"""Cost and error against size: a row of panels for each family of systems that grow."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

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
    good, slope = rows[np.isfinite(finite(rows["numbers"])) & (finite(rows[column]) > 0)], GROWING.get(column, "")
    keys = ["family", "integrator", "dt"]
    slopes = {} if fits is None or slope not in fits else fits.set_index(keys)[slope].to_dict()
    series = []
    for (name, dt), mine in good.groupby(keys[1:], sort=False):
        exponent = slopes.get((family, name, dt), np.nan)
        of = mine.sort_values("numbers")
        text = f"{exponent:.2f}" if np.isfinite(exponent) else ""
        series.append(Series(str(name), finite(of["numbers"]), finite(of[column]), text=text))
    note = "" if series else "no completed run has a value here"
    return Panel(series, column_named("numbers").label, column_named(column).label, title=family, note=note)


@chart
def mesh(table: DataFrame) -> Sheet:
    """Distance from the finest run against the numbers of a state, at the shortest step, and against the step, on the
    finest mesh; a row of panels a family.

    table : rows of `mesh`. Runs that failed are left out.
    """
    shown = []
    for family in names(table, "family"):
        rows = table[ok(table) & (table["family"].astype(str) == family)]
        for x, held, end in (("numbers", "dt", "min"), ("dt", "numbers", "max")):
            best = rows.groupby("integrator")[held].transform(end)
            good = rows[(rows[held] == best) & (finite(rows["mesh_error"]) > 0)].sort_values(x)
            lines = [
                Series(str(name), finite(of[x]), finite(of["mesh_error"])) for name, of in good.groupby("integrator")
            ]
            label = column_named("mesh_error").label
            note = "" if lines else "no two completed runs to compare"
            shown.append(Panel(lines, column_named(x).label, label, title=family, note=note))
    return Sheet(shown, 2, (3.6, 2.7))


CHARTS = (
    Chart("mesh", "Distance of nodes from the finest run, against mesh and step.", ("mesh",), mesh,
          by_scenario=False, study="mesh"),
    Chart("size", "Times and memory against the size of a system; the number at a line's end is its exponent.",
          ("size",), size, ("size_exponents",), by_scenario=False, options=("y",), study="size"),
)  # fmt: skip
