"""Error against cost and against step size: work-precision and convergence."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...studies.columns import column as column_named
from .kind import Kind
from .layout import failed_handle, failed_tracks, handle, legend, line_labels, note, panels, pt, titles
from .scales import log_axis, round_off_band, zero_log_axis
from .style import chart, finite, ink, look, names, ok

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pandas import DataFrame

    from .layout import Drawing

ERRORS = ("error_q", "error_p", "error_s", "error_theta", "energy_error_max", "angular_momentum_error_max")
CONSERVED = ("energy_error_max", "angular_momentum_error_max")  # exactly 0 is possible: these get an axis with a zero
PRODUCED = "error_entropy_produced"  # not an error of the state: drawn where it is asked for
VARIABLES = {"q": "positions q", "p": "momenta p", "s": "entropies s", "theta": "temperatures θ", "all": "all"}


@chart
def work_precision(table: DataFrame, x: str = "wall_time_min_s", y: Sequence[str] | None = None) -> Drawing:
    """Error against cost for one scenario, one panel for each column in `y` (by default every error there is).

    table : rows of `work_precision`; x, y : any numeric columns. Points of a method are joined from its coarsest to
    its finest setting.
    Failed runs are crosses at the upper edge; masked errors (NaN) of completed runs are left out.
    """
    columns = list(y) if y else _errors(table)
    figure, axes = panels(len(columns), 3, (3.6, 2.9))
    methods = names(table)
    failed = bool((~ok(table)).any())
    for ax, column in zip(axes, columns, strict=True):
        _cloud(ax, table, x, column, methods)
        ax.set_xlabel(column_named(x).label)
        ax.set_ylabel(column_named(column).label)
    legend(figure, methods, [failed_handle()] if failed else [])
    return figure


def _cloud(ax: Axes, table: DataFrame, x: str, column: str, methods: Sequence[str]) -> None:
    import pandas as pd

    if column not in table or x not in table:
        note(ax, f"The table has no column {column if column not in table else x}.")
        return
    done = ok(table)
    xs, ys = finite(table[x]), np.abs(finite(table[column]))
    usable = done & np.isfinite(xs) & (xs > 0) & np.isfinite(ys) & ((ys > 0) | (column in CONSERVED))
    if not usable.any() and np.all(done):
        note(ax, "no completed run has a value here")
        return
    log_axis(ax, "x", xs[np.isfinite(xs)])
    if column in CONSERVED:
        zero_log_axis(ax, ys[usable])
    else:
        log_axis(ax, "y", ys[usable])
        round_off_band(ax)
    order = pd.to_numeric(table["value"], errors="coerce") if "value" in table else pd.Series(xs, index=table.index)
    names_of = table["integrator"].astype(str).to_numpy()
    failed = ~np.asarray(done)
    crosses = {name: _edge(ax, xs[(names_of == name) & failed]) for name in methods}
    failed_tracks(ax, crosses, grow=bool(np.isfinite(xs[failed]).any()))
    for name in methods:
        style, pick = look(name), np.flatnonzero((names_of == name) & usable)
        pick = pick[np.argsort(-order.to_numpy(dtype=float)[pick], kind="stable")]
        ax.plot(xs[pick], ys[pick], color=style.colour, marker=style.marker, linestyle=style.dash)


def _edge(ax: Axes, xs: Any) -> Any:
    """Failed runs without a cost of their own stand at the right edge."""
    right = ax.get_xlim()[1]
    xs = np.asarray(xs, dtype=float)
    return np.where(np.isfinite(xs) & (xs > 0), xs, right)


def _errors(table: DataFrame) -> list[str]:
    """The errors of the variables that the system has, of its temperatures, and of what it conserves."""
    others = [str(c) for c in table if str(c).startswith("error_") and c not in ERRORS and c != PRODUCED]
    columns = [*(c for c in ERRORS if c not in CONSERVED), *others, *CONSERVED]
    return [c for c in columns if c in table and (np.abs(finite(table[c])) > (-1 if c in CONSERVED else 0)).any()] or [
        "error"
    ]


@chart
def convergence(points: DataFrame, fits: DataFrame | None = None) -> Drawing:
    """Error against step size for one scenario, one panel a variable, with the fitted slopes.

    points : rows of `convergence_points`; fits : rows of `convergence`. Filled markers are in the fit, hollow ones were
    dropped (round-off, reference, too coarse), crosses failed. The number at the end of a line is its fitted order.
    """
    variables = [v for v in [*VARIABLES, *names(points, "variable")] if v in set(points["variable"].astype(str))]
    variables = list(dict.fromkeys(variables)) or ["all"]
    figure, axes = panels(len(variables), 3, (3.7, 2.8), right=0.3)
    methods = names(points)
    for ax, variable in zip(axes, variables, strict=True):
        part = points[points["variable"].astype(str) == variable]
        fit = None if fits is None else fits[fits["variable"].astype(str) == variable]
        _slopes(ax, part, fit, methods)
        ax.set_xlabel(column_named("dt").label)
        ax.set_ylabel(column_named("error" if variable == "all" else f"error_{variable}").label)
    titles(axes, [VARIABLES.get(v, v) for v in variables])
    extra = [handle("", marker="o", linestyle="none", color=ink(), markerfacecolor="none")]
    extra[0].set_label("not in the fit")
    if _failed_points(points).any():
        extra.append(failed_handle())
    legend(figure, methods, extra)
    return figure


def _failed_points(points: DataFrame) -> Any:
    failed = ~np.isfinite(finite(points["error"]))
    if "reason" in points:
        return failed & points["reason"].astype(str).eq("failed").to_numpy()
    return (failed & ~np.asarray(ok(points))) if "status" in points else failed


def _slopes(ax: Axes, part: DataFrame, fits: DataFrame | None, methods: Sequence[str]) -> None:
    h, e = finite(part["dt"]), finite(part["error"])
    used = part["used"].fillna(False).astype(bool).to_numpy() if "used" in part else np.ones(len(part), dtype=bool)
    failed = _failed_points(part)
    good = np.isfinite(h) & np.isfinite(e) & (e > 0)
    if not good.any() and not failed.any():
        note(ax, "no error" if np.isfinite(e).any() else "no error was measured")  # 0: a variable that stays
        return
    log_axis(ax, "x", h)
    log_axis(ax, "y", e[good])
    round_off_band(ax)
    names_of = part["integrator"].astype(str).to_numpy()
    failed_tracks(ax, {name: h[(names_of == name) & failed & np.isfinite(h)] for name in methods})
    ends = []
    for name in methods:
        mine = names_of == name
        style = look(name)
        ax.plot(h[mine & good & used], e[mine & good & used], color=style.colour, marker=style.marker, linestyle="none")
        ax.plot(
            h[mine & good & ~used], e[mine & good & ~used], color=style.colour, marker=style.marker, linestyle="none",
            markerfacecolor="none",
        )  # fmt: skip
        end = _fitted_line(ax, name, h[mine & good & used], e[mine & good & used], fits)
        if end is not None:
            ends.append(end)
    if len(ends) <= 12:
        line_labels(ax, ends)


def _fitted_line(ax: Axes, name: str, h: Any, e: Any, fits: DataFrame | None) -> tuple[float, float, str, str] | None:
    """The line of the fitted order through the used points; its upper end and its label."""
    if fits is None or len(h) == 0:
        return None
    row = fits[fits["integrator"].astype(str) == name]
    order = float(finite(row["order"])[0]) if len(row) else np.nan
    if not np.isfinite(order):
        return None
    constant = np.exp(np.mean(np.log(e) - order * np.log(h)))
    ends = np.array([h.min(), h.max()])
    style = look(name)
    ax.plot(ends, constant * ends**order, color=style.colour, linestyle=style.dash, linewidth=pt(1))
    return float(ends[1]), float(constant * ends[1] ** order), f"{order:.2f}", style.colour


KINDS = (
    Kind("work-precision", "work_precision", "Error against cost; one panel an error.", ("work_precision",),
         work_precision, options=("x", "y")),
    Kind("convergence", "convergence", "Error against step size; the number at a line's end is its fitted order.",
         ("convergence_points",), convergence, ("convergence",), picks="variable"),
)  # fmt: skip
