"""Which charts there are and which tables each needs: what `tcbench plot` and the report have in common."""

from __future__ import annotations

import importlib
from functools import cache
from pathlib import Path
from typing import Any

from ..errors import unknown_name
from .charts.kind import OPENING, SERIES, Kind, Tables, of_scenario

__all__ = ["OPENING", "SERIES", "Kind", "Tables", "find_kind", "kinds", "of_scenario", "with_fallbacks"]


@cache
def kinds() -> dict[str, Kind]:
    """Every kind of chart by name: the KINDS of each file in `charts`, the files in alphabetical order."""
    files = sorted((Path(__file__).parent / "charts").glob("[a-z]*.py"))
    modules = [importlib.import_module(f".charts.{file.stem}", __package__) for file in files]
    return {kind.name: kind for module in modules for kind in getattr(module, "KINDS", ())}


def find_kind(name: str) -> Kind:
    if name not in kinds():
        raise unknown_name("chart", name, kinds())
    return kinds()[name]


def with_fallbacks(tables: Tables) -> dict[str, Any]:
    """Tables that can stand in for absent ones: blow-up times of the conservation study."""
    known = dict(tables)
    if "stability_points" not in known and "conservation" in known:
        rows = known["conservation"]
        if "status" in rows and rows["status"].ne("ok").any():
            known["stability_points"] = rows[rows["dt"].notna()] if "dt" in rows else rows
    return known
