"""`plot`: one chart of a run folder, or of trajectories, as PNG, SVG or PDF."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import TcbenchError, unknown_name
from ..files import replacing
from .chart_kinds import OPENING, SERIES, Kind, find_kind, of_scenario, with_fallbacks
from .charts.theme import Theme, own_settings, using

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from pandas import DataFrame

    from ..simulation.trajectory import Trajectory

SUFFIXES = (".png", ".svg", ".pdf")


def plot(
    kind: str,
    source: str | Path | Trajectory | Iterable[Trajectory],
    output: str | Path,
    *,
    scenario: str | None = None,
    integrators: Sequence[str] | None = None,
    x: str | None = None,
    y: Sequence[str] | None = None,
    dt: float | None = None,
    theme: Theme | None = None,
) -> Path:
    """Write one chart; its format is the suffix of `output` (.png, .svg or .pdf; the last two are vectors).

    kind : a name of `chart_kinds.kinds()`. source : the folder of a run, or trajectories (for laws, four-panel, path).
    scenario : needed where the run has several. integrators : only these. x, y : columns, of work-precision (x and y)
    and conservation (x). dt : of laws, four-panel and path, the runs of this step only. theme : sizes, fonts, order and
    names of methods; the user's own matplotlibrc counts.

    Raises TcbenchError for an unknown kind, scenario, integrator or suffix, and for tables that the run does not have.
    """
    from ..store.tables import only

    chosen = find_kind(kind)
    path = checked_output(output)
    tables = _tables(chosen, source, scenario, dt)
    if not chosen.possible(tables):
        raise TcbenchError(_absent(chosen, tables))
    theme = theme or Theme()
    tables = only(tables, "integrator", integrators or list(theme.labels))
    shown = _scenario(chosen, tables, scenario)
    options = _columns(chosen, tables[chosen.needs[0]], x, y)
    theme = replace(theme, settings={**own_settings(), **theme.settings})
    with using(theme):
        return save(chosen.draw(chosen.select(tables, shown), **options), path)


def draw(
    kind: str, table: DataFrame | Mapping[str, DataFrame], ax: Axes | None = None, *, scenario: str | None = None,
    x: str | None = None, y: Sequence[str] | None = None, methods: Mapping[str, str] | Sequence[str] | None = None,
) -> Figure:  # fmt: skip
    """A chart of a table, as a matplotlib Figure to change and save; nothing is written.

    kind : a name of `tcbench plot`. table : a table of a run, such as results.tables["work_precision"], or several by
    name where the chart takes several. ax : draw into this Axes (charts of one panel; y= chooses one) and return its
    Figure. methods : only these, in this order; a mapping says what to write for each.

    Raises TcbenchError for what the table does not have.
    """
    from ..store.tables import only

    chosen = find_kind(kind)
    tables = dict(table) if isinstance(table, Mapping) else {chosen.needs[0]: table}
    if not chosen.possible(tables):
        raise TcbenchError(_absent(chosen, tables))
    labels = dict(methods) if isinstance(methods, Mapping) else {name: name for name in methods or ()}
    tables = only(tables, "integrator", list(labels))
    options = _columns(chosen, tables[chosen.needs[0]], x, y)
    shown = _scenario(chosen, tables, scenario)
    with using(Theme(labels=labels, axes=ax)):
        return chosen.draw(chosen.select(tables, shown), **options)


def _columns(kind: Kind, table: DataFrame, x: str | None, y: Sequence[str] | None) -> dict[str, Any]:
    """The options x and y of the charts that take them, if they are columns of numbers."""
    from pandas.api.types import is_numeric_dtype

    for name, given in (("x", x), ("y", y)):
        if given and name not in kind.options:
            there = ", ".join(kind.options) or "none"
            raise TcbenchError(f"The chart {kind.name!r} has no option {name}; those that it has: {there}.")
    options: dict[str, Any] = {"x": x} if x and "x" in kind.options else {}
    if y and "y" in kind.options:
        options["y"] = tuple(y)
    for column in [*options.get("y", ()), *([x] if "x" in options else [])]:
        if column not in table:
            raise unknown_name("column", str(column), [str(c) for c in table.columns])
        if not is_numeric_dtype(table[column]):
            raise TcbenchError(f"The column {column!r} has no numbers to draw.")
    return options


def checked_output(output: str | Path) -> Path:
    """The path, if its suffix is one that can be written and its folder exists."""
    path = Path(output)
    if path.suffix.lower() not in SUFFIXES:
        raise TcbenchError(f"Charts are written as {', '.join(SUFFIXES)}, not {path.suffix or 'without a suffix'!r}.")
    if not path.resolve().parent.is_dir():
        raise TcbenchError(f"The folder of {str(output)!r} does not exist; create it first.")
    return path


def save(figure: Figure, path: Path) -> Path:
    """Write a figure: complete or not at all, and the same bytes for the same figure."""
    import matplotlib

    from .charts.style import STYLE

    fonts: Any = STYLE | {"pdf.fonttype": 42}
    metadata: dict[str, Any] = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(path.suffix.lower(), {})
    try:
        with replacing(path) as temporary, matplotlib.rc_context(fonts):
            figure.savefig(temporary, dpi=160, metadata=metadata)
    except OSError as error:
        raise TcbenchError(f"{str(path)!r} cannot be written: {error.strerror or error}.") from None
    return path


def _tables(
    kind: Kind, source: str | Path | Trajectory | Iterable[Trajectory], scenario: str | None, dt: float | None
) -> dict[str, DataFrame]:
    from ..simulation import series
    from ..simulation.trajectory import Trajectory
    from ..store.tables import read_tables

    if isinstance(source, str | Path):
        tables = with_fallbacks(read_tables(source))
        return _at_step(tables, dt) if _of_runs(kind) else tables
    runs = [source] if isinstance(source, Trajectory) else list(source)
    if not _of_runs(kind):
        raise TcbenchError(f"The chart {kind.name!r} shows the tables of a run: give its folder, not trajectories.")
    return dict.fromkeys((SERIES, OPENING), series.trajectories(runs))


def _of_runs(kind: Kind) -> bool:
    return bool({SERIES, OPENING} & set(kind.needs))


def _at_step(tables: dict[str, DataFrame], dt: float | None) -> dict[str, DataFrame]:
    """The runs in time of one step; all if none is named."""
    import numpy as np

    if dt is None or SERIES not in tables:
        return tables
    steps = sorted({float(v) for v in tables[SERIES].get("dt", ()) if v == v})
    if not np.isclose(steps, dt, rtol=1e-9).any():
        there = ", ".join(f"{step:g}" for step in steps) or "none"
        raise TcbenchError(f"No run of dt = {dt:g} was kept in time; this run has {there}.")
    near = {n: np.isclose(t["dt"].astype(float), dt, rtol=1e-9) for n, t in tables.items() if n in (SERIES, OPENING)}
    return tables | {name: tables[name][rows] for name, rows in near.items()}


def _absent(kind: Kind, tables: dict[str, DataFrame]) -> str:
    if _of_runs(kind):
        return (
            f"The chart {kind.name!r} shows runs in time, and this folder keeps none: the study conservation does, at "
            "each scenario's own step. Run it, or pass results of tcbench.simulate instead."
        )
    missing = [name for name in kind.needs if name not in tables or not len(tables[name])]
    there = ", ".join(tables) or "none"
    return f"The chart {kind.name!r} needs the table {missing[0]!r}, which this run has not. Its tables: {there}."


def _scenario(kind: Kind, tables: dict[str, DataFrame], scenario: str | None) -> str | None:
    """The scenario to draw: the one asked for, or the only one there is."""
    there = kind.scenarios(tables)
    if there == [None]:
        if scenario is not None:
            for name in kind.needs:
                tables[name] = of_scenario(tables[name], scenario)
        return None
    if scenario is None:
        if len(there) == 1:
            return there[0]
        raise TcbenchError(f"Which scenario? This run has {', '.join(str(name) for name in there)}.")
    if scenario not in there:
        raise unknown_name("scenario of this run", scenario, [str(name) for name in there])
    return scenario
