"""What happens as the step grows: conserved quantities, blow-up, the largest stable step."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.transforms import ScaledTranslation

from ...chart import Chart, Panel, Row, Series, Sheet
from ...studies.columns import column as column_named
from ...studies.columns import invariant_columns
from ..marks import MARKS, mark_of_limit
from ..page_data import FAMILIES
from . import theme
from .layout import failed_handle, failed_tracks, folded, legend, note, panels, pt
from .render import chart, chart_of_rows
from .scales import log_axis
from .style import GREY, by_name, finite, ink, look, names, numbers, ok
from .theme import scale

if TYPE_CHECKING:
    from pandas import DataFrame

AGAIN = "stable again"
RISES = ("entropy_fall_max", "lyapunov_increment_max")  # of what a law forbids: below 0 is none
COUNTS = ("newton_iterations_mean", "second_law_violations")
FAR = 30  # largest over least of positive numbers that are drawn on a logarithmic axis
MEANING = {mark: MARKS[mark] for mark in MARKS if mark != "x"} | {">": "no limit found", "_": "plain Newton's limit"}
ENDS = tuple(mark for mark in MARKS if mark != "x")
STEP_COLUMNS = ("dt_stable", "dt_unstable", "dt_half", "dt_stable_plain", "dt_cap")


@chart
def conservation(table: DataFrame, x: str = "dt", y: Sequence[str] | None = None) -> Sheet:
    """What each method loses against its step, for one scenario: energy, entropy, angular momentum.

    table : rows of `conservation`. Every error is a magnitude; 0 has its own place at the foot of the axis. Failed runs
    are crosses on tracks above the others (what they lost before is in the table). y : columns, one panel each;
    entropy_increment_min shows by how much the entropy fell.
    """
    import pandas as pd

    falls = np.maximum(0.0, -finite(table["entropy_increment_min"])) if "entropy_increment_min" in table else np.nan
    data = table.assign(entropy_fall_max=pd.Series(falls, index=table.index))
    wanted = ("energy_error_max", "entropy_fall_max", *invariant_columns(data.columns))
    measured = [c for c in wanted if c in data and np.isfinite(finite(data[c])).any()] or ["energy_error_max"]
    columns = ["entropy_fall_max" if c == "entropy_increment_min" else c for c in y or measured]
    methods = by_name(table)
    return Sheet([_losses(data, methods, x, column) for column in columns])


def _losses(table: DataFrame, methods: Mapping[str, Any], x: str, column: str) -> Panel:
    h, done, error = numbers(table, x), np.asarray(ok(table)), numbers(table, column)
    if column in RISES:
        np.maximum(0.0, error.values, out=error.values)
    if lost := column in RISES or (column_named(column).worse == "larger" and column not in COUNTS):
        np.abs(error.values, out=error.values)
    there, usable, series = np.isfinite(h.values), done & np.isfinite(error.values), []
    for name, rows in methods.items():
        if len(mine := rows[there[rows]]):
            pick = mine[usable[mine]]
            pick = pick[np.argsort(h.values[pick], kind="stable")]
            series.append(Series(name, h[pick], error[pick], crosses=h[mine[~done[mine]]]))
    known = error.values[done & np.isfinite(error.values)]
    wide = len(known) and known.min() > 0 and known.max() > FAR * known.min()
    scale = "zero" if lost else "log" if wide else "linear"  # what is no loss, as of a plugin, may have any sign
    return Panel(
        series, column_named(x).label, column_named(column).label, y_scale=scale, errors=lost, x_values=h,
        y_values=error[done], note="" if series else "no run has a fixed step",
    )  # fmt: skip


@chart
def blowup(table: DataFrame, sensitivity: DataFrame | None = None) -> Figure:
    """Blow-up time against step size, for one scenario.

    table : rows with dt, status, blowup_time (`stability_points`, of the shared solver, or `conservation`). Runs that
    reached the end are hollow markers on tracks above the upper edge, one track a method. sensitivity : rows of
    `blowup_sensitivity`, median and range of the blow-up time over steps within 1 % of dt, drawn as bars.
    """
    figure, (ax,) = panels(1, 1, (7.6, 3.3))
    if "solver" in table:
        table = table[table["solver"].astype(str) != "plain"]
    methods = names(table)
    h, times, done = finite(table["dt"]), finite(table["blowup_time"]), np.asarray(ok(table))
    if not np.isfinite(h).any():
        note(ax, "no run has a fixed step")
        return figure
    log_axis(ax, "x", h)
    names_of = table["integrator"].astype(str).to_numpy()
    pitch = scale() * min(0.08, 0.9 / max(len(methods), 1))  # inches between the tracks
    for rank, name in enumerate(methods):
        mine, style = names_of == name, look(name)
        pick = np.flatnonzero(mine & ~done & np.isfinite(times))
        pick = pick[np.argsort(h[pick])]
        drawn: Any = {"color": style.colour, "marker": style.marker, "markersize": pt(3.2 if len(table) > 150 else 5)}
        ax.plot(h[pick], times[pick], linestyle="none", **drawn)  # no line: runs between two failures may succeed
        hollow: Any = drawn | {"linestyle": "none", "markerfacecolor": "none", "clip_on": False}
        up = ScaledTranslation(0.0, (1 + rank) * pitch, ax.figure.dpi_scale_trans)
        ax.plot(h[mine & done], np.ones(int((mine & done).sum())), transform=ax.get_xaxis_transform() + up, **hollow)
    timeless = ~done & ~np.isfinite(times)
    failed_tracks(ax, {name: h[(names_of == name) & timeless] for name in methods}, grow=False)
    if not np.isfinite(times[~done]).any():
        ax.set_yticks([])
        ax.text(0.5, 0.5, "no time of failure", transform=ax.transAxes, ha="center", va="center", color=GREY)
    if sensitivity is not None:
        _ranges(ax, sensitivity)
    ax.set_ylim(bottom=0)
    ax.axhline(ax.get_ylim()[1], color=GREY, linewidth=pt(0.6))
    ax.set_xlabel(column_named("dt").label)
    ax.set_ylabel(folded(column_named("blowup_time").label, ax.get_window_extent().height / figure.dpi))
    ended = Line2D([], [], marker="o", linestyle="none", color=ink(), markerfacecolor="none", label="reached the end")
    without = [failed_handle("failed, no time known")] if timeless.any() else []
    legend(figure, methods, [ended, *without])
    return figure


def _ranges(ax: Axes, table: DataFrame) -> None:
    """Bars from the earliest to the latest blow-up, with the median; side by side where the steps are equal."""
    if not {"dt", "earliest", "median", "latest"} <= set(table.columns):
        return
    if "factor" in table:  # the bound itself, not the bounds that it is compared with
        table = table[np.isclose(finite(table["factor"]), 1.0)]
    methods = names(table)
    for _, row in table.iterrows():
        h, low, middle, high = finite([row[c] for c in ("dt", "earliest", "median", "latest")])
        if np.isfinite([h, low, middle, high]).all():
            aside = 1 + 0.015 * (methods.index(str(row["integrator"])) - (len(methods) - 1) / 2)
            ax.errorbar(
                h * aside, middle, yerr=[[max(0.0, middle - low)], [max(0.0, high - middle)]], capsize=pt(3),
                marker="_", color=look(row["integrator"]).colour, markersize=pt(8), linewidth=pt(1.8),
                alpha=0.8, zorder=4,
            )  # fmt: skip


@chart_of_rows
def stable_step(table: DataFrame, points: DataFrame | None = None) -> Sheet:
    """The largest stable step of each method, one panel a scenario; before them, of several, the first that fails.

    points : rows of `stability_points`: the axis begins at the smallest step that was tried.
    table : rows of `stability`. A bar ends at dt_stable, where the mark tells how the next one fails;
    a dotted line reaches dt_half; a grey mark is the limit of
    plain Newton. Where steps above the limit are stable again (not monotone) the row says so.
    """
    ends, methods = _Ends(table), by_name(table)
    scenarios = by_name(table, "scenario") or {"": np.arange(len(table))}
    tried = np.concatenate([*ends.steps.values(), finite(() if points is None else points["dt"])])
    caps = ends.steps["dt_cap"].values
    up_to = f" up to h = {np.nanmin(caps):.3g}" if np.isfinite(caps).any() else ""
    shown = {
        scenario: [ends.bracket(name, rows[np.isin(rows, here)]) for name, rows in methods.items()]
        for scenario, here in scenarios.items()
    }
    if len(scenarios) > 1:
        shown = {"every scenario, up to the first that fails": ends.firsts(methods)} | shown
    panels = []
    for title, rows in shown.items():
        used = {mark for row in rows for mark in (*row.marks, row.text)}
        keys = {mark: text + (up_to if mark == ">" else "") for mark, text in MEANING.items() if mark in used}
        panels.append(Panel((), column_named("dt").label, "", title=title, x_values=tried, rows=rows, keys=keys))
    return Sheet(panels, 2 if len(methods) <= 14 else 3, (3.6, 1.5))


class _Ends:
    """Where the steps of a table's rows end: marks by the kind of limit, and by that of plain Newton."""

    def __init__(self, table: DataFrame) -> None:
        self.steps = {name: numbers(table, name) for name in STEP_COLUMNS}
        self.limit = table["limit"].astype(str).to_numpy()
        self.known = table["limit"].notna().to_numpy()
        again = table["non_monotone"].fillna(False).astype(bool) if "non_monotone" in table else self.known & False
        self.again = np.asarray(again)
        plain = self.steps["dt_stable_plain"]
        of_plain = table["limit_plain"] if "limit_plain" in table else table["integrator"]
        free = np.isnan(self.steps["dt_stable"].values) & (self.limit == "none")
        reached = np.where(free, self.steps["dt_cap"].values, self.steps["dt_stable"].values)
        stable, there = replace(self.steps["dt_stable"], values=reached), np.isfinite(reached)
        causes = table["cause"] if "cause" in table else table["limit"]
        kinds = np.array([mark_of_limit(*of) for of in zip(table["limit"], causes, strict=True)], dtype=object)
        self.marks = {mark: (stable, there & (kinds == mark)) for mark in (*ENDS, ">")}
        self.marks["x"] = stable, ~there
        self.marks["_"] = plain, np.isfinite(plain.values) & (of_plain.astype(str) != "none").to_numpy()

    def marked(self, rows: Any) -> dict[str, Any]:
        """Mark -> the places of these rows that it stands at."""
        found = {mark: places[rows[of[rows]]] for mark, (places, of) in self.marks.items()}
        return {mark: places for mark, places in found.items() if len(places)}

    def bracket(self, name: str, rows: Any) -> Row:
        """Of a method on a scenario."""
        marks, end = self.marked(rows), math.nan
        for mark in (*ENDS, ">"):
            end = float(marks[mark].values[-1]) if mark in marks else end
        if math.isnan(end):
            return Row(name, marks)
        half = float(self.steps["dt_half"].values[rows[-1]])
        again = AGAIN if self.again[rows].any() else ""
        return Row(name, marks, (math.nan, end), half if half > end else math.nan, again)

    def firsts(self, methods: Mapping[str, Any]) -> list[Row]:
        """Over every scenario: marks where they end, a bar to the first of them; by family, then by its length."""
        rows, kinds, known = {}, [*FAMILIES], theme.current().families
        for name, all_rows in methods.items():
            mine = all_rows[self.known[all_rows]]
            ends, cap = (
                mine[self.limit[mine] != "none"],
                np.fmax.reduce(self.steps["dt_cap"].values[mine], initial=math.nan),
            )
            least = np.nan_to_num(self.steps["dt_stable"].values[ends]).min(initial=math.inf)
            marks = {mark: places for mark, places in self.marked(mine).items() if mark != ">" or not len(ends)}
            family = kinds.index(known[name]) if known.get(name) in kinds else len(kinds)
            bar = (math.nan, (least or math.nan) if len(ends) else cap)
            rows[family, -least, name] = Row(name, marks, bar, text="" if len(ends) else f"> {cap:.2g}")
        return [rows[key] for key in sorted(rows)]


CHARTS = (
    Chart("conservation", "Largest losses of a run against its step size.", ("conservation",), conservation,
          options=("x", "y"), study="conservation"),
    Chart("stable-step", "Largest stable step, by kind of limit.", ("stability",), stable_step, ("stability_points",),
          by_scenario=False, study="stability"),
    Chart("blowup", "Time at which a run failed, against its step size.", ("stability_points",), blowup,
          ("blowup_sensitivity",), study="stability", picture=True),
)  # fmt: skip
