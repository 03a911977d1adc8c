"""Charts as data for the page: the panels that pictures draw, as JSON that `templates/panels.js` draws."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import plugin_loading, plugins
from ..chart import Chart, Panel, Row, Series, Sheet
from ..engine.child import ask
from ..errors import TcbenchError
from ..store.store import Store
from ..store.tables import read_tables
from ..studies.columns import column
from .chart_kinds import own_kinds, with_fallbacks
from .charts import theme
from .charts.render import leading, span
from .charts.style import finite
from .matrix import families

if TYPE_CHECKING:
    from pandas import DataFrame

DIGITS = 4


def page_charts(folder: Path, tables: Mapping[str, Any], declared: Mapping[str, Any], problems: list[str]) -> Any:
    """Chart -> its text, its first table, and its panels by scenario ("" for a chart of all).

    Plugins that are not tcbench's own are imported in another process, unless this one has imported them already.
    problems : sentences on charts of plugins that cannot be drawn are appended.
    """
    found = panels_of(own_kinds().values(), tables, declared, problems)
    if not plugin_loading.are_foreign(plugins.plugin_folders()):
        return found
    if not plugins.waiting_to_be_imported():
        return found | panels_of(plugins.registry().charts.values(), tables, declared, problems)
    try:
        others, told = ask(f"{__name__}:of_plugins", str(folder), list(map(str, plugins.plugin_folders())))
    except (TcbenchError, RuntimeError) as error:
        others, told = {}, [f"Charts of plugins are not on the page: {error}"]
    problems += told
    return found | others


def of_plugins(folder: str, folders: Iterable[str]) -> str:
    """The charts of plugins, of a run folder, and problems, as JSON; in a process of its own."""
    plugins.only_look_up(folders)
    if not (charts := plugins.registry().charts):
        return "[{}, []]"
    store, problems = Store.read(folder), list[str]()
    return json.dumps([panels_of(charts.values(), read_tables(store), store.declared(), problems), problems])


def panels_of(
    charts: Iterable[Chart], tables: Mapping[str, Any], declared: Mapping[str, Any], problems: list[str]
) -> dict[str, Any]:
    """As `page_charts`, of these; what is a picture alone is left out."""
    found = {}
    known = {name: table.reset_index(drop=True) for name, table in with_fallbacks(tables).items()}
    with theme.using(theme.Theme(families=families(tables, declared))):
        for chart in charts:
            try:
                of = _sheets(chart, known) if chart.possible(known) and not chart.picture else {}
            except Exception as error:  # a plugin's function may raise anything
                problems.append(f"The chart {chart.name!r} is not on the page: {type(error).__name__}: {error}")
                continue
            if of:
                found[chart.name] = {"text": chart.text, "table": chart.needs[0], "of": of}
    return found


def _sheets(chart: Chart, tables: Mapping[str, Any]) -> dict[str, list[dict[str, Any]]]:
    draw, found, told = getattr(chart.panels, "__wrapped__", chart.panels), {}, Told(tables[chart.needs[0]])
    for scenario in chart.scenarios(tables):
        panels = draw(*chart.of(chart.select(tables, scenario)))
        if not hasattr(panels, "savefig"):
            shown = panels.panels if isinstance(panels, Sheet) else panels
            found[scenario or ""] = [_panel(panel, told) for panel in shown]
    return found


def _panel(panel: Panel, told: Told) -> dict[str, Any]:
    front = None if panel.rank is None else leading(panel)
    return _shown({
        "title": panel.title, "note": panel.note, "errors": panel.errors, "stepped": panel.stepped,
        "largest": panel.largest, "keys": dict(panel.keys), "fore": front,
        "x": _axis(panel, "x", panel.x, panel.x_scale), "y": _axis(panel, "y", panel.y, panel.y_scale),
        "series": [_series(one, told) for one in panel.series], "rows": [_row(one, told) for one in panel.rows],
    })  # fmt: skip


def _shown(parts: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in parts.items() if value not in ([], {}, "", False)}


def _axis(panel: Panel, which: str, label: str, scale: str) -> dict[str, Any]:
    """Its label, its scale, the least and the largest number that this can show, and which way is better."""
    known = span(panel, which)
    known = known[(known > 0) if scale in ("log", "zero") else np.isfinite(known)]
    domain = [float(known.min()), float(known.max())] if len(known) else None
    values = [getattr(one, which) for one in panel.series[:1]]
    values += [places for row in panel.rows for places in row.marks.values() if which == "x"]
    worse = next((column(str(of.name)).worse for of in values if hasattr(of, "name")), "")
    better = {"": "", "lower": "more"}.get(worse, "less")
    return _shown({"label": label, "scale": scale, "better": better}) | {
        "domain": [-0.02, 1.02] if scale == "share" else domain
    }


def _series(one: Series, told: Told) -> dict[str, Any]:
    at, failed = told.places(one.x), told.places(one.crosses)
    numbers = {name: told.numbers(getattr(one, name), at) for name in ("x", "y", "low", "high")}
    rest = {name: getattr(one, name) for name in ("name", "text", "line", "marks", "plain", "ended")}
    return _shown(numbers | {"at": at, "failed": failed, "crosses": told.numbers(one.crosses, failed)} | rest)


def _row(one: Row, told: Told) -> dict[str, Any]:
    marks = [[mark, at := told.places(x), told.numbers(x, at)] for mark, x in one.marks.items()]
    ends = {"bar": told.numbers(one.bar or (), []), "dotted": told.numbers([one.dotted], [])[0] or ""}
    return _shown({"name": one.name, "marks": marks, "text": one.text, "hollow": one.hollow} | ends)


class Told:
    """What the page has of a chart's first table already."""

    def __init__(self, table: DataFrame) -> None:
        self.rows = len(table)
        self.column = cache(lambda name: finite(table[name]) if name in table and column(name).shown else None)

    def places(self, values: Any) -> list[int]:
        """The rows that a column is of, each as its distance from the one before; -n is n times 1."""
        rows = values.index.to_numpy() if len(values) and hasattr(values, "name") else np.array([""])
        if rows.dtype.kind != "i" or rows.min() < 0 or rows.max() >= self.rows:
            return []
        steps = np.diff(rows, prepend=0)
        runs = np.split(steps, np.flatnonzero(np.diff(steps)) + 1)
        return [n for run in runs for n in ([-len(run)] if run[0] == 1 and len(run) > 1 else run.tolist())]

    def numbers(self, values: Any, at: list[int]) -> Any:
        """A column of the table by its name, where these rows of it say the same; else the numbers."""
        found = finite(values)
        known = self.column(str(values.name)) if at and self.places(values) == at else None
        if known is not None and np.array_equal(found, known[values.index], equal_nan=True):
            return str(values.name)
        return [float(f"{value:.{DIGITS}g}") if value == value else None for value in found.tolist()]
