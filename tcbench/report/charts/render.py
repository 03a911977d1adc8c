"""Panels of data as a picture: what `chart.Panel` says, drawn with matplotlib. `templates/chart.js` draws the same."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import wraps
from typing import TYPE_CHECKING, Any, ParamSpec, cast

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from ...chart import Sheet
from ..leaders import front
from . import theme
from .layout import end_labels, failed_handle, failed_tracks, handle, legend, line_labels, note, panels, pt, titles
from .scales import log_axis, round_off_band, thin_out, zero_log_axis
from .style import finite, ink, look, looks, names

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pandas import DataFrame

    from ...chart import Panel, Series
    from .layout import Drawing

BAND = 0.13  # opacity of a band
MOST_TEXTS = 12  # numbers at the ends of lines; of more, none can be read


Asked = ParamSpec("Asked")


def chart(draw: Callable[Asked, Any]) -> Callable[Asked, Figure]:
    """Draw panels, or a figure, with tcbench's style and the theme's over the caller's matplotlib settings.

    Of many methods those that lead are in colour, the rest is grey: `report.leaders`.
    """
    return _styled(draw, crowded=True)


def chart_of_rows(draw: Callable[Asked, Any]) -> Callable[Asked, Figure]:
    """As `chart`, of one in which every method has a row or a panel of its own: all of them are in colour."""
    return _styled(draw, crowded=False)


def _styled(draw: Callable[Asked, Any], crowded: bool) -> Callable[Asked, Figure]:
    @wraps(draw)
    def styled(*arguments: Asked.args, **options: Asked.kwargs) -> Figure:
        chosen = theme.current()
        tables = [a for a in arguments if hasattr(a, "columns")]
        methods = list(dict.fromkeys(name for table in tables for name in names(table)))
        rest = _rest(tables, methods) if crowded and not chosen.labels else frozenset()
        with (
            theme.using(replace(chosen, looks=looks(methods, chosen.looks), rest=rest)),
            matplotlib.rc_context(theme.rc(chosen.settings)),
        ):
            figure = draw(*arguments, **options)
            if not isinstance(figure, Figure) and not hasattr(figure, "figure"):  # panels, as data
                figure = render(figure if isinstance(figure, Sheet) else Sheet(list(figure)))
            for ax in getattr(figure, "grid", ()):
                thin_out(ax)
        return figure if isinstance(figure, Figure) else cast(Figure, figure.figure)  # of an Axes that was given

    return styled


def _rest(tables: Sequence[DataFrame], methods: Sequence[str]) -> frozenset[str]:
    """The methods that are drawn in grey: those that do not lead on the chart's scenario, or on most of several."""
    fore = theme.current().fore
    scenarios = {str(s) for table in tables if "scenario" in table for s in table["scenario"].dropna().unique()}
    front = fore.get(scenarios.pop() if len(scenarios) == 1 else "", methods)
    return frozenset(methods).difference(front) if set(front) & set(methods) else frozenset()


def render(sheet: Sheet) -> Drawing:
    """The panels of a sheet, with one legend for all of them or names at the ends of their lines."""
    shown = sheet.panels
    figure, axes = panels(max(1, len(shown)), sheet.columns, sheet.size, right=sheet.right)
    every = [one for panel in shown for one in panel.series]
    for ax, panel in zip(axes, shown, strict=False):
        rest = theme.current().rest if panel.rank is None else frozenset(not_in_front(panel))
        with theme.using(replace(theme.current(), rest=rest)):
            _draw(ax, panel, sheet.named)
        ax.set_xlabel(panel.x)
        ax.set_ylabel(panel.y)
    titles(axes, {i: panel.title for i, panel in enumerate(shown) if panel.title})
    if sheet.named or not every:
        figure.place()
        return figure
    extra = []
    if any(one.marks == "hollow" for one in every):
        extra.append(handle(sheet.hollow, marker="o", linestyle="none", color=ink(), markerfacecolor="none"))
    if any(len(one.crosses) for one in every):
        extra.append(failed_handle())
    legend(figure, list(dict.fromkeys(one.name for one in every if not one.plain)), extra)
    return figure


def not_in_front(panel: Panel) -> set[str]:
    """The methods of a panel with a rank of its own that are grey."""
    if theme.current().labels:
        return set()  # who was asked for is in colour
    rank, known = dict(panel.rank or {}), theme.current().families
    return set(rank).difference(front({name: known.get(name, "") for name in rank}, rank))


def _draw(ax: Axes, panel: Panel, named: bool) -> None:
    if panel.note:
        note(ax, panel.note)
        return
    for which, scale, values, kind in (
        ("x", panel.x_scale, panel.x_values, "x"), ("y", panel.y_scale, panel.y_values, "y"),
    ):  # fmt: skip
        known = values if values is not None else [v for one in panel.series for v in getattr(one, kind)]
        _axis(ax, which, scale, finite(known))
    if panel.errors and panel.y_scale == "log":
        round_off_band(ax)
    right, places = ax.get_xlim()[1], {}
    for one in panel.series:
        if len(one.crosses):
            at = finite(one.crosses)
            places[one.name] = np.where(np.isfinite(at), at, right)
    crosses = finite([x for one in panel.series for x in one.crosses])
    failed_tracks(ax, places, grow=bool(np.isfinite(crosses).any()))
    rest, ends, texts = theme.current().rest, [], []
    for one in sorted(panel.series, key=lambda one: one.name not in rest):
        x, y = finite(one.x), finite(one.y)
        keep = np.isfinite(x) & np.isfinite(y)
        colour = _line(ax, one, x[keep], y[keep], panel, keep)
        if keep.any():
            end = (float(x[keep][-1]), float(y[keep][-1]), one.text or one.name, colour)
            ends += [end] if one.name not in rest else []
            texts += [end] if one.text else []
    if named:
        end_labels(ax, ends)
    elif len(texts) <= MOST_TEXTS:
        line_labels(ax, texts)


def _axis(ax: Axes, which: str, scale: str, values: Any) -> None:
    if scale == "log":
        log_axis(ax, which, values)
    elif scale == "zero":
        zero_log_axis(ax, values)
    elif scale == "share":
        ax.set_ylim(-0.02, 1.02)
        ax.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{100 * y:.0f} %"))


def _line(ax: Axes, one: Series, x: Any, y: Any, panel: Panel, keep: Any) -> str:
    """One line, its band and its marks; its colour."""
    style = look(one.name)
    colour = ink() if one.plain else style.colour
    if len(one.low) and one.name not in theme.current().rest:
        low, high = finite(one.low)[keep], finite(one.high)[keep]
        ax.fill_between(x, low, high, color=colour, alpha=BAND, linewidth=0, step="post" if panel.stepped else None)
    settings: dict[str, Any] = {"color": colour, "linestyle": style.dash if one.line else "none"}
    if one.plain:
        settings |= {"linestyle": "-", "linewidth": pt(2.2), "clip_on": False}
    elif one.marks:
        settings |= {"marker": style.marker} | ({"markerfacecolor": "none"} if one.marks == "hollow" else {})
    else:
        settings |= {"linewidth": pt(1)}
    ax.plot(x, y, drawstyle="steps-post" if panel.stepped else "default", **settings)
    return colour
