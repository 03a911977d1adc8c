"""What happens as the step grows: conserved quantities, blow-up, the largest stable step."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.transforms import ScaledTranslation

from ...chart import Chart, Panel, Series, Sheet
from ...studies.columns import column as column_named
from ...studies.columns import invariant_columns
from .layout import failed_handle, failed_tracks, legend, note, panels, pt, titles
from .render import chart, chart_of_rows
from .scales import log_axis
from .style import GREY, finite, ink, look, names, ok, short
from .theme import scale

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pandas import DataFrame

    from .layout import Drawing

LIMITS = {"physical": "s", "branch": "^", "solver": "o", "none": ">"}
STEP_COLUMNS = ("dt_stable", "dt_unstable", "dt_half", "dt_stable_plain", "dt_cap")
MEANING = {
    "physical": "physical limit", "branch": "the branch of solutions ends", "solver": "Newton's limit, a root exists",
    "none": "no limit found",
}  # fmt: skip


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
    return Sheet([_losses(data, x, column) for column in columns])


def _losses(table: DataFrame, x: str, column: str) -> Panel:
    h, done = finite(table[x]), np.asarray(ok(table))
    error = np.abs(finite(table[column])) if column in table else np.full(len(table), np.nan)
    of, series = table["integrator"].astype(str).to_numpy(), []
    for name in names(table):
        mine = (of == name) & np.isfinite(h)
        pick = np.flatnonzero(mine & done & np.isfinite(error))
        pick = pick[np.argsort(h[pick])]
        if mine.any():
            series.append(Series(name, h[pick], error[pick], crosses=h[mine & ~done]))
    return Panel(
        series, column_named(x).label, column_named(column).label, y_scale="zero", errors=True, x_values=h,
        y_values=error[done], note="" if series else "no run has a fixed step",
    )  # fmt: skip


@chart
def blowup(table: DataFrame, sensitivity: DataFrame | None = None) -> Drawing:
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
    ax.set_ylabel(column_named("blowup_time").label)
    ended = Line2D([], [], marker="o", linestyle="none", color=ink(), markerfacecolor="none", label="reached the end")
    without = [failed_handle("failed, no time known")] if timeless.any() else []
    legend(figure, methods, [ended, *without], above=(1 + len(methods)) * pitch)
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
def stable_step(table: DataFrame, points: DataFrame | None = None) -> Drawing:
    """The largest stable step of each method as a bracket, one panel a scenario.

    points : rows of `stability_points`: the axis begins at the smallest step that was tried.
    table : rows of `stability`. The marker stands at dt_stable and tells the kind of limit, the short bar behind it is
    dt_unstable (neighbours on the ladder), the dotted line reaches dt_half; a star marks stable steps above the limit
    (not monotone), a grey tick the limit of plain Newton.
    """
    scenarios = names(table, "scenario") or [""]
    methods = names(table)
    left = 0.25 + 0.062 * max([len(short(n, 26)) for n in methods], default=0)
    size = (3.6 + left, max(1.5, 0.19 * len(methods) + 0.75))
    figure, axes = panels(len(scenarios), 2 if len(methods) <= 14 else 3, size, left)
    every = [finite(table[c]) for c in STEP_COLUMNS if c in table]
    every += [] if points is None else [finite(points["dt"])]
    spans = np.concatenate(every) if every else np.array([])
    for i, (ax, scenario) in enumerate(zip(axes, scenarios, strict=True)):
        part = table[table["scenario"].astype(str) == scenario] if scenario else table
        log_axis(ax, "x", spans)
        for row, name in enumerate(methods):
            _bracket(ax, part[part["integrator"].astype(str) == name], name, len(methods) - 1 - row)
        ax.set_ylim(-0.7, len(methods) - 0.3)
        ax.set_yticks(range(len(methods)), [short(n, 26) for n in reversed(methods)], fontsize=pt(7))
        ax.grid(axis="y", visible=False)
        if i >= len(scenarios) - figure.columns:
            ax.set_xlabel(column_named("dt").label)
    titles(axes, scenarios)
    caps = finite(table["dt_cap"]) if "dt_cap" in table else np.array([])
    up_to = f" up to h = {np.nanmin(caps):.3g}" if np.isfinite(caps).any() else ""
    kinds = set(table["limit"].dropna().astype(str)) if "limit" in table else set()
    keys = [
        Line2D([], [], color=ink(), marker=m, linestyle="none", label=MEANING[k] + (up_to if k == "none" else ""))
        for k, m in LIMITS.items()
        if k in kinds
    ]
    keys.append(Line2D([], [], color=GREY, marker="|", linestyle="none", label="limit with plain Newton"))
    if "non_monotone" in table and table["non_monotone"].fillna(False).astype(bool).any():
        keys.append(Line2D([], [], color=ink(), marker="*", linestyle="none", label="stable again above"))
    if not np.isfinite(finite(table["dt_stable"])).all():
        keys.append(failed_handle("no stable step, or no answer"))
    legend(figure, [], keys)
    return figure


def _bracket(ax: Axes, rows: DataFrame, name: str, y: float) -> None:
    for _, row in rows.iterrows():
        values: dict[str, Any] = {c: finite([row.get(c)])[0] for c in STEP_COLUMNS}
        limit, colour = str(row.get("limit")), look(name).colour
        stable = values["dt_stable"]
        if limit == "none" and not np.isfinite(stable):
            stable = values["dt_cap"]
        if not np.isfinite(stable):
            ax.plot([0.01], [y], transform=ax.get_yaxis_transform(), color=colour, marker="x", clip_on=False)
            continue
        ax.plot([ax.get_xlim()[0], stable], [y, y], color=colour, linewidth=pt(3), alpha=0.35, solid_capstyle="butt")
        if np.isfinite(values["dt_half"]) and values["dt_half"] > stable:
            ax.plot([stable, values["dt_half"]], [y, y], color=colour, linestyle=":", linewidth=pt(1.6))
        plain = math.nan if str(row.get("limit_plain")) == "none" else values["dt_stable_plain"]
        for dt, hue, size in ((values["dt_unstable"], colour, 11), (plain, GREY, 8)):
            if np.isfinite(dt):
                ax.plot([dt], [y], color=hue, marker="|", markersize=pt(size), markeredgewidth=pt(1.4))
        ax.plot([stable], [y], color=colour, marker=LIMITS.get(limit, "D"), linestyle="none", zorder=4)
        if row.get("non_monotone") is not None and bool(row.get("non_monotone") == True):  # noqa: E712
            ax.annotate(
                "★",
                (stable, y),
                xytext=(6, 0),
                fontsize=pt(7),
                textcoords="offset points",
                color=colour,
                va="center",
            )


CHARTS = (
    Chart("conservation", "Largest losses of a run against its step size.", ("conservation",), conservation,
          options=("x", "y"), study="conservation"),
    Chart("stable-step", "Largest stable step, by kind of limit.", ("stability",), stable_step, ("stability_points",),
          by_scenario=False, study="stability"),
    Chart("blowup", "Time at which a run failed, against its step size.", ("stability_points",), blowup,
          ("blowup_sensitivity",), study="stability"),
)  # fmt: skip
