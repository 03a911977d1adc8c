"""Panels of data as a picture: what `chart.Panel` says, drawn with matplotlib. `templates/chart.js` draws the same."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial, wraps
from typing import TYPE_CHECKING, Any, ParamSpec

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.lines import Line2D
from matplotlib.textpath import TextPath
from matplotlib.ticker import FuncFormatter
from matplotlib.transforms import Affine2D

from ...chart import Panel, Series, Sheet, sheet_of
from ..highlight import front
from ..marks import MARKS
from . import layout, theme
from .layout import pt
from .scales import ROUND_OFF, log_axis, round_off_band, zero_log_axis
from .style import GREY, finite, ink, look, looks, names, short

if TYPE_CHECKING:
    from pandas import DataFrame

BAND = 0.13  # opacity of a band
MOST_TEXTS = 12  # numbers at the ends of lines; of more, none can be read
LONGEST = 26  # letters of the name of a row
FEW = 3  # lines, of whose magnitudes the largest so far and the values can be told apart
FREE = 40  # points, each of which has its mark
CLOUD = 500  # points of a panel that are not joined, of which each is small


Arguments = ParamSpec("Arguments")


def chart(draw: Callable[Arguments, Any], crowded: bool = True) -> Callable[Arguments, Figure]:
    """Draw panels, or a figure, with tcbench's style and the theme's over the caller's matplotlib settings.

    Of many methods those that lead are in colour, the rest is grey: `report.highlight`; where not crowded, all of them.
    """

    @wraps(draw)
    def styled(*arguments: Arguments.args, **options: Arguments.kwargs) -> Figure:
        chosen = theme.current()
        tables = [a for a in arguments if hasattr(a, "columns")]
        methods = list(dict.fromkeys(name for table in tables for name in names(table)))
        rest = _rest(tables, methods) if crowded and not chosen.labels else frozenset()
        with (
            theme.using(replace(chosen, looks=looks(methods, chosen.looks), rest=rest)),
            matplotlib.rc_context(theme.rc(chosen.settings)),
        ):
            figure = draw(*arguments, **options)
            figure = figure if isinstance(figure, Figure) else render(sheet_of(figure))
            if chosen.size:
                layout.check_room(figure)
        return figure

    return styled


chart_of_rows = partial(chart, crowded=False)  # of one in which every method has a row or a panel of its own


def _rest(tables: Sequence[DataFrame], methods: Sequence[str]) -> frozenset[str]:
    """The methods that are drawn in grey: those that do not lead on the chart's scenario, or on most of several."""
    fore = theme.current().fore
    scenarios = {str(s) for table in tables if "scenario" in table for s in table["scenario"].dropna().unique()}
    front = fore.get(scenarios.pop() if len(scenarios) == 1 else "", methods)
    return frozenset(methods).difference(front) if set(front) & set(methods) else frozenset()


def render(sheet: Sheet) -> Figure:
    """The panels of a sheet, with one legend for all of them or names at the ends of their lines."""
    shown = [*map(with_note, sheet.panels or [Panel((), "", "")])]
    figure, axes = layout.panels(len(shown), sheet.columns, _size(sheet))
    ends = []
    for ax, panel in zip(axes, shown, strict=True):
        rest = theme.current().rest if panel.rank is None else frozenset(panel.rank).difference(leading(panel))
        with theme.using(replace(theme.current(), rest=rest)):
            ends.append(_draw(ax, panel))
        below = shown[len(ends) - 1 + layout.columns(ax) :][:1]
        if not below or below[0].x != panel.x:  # said once a column
            ax.set_xlabel(panel.x)
        ax.set_ylabel(layout.folded(panel.y, ax.get_window_extent().height / figure.dpi))
    layout.titles(axes, [panel.title for panel in shown])
    _legend(figure, sheet, shown)
    layout.settle(figure)
    for ax, of in zip(axes, ends, strict=True):
        asked = of if sheet.named else [end for end in of if end[4]]
        if sheet.named or len(asked) <= MOST_TEXTS:
            layout.name_lines(ax, asked, beside=sheet.named)
    return figure


