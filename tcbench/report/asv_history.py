"""What asv recorded over commits, as a table; asv itself is not needed."""

from __future__ import annotations

import json
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pandas import DataFrame

PLACES = (Path(".asv") / "results", Path("asv") / "results")


def history(folder: Path) -> dict[str, DataFrame]:
    """The table of the asv results of a run folder, of a folder above it, or of the working directory; {} for none."""
    bases = (folder.resolve(), *folder.resolve().parents[:3], Path.cwd())
    found = (base / place for base in bases for place in PLACES if (base / place / "benchmarks.json").is_file())
    table = next(map(read_history, found), ())
    return {"history": table} if len(table) else {}


def read_history(results: Path) -> DataFrame:
    """One row a benchmark, set of parameters, machine and commit, by date."""
    import pandas as pd

    rows: list[dict[str, Any]] = []
    for path in sorted(results.glob("*/*.json")):
        try:
            data = json.loads(path.read_bytes())
            rows += _rows(data, path.parent.name) if path.name != "machine.json" else []
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            continue  # a file of another version of asv is no reason to have no report
    table = pd.DataFrame(rows, columns=["benchmark", "parameters", "machine", "commit", "date", "value"])
    table["date"] = pd.to_datetime(table["date"], unit="ms").dt.strftime("%Y-%m-%d")
    return table.sort_values(["benchmark", "parameters", "date"], ignore_index=True)


def _rows(data: dict[str, Any], machine: str) -> list[dict[str, Any]]:
    columns, rows = data.get("result_columns", ["result", "params"]), []
    run = {"machine": machine, "commit": str(data["commit_hash"])[:8], "date": data["date"]}
    for benchmark, packed in data["results"].items():
        entry = dict(zip(columns, packed, strict=False)) if isinstance(packed, list) else packed
        for value, choice in zip(entry.get("result") or [], product(*(entry.get("params") or [])), strict=False):
            if isinstance(value, int | float):
                told = ", ".join(str(v).strip("'") for v in choice)
                rows.append(run | {"benchmark": benchmark, "parameters": told, "value": float(value)})
    return rows
