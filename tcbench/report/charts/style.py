"""What all charts share: the look of an integrator, axes, legends, and how a failure is drawn."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import wraps
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar, cast

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ...errors import TcbenchError
from . import theme

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pandas import DataFrame

# Okabe and Ito's colours without black and yellow, which vanish on a dark or a white page, for the paper's methods; for
# all others colours of Tol's muted scheme, which differ from these under every common kind of colour blindness.
BLUE, SKY, GREEN, ORANGE, RED = "#0072b2", "#56b4e9", "#009e73", "#e69f00", "#d55e00"
PURPLE, OLIVE, GREY, INDIGO, WINE, TEAL, ROSE = (
    "#cc79a7", "#8a7a1f", "#7f7f7f", "#332288", "#882255", "#44aa99", "#cc6677",
)  # fmt: skip
COLOURS = (PURPLE, OLIVE, GREY, INDIGO, WINE, TEAL, ROSE)
MARKERS = ("P", "X", "h", "<", ">", "p", "*", "d")  # told apart in print
DASHES = ("-", "--", "-.", (0, (1, 1)), (0, (5, 1, 1, 1, 1, 1)))
INK = "#222222"

STYLE: Any = {
    "font.family": ["DejaVu Sans"],
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.titley": 1.0,  # a place of its own: matplotlib would measure every label to find one
    "axes.labelsize": 9,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#c8c8c8",
    "grid.linewidth": 0.5,
    "grid.alpha": 0.6,
    "axes.axisbelow": True,
    "lines.linewidth": 1.4,
    "lines.markersize": 5,
    "legend.frameon": False,
    "legend.fontsize": 8,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "figure.dpi": 100,
    "text.parse_math": False,  # names come from plugins: a dollar sign is a dollar sign
    "svg.fonttype": "none",
    "svg.hashsalt": "tcbench",
    "path.simplify": True,
    "agg.path.chunksize": 20000,
}


class Look(NamedTuple):
    """How an integrator is drawn, everywhere."""

    colour: str
    marker: str
    dash: Any


KNOWN = {
    "tc_monolithic": Look(BLUE, "o", "-"),
    "tc_staggered": Look(SKY, "s", "--"),
    "tc_strang": Look(GREEN, "^", "-."),
    "midpoint_entropy": Look(ORANGE, "D", "-"),
    "midpoint_temperature": Look(RED, "v", "--"),
}


def look(name: str) -> Look:
    """The look of an integrator: its colour a function of its name alone, the same in every chart and every run.

    So is its marker, unless another method of the same chart has it.

    Variants, `base[parameter=value]`, keep the colour of their base.
    """
    name = str(name)
    if name in (drawn := theme.current().looks):
        return cast(Look, drawn[name])
    return _look(name)


def _look(name: str) -> Look:
    if name in KNOWN:
        return KNOWN[name]
    number = int.from_bytes(hashlib.sha256(name.encode("utf-8", "replace")).digest()[:8], "big")
    base, bracket, _ = name.partition("[")
    colour = _look(base).colour if bracket and base else COLOURS[number % len(COLOURS)]
    number //= len(COLOURS)
    return Look(colour, MARKERS[number % len(MARKERS)], DASHES[number // len(MARKERS) % len(DASHES)])


Chart = TypeVar("Chart", bound=Callable[..., Figure])


def chart(draw: Chart) -> Chart:
    """Draw with tcbench's style and the theme's, whatever the caller's matplotlib settings are; restores them."""

    @wraps(draw)
    def styled(*arguments: Any, **options: Any) -> Figure:
        chosen = theme.current()
        drawn = {n: None for a in arguments if hasattr(a, "columns") for n in names(a)}
        looks = theme.distinct(list(drawn), _look, (*(k.marker for k in KNOWN.values()), *MARKERS))
        settings: Any = theme.scaled(STYLE, chosen.scale) | dict(chosen.settings)
        with theme.using(replace(chosen, looks=looks)), matplotlib.rc_context(settings):
            figure: Any = draw(*arguments, **options)
            if isinstance(figure, Borrowed):
                return cast(Figure, figure.figure)
            if chosen.size is not None and isinstance(figure, Panels):
                figure.resize(*chosen.size)
            elif chosen.size is not None:
                figure.set_size_inches(*chosen.size)
            return cast(Figure, figure)

    return cast(Chart, styled)


def names(table: DataFrame, column: str = "integrator") -> list[str]:
    """The distinct names of a column: in the theme's order, or those with a fixed look first, then by alphabet."""
    known = [*theme.current().labels, *KNOWN]
    found = {str(n) for n in table[column].dropna().unique()} if column in table else set()
    return sorted(found, key=lambda n: (known.index(n) if n in known else len(known), n))


