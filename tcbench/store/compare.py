"""What changed between two runs, beyond noise, cell by cell; and which of the changes are for the worse."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping
from fnmatch import fnmatch
from typing import TYPE_CHECKING, Any

from ..errors import TcbenchError
from ..studies.columns import column as column_named
from .cells import identity_of
from .encoding import canonical_json
from .store import Store

if TYPE_CHECKING:
    from pandas import DataFrame

FLOOR = 1e-12  # absolute: differences of round-off size mean nothing, whatever their ratio
COLUMNS = (
    "study",
    "integrator",
    "scenario",
    "options",
    "column",
    "before",
    "after",
    "difference",
    "noise",
    "kind",
    "worse",
)


def compare(
    run_a: str | os.PathLike[str],
    run_b: str | os.PathLike[str],
    noise: float | Mapping[str, float] | None = None,
    floor: float = FLOOR,
) -> DataFrame:
    """The differences between two run folders that exceed the noise, one row a value.

    Parameters
    ----------
    run_a, run_b : run folders; `a` is before, `b` is after. Cells are matched by study, integrator,
        scenario, options: the code that measured them may differ, which is the point. Folders with tables
        only (a published baseline) are compared table by table, rows matched by their text columns, dt and
        tolerance.
    noise : relative differences to ignore: one number for all timings, or a mapping column pattern -> number
        that goes before the defaults (timings 0.15, everything else 1e-9).
    floor : absolute difference to ignore, in the column's own unit; not applied to timings.

    Returns
    -------
    DataFrame with columns study, integrator, scenario, options, column, before, after, difference (relative
    to the larger magnitude, NaN where that makes no sense), noise, kind and worse. `kind` is "status",
    "value", "missing" (in a only) or "new" (in b only). `worse` is True for what `regressions` returns.

    Timings of cells that did not run alone are ignored. Raises `TcbenchError` when a folder holds no run.
    """
    import pandas

    before, after = _cells_of(run_a), _cells_of(run_b)
    found: list[dict[str, Any]] = []
    for name, (cell, row) in before.items():
        if name not in after:
            found.append(_entry(cell, kind="missing", column="status", before=row.get("status"), worse=True))
        else:
            found += _row_changes(cell, row, after[name][1], noise, floor)
    for name, (cell, row) in after.items():
        if name not in before:
            found.append(_entry(cell, kind="new", column="status", after=row.get("status")))
    return pandas.DataFrame(found, columns=list(COLUMNS))


def regressions(changes: DataFrame) -> DataFrame:
    """The changes for the worse: lost or newly failed cells, larger errors, longer timings, ...

    Values whose better direction is not known are changes, not regressions.
    """
    return changes[changes["worse"].astype(bool)].reset_index(drop=True)


def _allowed(name: str, noise: float | Mapping[str, float] | None) -> float:
    """The relative difference to ignore in a column: what the caller says, else what is known of the column."""
    known = column_named(name)
    if isinstance(noise, Mapping):
        return next((value for pattern, value in noise.items() if fnmatch(name, pattern)), known.noise)
    return float(noise) if noise is not None and known.timing else known.noise


def _cells_of(folder: str | os.PathLike[str]) -> dict[str, tuple[dict[str, Any], dict[str, Any]]]:
    """Identity -> (cell, row) of a run folder: from its rows, or from its tables when there are no rows."""
    store = Store.read(folder)
    lines = store.lines()
    cells = {identity_of(line["cell"]): (line["cell"], line["row"]) for line in lines}
    if not cells:
        cells = dict(_cells_of_tables(store))
    if not cells:
        raise TcbenchError(f"The run in {store.folder} has no rows to compare. Run it first.")
    return cells


def _cells_of_tables(store: Store) -> Iterator[tuple[str, tuple[dict[str, Any], dict[str, Any]]]]:
    """Table rows as cells, identified by their text columns and the step or tolerance asked for."""
    from pandas.api.types import is_numeric_dtype

    asked = ("dt", "h", "rtol", "value", "t", "tolerance")
    for table in store.tables():
        if not column_named(table).compared:
            continue
        frame = store.read_table(table)
        names = [str(name) for name in frame.columns]
        text = [
            n for n in names if not is_numeric_dtype(frame[n]) and n not in ("status", "failure", "limit", "verdict")
        ]
        counts: dict[str, int] = {}
        for record in frame.to_dict("records"):
            options = {
                str(n): record[n] for n in names if n in asked or (n in text and n not in ("integrator", "scenario"))
            }
            cell = {"study": table, "integrator": str(record.get("integrator", "")), "options": options}
            cell["scenario"] = str(record.get("scenario", ""))
            row = {str(n): v for n, v in record.items() if n not in options and n not in ("integrator", "scenario")}
            name = identity_of(cell)
            counts[name] = counts.get(name, 0) + 1  # rows that nothing tells apart are matched in their order
            yield f"{name}#{counts[name]}", (cell, row | {"timed": True})


def _row_changes(
    cell: Mapping[str, Any],
    before: Mapping[str, Any],
    after: Mapping[str, Any],
    noise: float | Mapping[str, float] | None,
    floor: float,
) -> list[dict[str, Any]]:
    """What differs between two rows of one cell: the status, or else the values beyond noise."""
    old, new = before.get("status", "ok"), after.get("status", "ok")
    if old != new:
        return [_entry(cell, kind="status", column="status", before=old, after=new, worse=old == "ok")]
    found = []
    alone = cell.get("timed") or before.get("timed")
    old_values, new_values = dict(_flat(before)), dict(_flat(after))
    for name in [*old_values, *(n for n in new_values if n not in old_values)]:
        path = [part.split("[")[0] for part in name.split(".")]  # of points[3].errors.q: points, errors, q
        column = path[-1]
        known = column_named(column)
        if not all(column_named(part).compared for part in path) or name == "status" or (known.timing and not alone):
            continue
        a, b = old_values.get(name), new_values.get(name)
        allowed = _allowed(column, noise)
        difference = _difference(a, b, 0.0 if known.timing else floor)
        if difference is None or difference <= allowed:
            continue
        worse = any(_worse(part, a, b) for part in path)
        found.append(
            _entry(cell, "value", name, a, b, math.nan if math.isinf(difference) else difference, allowed, worse)
        )
    return found


def _flat(row: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Scalars of a nested row under names like `errors.q[3]`; the length of a list counts as a value."""
    for name, value in row.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{name}.")
        elif isinstance(value, (list, tuple)):
            yield f"{prefix}{name}.length", len(value)
            for index, item in enumerate(value):
                yield from _flat({f"{name}[{index}]": item}, prefix)
        else:
            yield f"{prefix}{name}", value