def _legend(figure: Figure, sheet: Sheet, shown: Sequence[Panel]) -> None:
    every = [one for panel in shown for one in panel.series]
    keys = {mark: text for panel in shown for mark, text in panel.keys.items()}
    extra = [Line2D([], [], label=text, linestyle="none", **_mark(m, ink())) for m, text in keys.items()]
    if keys or sheet.named:
        layout.legend(figure, [], extra)
        return
    if any(one.marks == "hollow" for one in every):
        hollow: Any = {"marker": "o", "linestyle": "none", "color": ink(), "markerfacecolor": "none"}
        extra.append(Line2D([], [], label=sheet.hollow, **hollow))
    if any(len(one.crosses) for one in every):
        extra.append(Line2D([], [], label="failed", **layout.failed_mark()))
    layout.legend(figure, list(dict.fromkeys(one.name for one in every if not one.plain)), extra)


def with_note(panel: Panel) -> Panel:
    """The panel; one without a point, a failed run, a row or a sentence says so, instead of being blank."""

    def shown(values: Any, scale: str) -> Any:
        return finite(values) > (0 if scale == "log" else -math.inf)

    def drawn(one: Series) -> bool:
        return bool(len(one.crosses) or (shown(one.x, panel.x_scale) & shown(one.y, panel.y_scale)).any())

    if panel.note or panel.rows or any(map(drawn, panel.series)):
        return panel
    return replace(panel, note="no number to draw")


def _size(sheet: Sheet) -> tuple[float, float]:
    """The size of a panel, in inches: of rows as their names and number ask for."""
    rows = [panel.rows for panel in sheet.panels]
    if not any(rows):
        return sheet.size
    names = 0.25 + 0.062 * max((len(short(one.name, LONGEST)) for of in rows for one in of), default=0)
    return sheet.size[0] + names, max(sheet.size[1], 0.19 * max(map(len, rows)) + 0.75)


def leading(panel: Panel) -> list[str]:
    """Of the methods of a panel with a rank of its own those in colour: all that were asked for, else the first."""
    rank, families = dict(panel.rank or {}), theme.current().families
    return [*rank] if theme.current().labels else front({name: families.get(name, "") for name in rank}, rank)


def _draw(ax: Axes, panel: Panel) -> list[tuple[float, float, str, str, bool]]:
    """Draw a panel; the end of each line in colour: x, y, what to write there, its colour, whether its author asks."""
    if panel.note:
        layout.note(ax, panel.note)
        return []
    if panel.rows:
        _rows(ax, panel)
        return []
    for which, scale in (("x", panel.x_scale), ("y", panel.y_scale)):
        _axis(ax, which, scale, span(panel, which))
    if panel.errors and panel.y_scale == "log":
        round_off_band(ax)
    if panel.y_scale == "linear" and panel.y_values is not None:
        low, high = span(panel, "y").min(), span(panel, "y").max()
        ax.set_ylim(low - 0.04 * (high - low or 1), high + 0.04 * (high - low or 1))
    crosses = {one.name: finite(one.crosses) for one in panel.series if len(one.crosses)}
    places = {name: np.where(np.isfinite(at), at, ax.get_xlim()[1]) for name, at in crosses.items()}
    layout.failed_tracks(ax, places, grow=any(np.isfinite(at).any() for at in crosses.values()))
    rest, ends = theme.current().rest, []
    for place, one in enumerate(sorted(panel.series, key=lambda one: one.name not in rest)):
        x, y = finite(one.x), finite(one.y)
        keep = np.isfinite(x) & np.isfinite(y)
        colour = _line(ax, one, x[keep], y[keep], panel, keep, place)
        if keep.any() and (one.text or (one.line and one.name not in rest)):
            ends.append((float(x[keep][-1]), float(y[keep][-1]), one.text or one.name, colour, bool(one.text)))
    ax.autoscale_view()  # where nothing has set the limits texts would stand as in others
    return ends


def span(panel: Panel, which: str) -> Any:
    """The numbers that an axis of a panel reaches over."""
    values = panel.x_values if which == "x" else panel.y_values
    if values is not None:
        return finite(values)
    parts: list[Any] = [getattr(one, which) for one in panel.series]
    for row in panel.rows:
        parts += [*row.marks.values(), row.bar or (), [row.dotted]]
    return np.concatenate([finite(part) for part in parts]) if parts else np.array([])


def _axis(ax: Axes, which: str, scale: str, values: Any) -> None:
    if scale == "log":
        log_axis(ax, which, values)
    elif scale == "zero":
        zero_log_axis(ax, values)
    elif scale == "share":
        ax.set_ylim(-0.02, 1.02)
        ax.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{100 * y:.0f} %"))


