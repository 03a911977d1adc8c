"""Error against cost and against step size: work-precision and convergence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ...chart import Chart, Panel, Series, Sheet
from ...studies.columns import column as column_named
from .render import chart
from .style import by_name, finite, lines, names, numbers, ok

if TYPE_CHECKING:
    from pandas import DataFrame

ERRORS = ("error_q", "error_p", "error_s", "error_theta")
CONSERVED = "_error_max"  # how columns of what is conserved end: exactly 0 is possible, these get an axis with a zero
PRODUCED = "error_entropy_produced"  # not an error of the state: drawn where it is asked for
VARIABLES = {
    "q": "positions q", "p": "momenta p", "s": "entropies s", "theta": "temperatures θ", "all": "the whole state",
}  # fmt: skip


@chart
def work_precision(table: DataFrame, x: str = "wall_time_min_s", y: Sequence[str] | None = None) -> Sheet:
    """Error against cost for one scenario, one panel for each column in `y` (by default every error there is).

    table : rows of `work_precision`; x, y : any numeric columns. Points of a method are joined from its coarsest to
    its finest setting. Failed runs are crosses at the upper edge, those without a cost of their own at its right end;
    masked errors (NaN) of completed runs are left out.
    """
    methods = by_name(table)
    return Sheet([_cloud(table, methods, x, column) for column in y or _errors(table)])


def _cloud(table: DataFrame, methods: Mapping[str, Any], x: str, column: str) -> Panel:
    done, floor = np.asarray(ok(table)), -1 if column.endswith(CONSERVED) else 0
    xs, ys = numbers(table, x), numbers(table, column)
    xs.values[~(xs.values > 0)] = np.nan
    np.abs(ys.values, out=ys.values)
    usable = done & np.isfinite(xs.values) & (ys.values > floor)
    order = -finite(table["value"]) if "value" in table else -xs.values
    return Panel(
        lines(methods, xs, ys, usable, order, ~done), column_named(x).label, column_named(column).label,
        y_scale="zero" if floor else "log", errors=True, x_values=xs, y_values=ys[usable],
        note="" if usable.any() or not done.all() else "no completed run has a value here",
    )  # fmt: skip


def _errors(table: DataFrame) -> list[str]:
    """The errors of the variables that the system has, of its temperatures, and of what it conserves."""
    others = [str(c) for c in table if str(c).startswith("error_") and c not in ERRORS and c != PRODUCED]
    conserved = [str(c) for c in table if str(c).endswith(CONSERVED)]
    floors = {c: -1 if c in conserved else 0 for c in ("error", *ERRORS, *others, *conserved)}
    return [c for c in floors if c in table and (np.abs(finite(table[c])) > floors[c]).any()] or ["error"]


@chart
def tolerance(table: DataFrame) -> Sheet:
    """The error of the state against the tolerance for one scenario, and on a line of its own what was asked for; then
    against the step, of methods that have one."""
    panels = []
    for control, title in (("rtol", "solvers with a tolerance; black: what was asked for"), ("dt", "fixed steps")):
        part = table[table["control"].astype(str) == control].reset_index(drop=True)
        if len(part):
            panel = _cloud(part, by_name(part), "value", "error")
            ends = np.array([part["value"].min(), part["value"].max()])
            asked = [Series("what is asked for", ends, ends, marks="", plain=True)] if control == "rtol" else []
            label = "tolerance" if control == "rtol" else column_named("dt").label
            panels.append(replace(panel, series=[*asked, *panel.series], x=label, title=title))
    return Sheet(panels or [Panel((), "tolerance", column_named("error").label, note="no run has an error")])


@chart
def convergence(points: DataFrame, fits: DataFrame | None = None) -> Sheet:
    """Error against step size for one scenario, one panel a variable, with the fitted slopes.

    points : rows of `convergence_points`; fits : rows of `convergence`. Filled markers are in the fit, hollow ones were
    dropped (round-off, reference, too coarse), crosses failed. The number at the end of a line is its fitted order.
    """
    measured = names(points, "variable")
    variables = [v for v in dict.fromkeys([*VARIABLES, *measured]) if v in measured] or ["all"]
    first = None if fits is None else fits.drop_duplicates(["variable", "integrator"])
    orders = {} if first is None else first.set_index(["variable", "integrator"])["order"].to_dict()
    shown = [_slopes(points[points["variable"].astype(str) == v], orders, v) for v in variables]
    return Sheet(shown, size=(3.7, 2.8), hollow="not in the fit")


def _slopes(part: DataFrame, orders: Mapping[Any, float], variable: str) -> Panel:
    h, e, methods = numbers(part, "dt"), numbers(part, "error"), by_name(part)
    used = part["used"].fillna(False).astype(bool).to_numpy() if "used" in part else np.ones(len(part), dtype=bool)
    lost = np.isnan(e.values) & np.isfinite(h.values)
    lost &= np.asarray(part["reason"].astype(str).eq("failed")) if "reason" in part else ~np.asarray(ok(part))
    good, series = np.isfinite(h.values) & (e.values > 0), list[Series]()
    filled = lines(methods, h, e, good & used, failed=lost, line=False)
    hollow = lines(methods, h, e, good & ~used, line=False, marks="hollow")
    for one, left in zip(filled, hollow, strict=True):
        order = float(finite([orders.get((variable, one.name))])[0])
        series += [one, left, *([_fitted_line(one, order)] if len(one.x) and np.isfinite(order) else [])]
    note = "" if good.any() or lost.any() else "no error" if np.isfinite(e.values).any() else "no error was measured"
    label = column_named("error" if variable == "all" else f"error_{variable}").label
    return Panel(
        series, column_named("dt").label, label, title=VARIABLES.get(variable, variable), note=note, errors=True,
        x_values=h, y_values=e[good],
    )  # fmt: skip


def _fitted_line(points: Series, order: float) -> Series:
    """The line of the fitted order through the used points; at its upper end the order."""
    h, e = np.asarray(points.x), np.asarray(points.y)
    constant, ends = np.exp(np.mean(np.log(e) - order * np.log(h))), np.array([h.min(), h.max()])
    return Series(points.name, ends, constant * ends**order, text=f"{order:.2f}", marks="")


CHARTS = (
    Chart("work-precision", "Error against cost; one panel an error.", ("work_precision",), work_precision,
          options=("x", "y"), study="work_precision"),
    Chart("tolerance", "What a tolerance buys, and a step: the error of the state against each.", ("tolerance",),
          tolerance, study="tolerance"),
    Chart("convergence", "Error against step size; the number at a line's end is its fitted order.",
          ("convergence_points",), convergence, ("convergence",), picks="variable", study="convergence"),
)  # fmt: skip