def _difference(a: Any, b: Any, floor: float) -> float | None:
    """Relative difference of two values; infinite where they differ in kind, None where they are equal."""
    a, b = (None if isinstance(v, float) and math.isnan(v) else v for v in (a, b))
    if a is None or b is None:
        return None if a is b else math.inf
    if _is_number(a) and _is_number(b):
        if a == b or abs(a - b) <= floor:
            return None
        return abs(a - b) / max(abs(a), abs(b)) if math.isfinite(a) and math.isfinite(b) else math.inf
    return None if a == b else math.inf


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _worse(column: str, a: Any, b: Any) -> bool:
    known = column_named(column)
    if known.good:
        return a in known.good and b not in known.good
    numbers = [_is_number(v) and not math.isnan(v) for v in (a, b)]
    if all(numbers):
        return bool((known.worse == "higher" and b > a) or (known.worse == "lower" and b < a))
    return bool(known.worse) and numbers[0]  # a number became NaN or nothing


def _entry(
    cell: Mapping[str, Any],
    kind: str,
    column: str,
    before: Any = None,
    after: Any = None,
    difference: float = math.nan,
    noise: float = math.nan,
    worse: bool = False,
) -> dict[str, Any]:
    named = {name: cell.get(name, "") for name in ("study", "integrator", "scenario")}
    values = (canonical_json(cell.get("options", {})), column, before, after, difference, noise, kind, worse)
    return named | dict(zip(COLUMNS[3:], values, strict=True))
