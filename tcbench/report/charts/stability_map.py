"""The stability map: a table of `tcbench.studies.map` -> Figure. No computing, no saving, no pyplot state."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import BoundaryNorm, ListedColormap
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
HATCH = "//////"
HATCH_COLOUR = "#333333"
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
    methods = names(table)
    x_name, y_name = (str(table[c].iloc[0]) for c in ("x_name", "y_name"))
    figure, axes = panels(len(methods), 4, (3.4, 3.6))
    for ax, name in zip(axes, methods, strict=True):
        _panel(ax, table[table["integrator"].astype(str) == name])
        ax.set_xlabel(_label(x_name))
    for ax in axes:
        if (place := ax.get_subplotspec()) is None or place.is_first_col():
            ax.set_ylabel(_label(y_name))
    steps = [] if "dt" in (x_name, y_name) or "dt" not in table else list(table["dt"].dropna().unique())
    titles(axes, [f"{name}, h = {steps[0]:g}" if len(steps) == 1 else name for name in methods])
    used = {cell_class(o, e) for o, e in zip(table["outcome"], table["energy_error_max"], strict=True)}
    handles: list[Any] = [
        Patch(facecolor=colour, edgecolor="#888888", label=text)
        for k, (text, colour) in enumerate(CLASSES) if k in used
    ]  # fmt: skip
    handles.append(Patch(facecolor="white", edgecolor=HATCH_COLOUR, hatch=HATCH, label=TEXT[0]))
    handles.append(Line2D([], [], marker="o", color="black", markersize=3, linestyle="", label=TEXT[1]))
    legend(figure, [], handles)
    return figure


def _label(name: str) -> str:
    return column_named("dt").label if name == "dt" else f"{name} (multiple of the scenario's)"


def _box(x: np.ndarray, y: np.ndarray, i: int, j: int) -> list[tuple[float, float]]:
    return [(x[i], y[j]), (x[i + 1], y[j]), (x[i + 1], y[j + 1]), (x[i], y[j + 1])]


def _panel(ax: Axes, table: DataFrame) -> None:
    """One integrator: colours, hatching where only plain Newton fails, dots where a branch folds."""
    table = table[table["x"].notna()]
    x, y = np.unique(table["x"]), np.unique(table["y"])
    column, row = np.searchsorted(x, table["x"]), np.searchsorted(y, table["y"])
    kinds = np.full((len(y), len(x)), NOT_RUN)
    kinds[row, column] = [cell_class(o, e) for o, e in zip(table["outcome"], table["energy_error_max"], strict=True)]
    colours = ListedColormap([colour for _, colour in CLASSES])
    norm = BoundaryNorm(np.arange(len(CLASSES) + 1) - 0.5, len(CLASSES))
    x_edges, y_edges = edges(x), edges(y)
    ax.pcolormesh(x_edges, y_edges, kinds, cmap=colours, norm=norm, rasterized=True)
    only_plain = (table["outcome"] == "ok") & table["outcome_plain"].notna() & (table["outcome_plain"] != "ok")
    boxes = [_box(x_edges, y_edges, i, j) for i, j in zip(column[only_plain], row[only_plain], strict=True)]
    ax.add_collection(
        PolyCollection(boxes, facecolor="none", edgecolor=HATCH_COLOUR, hatch=HATCH, linewidth=0.0), autolim=False
    )
    folds = table[table["folds"].fillna(False).astype(bool)]
    # a white rim keeps the dot visible on the dark colours
    ax.plot(folds["x"], folds["y"], "o", color="black", markersize=2.2, markeredgecolor="white", markeredgewidth=0.3)
    for axis, values in (("x", x), ("y", y)):
        if len(values) > 2 and not np.allclose(np.diff(values), values[1] - values[0]):
            log_axis(ax, axis, values)
    ax.grid(False)
    ax.set_xlim(x_edges[0], x_edges[-1])
    ax.set_ylim(y_edges[0], y_edges[-1])


CHARTS = (
    Chart("map", "How runs end in a plane of two parameters.", ("map",), map_figure, study="stability", picture=True),
)