def _rows(ax: Axes, panel: Panel) -> None:
    """Methods below each other, each with a bar and marks on it."""
    log_axis(ax, "x", span(panel, "x"))
    if panel.errors:
        ax.set_xlim(left=ROUND_OFF / 5)
        round_off_band(ax, "x")
    names, low, paper = [one.name for one in panel.rows], ax.get_xlim()[0], matplotlib.rcParams["axes.facecolor"]
    for y, one in enumerate(reversed(panel.rows)):
        colour, end = look(one.name).colour, low
        if one.bar is not None:
            start, end = (low if math.isnan(x) else x for x in one.bar)
            ax.plot([start, end], [y, y], color=colour, linewidth=pt(3), alpha=0.35, solid_capstyle="butt")
            ax.plot([end, one.dotted], [y, y], color=colour, linestyle=":", linewidth=pt(1.6))
        marks = {mark: at[np.isfinite(at)] for mark, places in one.marks.items() for at in [finite(places)]}
        for mark, at in marks.items():
            drawn = _mark(mark, colour) | ({"markerfacecolor": paper} if one.hollow else {})
            ax.plot(at, np.full(len(at), y), linestyle="none", clip_on=False, **drawn)
        nothing = one.bar is None and bool(marks) and not any(map(len, marks.values()))
        behind: Any = {"xytext": (6, 0), "textcoords": "offset points", "va": "center"}
        ax.annotate(one.text or ("no answer" if nothing else ""), (end, y), fontsize=pt(7), color=colour, **behind)
    ax.set_ylim(-0.7, len(names) - 0.3)
    ax.set_yticks(range(len(names)), [short(name, LONGEST) for name in reversed(names)], fontsize=pt(7))
    ax.grid(axis="y", visible=False)


def _mark(mark: str, colour: str) -> dict[str, Any]:
    """How a mark of a row is drawn; a letter is one in the middle of its place."""
    thin, letter = mark in ("|", "_"), mark in MARKS and mark != "x"
    shape: Any = {".": "o", "_": "|"}.get(mark, mark)
    if letter:
        path = TextPath((0, 0), mark, size=10, prop=FontProperties(weight="bold"))
        box = path.get_extents()
        shape = path.transformed(Affine2D().translate(-(box.x0 + box.x1) / 2, -(box.y0 + box.y1) / 2))
    edge = 1.4 if thin or mark == "x" else 0.2 if letter else 0.9
    size = {".": 3.5, "|": 11, "_": 8}.get(mark, 6 if letter else 5)
    return {
        "marker": shape, "color": GREY if mark == "_" else colour,
        "markersize": pt(size), "markeredgewidth": pt(edge), "zorder": 3 if thin else 4,
    }  # fmt: skip


def _line(ax: Axes, one: Series, x: Any, y: Any, panel: Panel, keep: Any, place: int) -> str:
    """One line, its band and its marks; its colour."""
    style = look(one.name)
    colour = ink() if one.plain else style.colour
    if len(one.low) and one.name not in theme.current().rest:
        low, high = finite(one.low)[keep], finite(one.high)[keep]
        if one.line:
            ax.fill_between(x, low, high, color=colour, alpha=BAND, lw=0, step="post" if panel.stepped else None)
        else:
            ax.vlines(x, low, high, color=colour, linewidth=pt(1.8), alpha=0.8)
    settings: dict[str, Any] = {"color": colour, "linestyle": style.dash if one.line else "none"}
    if one.plain:
        settings |= {"linestyle": "-", "linewidth": pt(2.2), "clip_on": False}
    elif one.marks == ".":
        settings |= {"marker": ".", "markersize": pt(2.5), "alpha": 0.3, "rasterized": True}
    elif one.marks:
        crowd = {"markersize": pt(3.2)} if sum(len(s.x) for s in panel.series if not s.line) > CLOUD else {}
        settings |= {"marker": style.marker, **crowd} | ({"markerfacecolor": "none"} if one.marks == "hollow" else {})
    else:
        settings |= {"linewidth": pt(1)}
    if panel.largest and len(y):
        if len(panel.series) <= FEW:
            ax.plot(x, np.abs(y), color=colour, linewidth=pt(0.5), alpha=0.45)
        y = np.maximum.accumulate(np.abs(y))
    if one.line and len(x) > FREE:  # sparse, and at other places of each line
        stride = len(x) // 8
        settings |= {"markevery": ((place * stride // 5) % stride, stride), "markersize": pt(4)}
    ax.plot(x, y, drawstyle="steps-post" if panel.stepped else "default", **settings)
    if one.ended and len(x):
        ax.plot(x[-1:], y[-1:], color=colour, marker="x", markersize=pt(8), markeredgewidth=pt(2))
    return colour
