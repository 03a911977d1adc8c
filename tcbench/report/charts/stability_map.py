"""The stability map: a table of `tcbench.studies.map` -> Figure. No computing, no saving, no pyplot state."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ...chart import Chart
from ...studies.columns import column as column_named
from .layout import legend, panels, titles
from .render import chart_of_rows
from .scales import log_axis
from .style import names

if TYPE_CHECKING:
    from pandas import DataFrame

# classes of a cell: a sequence of blues for completed runs, then colours that differ from it in lightness and in hue
CLASSES = (
    ("completed, |E - E0|/V0 below 1 %", "#deebf7"),
    ("completed, below 10 %", "#9ecae1"),
    ("completed, below 100 %", "#4292c6"),
    ("physical: blow-up, collapse, entropy falls", "#e69f00"),
    ("branch: the principal root ends", "#5b1a6b"),
    ("undecided: no root found", "#bdbdbd"),
    ("not run", "#ffffff"),
)
PHYSICAL, BRANCH, UNDECIDED, NOT_RUN = 3, 4, 5, 6
HATCH: Any = {"facecolor": "none", "edgecolor": "#333333", "hatch": "//////"}
TEXT = "only plain Newton from z0 fails", "a branch folds"


def cell_class(outcome: str, energy_error: float) -> int:
    """Index into CLASSES of one cell."""
    if outcome == "ok":
        return int(np.searchsorted([0.01, 0.1], energy_error))
    return {"physical": PHYSICAL, "branch": BRANCH, "solver": UNDECIDED}.get(outcome, NOT_RUN)


def edges(centres: np.ndarray) -> np.ndarray:
    """Edges of cells around these centres, shape (n + 1,); in the logarithm where the centres are geometric."""
    ratio = centres[1:] / centres[:-1]
    log = len(centres) > 2 and np.allclose(ratio, ratio[0], rtol=1e-6)
    c = np.log(centres) if log else centres
    inner = (c[1:] + c[:-1]) / 2
    outer = np.concatenate([[2 * c[0] - inner[0]], inner, [2 * c[-1] - inner[-1]]])
    return np.exp(outer) if log else outer


@chart_of_rows
def map_figure(table: DataFrame) -> Figure:
    """Maps of several integrators side by side, one scenario; the columns are those of `maps.COLUMNS`."""
    kinds = [cell_class(o, e) for o, e in zip(table["outcome"], table["energy_error_max"], strict=True)]
    table, methods = table.assign(kind=kinds), names(table)
    axis_names = [str(table[c].iloc[0]) for c in ("x_name", "y_name")]
    x_label, y_label = (
        column_named("dt").label if name == "dt" else f"{name} (multiple of the scenario's)" for name in axis_names
    )
    figure, axes = panels(len(methods), 4, (3.4, 3.6))
    for ax, name in zip(axes, methods, strict=True):
        _panel(ax, table[table["integrator"].astype(str) == name])
        place = ax.get_subplotspec()
        ax.set(xlabel=x_label, ylabel=y_label if place is None or place.is_first_col() else "")
    steps = [] if "dt" in axis_names or "dt" not in table else list(table["dt"].dropna().unique())
    titles(axes, [f"{name}, h = {steps[0]:g}" if len(steps) == 1 else name for name in methods])
    handles: list[Any] = [
        Patch(facecolor=CLASSES[k][1], edgecolor="#888888", label=CLASSES[k][0]) for k in sorted({*kinds})
    ]
    handles += [
        Patch(**HATCH, label=TEXT[0]), Line2D([], [], marker="o", color="k", markersize=3, linestyle="", label=TEXT[1])
    ]  # fmt: skip
    legend(figure, [], handles)
    return figure


def _panel(ax: Axes, table: DataFrame) -> None:
    """One integrator: colours, hatching where only plain Newton fails, dots where a branch folds."""
    table = table[table["x"].notna()]
    kinds = table.pivot_table("kind", "y", "x", fill_value=NOT_RUN)
    x, y = kinds.columns.to_numpy(), kinds.index.to_numpy()
    x_edges, y_edges = edges(x), edges(y)
    colours = ListedColormap([colour for _, colour in CLASSES])
    ax.pcolormesh(x_edges, y_edges, kinds, cmap=colours, vmin=-0.5, vmax=len(CLASSES) - 0.5, rasterized=True)
    only_plain = table[table["outcome"].eq("ok") & table["outcome_plain"].notna() & table["outcome_plain"].ne("ok")]
    i, j = np.searchsorted(x, only_plain["x"]), np.searchsorted(y, only_plain["y"])
    corners = [(x_edges[i + a], y_edges[j + b]) for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]
    ax.add_collection(PolyCollection(list(np.array(corners).transpose(2, 0, 1)), **HATCH, linewidth=0.0), autolim=False)
    folds = table[table["folds"].fillna(False).astype(bool)]
    # a white rim keeps the dot visible on the dark colours
    ax.plot(folds["x"], folds["y"], "o", color="black", markersize=2.2, markeredgecolor="white", markeredgewidth=0.3)
    for axis, values in (("x", x), ("y", y)):
        if len(values) > 2 and not np.allclose(np.diff(values), values[1] - values[0]):
            log_axis(ax, axis, values)
    ax.grid(False)
    ax.set(xlim=x_edges[[0, -1]], ylim=y_edges[[0, -1]])


CHARTS = (
    Chart("map", "How runs end in a plane of two parameters.", ("map",), map_figure, study="stability", picture=True),
)
