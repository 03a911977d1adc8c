"""Trajectories in time and in the plane. The tables are those of `simulation.series`."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ...chart import OPENING, RUNS, Chart, Panel, Series, Sheet
from ...errors import TcbenchError
from ...simulation.series import ENDS, variables
from ...studies.columns import column as column_named
from .layout import halo, legend, panels, pt
from .render import chart, chart_of_rows
from .style import by_name, finite, ink, numbers, short

if TYPE_CHECKING:
    from pandas import DataFrame

LAWS = {
    "energy_error": "energy: |E − E₀| / V₀",
    "entropy_fall": "entropy lost: max S so far − S",
    "angular_momentum_error": "angular momentum: |J − J₀| / |J₀|",
    "lyapunov_rise": "E − θ_ref S regained / V₀",
    "exact_error": "distance from the exact motion, relative",
}
EXTENT = [f"temperature_{end}" for end in ENDS]
MOST_OF_ARRAY = 6  # numbers of an array that have a panel each
MOST_PATHS = 12  # panels, of paths or of variables, that still can be read
MOST_LINES = 6  # of one method in one panel
GROWTH = {
    "entropy": "entropy S",
    "strain_a": "logarithmic strain, spring a", "strain_b": "logarithmic strain, spring b",
    "temperature_a": "temperature θ, spring a", "temperature_b": "temperature θ, spring b",
    "rate": "rate of rotation ω",
}  # fmt: skip
GAPS = ("entropy_gap", "strain_gap", "temperature_gap", "rotation_gap")


@chart
def laws(series: DataFrame, y: Sequence[str] | None = None) -> Sheet:
    """What several runs of one scenario lose in time: energy, entropy, every invariant, Lyapunov functional.

    series : rows of the table `series`. Magnitudes; a law that is kept exactly lies on the 0 at the foot of the axis.
    The line is the largest so far; beside it runs a thin one, the value, where runs are few. A cross ends a failed run.
    y : columns, one panel each; those above by default.
    """
    lost = [c for c in map(str, series) if c.endswith("_error") and c not in LAWS]
    titles = LAWS | {c: f"{c.removesuffix('_error').replace('_', ' ')}: |I − I₀| / |I₀|" for c in lost}
    columns = y or _measured(series, list(titles)) or ["energy_error"]
    texts = [titles.get(column, column_named(column).label) for column in columns]
    return Sheet([
        Panel(lines, column_named("t").label, "", "linear", "zero", text, errors=True, largest=True)
        for text, lines in zip(texts, _lines(series, columns), strict=True)
    ], 2, (4.9, 2.7))  # fmt: skip


@chart
def in_time(series: DataFrame) -> Sheet:
    """Each temperature and strain that moves, in time; of systems without strains each variable.

    series : rows of the table `series`, of one scenario. Of an array of more than a few numbers the mean is drawn, in
    a band from the least to the largest.
    """
    strains = _numbered(series, "strain")
    moving = [c for c in (*_numbered(series, "temperature"), *strains) if _moves(series[c])]
    arrays: dict[str, list[str]] = {}
    for column in dict.fromkeys([*moving, *([] if strains else _measured(series, variables(series)))]):
        arrays.setdefault(re.sub(r"(_[a-z]|_low|_mean|_high|[\d_,]+)$", "", column), []).append(column)
    large = {stem: of for stem, of in arrays.items() if len(of) > MOST_OF_ARRAY or of == EXTENT}
    columns = [column for stem, of in arrays.items() if stem not in large for column in of][:MOST_PATHS]
    shown = zip(columns, _lines(series, columns), strict=True)
    panels = [_plain(lines, column_named(column).label) for column, lines in shown]
    return Sheet([*panels, *(_band(series, stem, of) for stem, of in large.items())])


def _plain(lines: Sequence[Series], title: str, **more: Any) -> Panel:
    """Lines in time on a linear axis."""
    return Panel(lines, column_named("t").label, "", "linear", "linear", title, **more)


def _band(series: DataFrame, stem: str, columns: Sequence[str]) -> Panel:
    """The mean of an array in time, in a band from its least to its largest number."""
    values, t = np.array([finite(series[column]) for column in columns]), numbers(series, "t")
    low, mean, high = values if columns == EXTENT else (of(values, axis=0) for of in ENDS.values())
    lines = [
        Series(name, t[rows], mean[rows], low[rows], high[rows], marks="", ended=_failed(series, rows[-1]))
        for name, rows in _runs(series)
    ]
    count = "" if columns == EXTENT else f" of {len(columns)}"
    title = f"{stem.replace('_', ' ')}: mean{count}, least to largest"
    return _plain(lines, title, y_values=[*low, *high])


def _moves(values: Any) -> bool:
    """Whether a column changes in any run: what does not is a fact, not a line."""
    column = finite(values)
    return bool(np.nanmax(column) - np.nanmin(column) > 1e-8 * np.nanmax(np.abs(column)))


def _lines(series: DataFrame, columns: Sequence[str], magnitudes: bool = False, **more: Any) -> list[list[Series]]:
    """For each column a line a run."""
    runs, t, of = _runs(series), numbers(series, "t"), [numbers(series, column) for column in columns]
    for column in of if magnitudes else ():
        np.abs(column.values, out=column.values)
    ended = [_failed(series, rows[-1]) for _, rows in runs]
    return [
        [Series(name, t[rows], values[rows], ended=bad, **more) for (name, rows), bad in zip(runs, ended, strict=True)]
        for values in of
    ]


def _failed(series: DataFrame, last: int) -> bool:
    """Whether the run of this last row did."""
    return "status" in series and str(series["status"].iloc[last]) != "ok"


def _runs(series: DataFrame) -> list[tuple[str, Any]]:
    """The rows of each run, in order of time; several steps of one method are several runs."""
    t, steps = numbers(series, "t").values, numbers(series, "dt").values
    runs = []
    for name, rows in by_name(series).items():
        of = steps[rows]
        for step in np.unique(of):
            mine = rows[(of == step) | (np.isnan(of) & np.isnan(step))]
            runs.append((name, mine[np.argsort(t[mine], kind="stable")]))
    return runs


def _measured(series: DataFrame, columns: Sequence[str]) -> list[str]:
    """Those that have values: a table of several systems has columns of all of them."""
    return [c for c in columns if c in series and np.isfinite(finite(series[c])).any()]


def _numbered(series: DataFrame, stem: str) -> list[str]:
    return _measured(series, [str(c) for c in series.columns if str(c).startswith(f"{stem}_")])


@chart
def four_panel(series: DataFrame) -> Sheet:
    """Energy, entropy, temperatures and logarithmic strains in time, as in the paper; without strains, variables."""
    strains, moving = _numbered(series, "strain"), _measured(series, variables(series))
    rest = f", the first {MOST_LINES} of {len(moving)}" if len(moving) > MOST_LINES else ""
    groups = {"energy E": ["energy"], "entropy S": ["entropy"], "temperatures θ": _numbered(series, "temperature")}
    groups |= {"logarithmic strains": strains} if strains or not moving else {f"variables{rest}": moving[:MOST_LINES]}
    shown = []
    for title, columns in groups.items():
        lines = list[Series]()
        for column in (measured := _measured(series, columns)):
            element = f"spring {column.rpartition('_')[2]}" if strains else column_named(column).label
            lines += _lines(series, [column], marks="")[0]
            if len(measured) > 1 and lines:  # said once: the methods' lines of one element are near each other
                lines[-1] = replace(lines[-1], text=element)
        room = _roomy(numbers(series, "energy").values) if columns == ["energy"] else None
        shown.append(_plain(lines, title, note="" if lines else f"no {title} in this system", y_values=room))
    return Sheet(shown, 2, (4.9, 2.6))


def _roomy(values: Any) -> Any:
    """The range of an energy; one that is constant to round-off is a flat line, not noise that fills the panel."""
    good = values[np.isfinite(values)]
    size = max(1.0, abs(good).max(initial=0.0))
    if not len(good) or np.ptp(good) >= 1e-6 * size:
        return None
    return np.median(good) + 0.01 * size * np.array([-1.0, 1.0])


@chart_of_rows
def path(series: DataFrame) -> Figure:
    """Paths of the masses in the plane, coloured by the temperature of each one's spring; one panel a run.

    Needs positions x_1, y_1, x_2, ... (at_x_1, ... of a system with points(z)) and temperature_a, temperature_b, ...
    The start is a ring, the end a dot.
    """
    from matplotlib.collections import LineCollection

    runs, heat = _runs(series), _numbered(series, "temperature")
    drawn = "at_" if _measured(series, ["at_x_1"]) else ""
    places = [(f"{drawn}x_{i}", f"{drawn}y_{i}") for i in range(1, 10)]
    masses = [pair for pair in places if len(_measured(series, pair)) == 2]
    if runs and not (masses and heat):
        raise TcbenchError(
            "The chart 'path' shows ways in the plane and temperatures, and these runs have none: a system says where "
            "it is with points(z), and how warm with temperature(z, dE, dS)."
        )
    more, runs = len(runs) - MOST_PATHS, runs[:MOST_PATHS]
    figure, axes = panels(max(1, len(runs)), 3, (3.3, 3.1))
    every = finite(np.ravel(series[heat].to_numpy()))
    low, high = (np.nanmin(every), np.nanmax(every)) if np.isfinite(every).any() else (0.0, 1.0)
    coloured = None
    for ax, (name, rows) in zip(axes, runs, strict=False):
        run = series.iloc[rows]
        for i, (x, y) in enumerate(masses):
            points = np.column_stack([finite(run[x]), finite(run[y])])
            coloured = LineCollection(
                list(np.stack([points[:-1], points[1:]], axis=1)), cmap="cividis", rasterized=True,
                clim=(low, high if high > low else low + 1.0), linewidths=1.0 if i == 0 else 1.8,
            )  # fmt: skip
            coloured.set_array(finite(run[heat[min(i, len(heat) - 1)]])[:-1])
            ax.add_collection(coloured)
            ax.plot(*points[0], marker="o", markerfacecolor="none", color=ink(), markersize=pt(6))
            ax.plot(*points[-1], marker="o", color=ink(), markersize=pt(4))
            ax.annotate(str(i + 1), points[0], (5, 5), textcoords="offset points", fontsize=pt(7), **halo(ax))
        ax.plot(0, 0, marker="+", color=ink(), markersize=pt(8))
        ax.set_aspect("equal", adjustable="datalim")
        ax.autoscale_view()
        ax.set_title(short(name), loc="left")
        ax.set(xlabel="x", ylabel="y")
    if coloured is not None:
        figure.colorbar(coloured, ax=axes, label="temperature θ of its spring", shrink=0.8)
    if more > 0:
        legend(figure, [], [Line2D([], [], linestyle="none", label=f"{more} more runs are not drawn")])
    return figure


@chart
def equilibrium(table: DataFrame, summary: DataFrame | None = None) -> Sheet:
    """Gaps to the exact equilibrium in time, for one scenario, one panel a measure.

    table : rows of `equilibrium`. Where it has no gaps, because the equilibrium is distant, the measures themselves are
    drawn: a strain that grows like ln t is a straight line. summary : rows of `equilibrium_summary`; the exact values
    become lines where they are within sight.
    """
    gaps, shown = _measured(table, GAPS), []
    columns = gaps or _measured(table, list(GROWTH))
    for column, lines in zip(columns, _lines(table, columns, magnitudes=bool(gaps)), strict=True):
        scale = "linear" if not gaps else "zero" if (finite(table[column]) == 0).any() else "log"
        lines += [] if gaps else _exact(table, column, summary)
        title = GROWTH.get(column, column_named(column).label)
        shown.append(Panel(lines, column_named("t").label, "", y_scale=scale, title=title, errors=bool(gaps)))
    return Sheet(shown or [Panel([], "", "", note="no gap was measured")], 2, (4.9, 2.6))


def _exact(table: DataFrame, column: str, summary: DataFrame | None) -> list[Series]:
    """A line at the value of the exact equilibrium, unless it lies beyond what the runs reached."""
    exact = "exact_temperature" if column.startswith("temperature") else f"exact_{column}"
    exact_values = finite(() if summary is None or exact not in summary else summary[exact].dropna())[:1]
    t, seen = finite(table["t"]), finite(table[column])
    room, ends = 0.25 * np.ptp(seen[np.isfinite(seen)]), (np.nanmin(t), np.nanmax(t))
    near = [v for v in exact_values if np.nanmin(seen) - room <= v <= np.nanmax(seen) + room]
    return [Series("exact", ends, (v, v), marks="", text="exact", plain=True) for v in near]


CHARTS = (
    Chart("laws", "Losses in time, at the scenario's own step; on the 0 a law is kept exactly.", (RUNS,), laws,
          options=("y",), study="conservation"),
    Chart("in-time", "Each temperature, strain or variable in time.", (RUNS,), in_time, study="conservation"),
    Chart("four-panel", "Energy, entropy, temperatures, and strains (or variables) in time.", (RUNS,), four_panel,
          study="conservation", picture=True),
    Chart("path", "Paths of the masses in the plane over the first steps, coloured by temperature.", (OPENING,), path,
          study="conservation", picture=True),
    Chart("equilibrium", "Distance to the exact equilibrium in time.", ("equilibrium",), equilibrium,
          ("equilibrium_summary",), study="equilibrium"),
)  # fmt: skip
