"""What asv recorded over commits, as a table; asv itself is not needed."""

from __future__ import annotations

import json
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pandas import DataFrame

PLACES = (Path(".asv") / "results", Path("asv") / "results")


def find_history(folder: Path) -> Path | None:
    """The asv results of a run folder, of a folder above it, or of the working directory."""
    here = folder.resolve()
    for base in (here, *here.parents[:3], Path.cwd()):
        for place in PLACES:
            if (base / place / "benchmarks.json").is_file():
                return base / place
    return None


def read_history(results: Path) -> DataFrame:
    """One row a benchmark, set of parameters, machine and commit, by date."""
    import pandas as pd

    rows: list[dict[str, Any]] = []
    for path in sorted(results.glob("*/*.json")):
        if path.name == "machine.json":
            continue
        try:
            data = json.loads(path.read_bytes())
            rows += _rows(data, path.parent.name)
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            continue  # a file of another version of asv is no reason to have no report
    table = pd.DataFrame(rows, columns=["benchmark", "parameters", "machine", "commit", "date", "value"])
    table["date"] = pd.to_datetime(table["date"], unit="ms")
    return table.sort_values(["benchmark", "parameters", "date"], ignore_index=True)


def _rows(data: dict[str, Any], machine: str) -> list[dict[str, Any]]:
    columns = data.get("result_columns", ["result", "params"])
    rows = []
    for benchmark, packed in data["results"].items():
        entry = dict(zip(columns, packed, strict=False)) if isinstance(packed, list) else packed
        for value, choice in zip(entry.get("result") or [], product(*(entry.get("params") or [])), strict=False):
            if isinstance(value, int | float):
                rows.append({
                    "benchmark": benchmark, "machine": machine, "commit": str(data["commit_hash"])[:8],
                    "parameters": ", ".join(str(v).strip("'") for v in choice), "date": data["date"],
                    "value": float(value),
                })  # fmt: skip
    return rows
