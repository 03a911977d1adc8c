"""Where things stand on a figure: panels, legends, names at lines, and how a failure is drawn."""

from __future__ import annotations

import io
import math
import textwrap
import warnings
from collections.abc import Iterable, Mapping, Sequence
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
SMALLEST = (0.85, 0.5)  # inches of a panel that can still be read, at type of 9 points
ROWS = 4  # of a legend above the panels; a longer one stands beside them
NAME = 7.5  # points of a name at a line


class TooSmall(TcbenchError):
    """A size in which the panels cannot be read."""


class Panels(Figure):
    """A figure that a notebook shows without pyplot."""

    def _repr_png_(self) -> bytes:
        self.savefig(page := io.BytesIO(), format="png")
        return page.getvalue()


def panels(count: int, most: int = 2, size: tuple[float, float] = (4.2, 2.9)) -> tuple[Figure, list[Axes]]:
    """A figure with `count` panels, row by row, at most so many in one, and their axes.

    size : of each in inches, at type of 9 points. In the Axes of the caller where one was given.
    """
    chosen, k, count = current(), scale(), max(1, count)
    if chosen.axes is not None:
        if count > 1:
            raise TcbenchError(
                f"This chart has {count} panels, and one Axes was given: choose one with y=, or give none."
            )
        return chosen.axes.figure, [chosen.axes]
    wide = min(most, count)
    if chosen.size:  # what leaves the panels nearest to their own shape, and few places empty
        shape = chosen.size[0] / chosen.size[1] * size[1] / size[0]
        rows_of = {n: -(-count // n) for n in range(1, count + 1)}
        wide = min(rows_of, key=lambda n: abs(math.log(shape * rows_of[n] / n)) + math.log(n * rows_of[n] / count))
    rows = -(-count // wide)
    figure = Panels(figsize=chosen.size or (wide * size[0] * k, rows * size[1] * k), layout="constrained")
    axes = figure.subplots(rows, wide, squeeze=False).ravel().tolist()
    for ax in axes[count:]:
        ax.remove()
    return figure, axes[:count]


def columns(ax: Axes) -> int:
    """How many columns of panels its figure has."""
    place = ax.get_subplotspec()
    return int(place.get_gridspec().ncols) if place else 1


def settle(figure: Figure) -> bool:
    """Put the panels in their places, which names at lines ask for; whether there is room."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        if (engine := figure.get_layout_engine()) is not None:
            engine.execute(figure)
    return not caught


def check_room(figure: Figure) -> None:
    """TooSmall where the panels cannot be read in the size that was asked for."""
    smallest, fits = np.array(SMALLEST) * scale() * figure.dpi, settle(figure)
    if not fits or any(np.any(ax.get_window_extent().size < smallest) for ax in figure.axes if ax.get_subplotspec()):
        size = " x ".join(f"{length:.3g}" for length in figure.get_size_inches())
        raise TooSmall(f"{size} inches are too few for the panels of this chart: ask for more, or smaller type.")


def pt(size: float) -> float:
    """Of type, lines and markers: `size` points where the chart's type is 9."""
    return size * scale()


def handle(name: str, **changes: Any) -> Line2D:
    """The entry of a method in a legend."""
    style = look(name)
    settings: dict[str, Any] = {"color": style.colour, "marker": style.marker, "linestyle": style.dash}
    return Line2D([], [], label=short(name), **(settings | changes))


def legend(figure: Figure, methods: Sequence[str], extra: Iterable[Any] = ()) -> None:
    """One legend for the whole figure: the methods in colour, then one word for all others. Above the panels for a few
    names, beside them for many; a figure whose size nobody asked for grows by it."""
    rest = current().rest.intersection(methods)
    others = [Line2D([], [], color=OTHER.colour, label=f"{len(rest)} others")] if rest else []
    handles = [*(handle(name) for name in methods if name not in rest), *others, *extra]
    if not handles:
        return
    if current().axes is not None:
        current().axes.legend(handles=handles)
        return
    k, (width, height) = scale(), figure.get_size_inches()
    widths = [(0.62 + LETTER * len(str(h.get_label()))) * k for h in handles]
    columns = len(handles)
    while columns > 1 and sum(max(part) for part in np.array_split(widths, columns)) > width - 0.1:
        columns -= 1
    settings: dict[str, Any] = {"handlelength": 2.6, "columnspacing": 1.4, "loc": "outside upper left"}
    if (rows := -(-len(handles) // columns)) <= ROWS:
        grown = (width, height + (0.08 + 0.185 * rows) * k)
    else:
        columns = -(-len(handles) // max(1, int(max(height, 3) / (0.148 * k))))
        settings |= {"loc": "outside right upper", "fontsize": pt(7)}
        grown = (width + columns * max(widths), max(height, 3))
    if not current().size:
        figure.set_size_inches(grown)
    figure.legend(handles=handles, ncols=columns, borderaxespad=0.3, **settings)


def name_lines(ax: Axes, ends: Sequence[Any], beside: bool = False) -> None:
    """Texts at the ends of lines, (x, y, text, colour), pushed apart where they would overlap.

    beside : in the margin right of the axes. Else at the very ends, and moved up to stay inside of the axes.
    """
    box, tall = ax.get_window_extent(), pt(NAME) / 72 * float(ax.figure.dpi)
    labels = [(ax.transData.transform(end[:2]), *end[2:4]) for end in ends]
    labels = sorted((one for one in labels if np.isfinite(one[0]).all()), key=lambda one: one[0][1])
    places, wide = [one[0] for one in labels], 0.65 * tall * max((len(one[1]) for one in labels), default=0)
    if beside:
        low, high = box.y0 + 0.02 * box.height, box.y0 + 0.98 * box.height
        heights = spread([y for _, y in places], 1.3 * tall, low, high)
        places = [(box.x1 + 0.015 * box.width, y) for y in heights]
    else:
        for k, (x, y) in enumerate(places):
            y = max(y, box.y0 + 0.6 * tall)
            while any(abs(px - x) < wide and abs(py - y) < 1.14 * tall for px, py in places[:k]):
                y += 0.3 * tall
            places[k] = (x, y)
    settings = {"xytext": (0 if beside else 4, 0), "textcoords": "offset points", **({} if beside else halo(ax))}
    for (_, text, colour), place in zip(labels, places, strict=True):
        ax.annotate(
            short(text), tuple(ax.transAxes.inverted().transform(place)), xycoords="axes fraction", color=colour,
            fontsize=pt(NAME), va="center", ha="left", annotation_clip=False, **settings,
        )  # fmt: skip


def halo(ax: Axes) -> dict[str, Any]:
    """Text that stands on lines can be read."""
    return {"zorder": 6, "path_effects": [withStroke(linewidth=pt(2), foreground=ax.get_facecolor())]}


def spread(positions: Sequence[float], gap: float, low: float, high: float) -> list[float]:
    """Ascending positions moved as little as needed (least squares) to be `gap` apart between low and high."""
    from scipy.optimize import isotonic_regression

    if not len(positions):
        return []
    places = np.arange(len(positions)) * min(gap, (high - low) / max(1, len(positions) - 1))
    moved = isotonic_regression(np.asarray(positions) - places).x  # what is left of them need only ascend
    result: list[float] = (np.clip(moved, low, high - places[-1]) + places).tolist()
    return result


def note(ax: Axes, text: str) -> None:
    """A sentence in an empty panel."""
    ax.text(0.5, 0.5, text, transform=ax.transAxes, ha="center", va="center", fontsize=pt(8), color=GREY, wrap=True)
    ax.set_xticks([])
    ax.set_yticks([])


def failed_tracks(ax: Axes, crosses: Mapping[str, Any], grow: bool = True) -> None:
    """Crosses of failed cells on tracks of their own, above whatever is drawn: the panel grows upwards for them.

    crosses : method -> where its failed cells stand on the horizontal axis; those in grey share a track. The limits of
    the panel must be set. grow : False where they stand at the right edge, beside what is drawn.
    """
    rest = [name for name in crosses if name in current().rest]
    tracks = {name: xs for name, xs in crosses.items() if name not in rest}
    if rest:
        tracks[rest[0]] = np.concatenate([crosses[name] for name in rest])
    tracks = {name: xs for name, xs in tracks.items() if np.isfinite(xs).any()}
    if not tracks:
        return
    share = min(0.05 * len(tracks), 0.3)
    scale = ax.yaxis.get_transform()
    low, high = scale.transform(np.array(ax.get_ylim(), dtype=float))
    if grow:
        ax.set_ylim(top=float(scale.inverted().transform(np.array([low + (high - low) / (0.97 - share)]))[0]))
    for rank, (name, xs) in enumerate(tracks.items()):
        style = failed_mark() | {"color": look(name).colour, "clip_on": False, "zorder": 5}
        heights = np.full(len(xs), 0.985 - rank * share / len(tracks))
        ax.plot(xs, heights, transform=ax.get_xaxis_transform(), **style)


def failed_mark() -> dict[str, Any]:
    return {"marker": "x", "linestyle": "none", "markersize": pt(5), "markeredgewidth": pt(1.4), "color": ink()}


def titles(axes: Sequence[Axes], texts: Sequence[str]) -> None:
    for ax, text in zip(axes, texts, strict=False):
        if text:
            ax.set_title(folded(short(text, 60), ax.get_window_extent().width / ax.figure.dpi), loc="left")


def folded(text: str, inches: float) -> str:
    """Text in lines of this length, at type of 9 points; behind a colon first, for a formula stays in one piece."""
    letters = max(8, int(inches / (LETTER * scale())))
    parts = [text] if len(text) <= letters else text.replace(": ", ":\n").split("\n")
    return "\n".join(
        line for part in parts for line in textwrap.wrap(part, letters, break_long_words=False, break_on_hyphens=False)
    )
