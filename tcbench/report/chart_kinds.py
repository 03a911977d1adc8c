"""Which charts there are, tcbench's own and those of plugins: what `tcbench plot` and the report have in common."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import plugins
from ..chart import Chart, Tables
from ..errors import TcbenchError, calling, unknown_name

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@cache
def own_kinds() -> dict[str, Chart]:
    """tcbench's own charts by name: the CHARTS of each file in `charts`, the files in alphabetical order."""
    files = sorted((Path(__file__).parent / "charts").glob("[a-z]*.py"))
    modules = [importlib.import_module(f".charts.{file.stem}", __package__) for file in files]
    return {chart.name: chart for module in modules for chart in getattr(module, "CHARTS", ())}


def kinds() -> dict[str, Chart]:
    """Every chart by name, those of plugins last."""
    return own_kinds() | plugin_kinds()


def plugin_kinds() -> dict[str, Chart]:
    """The charts of plugins; one that is called like one of tcbench's own is refused, for that would be lost."""
    charts = plugins.registry().charts
    for name in set(charts).intersection(own_kinds()):
        raise TcbenchError(f"{charts[name].plugin} registers the chart {name!r}, which tcbench has. Rename it.")
    return dict(charts)


def find_kind(name: str) -> Chart:
    """The chart of this name; plugins are asked where it is not one of tcbench's own."""
    if name in own_kinds():
        return own_kinds()[name]
    if name not in kinds():
        if Path(name).is_dir():
            raise TcbenchError(f"{name!r} is a folder; the kind of chart comes first: tcbench plot KIND {name}.")
        raise unknown_name("chart", name, kinds(), *plugins.cure())
    return kinds()[name]


def draw_kind(kind: Chart, tables: Tables, **options: Any) -> Figure:
    """The chart of these tables, drawn by itself or as its panels say."""
    from .charts.render import chart

    draw: Callable[..., Any] = kind.panels if kind.name in own_kinds() else chart(kind.panels)
    with calling(f"The chart {kind.name!r} cannot be drawn"):
        figure: Figure = draw(*kind.of(tables), **options)
    return figure


def with_fallbacks(tables: Tables) -> dict[str, Any]:
    """Tables that can stand in for absent ones: blow-up times of the conservation study."""
    filled, rows = dict(tables), tables.get("conservation")
    if "stability_points" not in filled and rows is not None and "status" in rows and rows["status"].ne("ok").any():
        filled["stability_points"] = rows[rows["dt"].notna()] if "dt" in rows else rows
    return filled
