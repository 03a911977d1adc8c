"""What happens as the step grows: conserved quantities, blow-up, the largest stable step."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ...chart import Chart, Panel, Row, Series, Sheet
from ...studies.columns import column as column_named
from ...studies.columns import invariant_columns
from ..marks import MARKS, mark_of_limit
from ..page_data import FAMILIES
from . import theme
from .render import chart, chart_of_rows
from .style import by_name, finite, lines, numbers, ok

if TYPE_CHECKING:
    from pandas import DataFrame

RISES = ("entropy_fall_max", "lyapunov_increment_max")  # of what a law forbids: below 0 is none
COUNTS = ("newton_iterations_mean", "second_law_violations")
FAR = 30  # largest over least of positive numbers that are drawn on a logarithmic axis
ENDS = tuple(mark for mark in MARKS if mark != "x")
MEANING = {mark: MARKS[mark] for mark in ENDS} | {">": "no limit found", "_": "plain Newton's limit"}


@chart
def conservation(table: DataFrame, x: str = "dt", y: Sequence[str] | None = None) -> Sheet:
    """What each method loses against its step, for one scenario: energy, entropy, angular momentum.

    table : rows of `conservation`. Every error is a magnitude; 0 has its own place at the foot of the axis. Failed runs
    are crosses on tracks above the others (what they lost before is in the table). y : columns, one panel each;
    entropy_increment_min shows by how much the entropy fell.
    """
    data = table.assign(entropy_fall_max=np.maximum(0.0, -numbers(table, "entropy_increment_min").values))
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
    stepped, usable = np.isfinite(h.values), done & np.isfinite(error.values)
    shown = {name: rows for name, rows in methods.items() if stepped[rows].any()}
    sizes = error.values[usable]
    wide = len(sizes) and sizes.min() > 0 and sizes.max() > FAR * sizes.min()
    scale = "zero" if lost else "log" if wide else "linear"  # what is no loss, as of a plugin, may have any sign
    return Panel(
        lines(shown, h, error, stepped & usable, h.values, stepped & ~done), column_named(x).label,
        column_named(column).label, y_scale=scale, errors=lost, x_values=h, y_values=error[done],
        note="" if shown else "no run has a fixed step",
    )  # fmt: skip


@chart
def reachable_range(table: DataFrame) -> Sheet:
    """How far a run leaves the exact range against its step, for one scenario; and the error of its temperatures."""
    shown = [(c, _losses(table, by_name(table), "dt", c)) for c in ("range_left", "error_theta") if c in table]
    return Sheet([replace(panel, y_scale="linear", errors=False) if c == "range_left" else panel for c, panel in shown])


@chart
def blowup(table: DataFrame, sensitivity: DataFrame | None = None) -> Sheet:
    """Blow-up time against step size, for one scenario.

    table : rows with dt, status, blowup_time (`stability_points`, of the shared solver, or `conservation`). Runs that
    reached the end are hollow, on tracks above the others, one track a method. sensitivity : rows of
    `blowup_sensitivity`, median and range of the blow-up time over steps within 1 % of dt, drawn as bars.
    """
    if "solver" in table:
        table = table[table["solver"].astype(str) != "plain"].reset_index(drop=True)
    h, times, done, methods = numbers(table, "dt"), numbers(table, "blowup_time"), np.asarray(ok(table)), by_name(table)
    timed, stepped = ~done & np.isfinite(times.values), np.isfinite(h.values)
    series = lines(methods, h, times, timed & stepped, h.values, stepped & ~done & ~timed, line=False)
    if sensitivity is not None and {"dt", "earliest", "median", "latest"} <= set(sensitivity):
        bound = numbers(sensitivity, "factor").values if "factor" in sensitivity else 1.0
        series += _ranges(sensitivity[np.isclose(bound, 1.0)])  # not the bounds that it is compared with
    tops = [finite(of).max(initial=0.0) for one in series for of in (one.y, one.high)]
    top, pitch = max(tops, default=0.0) or 1.0, min(0.05, 0.5 / max(1, len(methods)))
    for rank, (name, rows) in enumerate(methods.items()):
        ended, height = rows[done[rows] & stepped[rows]], top * (1.06 + pitch * rank)
        series.append(Series(name, h[ended], np.full(len(ended), height), line=False, marks="hollow"))
    note, heights = "" if stepped.any() else "no run has a fixed step", [0.0, top * (1.06 + pitch * len(methods))]
    labels = column_named("dt").label, column_named("blowup_time").label
    panel = Panel(series, *labels, y_scale="linear", y_values=heights, note=note)
    return Sheet([panel], 1, (7.6, 3.3), hollow="reached the end")


def _ranges(table: DataFrame) -> list[Series]:
    """Bars from the earliest to the latest blow-up, with the median; side by side where the steps are equal."""
    methods = by_name(table)
    h, low, middle, high = (finite(table[c]) for c in ("dt", "earliest", "median", "latest"))
    aside = {name: 1 + 0.015 * (k - (len(methods) - 1) / 2) for k, name in enumerate(methods)}
    bars = {name: (h[of] * aside[name], middle[of], low[of], high[of]) for name, of in methods.items()}
    return [Series(name, *bar, line=False) for name, bar in bars.items()]


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
    tried = np.concatenate([*ends.tried, finite(() if points is None else points["dt"])])
    up_to = f" up to h = {np.nanmin(ends.cap):.3g}" if np.isfinite(ends.cap).any() else ""
    shown = {
        scenario: [ends.row(name, rows[np.isin(rows, here)]) for name, rows in methods.items()]
        for scenario, here in scenarios.items()
    }
    if len(scenarios) > 1:
        shown = {"every scenario, up to the first that fails": ends.firsts(methods)} | shown
    panels = []
    for title, rows in shown.items():
        used = {mark for row in rows for mark in row.marks}
        keys = {mark: text + (up_to if mark == ">" else "") for mark, text in MEANING.items() if mark in used}
        panels.append(Panel((), column_named("dt").label, "", title=title, x_values=tried, rows=rows, keys=keys))
    return Sheet(panels, 2 if len(methods) <= 14 else 3, (3.6, 1.5))


class _Ends:
    """Where the steps of a table's rows end: at the largest stable one, or at the cap where no limit was found."""

    def __init__(self, table: DataFrame) -> None:
        stable, plain = numbers(table, "dt_stable"), numbers(table, "dt_stable_plain")
        self.half, self.cap = numbers(table, "dt_half").values, numbers(table, "dt_cap").values
        self.tried = [stable.values, plain.values, self.half, self.cap, numbers(table, "dt_unstable").values]
        self.searched, free = table["limit"].notna().to_numpy(), table["limit"].eq("none").to_numpy()
        self.limited = self.searched & ~free
        self.stable = stable.values
        self.at = replace(stable, values=np.where(free & np.isnan(stable.values), self.cap, stable.values))
        causes = table["cause"] if "cause" in table else table["limit"]
        kinds = [mark_of_limit(*of) for of in zip(table["limit"], causes, strict=True)]
        self.kinds = np.where(np.isfinite(self.at.values), np.array(kinds, dtype=object), "x")
        self.plain, ends = plain, table["limit_plain"].ne("none").to_numpy() if "limit_plain" in table else True
        self.plain_ends = np.isfinite(plain.values) & ends
        again = table["non_monotone"].fillna(False).astype(bool) if "non_monotone" in table else self.searched & False
        self.again = np.asarray(again)

    def marked(self, rows: Any) -> dict[str, Any]:
        """Mark -> the places of these rows that it stands at."""
        places_of = {mark: self.at[rows[self.kinds[rows] == mark]] for mark in (*ENDS, ">", "x")}
        places_of["_"] = self.plain[rows[self.plain_ends[rows]]]
        return {mark: places for mark, places in places_of.items() if len(places)}

    def row(self, name: str, rows: Any) -> Row:
        """Of a method on a scenario."""
        marks = self.marked(rows)
        ends = [float(marks[mark].values[-1]) for mark in (*ENDS, ">") if mark in marks]
        if not ends:
            return Row(name, marks)
        half = float(self.half[rows[-1]])
        text = "stable again" if self.again[rows].any() else ""
        return Row(name, marks, (math.nan, ends[-1]), half if half > ends[-1] else math.nan, text)

    def firsts(self, methods: Mapping[str, Any]) -> list[Row]:
        """Over every scenario: marks where they end, a bar to the first of them; by family, then by its length."""
        rows, kinds, families = {}, [*FAMILIES], theme.current().families
        for name, all_rows in methods.items():
            mine = all_rows[self.searched[all_rows]]
            ends, cap = mine[self.limited[mine]], np.fmax.reduce(self.cap[mine], initial=math.nan)
            nearest = np.nan_to_num(self.stable[ends]).min(initial=math.inf)
            marks = {mark: places for mark, places in self.marked(mine).items() if mark != ">" or not len(ends)}
            family = kinds.index(families[name]) if families.get(name) in kinds else len(kinds)
            bar = (math.nan, (nearest or math.nan) if len(ends) else cap)
            rows[family, -nearest, name] = Row(name, marks, bar, text="" if len(ends) else f"> {cap:.2g}")
        return [rows[key] for key in sorted(rows)]


CHARTS = (
    Chart("conservation", "Largest losses of a run against its step size.", ("conservation",), conservation,
          options=("x", "y"), study="conservation"),
    Chart("reachable-range", "How far temperatures and positive quantities leave their exact range, against the step.",
          ("reachable_range",), reachable_range, study="reachable_range"),
    Chart("stable-step", "Largest stable step, by kind of limit.", ("stability",), stable_step, ("stability_points",),
          by_scenario=False, study="stability"),
    Chart("blowup", "Time at which a run failed, against its step size.", ("stability_points",), blowup,
          ("blowup_sensitivity",), study="stability"),
)  # fmt: skip
