"""`draw` and `plot`: one chart of a run folder, of tables or of trajectories, as a Figure or as PNG, SVG or PDF."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from ..chart import OPENING, RUNS, Chart, of_scenario
from ..errors import TcbenchError, expect, needs_folder, several, shown, unknown_name, writing
from ..files import written
from .chart_kinds import draw_kind, find_kind, with_fallbacks
from .charts import layout, theme
from .highlight import leaders
from .page_data import families, names

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from pandas import DataFrame

    from ..simulation.trajectory import Trajectory

    Source: TypeAlias = str | Path | DataFrame | Mapping[str, DataFrame] | Trajectory | Iterable[Trajectory]

MAPS = ("map", "failure_map")  # tables that a command of their own makes, for it asks for their axes
SUFFIXES = (".png", ".svg", ".pdf")
FITTING = (9.0, 8.0, 7.0, 6.0, 5.0)  # points: the first in which a chart fits a size that was asked for


def plot(kind: str, data: Source, output: str | Path, **options: Any) -> Path:
    """Write one chart; its format is the suffix of `output` (.png, .svg or .pdf; the last two are vectors).

    kind, data, options : as of `draw`. Raises TcbenchError as it does, and for an unknown suffix.
    """
    path = checked_output(output)
    return save(draw(kind, data, **options), path)


KINDS_OF_ARGUMENTS = {
    "kind": "a word", "scenario": "a word or nothing", "methods": "a word or words or a mapping or nothing",
    "x": "a word or nothing", "y": "a word or words or nothing", "dt": "a number or nothing",
    "size": "a word or numbers or nothing", "font_size": "a number or nothing",
    "style": "a path or a mapping or nothing",
}  # fmt: skip


def draw(
    kind: str,
    data: Source,
    ax: Axes | None = None,
    *,
    scenario: str | None = None,
    methods: str | Sequence[str] | Mapping[str, str] | None = None,
    x: str | None = None,
    y: str | Sequence[str] | None = None,
    dt: float | None = None,
    size: str | Sequence[float] | None = None,
    font_size: float | None = None,
    style: str | Path | Mapping[str, Any] | None = None,
) -> Figure:
    """A chart as a matplotlib Figure, to change and to save; nothing is written, and a notebook shows it.

    Parameters
    ----------
    kind : str
        A name of `tcbench plot`.
    data : str, Path, DataFrame, mapping of str to DataFrame, Trajectory or iterable of Trajectory
        The folder of a run; a table, such as results.tables["work_precision"], or several by name where the chart takes
        several; trajectories, of shape (m, n) each, for laws, four-panel and path.
    ax : Axes, optional
        Draw into this one (charts of one panel; `y` chooses one) and return its Figure.
    scenario : str, optional
        Needed where the data have several.
    methods : str, sequence of str or mapping of str to str, optional
        Only these, in this order; a mapping, or a str as on the command line, "tc_strang=Strang,gauss2", says what to
        write for each.
    x, y : str, or sequence of str; optional
        Columns; `y` of charts whose panels are variables, laws or measures: these.
    dt : float, optional
        Of laws, four-panel and path: the runs of this step only, in the scenario's dimensionless time.
    size : str or (float, float), optional
        Of the figure: in inches, or "15x10cm".
    font_size : float, optional
        In points; 9 by default, or down to 5 what fits into that size.
    style : str, Path or mapping, optional
        A matplotlib style, its file, its name or its settings, over what your own matplotlibrc sets.

    Returns
    -------
    Figure
        Not known to pyplot, so that it need not be closed.

    Raises
    ------
    TcbenchError
        For an unknown kind, scenario, method, column or style, for what the data do not have, and for a size too small
        for the panels.

    References
    ----------
    docs/gallery.md shows every kind.
    """
    from ..runner.tables import only

    expect("draw", locals(), KINDS_OF_ARGUMENTS)
    chosen = find_kind(kind)
    if ax is not None and size is not None:
        raise TcbenchError("An Axes has the size of its figure: give ax or size, not both.")
    wanted = theme.theme_of(methods, size, font_size, style, ax)
    tables, declared = _tables(chosen, data, dt)
    if not chosen.possible(tables):
        raise TcbenchError(_absent(chosen, tables))
    looks: dict[str, Any] = {
        "looks": run_looks(tables),
        "fore": leaders(tables, declared),
        "families": families(tables, declared),
    }
    tables = only(tables, "integrator", list(wanted.labels))
    shown = chosen.select(tables, _scenario(chosen, tables, scenario))
    shown, options = _columns(chosen, shown, x, [y] if isinstance(y, str) else list(y or ()))
    sizes: Sequence[float | None] = (None,) if size is None or "font.size" in wanted.settings else FITTING
    for points in sizes:
        settings = wanted.settings if points is None else {**wanted.settings, "font.size": points}
        try:
            with theme.using(replace(wanted, settings=settings, **looks)):
                return draw_kind(chosen, shown, **options)
        except layout.TooSmall:
            if points == sizes[-1]:
                raise
    raise AssertionError("one size at least is tried")


def _columns(
    kind: Chart, tables: dict[str, DataFrame], x: str | None, y: Sequence[str]
) -> tuple[dict[str, DataFrame], dict[str, Any]]:
    """The tables of the panels in y, and the options x and y of the charts that take them as columns of numbers."""
    from pandas.api.types import is_numeric_dtype

    able = (*kind.options, *(["y"] if kind.picks else []))
    for name, columns in (("x", x), ("y", y)):
        if columns and name not in able:
            options = ", ".join(able) or "none"
            raise TcbenchError(f"The chart {kind.name!r} has no option {name}; those that it has: {options}.")
    table = tables[kind.needs[0]]
    if kind.picks and y:
        picked = table[kind.picks].astype(str)
        for value in {*y}.difference(picked):
            raise unknown_name(f"{kind.picks} of this run", value, picked.unique())
        return tables | {kind.needs[0]: table[picked.isin(y)]}, {}
    for column in [*y, *([x] if x else [])]:
        if column not in table:
            raise unknown_name("column", str(column), [str(c) for c in table.columns])
        if not is_numeric_dtype(table[column]):
            raise TcbenchError(f"The column {column!r} has no numbers to draw.")
    return tables, ({"x": x} if x else {}) | ({"y": tuple(y)} if y else {})


def checked_output(output: str | Path) -> Path:
    """The path, if its suffix is one that can be written and its folder exists."""
    path = Path(output)
    if path.suffix.lower() not in SUFFIXES:
        raise TcbenchError(f"Charts are written as {', '.join(SUFFIXES)}, not {path.suffix or 'without a suffix'!r}.")
    needs_folder(path)
    return path


def save(figure: Figure, path: Path) -> Path:
    """Write a figure: complete or not at all, and the same bytes for the same figure."""
    import matplotlib

    fonts = {k: v for k, v in theme.STYLE.items() if not k.startswith("figure")} | {"pdf.fonttype": 42}
    metadata: dict[str, Any] = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(path.suffix.lower(), {})
    with writing(repr(str(path))), written(path) as temporary, matplotlib.rc_context(fonts):
        figure.savefig(temporary, dpi=160, metadata=metadata)
    return path


def run_looks(tables: Mapping[str, DataFrame]) -> dict[str, Any]:
    """How each method of a run is drawn: in every chart and on the page the same."""
    from .charts.style import looks

    return looks(names(tables, "integrator"))


def _tables(kind: Chart, data: Source, dt: float | None) -> tuple[dict[str, DataFrame], dict[str, Any]]:
    """The tables of what was given, and what its folder declares of its methods."""
    from pandas import DataFrame

    from ..runner.rows import Store
    from ..runner.tables import read_tables
    from ..simulation import series
    from ..simulation.trajectory import Trajectory

    declared: dict[str, Any] = {}
    if isinstance(data, str | Path):
        store = Store.read(data)
        data, declared = read_tables(store), dict(store.declared())
    if isinstance(data, DataFrame | Mapping):
        tables = with_fallbacks({kind.needs[0]: data} if isinstance(data, DataFrame) else data)
    elif not _of_runs(kind):
        raise TcbenchError(f"The chart {kind.name!r} shows the tables of a run: give its folder, not trajectories.")
    else:
        runs: list[Any] = [data] if isinstance(data, Trajectory) or not several(data) else list(data)
        for run in runs:
            if not isinstance(run, Trajectory):
                raise TcbenchError(
                    f"What is drawn is a run folder, tables, or what simulate returns, not {shown(run)}."
                )
        tables = dict.fromkeys((RUNS, OPENING), series.trajectories(runs))
    return (_at_step(tables, dt) if _of_runs(kind) else tables), declared


def _of_runs(kind: Chart) -> bool:
    return bool({RUNS, OPENING} & set(kind.needs))


def _at_step(tables: dict[str, DataFrame], dt: float | None) -> dict[str, DataFrame]:
    """The runs in time of one step; all if none is named."""
    import numpy as np

    if dt is None or RUNS not in tables:
        return tables
    steps = sorted({float(v) for v in tables[RUNS].get("dt", ()) if v == v})
    if not np.isclose(steps, dt, rtol=1e-9).any():
        kept = ", ".join(f"{step:g}" for step in steps) or "none"
        raise TcbenchError(f"No run of dt = {dt:g} was kept in time; this run has {kept}.")
    near = {n: np.isclose(t["dt"].astype(float), dt, rtol=1e-9) for n, t in tables.items() if n in (RUNS, OPENING)}
    return tables | {name: tables[name][rows] for name, rows in near.items()}


def _absent(kind: Chart, tables: dict[str, DataFrame]) -> str:
    if _of_runs(kind):
        return (
            f"The chart {kind.name!r} shows runs in time, and this folder keeps none: the study conservation does, at "
            "each scenario's own step. Run it, or pass results of tcbench.simulate instead."
        )
    missing = next(name for name in kind.needs if name not in tables or not len(tables[name]))
    command = "map INTEGRATOR SCENARIO" if missing in MAPS else f"run --study {kind.study}"
    remedy = f" tcbench {command} makes it." if kind.study else ""
    lack = f"The chart {kind.name!r} needs the table {missing!r}, which this run has not."
    return f"{lack} Its tables: {', '.join(tables) or 'none'}.{remedy}"


def _scenario(kind: Chart, tables: dict[str, DataFrame], scenario: str | None) -> str | None:
    """The scenario to draw: the one asked for, or the only one there is."""
    choices = [name for name in kind.scenarios(tables) if name is not None]
    if not choices and scenario is not None:  # a chart of all
        tables |= {name: of_scenario(tables[name], scenario) for name in kind.needs}
    elif choices and scenario is None and len(choices) > 1:
        raise TcbenchError(f"Which scenario? This run has {', '.join(choices)}.")
    elif choices and scenario not in (None, *choices):
        raise unknown_name("scenario of this run", str(scenario), choices)
    return (scenario or choices[0]) if choices else None
