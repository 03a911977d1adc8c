"""Cost against size: a row of panels for each family of systems that grow."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...studies.columns import column as column_named
from ...studies.size import GROWING
from .kind import Kind
from .layout import legend, line_labels, note, panels, titles
from .scales import log_axis
from .style import chart, finite, look, names, ok

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pandas import DataFrame

    from .layout import Drawing


@chart
def size(table: DataFrame, fits: DataFrame | None = None, y: Sequence[str] | None = None) -> Drawing:
    """Time to the first step, time a step and memory against the numbers in a state, a row of panels a family.

    table : rows of `size`; fits : rows of `size_exponents`; y : other columns of `size`. The number at the end of a
    line is its exponent. Runs that failed are left out.
    """
    columns, families = list(y or GROWING), names(table, "family") or [""]
    figure, axes = panels(len(columns) * len(families), len(columns), (3.3, 2.7), right=0.35)
    pairs = [(family, column) for family in families for column in columns]
    for ax, (family, column) in zip(axes, pairs, strict=True):
        fit = None if fits is None or "family" not in fits else fits[fits["family"].astype(str) == family]
        _lines(ax, table[(table["family"].astype(str) == family) & ok(table)], fit, column)
        ax.set_xlabel(column_named("numbers").label)
        ax.set_ylabel(column_named(column).label)
    titles(axes, [family for family, _ in pairs])
    legend(figure, names(table))
    return figure


def _lines(ax: Axes, rows: DataFrame, fits: DataFrame | None, column: str) -> None:
    x, y = finite(rows["numbers"]), finite(rows[column])
    good = np.isfinite(x) & (y > 0)
    if not good.any():
        note(ax, "no completed run has a value here")
        return
    log_axis(ax, "x", x[good])
    log_axis(ax, "y", y[good])
    ends: list[tuple[float, float, str, str]] = []
    for key, mine in rows[good].groupby(["integrator", "dt"], sort=False):
        style, mine = look(str(key[0])), mine.sort_values("numbers")
        ax.plot(mine["numbers"], mine[column], color=style.colour, marker=style.marker, linestyle=style.dash)
        slope = _exponent(fits, key, column)
        if np.isfinite(slope):
            last = mine.iloc[-1]
            ends.append((float(last["numbers"]), float(last[column]), f"{slope:.2f}", style.colour))
    line_labels(ax, ends)


def _exponent(fits: DataFrame | None, key: Any, column: str) -> float:
    """The exponent of a method's column, NaN if none is known."""
    if fits is None or column not in GROWING or GROWING[column] not in fits:
        return np.nan
    mine = fits[(fits["integrator"].astype(str) == key[0]) & (fits["dt"] == key[1])]
    return float(finite(mine[GROWING[column]])[0]) if len(mine) else np.nan


KINDS = (
    Kind("size", "size", "Times and memory against the size of a system; the number at a line's end is its exponent.",
         ("size",), size, ("size_exponents",), by_scenario=False, options=("y",)),
)  # fmt: skip
