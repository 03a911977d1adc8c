"""Error against cost and against step size: work-precision and convergence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...chart import Chart, Panel, Series, Sheet
from ...studies.columns import column as column_named
from .render import chart
from .style import by_name, finite, names, numbers, ok

if TYPE_CHECKING:
    from pandas import DataFrame

ERRORS = ("error_q", "error_p", "error_s", "error_theta")
CONSERVED = "_error_max"  # how columns of what is conserved end: exactly 0 is possible, these get an axis with a zero
PRODUCED = "error_entropy_produced"  # not an error of the state: drawn where it is asked for
VARIABLES = {
    "q": "positions q",
    "p": "momenta p",
    "s": "entropies s",
    "theta": "temperatures θ",
    "all": "the whole state",
}


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
    absent = [name for name in (column, x) if name not in table]
    done = np.asarray(ok(table))
    xs, ys = numbers(table, x), numbers(table, column)
    xs.values[~(xs.values > 0)] = np.nan
    np.abs(ys.values, out=ys.values)
    usable = done & np.isfinite(xs.values) & (ys.values > (-1 if column.endswith(CONSERVED) else 0))
    note = f"The table has no column {absent[0]}." if absent else ""
    if not usable.any() and done.all():
        note = note or "no completed run has a value here"
    order = finite(table["value"]) if "value" in table else xs.values
    series = []
    for name, mine in methods.items():
        pick = mine[usable[mine]]
        pick = pick[np.argsort(-order[pick], kind="stable")]
        series.append(Series(name, xs[pick], ys[pick], crosses=xs[mine[~done[mine]]]))
    scale = "zero" if column.endswith(CONSERVED) else "log"
    return Panel(
        series, column_named(x).label, column_named(column).label, y_scale=scale, note=note, errors=True,
        x_values=xs, y_values=ys[usable],
    )  # fmt: skip


def _errors(table: DataFrame) -> list[str]:
    """The errors of the variables that the system has, of its temperatures, and of what it conserves."""
    others = [str(c) for c in table if str(c).startswith("error_") and c not in ERRORS and c != PRODUCED]
    conserved = [str(c) for c in table if str(c).endswith(CONSERVED)]
    least = {c: -1 if c in conserved else 0 for c in ("error", *ERRORS, *others, *conserved)}
    return [c for c in least if c in table and (np.abs(finite(table[c])) > least[c]).any()] or ["error"]


@chart
def convergence(points: DataFrame, fits: DataFrame | None = None) -> Sheet:
    """Error against step size for one scenario, one panel a variable, with the fitted slopes.

    points : rows of `convergence_points`; fits : rows of `convergence`. Filled markers are in the fit, hollow ones were
    dropped (round-off, reference, too coarse), crosses failed. The number at the end of a line is its fitted order.
    """
    there = names(points, "variable")
    variables = [v for v in dict.fromkeys([*VARIABLES, *there]) if v in there] or ["all"]
    orders = _orders(fits)
    return Sheet(
        [_slopes(points[points["variable"].astype(str) == v], orders, v) for v in variables],
        size=(3.7, 2.8), hollow="not in the fit",
    )  # fmt: skip


def _orders(fits: DataFrame | None) -> dict[tuple[str, str], float]:
    """The fitted order of each variable and method."""
    if fits is None:
        return {}
    rows = fits.drop_duplicates(["variable", "integrator"])
    pairs = zip(rows["variable"].astype(str), rows["integrator"].astype(str), strict=True)
    return dict(zip(pairs, finite(rows["order"]), strict=True))


def _failed_points(points: DataFrame) -> Any:
    failed = ~np.isfinite(finite(points["error"]))
    if "reason" in points:
        return failed & points["reason"].astype(str).eq("failed").to_numpy()
    return (failed & ~np.asarray(ok(points))) if "status" in points else failed


def _slopes(part: DataFrame, orders: Mapping[tuple[str, str], float], variable: str) -> Panel:
    steps, errors = numbers(part, "dt"), numbers(part, "error")
    h, e = steps.values, errors.values
    used = part["used"].fillna(False).astype(bool).to_numpy() if "used" in part else np.ones(len(part), dtype=bool)
    failed = _failed_points(part)
    good = np.isfinite(h) & np.isfinite(e) & (e > 0)
    note = ""
    if not good.any() and not failed.any():
        note = "no error" if np.isfinite(e).any() else "no error was measured"  # 0: a variable that stays
    series: list[Series] = []
    for name, mine in by_name(part).items():
        fitted, left, lost = (mine[of[mine]] for of in (good & used, good & ~used, failed & np.isfinite(h)))
        series.append(Series(name, steps[fitted], errors[fitted], line=False, crosses=steps[lost]))
        series.append(Series(name, steps[left], errors[left], line=False, marks="hollow"))
        order = orders.get((variable, name), np.nan)
        if len(fitted) and np.isfinite(order):
            series.append(_fitted_line(name, h[fitted], e[fitted], order))
    label = column_named("error" if variable == "all" else f"error_{variable}").label
    return Panel(
        series, column_named("dt").label, label, title=VARIABLES.get(variable, variable), note=note, errors=True,
        x_values=h, y_values=e[good],
    )  # fmt: skip


def _fitted_line(name: str, h: Any, e: Any, order: float) -> Series:
    """The line of the fitted order through the used points; at its upper end the order."""
    constant = np.exp(np.mean(np.log(e) - order * np.log(h)))
    ends = np.array([h.min(), h.max()])
    return Series(name, ends, constant * ends**order, text=f"{order:.2f}", marks="")


CHARTS = (
    Chart("work-precision", "Error against cost; one panel an error.", ("work_precision",), work_precision,
          options=("x", "y"), study="work_precision"),
    Chart("convergence", "Error against step size; the number at a line's end is its fitted order.",
          ("convergence_points",), convergence, ("convergence",), picks="variable", study="convergence"),
)  # fmt: skip
