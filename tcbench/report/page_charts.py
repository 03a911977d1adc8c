"""Charts as data for the page: the panels that pictures draw, as JSON that `templates/panels.js` draws."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import cache
from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..chart import Chart, Panel, Row, Series, sheet_of
from ..errors import TcbenchError, blamed
from ..studies.base import table_schemas
from ..studies.columns import column
from ..table import Table
from .charts import theme
from .charts.render import leading, span, with_note
from .charts.style import finite
from .page_data import families

if TYPE_CHECKING:
    from pandas import DataFrame

DIGITS = 4
NOWHERE = np.array([], dtype=int)  # rows of what is no column of the table


def panels_of(
    charts: Iterable[Chart], tables: Mapping[str, Any], declared: Mapping[str, Any], problems: list[str]
) -> dict[str, Any]:
    """Chart -> its text, its first table, and its panels by scenario ("" for a chart of all); no pictures.

    problems : sentences on charts of plugins that cannot be drawn are appended.
    """
    content, schemas = {}, table_schemas(declared)
    indexed = {name: table.reset_index(drop=True) for name, table in tables.items()}
    parts = cache(lambda name: {str(scenario): rows for scenario, rows in indexed[name].groupby("scenario")})

    def part(name: str, scenario: str | None) -> Any:
        if scenario is None or "scenario" not in indexed.get(name, ()):
            return indexed.get(name)
        return parts(name).get(scenario, indexed[name].iloc[:0])

    with theme.using(theme.Theme(families=families(tables, declared))):
        for chart in charts:
            try:
                own = tuple(schemas[name] for name in (*chart.needs, *chart.also) if name in schemas)
                of = _sheets(chart, indexed, part, own) if chart.possible(indexed) and not chart.picture else {}
            except MemoryError:
                raise
            except Exception as error:  # of a plugin's function
                why = str(error) if isinstance(error, TcbenchError) else f"{blamed(error)}."
                problems.append(f"The chart {chart.name!r} is not on the page: {why}")
                continue
            if of:
                content[chart.name] = {"text": chart.text, "table": chart.needs[0], "of": of}
    return content


def _sheets(
    chart: Chart, tables: Mapping[str, Any], part: Callable[..., Any], schemas: tuple[Table, ...]
) -> dict[str, list[dict[str, Any]]]:
    """Its panels by scenario. part : (name of a table, scenario) -> its rows, as `Chart.select`, of all charts."""
    draw, shown = getattr(chart.panels, "__wrapped__", chart.panels), {}
    page = PageTable(tables[chart.needs[0]], schemas)
    for scenario in chart.scenarios(tables):
        panels = draw(*(part(name, scenario) for name in (*chart.needs, *chart.also)))
        if not hasattr(panels, "savefig"):
            shown[scenario or ""] = [_panel(with_note(panel), page) for panel in sheet_of(panels).panels]
    return shown


def _panel(panel: Panel, page: PageTable) -> dict[str, Any]:
    front = None if panel.rank is None else leading(panel)
    return _shown({
        "title": panel.title, "note": panel.note, "errors": panel.errors, "stepped": panel.stepped,
        "largest": panel.largest, "keys": dict(panel.keys), "fore": front,
        "x": _axis(panel, "x", panel.x_scale, page), "y": _axis(panel, "y", panel.y_scale, page),
        "series": [_series(one, page) for one in panel.series], "rows": [_row(one, page) for one in panel.rows],
    })  # fmt: skip


def _shown(parts: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in parts.items() if value not in ([], {}, "", False)}


def _axis(panel: Panel, which: str, scale: str, page: PageTable) -> dict[str, Any]:
    """Its label, its scale, the least and the largest number that this can show, and which way is better."""
    numbers = span(panel, which)
    numbers = numbers[(numbers > 0) if scale in ("log", "zero") else np.isfinite(numbers)]
    domain = [float(numbers.min()), float(numbers.max())] if len(numbers) else None
    values = [getattr(one, which) for one in panel.series[:1]]
    values += [places for row in panel.rows for places in row.marks.values() if which == "x"]
    worse = next((column(str(of.name), *page.schemas).worse for of in values if hasattr(of, "name")), "")
    better = {"": "", "lower": "more"}.get(worse, "less")
    return _shown({"label": getattr(panel, which), "scale": scale, "better": better}) | {
        "domain": [-0.02, 1.02] if scale == "share" else domain
    }


def _series(one: Series, page: PageTable) -> dict[str, Any]:
    rows, failed = page.rows(one.x), page.rows(one.crosses)
    parts = {name: page.numbers(getattr(one, name), rows) for name in ("x", "y", "low", "high")}
    parts |= {"at": steps(rows), "failed": steps(failed), "crosses": page.numbers(one.crosses, failed)}
    return _shown(parts | {name: getattr(one, name) for name in ("name", "text", "line", "marks", "plain", "ended")})


def _row(one: Row, page: PageTable) -> dict[str, Any]:
    marks = [[mark, steps(rows := page.rows(x)), page.numbers(x, rows)] for mark, x in one.marks.items()]
    ends = {"bar": page.numbers(one.bar or (), NOWHERE), "dotted": page.numbers([one.dotted], NOWHERE)[0] or ""}
    return _shown({"name": one.name, "marks": marks, "text": one.text, "hollow": one.hollow} | ends)


def steps(rows: NDArray[Any]) -> list[int]:
    """Rows, each as its distance from the one before; -n is n times 1."""
    runs = [(step, len(list(run))) for step, run in groupby(np.diff(rows, prepend=0).tolist())]
    return [n for step, count in runs for n in ([-count] if step == 1 and count > 1 else [step] * count)]


class PageTable:
    """What the page has of a chart's first table already."""

    def __init__(self, table: DataFrame, schemas: tuple[Table, ...]) -> None:
        self.count, self.schemas = len(table), schemas
        self.column = cache(lambda n: finite(table[n]) if n in table and column(n, *schemas).shown else None)

    def rows(self, values: Any) -> NDArray[Any]:
        """Those of the table that a column is of; NOWHERE if it is none of its columns."""
        rows = np.asarray(values.index) if len(values) and hasattr(values, "name") else NOWHERE
        is_index = len(rows) and rows.dtype.kind == "i" and rows.min() >= 0 and rows.max() < self.count
        return rows if is_index else NOWHERE

    def numbers(self, values: Any, rows: NDArray[Any]) -> Any:
        """A column of the table by its name, where these rows of it say the same; else the numbers."""
        floats = finite(values)
        stored = self.column(str(values.name)) if len(rows) and np.array_equal(self.rows(values), rows) else None
        if stored is not None and np.array_equal(floats, stored[rows], equal_nan=True):
            return str(values.name)
        return [float(f"{value:.{DIGITS}g}") if value == value else None for value in floats.tolist()]
