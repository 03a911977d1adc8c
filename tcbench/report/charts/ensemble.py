"""Charts of the study `ensemble`: shares of failures, laws, error against time, profiles, and where methods fail."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
from matplotlib.ticker import FuncFormatter, LogLocator

from .kind import Kind
from .layout import end_labels, handle, legend, line_labels, note, panels, pt, titles
from .scales import ROUND_OFF, log_axis, round_off_band
from .style import GREY, OTHER, Look, chart_of_rows, finite, ink, look, names, short
from .theme import INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pandas import DataFrame

    from .layout import Drawing

NAMED = 6  # lines of a panel that are coloured and named; the others are grey
BAND = 0.13  # opacity of a band
FEWEST = 5  # runs: a share of fewer says nothing
CONTROLS = {"dt": "step size h", "tolerance": "tolerance"}


def first(table: DataFrame) -> DataFrame:
    """The rows of the first ensemble of a table."""
    return table[table["ensemble"] == table["ensemble"].iloc[0]]


@chart_of_rows
def failure_share(table: DataFrame) -> Drawing:
    """Share of runs that failed against the step (and, of adaptive solvers, the tolerance), with 95 % bands.

    table : rows of `failure_share` of one ensemble. Methods that never failed are one line, at 0, with the largest
    upper limit among them; their number is its name.
    """
    enough = table[finite(table["runs"]) >= FEWEST]
    shown = [control for control in CONTROLS if control in enough and np.isfinite(finite(enough[control])).any()]
    figure, axes = panels(max(1, len(shown)), 2, (5.4, 3.3), right=1.5)
    if not shown:
        note(axes[0], f"no step or tolerance has {FEWEST} runs")
    parts = [enough[np.isfinite(finite(enough[c]))].sort_values(c, kind="stable") for c in shown]
    coloured = {name: look(name) for part in parts for name in _most_failing(part)[:NAMED]}
    for ax, part, control in zip(axes, parts, shown, strict=False):
        _shares(ax, part, control, coloured)
    figure.place()
    return figure


def _most_failing(part: DataFrame) -> list[str]:
    """The methods that failed at all, the one with the largest mean share first."""
    worst = {n: float(finite(part.loc[part["integrator"] == n, "share"]).mean()) for n in names(part)}
    return sorted((n for n in worst if worst[n] > 0), key=lambda n: -worst[n])


def _shares(ax: Axes, part: DataFrame, control: str, coloured: Mapping[str, Look]) -> None:
    log_axis(ax, "x", finite(part[control]))
    _percent(ax)
    failing = _most_failing(part)
    never = [n for n in names(part) if n not in failing]
    ends = []
    for name in reversed(failing):
        rows = part[part["integrator"] == name]
        x, share = finite(rows[control]), finite(rows["share"])
        style = coloured.get(name, OTHER)
        colour = style.colour
        if name in coloured:
            ax.fill_between(x, finite(rows["low"]), finite(rows["high"]), color=colour, alpha=BAND, linewidth=pt(0))
        ax.plot(x, share, color=colour, linestyle=style.dash, marker=style.marker, markersize=pt(3.5))
        ends.append((float(x[-1]), float(share[-1]), name, colour))
    if never:
        rows = part[part["integrator"].isin(never)]
        x = np.unique(finite(rows[control]))
        high = [float(finite(rows.loc[finite(rows[control]) == value, "high"]).max()) for value in x]
        ax.fill_between(x, 0.0, high, color=ink(), alpha=BAND, linewidth=0)
        ax.plot(x, np.zeros(len(x)), color=ink(), linewidth=pt(2.2), clip_on=False)
        text = never[0] if len(never) == 1 else f"0 of all runs: {len(never)} methods"
        ends.append((float(x[-1]), 0.0, text, ink()))
    end_labels(ax, ends)
    ax.set_xlabel(CONTROLS[control])
    ax.set_ylabel("share of runs that failed")


def _percent(ax: Axes) -> None:
    ax.set_ylim(-0.02, 1.02)
    ax.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{100 * y:.0f} %"))


@chart_of_rows
def performance_profiles(table: DataFrame) -> Drawing:
    """Share of scenarios solved within tau times the fastest, one panel a target, with 95 % bands.

    table : rows of `performance_profile` of one ensemble. At tau = 1: how often a method is the first.
    """
    targets = list(dict.fromkeys(zip(table["measure"].astype(str), table["target"].astype(float), strict=True)))
    figure, axes = panels(max(1, len(targets)), 2, (5.4, 3.1), right=1.4)
    texts = []
    parts = [table[(table["measure"] == measure) & (table["target"] == target)] for measure, target in targets]
    coloured = {name: look(name) for part in parts for name in _leading(part)[:NAMED]}
    for ax, part, (measure, target) in zip(axes, parts, targets, strict=False):
        _profiles(ax, part, coloured)
        runs, left_out = (int(part[c].iloc[0]) for c in ("runs", "without_reference"))
        missing = f", {left_out} without reference" if left_out else ""
        texts.append(f"{measure} to {target:.0e}: {runs} scenarios{missing}".replace("e-0", "e-"))
    titles(axes, texts)
    figure.place()
    return figure


def _leading(part: DataFrame) -> list[str]:
    """The methods that solve anything, the one with the largest mean share first."""
    score = {n: float(finite(part.loc[part["integrator"] == n, "share"]).mean()) for n in names(part)}
    return sorted((n for n in score if score[n] > 0), key=lambda n: -score[n])


def _profiles(ax: Axes, part: DataFrame, coloured: Mapping[str, Look]) -> None:
    ax.set_xlabel("time over the fastest method's, τ")
    ax.set_ylabel("share of scenarios")
    if not np.isfinite(finite(part["share"])).any():
        note(ax, "no scenario has a reference that is good enough")
        return
    log_axis(ax, "x", finite(part["tau"]))
    ax.set_xlim(1.0, float(finite(part["tau"]).max()))
    _percent(ax)
    leading = _leading(part)
    ends = []
    for name in reversed(leading):
        rows = part[part["integrator"] == name]
        tau, share = finite(rows["tau"]), finite(rows["share"])
        named = name in leading[:NAMED]
        style = coloured[name] if named else OTHER
        colour = style.colour
        if named:
            ax.fill_between(tau, finite(rows["low"]), finite(rows["high"]), color=colour, alpha=BAND, linewidth=0,
                            step="post")  # fmt: skip
            ends.append((float(tau[-1]), float(share[-1]), name, colour))
        ax.step(tau, share, where="post", color=colour, linestyle=style.dash, linewidth=pt(1.6 if named else 0.7))
    end_labels(ax, ends)


@chart_of_rows
def error_time(points: DataFrame, integrators: Sequence[str] | None = None) -> Drawing:
    """Error of the state against time: every run a dot, and the medians of each setting joined, from coarse to fine.

    points : rows of `ensemble_points` of one ensemble. integrators : those to draw in colour; by default those with the
    least median time at the middle of the errors. The other runs are grey.
    """
    figure, (ax,) = panels(1, 1, (7.0, 4.6), right=0.8)
    error, seconds = finite(points["error"]), finite(points["time_s"])
    good = np.isfinite(error) & (error > 0) & np.isfinite(seconds) & (seconds > 0)
    ax.set_xlabel("time of a run, s (lines: medians of each setting)")
    ax.set_ylabel("error of the state at the end")
    if not good.any():
        note(ax, "no run has a reference to be compared with")
        return figure
    log_axis(ax, "x", seconds[good])
    log_axis(ax, "y", np.clip(error[good], ROUND_OFF, 1e3))
    round_off_band(ax)
    known = points[good]
    chosen = list(integrators) if integrators else _leaders(known)
    method = known["integrator"].astype(str).to_numpy()
    others = ~np.isin(method, chosen)
    ax.plot(
        seconds[good][others],
        error[good][others],
        ".",
        color=GREY,
        markersize=pt(2),
        alpha=0.25,
        rasterized=True,
    )
    ends = []
    for name in chosen:
        style, mine = look(name), known[method == name]
        colour = style.colour
        ax.plot(
            finite(mine["time_s"]),
            finite(mine["error"]),
            ".",
            color=colour,
            markersize=pt(2.5),
            alpha=0.3,
            rasterized=True,
        )
        groups = mine.groupby("value")
        middle = groups[["time_s", "error"]].median().sort_index(ascending=False)
        middle = middle[
            groups.size().reindex(middle.index) >= 0.7 * groups.size().max()
        ]  # those that every scenario had time for
        ax.plot(middle["time_s"], middle["error"], color=colour, marker=style.marker, markersize=pt(5),
                markeredgecolor=ax.get_facecolor(), markeredgewidth=pt(0.5))  # fmt: skip
        last = middle.iloc[-1]
        ends.append((float(last["time_s"]), float(last["error"]), name, colour))
    line_labels(ax, ends)
    return figure


def _leaders(points: DataFrame) -> list[str]:
    """The methods that are the fastest at errors around 1e-3, 1e-6 and 1e-9, by median."""
    found: dict[str, None] = {}
    error = np.log10(np.clip(finite(points["error"]), ROUND_OFF, None))
    for centre in (-3, -6, -9):
        near = points[np.abs(error - centre) < 1.5]
        times = near.groupby("integrator")["time_s"].median().sort_values()
        found |= dict.fromkeys(str(name) for name in times.index[:3])
    return list(found)[:NAMED]


@chart_of_rows
def law_quantiles(table: DataFrame) -> Drawing:
    """What methods lose of each law: median, 99 % and worst of all runs; filled dots where the method claims the law.

    table : rows of `ensemble_laws` of one ensemble.
    """
    known = list(dict.fromkeys(table["law"].astype(str)))
    methods = names(table)
    figure, axes = panels(max(1, len(known)), 3, (3.6, 0.75 + 0.17 * max(4, len(methods))), left=1.45)
    values = finite(table["worst"])
    for ax, law in zip(axes, known, strict=False):
        log_axis(ax, "x", np.clip(values[np.isfinite(values)], ROUND_OFF, None))
        ax.set_xlim(left=ROUND_OFF / 5)
        round_off_band(ax, "x")
        ax.xaxis.set_major_locator(LogLocator(numticks=4))
        for place, name in enumerate(reversed(methods)):
            rows = table[(table["integrator"] == name) & (table["law"] == law)]
            if len(rows):
                _dots(ax, rows.iloc[0], place, look(name).colour)
        ax.set_yticks(range(len(methods)), [short(name, 22) for name in reversed(methods)], fontsize=pt(7))
        ax.set_ylim(-0.7, len(methods) - 0.3)
        ax.set_xlabel("median, 99 %, worst")
    titles(axes, [law.replace("_", " ") for law in known])
    dot = {"color": ink(), "marker": "o", "linestyle": "none"}
    legend(figure, [], [handle("claimed", **dot), handle("not claimed", markerfacecolor="none", **dot)])
    return figure


def _dots(ax: Axes, row: Any, place: int, colour: str) -> None:
    x = np.clip(finite([row["median"], row["quantile_99"], row["worst"]]), ROUND_OFF, None)
    fill = colour if bool(row["claimed"]) else matplotlib.rcParams["axes.facecolor"]
    ax.plot(x[[0, 2]], [place, place], color=colour, linewidth=pt(0.8))
    for value, size in zip(x, (5.0, 3.5, 3.5), strict=True):
        ax.plot([value], [place], "o", color=colour, markerfacecolor=fill, markersize=pt(size), markeredgewidth=pt(0.9))


@chart_of_rows
def where_it_fails(table: DataFrame) -> Drawing:
    """Shares of failures over a constant and the step, one panel a method: where to look.

    table : rows of `failure_map` of one ensemble. The number in a cell is its share in per cent; a cell in which no run
    failed is white.
    """
    methods = names(table)
    figure, axes = panels(max(1, len(methods)), 3, (4.0, 3.4), left=0.8, right=0.25)
    for ax, name in zip(axes, methods, strict=False):
        _map_panel(ax, table[table["integrator"] == name])
    titles(axes, methods)
    figure.place(above=0.05)
    return figure


def _map_panel(ax: Axes, rows: DataFrame) -> None:
    columns, heights = np.unique(finite(rows["x_low"])), np.unique(finite(rows["y_low"]))
    share = np.full((len(heights), len(columns)), np.nan)
    i, j = np.searchsorted(heights, finite(rows["y_low"])), np.searchsorted(columns, finite(rows["x_low"]))
    share[i, j] = finite(rows["share"])
    colours = matplotlib.colormaps["Oranges"].with_extremes(under="white", bad=GREY)
    ax.imshow(share, origin="lower", aspect="auto", cmap=colours, vmin=1e-9, vmax=1)
    for (row, column), value in np.ndenumerate(share):
        if np.isfinite(value):
            ax.text(column, row, f"{100 * value:.0f}", ha="center", va="center", fontsize=pt(6.5),
                    color="white" if value > 0.6 else INK)  # fmt: skip
    for axis, which, values in ((ax.xaxis, "x", columns), (ax.yaxis, "y", heights)):
        top = rows.set_index(f"{which}_low")[f"{which}_high"]
        axis.set_ticks(
            range(len(values)), [_cell_text(v, float(top.loc[[v]].iloc[0])) for v in values], fontsize=pt(6.5)
        )
    ax.grid(False)
    ax.set_xlabel(str(rows["x_name"].iloc[0]).replace("dt", CONTROLS["dt"]))
    ax.set_ylabel(str(rows["y_name"].iloc[0]).replace("dt", CONTROLS["dt"]))


def _cell_text(low: float, high: float) -> str:
    return f"{low:.3g}" if low == high else f"{low:.3g}–{high:.3g}"


KINDS = (
    Kind("failure-share", "ensemble", "Share of random scenarios on which a method fails, with 95 % bands.",
         ("failure_share",), lambda table: failure_share(first(table)), by_scenario=False),
    Kind("performance-profile", "ensemble", "Share of random scenarios that a method solves within τ times the fastest "
         "one's time; at τ = 1, those where it is the fastest.", ("performance_profile",),
         lambda table: performance_profiles(first(table)), by_scenario=False, picks="measure"),
    Kind("error-time", "ensemble", "Error against time on random scenarios: every run, and the medians.",
         ("ensemble_points",), lambda table: error_time(first(table)), by_scenario=False),
    Kind("law-quantiles", "ensemble", "Losses over random scenarios: median, 99 % and worst of all runs; filled where "
         "the law is claimed.", ("ensemble_laws",), lambda table: law_quantiles(first(table)), by_scenario=False,
         picks="law"),
    Kind("failure-map", "ensemble_map", "Share of failures, per cent, over a constant and the step.", ("failure_map",),
         lambda table: where_it_fails(first(table)), by_scenario=False),
)  # fmt: skip
