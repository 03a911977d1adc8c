"""Charts of the study `ensemble`: shares of failures, laws, error against time, profiles, and where methods fail."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...chart import Chart, Panel, Row, Series, Sheet
from ..words import power
from .layout import note, panels, pt, titles
from .render import chart, chart_of_rows, leading
from .scales import ROUND_OFF
from .style import GREY, by_name, finite, names
from .theme import INK

if TYPE_CHECKING:
    from pandas import DataFrame

FEWEST = 5  # runs: a share of fewer says nothing
CONTROLS = {"dt": "step size h", "tolerance": "tolerance"}


def first(table: DataFrame) -> DataFrame:
    """The rows of the first ensemble of a table, where it has several."""
    return table[table["ensemble"] == table["ensemble"].iloc[0]] if "ensemble" in table and len(table) else table


@chart
def failure_share(table: DataFrame) -> Sheet:
    """Share of runs that failed against the step (and, of adaptive solvers, the tolerance), with 95 % bands.

    table : rows of `failure_share` of one ensemble. Methods that never failed are one line, at 0, with the largest
    upper limit among them; their number is its name. In colour are those that fail most.
    """
    table = first(table)
    enough = table[finite(table["runs"]) >= FEWEST]
    shown = [control for control in CONTROLS if control in enough and np.isfinite(finite(enough[control])).any()]
    parts = [_shares(enough[np.isfinite(finite(enough[c]))].sort_values(c, kind="stable"), c) for c in shown]
    few = Panel([], "", "", note=f"no step or tolerance has {FEWEST} runs")
    return Sheet(parts or [few], 2, (5.4, 3.3), named=True)


def _ranked(part: DataFrame) -> dict[str, float]:
    """The methods with a share above 0, and minus its mean: the largest first."""
    share = finite(part["share"])
    mean = {name: float(share[rows].mean()) for name, rows in by_name(part).items()}
    return {n: -mean[n] for n in sorted(mean, key=lambda n: -mean[n]) if mean[n] > 0}


def _shares(part: DataFrame, control: str) -> Panel:
    failing, methods = _ranked(part), by_name(part)
    series = [_banded(part, name, methods[name], control) for name in reversed(failing)]
    if never := [n for n in methods if n not in failing]:
        high = part[part["integrator"].isin(never)].groupby(control)["high"].max()
        text = never[0] if len(never) == 1 else f"no run failed: {len(never)} methods"
        x, zero = high.index.to_numpy(), np.zeros(len(high))
        series.append(Series(text, x, zero, zero, high.to_numpy(), marks="", plain=True))
    y = "share of runs that failed"
    return Panel(series, CONTROLS[control], y, y_scale="share", rank=failing, x_values=part[control])


def _banded(
    part: DataFrame, name: str, rows: Any, column: str, marks: str = "filled", ends: bool = True
) -> Series:  # fmt: skip
    """ends: a band also where the share is 0 or 1, as it is of most lines of a profile: there it is of n alone."""
    x, share, low, high = (finite(part[c])[rows] for c in (column, "share", "low", "high"))
    if not ends:
        low, high = (np.where((share > 0) & (share < 1), bound, np.nan) for bound in (low, high))
    return Series(name, x, share, low, high, marks=marks)


@chart
def performance_profiles(table: DataFrame) -> Sheet:
    """Share of scenarios solved within tau times the fastest, one panel a target, with 95 % bands between 0 and 1.

    table : rows of `performance_profile` of one ensemble. At tau = 1: how often a method is the first. In colour are
    those that solve most, over all tau.
    """
    targets = first(table).groupby(["measure", "target"], sort=False)
    return Sheet([_profile(part, *of) for of, part in targets], 2, (5.4, 3.1), named=True)


def _profile(part: DataFrame, measure: Any, target: Any) -> Panel:
    runs, left_out = (int(part[c].iloc[0]) for c in ("runs", "without_reference"))
    missing = f", {left_out} without reference" if left_out else ""
    measured, solving, methods = np.isfinite(finite(part["share"])).any(), _ranked(part), by_name(part)
    return Panel(
        [_banded(part, name, methods[name], "tau", "", ends=False) for name in reversed(solving)],
        "time over the fastest method's, τ", "share of scenarios", y_scale="share", rank=solving, stepped=True,
        x_values=part["tau"],
        title=f"{measure} to {power(target)}: {runs} scenarios{missing}",
        note="" if measured else "no scenario has a reference that is good enough",
    )  # fmt: skip


@chart_of_rows
def error_time(points: DataFrame) -> Sheet:
    """Error of the state against time: every run a dot, and the medians of each setting joined, from coarse to fine.

    points : rows of `ensemble_points` of one ensemble. In colour are the methods with the least median time at some
    accuracy; the other runs are grey.
    """
    points = first(points).assign(**{column: finite(first(points)[column]) for column in ("error", "time_s")})
    points = points[(points["error"] > 0) & (points["time_s"] > 0)]
    points["error"] = points["error"].clip(ROUND_OFF, 1e3)
    methods, rank = by_name(points), _places(points)
    places = points[["time_s", "error"]].to_numpy()
    panel = Panel(
        [Series(name, places[rows, 0], places[rows, 1], line=False, marks=".") for name, rows in methods.items()],
        "time of a run, s (lines: medians of each setting)", "error of the state at the end", errors=True, rank=rank,
        note="" if len(points) else "no run has a reference to be compared with",
    )  # fmt: skip
    medians = [Series(name, *_medians(points.iloc[methods[name]])) for name in leading(panel)]
    return Sheet([Panel(**{**vars(panel), "series": [*panel.series, *medians]})], 1, (7.0, 4.6), named=True)


def _medians(mine: DataFrame) -> tuple[Any, Any]:
    """Median times and errors from the coarsest setting, of those that most scenarios had time for."""
    groups = mine.groupby("value")
    middle, size = groups[["time_s", "error"]].median(), groups.size()
    middle = middle[size >= 0.7 * size.max()].iloc[::-1]
    return middle["time_s"].to_numpy(), middle["error"].to_numpy()


def _places(points: DataFrame) -> dict[str, float]:
    """The best place of a method among the fastest at errors around 1e-3, 1e-6 or 1e-9, by median; the first first."""
    rank, error = dict.fromkeys(names(points), math.inf), np.log10(points["error"])
    for centre in (-3, -6, -9):
        times = points[(error - centre).abs() < 1.5].groupby("integrator")["time_s"].median().sort_values()
        rank |= {str(name): min(place, rank[str(name)]) for place, name in enumerate(times.index)}
    return dict(sorted(rank.items(), key=lambda item: item[1]))


@chart_of_rows
def law_quantiles(table: DataFrame) -> Sheet:
    """What methods lose of each law: median (large), 99 % and worst of all runs; hollow where the law is not claimed.

    table : rows of `ensemble_laws` of one ensemble.
    """
    table = first(table)
    values, shown = np.maximum(finite(table["worst"]), ROUND_OFF), []
    keys = {"o": "median; hollow: not claimed", ".": "99 % and worst"}
    for law, part in table.groupby(table["law"].astype(str), sort=False):
        of = part.drop_duplicates("integrator").set_index("integrator")
        rows = [_quantiles(of.loc[name], name) if name in of.index else Row(name, {}) for name in names(table)]
        shown.append(Panel((), "loss: median, 99 %, worst", "", title=str(law).replace("_", " "), errors=True,
                           x_values=values, rows=rows, keys=keys))  # fmt: skip
    return Sheet(shown, 3, (3.6, 1.5))


def _quantiles(row: Any, name: str) -> Row:
    median, high, worst = np.maximum(finite([row["median"], row["quantile_99"], row["worst"]]), ROUND_OFF)
    return Row(name, {"o": [median], ".": [high, worst]}, (median, worst), hollow=not row["claimed"])


@chart_of_rows
def where_it_fails(table: DataFrame) -> Figure:
    """Shares of failures over a constant and the step, one panel a method: where to look.

    table : rows of `failure_map` of one ensemble. The number in a cell is its share in per cent; a cell in which no run
    failed is white.
    """
    table = first(table)
    methods = names(table)
    figure, axes = panels(max(1, len(methods)), 3, (4.0, 3.4))
    for ax, name in zip(axes, methods, strict=False):
        _map_panel(ax, table[table["integrator"] == name])
    titles(axes, methods)
    return figure


def _map_panel(ax: Axes, rows: DataFrame) -> None:
    rows = rows.dropna(subset=["x_low", "y_low"])
    if not len(rows):
        note(ax, "nothing was run here")
        return
    share = rows.pivot_table("share", "y_low", "x_low", dropna=False)
    colours = matplotlib.colormaps["Oranges"].with_extremes(under="white", bad=GREY)
    ax.imshow(share, origin="lower", aspect="auto", cmap=colours, vmin=1e-9, vmax=1)
    for (row, column), value in np.ndenumerate(share):
        if np.isfinite(value):
            ax.text(column, row, f"{100 * value:.0f}", ha="center", va="center", fontsize=pt(6.5),
                    color="white" if value > 0.6 else INK)  # fmt: skip
    for axis, which, values in ((ax.xaxis, "x", share.columns), (ax.yaxis, "y", share.index)):
        top = rows.groupby(f"{which}_low")[f"{which}_high"].first()
        ends = [f"{low:.3g}" if low == top[low] else f"{low:.3g}–{top[low]:.3g}" for low in values]
        axis.set_ticks(range(len(values)), ends, fontsize=pt(6.5))
        axis.set_label_text(str(rows[f"{which}_name"].iloc[0]).replace("dt", CONTROLS["dt"]))
    ax.grid(False)


CHARTS = (
    Chart("failure-share", "Share of random scenarios on which a method fails, with 95 % bands.", ("failure_share",),
          failure_share, by_scenario=False, study="ensemble"),
    Chart("performance-profile", "Share of random scenarios that a method solves within τ times the fastest one's "
          "time; at τ = 1, those where it is the fastest.", ("performance_profile",),
          performance_profiles, by_scenario=False, picks="measure", study="ensemble"),
    Chart("error-time", "Error against time on random scenarios: every run, and the medians.", ("ensemble_points",),
          error_time, by_scenario=False, study="ensemble", picture=True),
    Chart("law-quantiles", "Losses over random scenarios: median, 99 % and worst of all runs; filled where the law is "
          "claimed.", ("ensemble_laws",), law_quantiles, by_scenario=False, picks="law",
          study="ensemble"),
    Chart("failure-map", "Share of failures, per cent, over a constant and the step.", ("failure_map",),
          where_it_fails, by_scenario=False, study="ensemble_map", picture=True),
)  # fmt: skip
