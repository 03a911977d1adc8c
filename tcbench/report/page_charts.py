"""Charts as data for the page: the panels that pictures draw, as JSON that `templates/panels.js` draws."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import plugin_loading, plugins
from ..chart import Chart, Panel, Series, Sheet
from ..engine.child import ask
from ..errors import TcbenchError
from ..store.store import Store
from ..store.tables import read_tables
from .chart_kinds import own_kinds, with_fallbacks
from .leaders import front
from .matrix import families

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

OWN = ("performance-profile", "failure-share")  # that the page draws from panels; its other charts from their tables
DIGITS = 4


def page_charts(folder: Path, tables: Mapping[str, Any], declared: Mapping[str, Any], problems: list[str]) -> Any:
    """Chart -> its text, whether a plugin brought it, and its panels by scenario ("" for a chart of all).

    Plugins that are not tcbench's own are imported in another process, unless this one has imported them already.
    problems : sentences on charts of plugins that cannot be drawn are appended.
    """
    found = panels_of([own_kinds()[name] for name in OWN], tables, declared, problems)
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


def of_plugins(folder: str, folders: Iterable[str]) -> tuple[dict[str, Any], list[str]]:
    """The charts of plugins, of a run folder; in a process of its own."""
    plugins.only_look_up(folders)
    if not (charts := plugins.registry().charts):
        return {}, []
    store, problems = Store.read(folder), list[str]()
    return panels_of(charts.values(), read_tables(store), store.declared(), problems), problems


def panels_of(
    charts: Iterable[Chart], tables: Mapping[str, Any], declared: Mapping[str, Any], problems: list[str]
) -> dict[str, Any]:
    """As `page_charts`, of these; what is a picture alone is left out."""
    found, known, kind_of = {}, with_fallbacks(tables), families(tables, declared)
    for chart in charts:
        try:
            sheets = _sheets(chart, known) if chart.possible(known) else {}
            of = {name: [_panel(panel, kind_of) for panel in sheet.panels] for name, sheet in sheets.items()}
        except Exception as error:  # a plugin's function may raise anything
            problems.append(f"The chart {chart.name!r} is not on the page: {type(error).__name__}: {error}")
            continue
        if of:
            found[chart.name] = {"text": chart.text, "plugin": chart.name not in own_kinds(), "of": of}
    return found


def _sheets(chart: Chart, tables: Mapping[str, Any]) -> dict[str, Sheet]:
    draw, found = getattr(chart.panels, "__wrapped__", chart.panels), {}
    for scenario in chart.scenarios(tables):
        panels = draw(*chart.of(chart.select(tables, scenario)))
        if not hasattr(panels, "savefig"):
            found[scenario or ""] = panels if isinstance(panels, Sheet) else Sheet(list(panels))
    return found


def _panel(panel: Panel, kind_of: Mapping[str, str]) -> dict[str, Any]:
    x = panel.x_values if panel.x_values is not None else [v for one in panel.series for v in one.x]
    y = panel.y_values if panel.y_values is not None else [v for one in panel.series for v in one.y]
    rank = panel.rank
    return {
        "title": panel.title, "note": panel.note, "errors": panel.errors, "stepped": panel.stepped,
        "x": {"label": panel.x, "scale": panel.x_scale, "domain": _domain(x, panel.x_scale)},
        "y": {"label": panel.y, "scale": panel.y_scale, "domain": _domain(y, panel.y_scale)},
        "fore": None if rank is None else front({name: kind_of.get(name, "") for name in rank}, rank),
        "series": [_series(one) for one in panel.series],
    }  # fmt: skip


def _domain(values: Any, scale: str) -> list[float] | None:
    """The least and the largest number, where there is one that the scale can show."""
    from .charts.style import finite

    if scale == "share":
        return [-0.02, 1.02]
    known = finite(values)
    known = known[(known > 0) if scale in ("log", "zero") else known == known]
    return [float(known.min()), float(known.max())] if len(known) else None


def _series(one: Series) -> dict[str, Any]:
    numbers = {name: _rounded(getattr(one, name)) for name in ("x", "y", "low", "high", "crosses")}
    rest = {name: getattr(one, name) for name in ("name", "text", "line", "marks", "plain")}
    return {name: value for name, value in (numbers | rest).items() if value not in ([], "", False)}


def _rounded(values: Any) -> list[float | None]:
    from .charts.style import finite

    known: NDArray[np.float64] = finite(values)
    return [float(f"{value:.{DIGITS}g}") if value == value else None for value in known.tolist()]
