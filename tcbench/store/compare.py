"""What changed between two runs, beyond noise, cell by cell; and which of the changes are for the worse."""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from fnmatch import fnmatch
from statistics import median
from typing import TYPE_CHECKING, Any

from ..errors import TcbenchError
from ..studies.columns import column as column_named
from .cells import identity_of
from .encoding import canonical_json
from .provenance import machine_name
from .store import Store
from .tables import latest_rows, read_tables

if TYPE_CHECKING:
    from pandas import DataFrame

FLOOR = 1e-12  # absolute: differences of round-off size mean nothing, whatever their ratio
P_VALUE = 0.002  # of the test of timings: asv's
EFFECT = 0.05  # relative difference of medians that is worth a word
JUDGED = ("wall_time_median_s", "seconds")  # stand for the timings of a rung that has samples
# What tells the rows of a table apart, beside integrator and scenario.
KEYS = {
    "conservation": ("dt", "tolerance"), "convergence": ("variable",), "convergence_points": ("variable", "dt"),
    "equilibrium": ("dt", "t"), "equilibrium_summary": ("dt",), "claims": ("claim", "section", "group"),
    "stability": (), "stability_points": ("solver", "dt"), "blowup_sensitivity": ("factor",), "stable_tolerances": (),
    "work_precision": ("control", "value"), "map": ("x_name", "x", "y_name", "y"),
}  # fmt: skip
ANY_KEY = ("variable", "dt", "tolerance", "t", "measure", "target", "claim", "factor", "tau", "control")  # of others
RUNG = ("value", *ANY_KEY)  # of an entry of a list in a row
DERIVED = ("time_to_accuracy", "cost", "series", "opening")
TIMED = ("work_precision",)
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
    run_a, run_b : run folders; `a` is before, `b` is after. Cells are matched by study, integrator, scenario and
        options: the code that measured them may differ, which is the point. Where one folder has tables only (a
        published baseline) the tables of both are compared, rows matched by integrator, scenario and `KEYS`.
    noise : relative differences to ignore: one number for all timings, or a mapping column pattern -> number
        that goes before what is known of the columns (timings 0.15, everything else 1e-9).
    floor : absolute difference to ignore, in the column's own unit; not applied to timings.

    Returns
    -------
    DataFrame with columns study, integrator, scenario, options, column, before, after, difference (relative
    to the larger magnitude, NaN where that makes no sense), noise, kind and worse. `kind` is "status",
    "value", "missing" (in a only) or "new" (in b only). `worse` is True for what `regressions` returns.

    Timings are compared where they were measured alone, on one kind of machine (see `other_machine`): by a test on the
    samples where both rows keep enough of them (`slower`), else against the noise. Raises `TcbenchError` when a folder
    holds no run.
    """
    import pandas

    a, b = Store.read(run_a), Store.read(run_b)
    timings = not other_machine(a, b)
    before, after = _both(a, b)
    found: list[dict[str, Any]] = []
    for name, (cell, row) in before.items():
        if name not in after:
            found.append(_entry(cell, kind="missing", column="status", before=row.get("status"), worse=True))
        else:
            found += _row_changes(cell, row, after[name][1], noise, floor, timings)
    for name, (cell, row) in after.items():
        if name not in before:
            found.append(_entry(cell, kind="new", column="status", after=row.get("status")))
    return pandas.DataFrame(found, columns=list(COLUMNS))


def other_machine(run_a: str | os.PathLike[str] | Store, run_b: str | os.PathLike[str] | Store) -> str:
    """A sentence where two runs were not measured on one kind of machine; else ""."""
    names = []
    for run in (run_a, run_b):
        store = run if isinstance(run, Store) else Store.read(run)
        # those that measured the rows, or else the one that wrote the tables
        kinds = [p["machine"] for p in store.provenances().values() if "machine" in p] or [
            store.manifest().get("machine")
        ]
        names.append(sorted({machine_name(kind) if kind else "an unknown machine" for kind in kinds}))
    if names[0] == names[1] and len(names[0]) == 1:
        return ""
    where = " and ".join(" or ".join(kinds) for kinds in names)
    return f"The runs were measured on different machines ({where}): their timings are left out."


def slower(before: Sequence[float], after: Sequence[float]) -> float | None:
    """Relative change of the median of timings if it is real, 0.0 if it is not; None if the samples cannot tell.

    Real: a Mann-Whitney test gives less than P_VALUE, as in asv, and the medians differ by more than EFFECT (enough
    samples make the smallest difference significant). Too few samples reach no such value whatever they are.
    """
    from scipy.stats import mannwhitneyu

    if 2 / math.comb(len(before) + len(after), len(before)) > P_VALUE:
        return None
    old, new = median(before), median(after)
    difference = abs(new - old) / max(new, old)
    p = float(mannwhitneyu(before, after, alternative="two-sided").pvalue)
    return difference if p < P_VALUE and difference > EFFECT else 0.0


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


Cells = dict[str, tuple[dict[str, Any], dict[str, Any]]]


def _both(a: Store, b: Store) -> tuple[Cells, Cells]:
    """Identity -> (cell, row) of two runs: of their rows, or of their tables where one of them has no rows."""
    latest = [latest_rows(store)[0] for store in (a, b)]
    rows = [
        {identity_of(line["cell"]): (line["cell"], line["row"]) for line in store.lines() if line["key"] in keys}
        for store, keys in zip((a, b), latest, strict=True)
    ]
    if all(rows):
        return rows[0], rows[1]
    found = [dict(_cells_of_tables(store)) for store in (a, b)]
    for store, cells in zip((a, b), found, strict=True):
        if not cells:
            raise TcbenchError(f"The run in {store.folder} has no rows to compare. Run it first.")
    return found[0], found[1]


def _cells_of_tables(store: Store) -> Iterator[tuple[str, tuple[dict[str, Any], dict[str, Any]]]]:
    """Rows of the tables as cells; what only sums up other tables is left out."""
    for table, frame in read_tables(store).items():
        if table in DERIVED:
            continue
        keys = [name for name in KEYS.get(table, ANY_KEY) if name in frame]
        counts: dict[str, int] = {}
        for record in frame.to_dict("records"):
            row = {str(name): value for name, value in record.items()}
            options = {name: _rounded(row.pop(name)) for name in keys}
            cell: dict[str, Any] = {name: str(row.pop(name, "")) for name in ("integrator", "scenario")}
            cell |= {"study": table, "options": {k: value for k, value in options.items() if value is not None}}
            name = canonical_json(cell)
            counts[name] = counts.get(name, 0) + 1  # rows that nothing tells apart are matched in their order
            if isinstance(samples := row.get("samples"), str):
                row["samples"] = json.loads(samples)
            yield f"{name}#{counts[name]}", (cell, row | {"timed": table in TIMED})


def _rounded(value: Any) -> Any:
    """A key as it is matched: the last digits of a step may differ. None where there is none."""
    if isinstance(value, float):
        return None if math.isnan(value) else float(f"{value:.12g}")
    return value


def _row_changes(
    cell: Mapping[str, Any],
    before: Mapping[str, Any],
    after: Mapping[str, Any],
    noise: float | Mapping[str, float] | None,
    floor: float,
    timings: bool,
) -> list[dict[str, Any]]:
    """What differs between two rows of one cell: the status, or else the values beyond noise."""
    old, new = before.get("status", "ok"), after.get("status", "ok")
    if old != new:
        return [_entry(cell, kind="status", column="status", before=old, after=new, worse=old == "ok")]
    found = []
    alone = bool(cell.get("timed") or before.get("timed"))
    old_values, new_values = dict(_flat(_cut(before, after) if alone else before)), dict(_flat(after))
    if alone:
        new_values = dict(_flat(_cut(after, before)))
    judged = _judged_by_samples(before, after) if alone and timings and noise is None else {}
    for name in [*old_values, *(n for n in new_values if n not in old_values)]:
        path = [part.split("[")[0] for part in name.split(".")]  # of points[3].errors.q: points, errors, q
        column = path[-1]
        known = column_named(column)
        if not all(column_named(part).compared for part in path) or name == "status":
            continue
        if known.timing and not (alone and timings):
            continue
        a, b = old_values.get(name), new_values.get(name)
        allowed = _allowed(column, noise)
        group = name.rpartition(".")[0]
        if known.timing and group in judged:
            difference: float | None = judged[group] if column in JUDGED else None
            allowed = EFFECT
        else:
            difference = _difference(a, b, 0.0 if known.timing else floor)
        if difference is None or difference <= allowed:
            continue
        worse = any(_worse(part, a, b) for part in path)
        found.append(
            _entry(
                cell,
                "value",
                _with_rungs(name, before, after),
                a,
                b,
                math.nan if math.isinf(difference) else difference,
                allowed,
                worse,
            )
        )
    return found


def _cut(row: Mapping[str, Any], other: Mapping[str, Any]) -> dict[str, Any]:
    """A timed row without the rungs that the other has not: how far a ladder goes depends on the time that it takes."""
    lists = [name for name, value in row.items() if isinstance(value, list) and isinstance(other.get(name), list)]
    return dict(row) | {name: row[name][: len(other[name])] for name in lists}


def _judged_by_samples(before: Mapping[str, Any], after: Mapping[str, Any], prefix: str = "") -> dict[str, float]:
    """Name of a group of values (a rung) that has samples on both sides -> what `slower` says of them."""
    found: dict[str, float] = {}
    if isinstance(a := before.get("samples"), list) and isinstance(b := after.get("samples"), list):
        if a and b and (verdict := slower(a, b)) is not None:
            found[prefix] = verdict
        return found
    for name, value in before.items():
        other = after.get(name)
        if isinstance(value, list) and isinstance(other, list):
            for index, (x, y) in enumerate(zip(value, other, strict=False)):
                if isinstance(x, Mapping) and isinstance(y, Mapping):
                    found |= _judged_by_samples(x, y, f"{prefix}.{name}[{index}]".lstrip("."))
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


def _with_rungs(name: str, *rows: Mapping[str, Any]) -> str:
    """A name like `points[3].error` with what the rung is: `points[dt=0.05, variable=q].error`."""
    found = re.fullmatch(r"(\w+)\[(\d+)\]\.(.+)", name)
    for row in rows if found else ():
        group, index, rest = found.groups()  # type: ignore[union-attr]
        rung = row[group][int(index)] if int(index) < len(row.get(group, ())) else {}
        values = {str(row.get("control", key)) if key == "value" else key: rung[key] for key in RUNG if key in rung}
        said = [f"{key}={value:.6g}" if _is_number(value) else f"{key}={value}" for key, value in values.items()]
        if said and rest not in RUNG:
            return f"{group}[{', '.join(said)}].{rest}"
    return name


def _difference(a: Any, b: Any, floor: float) -> float | None:
    """Relative difference of two values; infinite where they differ in kind, None where they are equal."""
    a, b = (None if v == "" or (isinstance(v, float) and math.isnan(v)) else v for v in (a, b))
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
        larger = known.worse == "larger" and abs(b) > abs(a)
        return bool(larger or (known.worse == "higher" and b > a) or (known.worse == "lower" and b < a))
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
