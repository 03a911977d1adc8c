"""Where things stand on a figure: panels, legends, names at lines, and how a failure is drawn."""

from __future__ import annotations

import io
import math
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke

from ...errors import TcbenchError
from .style import GREY, OTHER, ink, look, short
from .theme import current, scale

LETTER = 0.064  # inches of a letter of a title or a legend, at type of 9 points
LEAST = (0.85, 0.5)  # inches of a panel that can still be read, at type of 9 points


class TooSmall(TcbenchError):
    """A size in which the panels cannot be read."""


class Panels(Figure):
    """A figure of equal panels with margins in inches, all of them larger where the type is.

    matplotlib's own layout engines measure every label twice, which doubles the time to draw; these charts know theirs.
    """

    def __init__(self, count: int, columns: int, cell: tuple[float, float], left: float, right: float) -> None:
        k, self.fixed = scale(), current().size
        self.cell, self.left, self.right = (cell[0] * k, cell[1] * k), left * k, right * k
        self.columns = max(1, min(columns, count))
        if self.fixed:
            self.columns = _columns(count, self.fixed[0] / self.fixed[1] * self.cell[1] / self.cell[0])
        self.rows = -(-count // self.columns)
        self.above, self.beside, self.below = 0.0, 0.0, 0.0
        super().__init__()
        self.grid = [self.add_axes((0, 0, 1, 1), label=str(i)) for i in range(count)]
        self.place()

    def _repr_png_(self) -> bytes:
        """For a notebook, without pyplot."""
        self.savefig(page := io.BytesIO(), format="png")
        return page.getvalue()

    @property
    def width(self) -> float:
        return self.fixed[0] if self.fixed else self.cell[0] * self.columns

    @property
    def height(self) -> float:
        return self.fixed[1] if self.fixed else self.cell[1] * self.rows

    def place(self, above: float = 0.0, beside: float = 0.0, below: float = 0.0) -> None:
        """Put the panels in their places, with room above and beside them for a legend, below them for a caption.

        A figure of a size that was asked for keeps it; others grow by that room.
        """
        self.above, self.beside, self.below = above, beside, below
        k = scale()
        whole = self.fixed or (self.width + beside, self.height + above + below)
        width, height = (whole[0] - beside) / self.columns, (whole[1] - above - below) / self.rows
        lines = max(_wrapped(ax, int((width - self.left - 0.06 * k) / (LETTER * k))) for ax in self.grid)
        bottom, top = 0.48 * k, (0.12 + 0.15 * lines) * k
        inner = (width - self.left - self.right, height - bottom - top)
        lack = [max(0.0, least * k - room) for least, room in zip(LEAST, inner, strict=True)]
        if any(lack):
            needed = whole[0] + lack[0] * self.columns, whole[1] + lack[1] * self.rows
            raise TooSmall(
                f"{whole[0]:.3g} x {whole[1]:.3g} inches are too few: this chart needs "
                f"{math.ceil(10 * needed[0]) / 10} x {math.ceil(10 * needed[1]) / 10}, or smaller type."
            )
        self.set_size_inches(*whole)
        for i, ax in enumerate(self.grid):
            row, column = divmod(i, self.columns)
            x, y = column * width + self.left, (self.rows - 1 - row) * height + bottom + below
            ax.set_position((x / whole[0], y / whole[1], inner[0] / whole[0], inner[1] / whole[1]))
            ax.xaxis.set_label_coords(0.5, -0.3 * k / inner[1])
            ax.yaxis.set_label_coords(-(self.left - 0.16 * k) / inner[0], 0.5)
            shrunk = (inner[1] + bottom) / (LETTER * k * max(1, len(ax.get_ylabel())))  # a name longer than its axis
            if shrunk < 1:
                ax.yaxis.label.set_fontsize(pt(9) * max(0.7, shrunk))

    def key(self, handles: Sequence[Any], above: float) -> None:
        """One legend for the whole figure: above it for a few names, beside it for many."""
        k = scale()
        widths = [(0.62 + LETTER * len(str(h.get_label()))) * k for h in handles]
        item, columns = (0.55 + 0.072 * max(len(str(h.get_label())) for h in handles)) * k, len(handles)
        while columns > 1 and sum(max(part) for part in np.array_split(widths, columns)) > self.width - 0.1:
            columns -= 1  # matplotlib makes each column as wide as its widest name, and no column wider
        rows = -(-len(handles) // columns)
        per_column = max(1 if self.fixed else 16, int((self.height + above - 0.2) / (0.148 * k)))
        aside = -(-len(handles) // per_column)
        few = rows <= 4 and len(handles) <= 14
        if self.fixed:  # where it leaves more to the panels
            leaves = self.width * (self.height - 0.185 * rows * k), (self.width - aside * item * 0.86) * self.height
            few = leaves[0] >= leaves[1]
        if few:
            self.place(above + (0.08 + 0.185 * rows) * k)
            self.legend(handles=handles, loc="upper left", bbox_to_anchor=(0.0, 1.0), ncols=columns, handlelength=2.6,
                        columnspacing=1.4, borderaxespad=0.3)  # fmt: skip
            return
        lack = (0.148 * min(len(handles), per_column) + 0.2) * k - self.height
        self.place(max(above, lack), aside * item * 0.86)
        self.legend(handles=handles, loc="upper right", bbox_to_anchor=(1.0, 1.0), ncols=aside, fontsize=pt(7),
                    handlelength=2.4, columnspacing=1.2, borderaxespad=0.3)  # fmt: skip

    def bar(self, mappable: Any, text: str) -> None:
        """A scale of colours beside all panels."""
        k = scale()
        room = 0.4 + 0.6 * k  # what stands between its parts does not shrink with the type
        self.place(self.above, room, self.below)
        whole = self.get_size_inches()[0]
        self.colorbar(mappable, cax=self.add_axes((1 - (room - 0.15) / whole, 0.16, 0.13 / whole, 0.68)), label=text)


def _wrapped(ax: Axes, letters: int) -> int:
    """Break the title of a panel where it is wider than its room; how many lines it has."""
    text = ax.get_title(loc="left").replace("\n", " ")
    if not text:
        return 0
    parts = [text] if len(text) <= letters else text.replace(": ", ":\n").split("\n")  # a formula stays in one piece
    fold = partial(textwrap.wrap, width=max(letters, 8), break_long_words=False, break_on_hyphens=False)
    lines = [line for part in parts for line in fold(part)]
    ax.set_title("\n".join(lines), loc="left")
    return len(lines)


def _columns(count: int, shape: float) -> int:
    """How many columns leave the panels nearest to their own shape, and few places empty."""
    rows = {n: -(-count // n) for n in range(1, count + 1)}
    return min(rows, key=lambda n: abs(math.log(shape * rows[n] / n)) + math.log(n * rows[n] / count))


class Borrowed:
    """The figure of an Axes that the caller made: nothing of its size and layout is changed."""

    columns = 1

    def __init__(self, ax: Axes) -> None:
        self.ax, self.figure = ax, ax.figure

    def place(self, above: float = 0.0, beside: float = 0.0, below: float = 0.0) -> None:
        """Its places are the caller's."""

    def key(self, handles: Sequence[Any], above: float) -> None:
        self.ax.legend(handles=handles)

    def bar(self, mappable: Any, text: str) -> None:
        self.figure.colorbar(mappable, ax=self.ax, label=text)


Drawing = Panels | Borrowed


def panels(
    count: int, columns: int = 2, size: tuple[float, float] = (4.2, 2.9), left: float = 0.68, right: float = 0.2
) -> tuple[Drawing, list[Axes]]:
    """A figure with `count` panels, row by row; size of each, and margins beside its axes, in inches at 9 points.

    In the Axes of the caller where one was given.
    """
    given = current().axes
    if given is not None:
        if count > 1:
            raise TcbenchError(
                f"This chart has {count} panels, and one Axes was given: choose one with y=, or give none."
            )
        return Borrowed(given), [given]
    figure = Panels(max(1, count), columns, size, left, right)
    return figure, figure.grid


def pt(size: float) -> float:
    """Of type, lines and markers: `size` points where the chart's type is 9."""
    return size * scale()


# -- legends and labels


def handle(name: str, **changes: Any) -> Line2D:
    style = look(name)
    settings: dict[str, Any] = {"color": style.colour, "marker": style.marker, "linestyle": style.dash}
    return Line2D([], [], label=short(name), **(settings | changes))


def legend(figure: Drawing, methods: Sequence[str], extra: Iterable[Any] = (), above: float = 0.0) -> None:
    """One legend for the whole figure: the methods in colour, then one word for all others.

    above : inches that the panels themselves need over their upper edge.
    """
    rest = current().rest.intersection(methods)
    others = [Line2D([], [], color=OTHER.colour, label=f"{len(rest)} others")] if rest else []
    handles = [*(handle(name) for name in methods if name not in rest), *others, *extra]
    if handles:
        figure.key(handles, above)
    else:
        figure.place(above)


def end_labels(ax: Axes, ends: Sequence[tuple[float, float, str, str]]) -> None:
    """Name lines in the margin right of them, (x, y, text, colour), pushed apart where they would overlap."""
    found = [(ax.transData.transform((x, y)), text, colour) for x, y, text, colour in ends]
    found = sorted((p for p in found if np.all(np.isfinite(p[0]))), key=lambda p: p[0][1])
    to_axes = ax.transAxes.inverted()
    heights = [float(to_axes.transform(p[0])[1]) for p in found]
    gap = 1.3 * _pixels(ax, 7.5) / ax.get_window_extent().height
    for (_, text, colour), y in zip(found, spread(heights, gap, low=0.02, high=0.98), strict=True):
        ax.annotate(
            short(text), (1.015, y), xycoords="axes fraction", color=colour, fontsize=pt(7.5), va="center",
            ha="left", annotation_clip=False,
        )  # fmt: skip


def line_labels(ax: Axes, ends: Sequence[tuple[float, float, str, str]]) -> None:
    """Texts at the very ends of their lines, (x, y, text, colour), moved up where they overlap or leave the axes."""
    foot = ax.get_window_extent().y0
    tall, wide = 1.15 * _pixels(ax, 7.5), 0.65 * _pixels(ax, 7.5) * max([len(end[2]) for end in ends], default=0)
    placed: list[Any] = []
    found = [(ax.transData.transform((x, y)), text, colour) for x, y, text, colour in ends]
    for at, text, colour in sorted((p for p in found if np.all(np.isfinite(p[0]))), key=lambda p: p[0][1]):
        at = np.array([at[0], max(at[1], foot + tall / 2)])
        while any(abs(other[0] - at[0]) < wide and abs(other[1] - at[1]) < 0.99 * tall for other in placed):
            at = at + (0.0, tall / 4)
        placed.append(at)
        ax.annotate(
            short(text), tuple(ax.transData.inverted().transform(at)), xytext=(4, 0), textcoords="offset points",
            va="center", ha="left", color=colour, fontsize=pt(7.5), annotation_clip=False, **halo(ax),
        )  # fmt: skip


def halo(ax: Axes) -> dict[str, Any]:
    """Text that stands on lines can be read."""
    return {"zorder": 6, "path_effects": [withStroke(linewidth=pt(2), foreground=ax.get_facecolor())]}


def _pixels(ax: Axes, size: float) -> float:
    """Height of type of that size."""
    return pt(size) / 72 * float(ax.figure.dpi)


def spread(positions: Sequence[float], gap: float, low: float, high: float) -> list[float]:
    """Ascending positions moved as little as needed (least squares) to be `gap` apart between low and high."""
    from scipy.optimize import isotonic_regression

    if not len(positions):
        return []
    places = np.arange(len(positions)) * min(gap, (high - low) / max(1, len(positions) - 1))
    moved = isotonic_regression(np.asarray(positions) - places).x  # what is left of them need only ascend
    found: list[float] = (np.clip(moved, low, high - places[-1]) + places).tolist()
    return found


def note(ax: Axes, text: str) -> None:
    """A sentence in an empty panel."""
    ax.text(0.5, 0.5, text, transform=ax.transAxes, ha="center", va="center", fontsize=pt(8), color=GREY, wrap=True)
    ax.set_xticks([])
    ax.set_yticks([])


def failed_tracks(ax: Axes, crosses: Mapping[str, Any], grow: bool = True) -> None:
    """Crosses of failed cells on tracks of their own, above whatever is drawn: the panel grows upwards for them.

    crosses : method -> where its failed cells stand on the horizontal axis. The limits of the panel must be set.
    grow : False where they stand at the right edge, beside what is drawn.
    """
    rest = [np.asarray(crosses[name], dtype=float) for name in crosses if name in current().rest]
    crosses = {name: xs for name, xs in crosses.items() if name not in current().rest}
    if rest:
        crosses |= {next(iter(current().rest)): np.concatenate(rest)}  # one track, and one look, for all of them
    failing = [name for name, xs in crosses.items() if np.isfinite(np.asarray(xs, dtype=float)).any()]
    if not failing:
        return
    share = min(0.05 * len(failing), 0.3)
    scale = ax.yaxis.get_transform()
    low, high = scale.transform(np.array(ax.get_ylim(), dtype=float))
    if grow:
        ax.set_ylim(top=float(scale.inverted().transform(np.array([low + (high - low) / (0.97 - share)]))[0]))
    for rank, name in enumerate(failing):
        style = _failed() | {"color": look(name).colour, "clip_on": False, "zorder": 5}
        heights = np.full(len(crosses[name]), 0.985 - rank * share / len(failing))
        ax.plot(crosses[name], heights, transform=ax.get_xaxis_transform(), **style)


def _failed() -> dict[str, Any]:
    return {"marker": "x", "linestyle": "none", "markersize": pt(5), "markeredgewidth": pt(1.4)}


def failed_handle(text: str = "failed") -> Line2D:
    return Line2D([], [], label=text, color=ink(), **_failed())


def titles(axes: Sequence[Axes], texts: Sequence[str]) -> None:
    for ax, text in ((ax, text) for ax, text in zip(axes, texts, strict=False) if text):
        ax.set_title(short(text, 60), loc="left")