def short(name: str, length: int = 32) -> str:
    """A name that fits a legend: as the theme says it, printable, on one line."""
    name = theme.current().labels.get(str(name), name)
    text = " ".join("".join(c if c.isprintable() else " " for c in str(name)).split())
    return text if len(text) <= length else f"{text[: length - 1]}…"


class Panels(Figure):
    """A figure of equal panels with margins in inches.

    matplotlib's own layout engines measure every label twice, which doubles the time to draw; these charts know theirs.
    """

    def __init__(self, count: int, columns: int, size: tuple[float, float], left: float, right: float) -> None:
        self.columns = max(1, min(columns, count))
        self.rows = -(-count // self.columns)
        self.cell, self.left, self.right = size, left, right
        self.above, self.beside = 0.0, 0.0
        super().__init__(figsize=(size[0] * self.columns, size[1] * self.rows))
        self.grid = [self.add_axes((0, 0, 1, 1), label=str(i)) for i in range(count)]
        self.place()

    def place(self, above: float = 0.0, beside: float = 0.0, below: float = 0.0) -> None:
        """Put the panels in their places, with room above and beside them for a legend, below them for a caption."""
        self.above, self.beside, self.below = above, beside, below
        (width, height), bottom, top = self.cell, 0.48, 0.27
        whole = (width * self.columns + beside, height * self.rows + above + below)
        self.set_size_inches(*whole)
        for i, ax in enumerate(self.grid):
            row, column = divmod(i, self.columns)
            x, y = column * width + self.left, (self.rows - 1 - row) * height + bottom + below
            inner = (width - self.left - self.right, height - bottom - top)
            ax.set_position((x / whole[0], y / whole[1], inner[0] / whole[0], inner[1] / whole[1]))
            ax.xaxis.set_label_coords(0.5, -0.3 / inner[1])
            ax.yaxis.set_label_coords(-(self.left - 0.16) / inner[0], 0.5)

    def resize(self, width: float, height: float) -> None:
        """The whole figure in this size, in inches: panels take what legends leave."""
        cell = ((width - self.beside) / self.columns, (height - self.above - self.below) / self.rows)
        if cell[0] < self.left + self.right + 0.5 or cell[1] < 1.25:
            least = (
                self.columns * (self.left + self.right + 0.5) + self.beside, self.rows * 1.25 + self.above + self.below
            )  # fmt: skip
            raise TcbenchError(
                f"{width:g} x {height:g} inches are too few: this chart needs {least[0]:.1f} x {least[1]:.1f}."
            )
        self.cell = cell
        self.place(self.above, self.beside, self.below)


def panels(
    count: int, columns: int = 2, size: tuple[float, float] = (4.2, 2.9), left: float = 0.68, right: float = 0.2
) -> tuple[Panels, list[Axes]]:
    """A figure with `count` panels, row by row; size of each, and margins beside its axes, in inches."""
    given = theme.current().axes
    if given is not None:
        if count > 1:
            raise TcbenchError(
                f"This chart has {count} panels, and one Axes was given: choose one with y=, or give none."
            )
        return Borrowed(given), [given]  # type: ignore[return-value]
    figure = Panels(max(1, count), columns, size, left, right)
    return figure, figure.grid


class Borrowed:
    """The figure of an Axes that the caller made: nothing of its size and layout is changed."""

    def __init__(self, ax: Axes) -> None:
        self.ax, self.figure = ax, ax.figure

    def place(self, above: float = 0.0, beside: float = 0.0, below: float = 0.0) -> None:
        """Its places are the caller's."""


def ok(table: DataFrame) -> Any:
    """Which rows are of completed runs; all of them in a table without status."""
    return table["status"].eq("ok") if "status" in table else np.ones(len(table), dtype=bool)


def finite(values: Any) -> Any:
    """As floats, with everything that is not a finite number NaN."""
    import pandas as pd

    array = pd.to_numeric(pd.Series(values), errors="coerce").to_numpy(dtype=float)
    return np.where(np.isfinite(array), array, np.nan)


# -- legends and labels


def handle(name: str, **changes: Any) -> Line2D:
    style = look(name)
    settings: dict[str, Any] = {"color": style.colour, "marker": style.marker, "linestyle": style.dash}
    return Line2D([], [], label=short(name), **(settings | changes))


def legend(figure: Panels | Borrowed, methods: Sequence[str], extra: Iterable[Line2D] = (), above: float = 0.0) -> None:
    """One legend for the whole figure: above it for a few names, beside it for many.

    above : inches that the panels themselves need over their upper edge.
    """
    handles = [*(handle(name) for name in methods), *extra]
    if isinstance(figure, Borrowed):
        if handles:
            figure.ax.legend(handles=handles)
        return
    if not handles:
        figure.place(above)
        return
    width, height = figure.cell[0] * figure.columns, figure.cell[1] * figure.rows
    item = 0.55 + 0.072 * max(len(str(h.get_label())) for h in handles)
    columns = max(1, int((width - 0.1) / item))
    rows = -(-len(handles) // columns)
    if rows <= 4 and len(handles) <= 14:
        figure.place(above + 0.08 + 0.185 * rows)
        figure.legend(handles=handles, loc="upper left", bbox_to_anchor=(0.0, 1.0), ncols=columns, handlelength=2.6,
                      columnspacing=1.4, borderaxespad=0.3)  # fmt: skip
        return
    per_column = max(16, int((height + above - 0.2) / 0.148))
    columns = -(-len(handles) // per_column)
    lack = 0.148 * min(len(handles), per_column) + 0.2 - height
    figure.place(max(above, lack), columns * item * 0.86)
    figure.legend(handles=handles, loc="upper right", bbox_to_anchor=(1.0, 1.0), ncols=columns, fontsize=7,
                  handlelength=2.4, columnspacing=1.2, borderaxespad=0.3)  # fmt: skip


def end_labels(ax: Axes, ends: Sequence[tuple[float, float, str, str]]) -> None:
    """Name lines at their right ends, (x, y, text, colour), pushed apart where they would overlap."""
    points = [(ax.transData.transform((x, y)), text, colour) for x, y, text, colour in ends]
    points = sorted((p for p in points if np.all(np.isfinite(p[0]))), key=lambda p: p[0][1])
    to_axes = ax.transAxes.inverted()
    heights = [float(to_axes.transform(p[0])[1]) for p in points]
    placed = spread(heights, gap=0.075, low=0.02, high=0.98)
    for (_, text, colour), y in zip(points, placed, strict=True):
        ax.annotate(
            short(text), (1.015, y), xycoords="axes fraction", color=colour, fontsize=7.5 * theme.current().scale,
            va="center", ha="left", annotation_clip=False,
        )  # fmt: skip


def spread(positions: Sequence[float], gap: float, low: float, high: float) -> list[float]:
    """Ascending positions moved as little as needed to be `gap` apart between low and high."""
    if not positions:
        return []
    gap = min(gap, (high - low) / max(1, len(positions) - 1))
    placed = [min(max(p, low), high) for p in positions]
    for _ in range(50):
        moved = False
        for i in range(len(placed) - 1):
            overlap = gap - (placed[i + 1] - placed[i])
            if overlap > 1e-9:
                placed[i] -= overlap / 2
                placed[i + 1] += overlap / 2
                moved = True
        shift = max(0.0, low - placed[0])
        placed = [p + shift for p in placed]
        shift = max(0.0, placed[-1] - high)
        placed = [p - shift for p in placed]
        if not moved:
            break
    return placed


def note(ax: Axes, text: str) -> None:
    """A sentence in an empty panel."""
    ax.text(0.5, 0.5, text, transform=ax.transAxes, ha="center", va="center", fontsize=8, color=GREY, wrap=True)
    ax.set_xticks([])
    ax.set_yticks([])


def failed_tracks(ax: Axes, crosses: Mapping[str, Any], grow: bool = True) -> None:
    """Crosses of failed cells on tracks of their own, above whatever is drawn: the panel grows upwards for them.

    crosses : method -> where its failed cells stand on the horizontal axis. The limits of the panel must be set.
    grow : False where they stand at the right edge, beside what is drawn.
    """
    failing = [name for name, xs in crosses.items() if np.isfinite(np.asarray(xs, dtype=float)).any()]
    if not failing:
        return
    share = min(0.05 * len(failing), 0.3)
    scale = ax.yaxis.get_transform()
    low, high = scale.transform(np.array(ax.get_ylim(), dtype=float))
    if grow:
        ax.set_ylim(top=float(scale.inverted().transform(np.array([low + (high - low) / (0.97 - share)]))[0]))
    for rank, name in enumerate(failing):
        style = FAILED | {"color": look(name).colour, "clip_on": False, "zorder": 5}
        heights = np.full(len(crosses[name]), 0.985 - rank * share / len(failing))
        ax.plot(crosses[name], heights, transform=ax.get_xaxis_transform(), **style)


FAILED: Any = {"marker": "x", "linestyle": "none", "color": INK, "markersize": 5, "markeredgewidth": 1.4}


def failed_handle(text: str = "failed") -> Line2D:
    return Line2D([], [], label=text, **FAILED)


def titles(axes: Sequence[Axes], texts: Mapping[int, str] | Sequence[str]) -> None:
    pairs = texts.items() if isinstance(texts, Mapping) else enumerate(texts)
    for i, text in pairs:
        axes[i].set_title(short(text, 60), loc="left")
