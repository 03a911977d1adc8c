"""What changed between two runs, cell by cell; and which of the changes are for the worse.

Numbers, statuses and orders are judged. Of timings the ratio is shown, without a verdict: asv judges time.
"""

from __future__ import annotations

import math
import os
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from statistics import median
from typing import TYPE_CHECKING, Any, NamedTuple

from ..errors import ChangedError, TcbenchError, expect
from ..studies.base import known_tables, tables_by_study
from ..studies.columns import column
from ..table import Column, Table
from .cell import identity_of
from .codec import NAMES, canonical_json
from .declared import merged
from .provenance import machine_name
from .rows import Store
from .tables import latest_rows, read_tables

if TYPE_CHECKING:
    from pandas import DataFrame

NOISE = 1e-9  # relative differences up to here mean nothing
FLOOR = 1e-12  # absolute: differences of round-off size mean nothing, whatever their ratio
ONE_SIDED = ("missing", "new")
ANY_KEY = ("variable", "dt", "tolerance", "t", "measure", "target", "claim", "factor", "tau", "control", "value",
           "seed", "first_seed")  # fmt: skip # what may tell the rows of a table apart that no study declares

Columns = Callable[[str], "list[Column]"]  # of a value of a row, by its path
NO_TABLE = (Table("-"),)  # of a study that no run folder declares: no pattern counts
Line = tuple[dict[str, Any], dict[str, Any]]  # cell, row
MOST_SAID = 12  # sentences on what only one run has
COLUMNS = (
    "study", "integrator", "scenario", "options", "column", "before", "after", "difference", "noise", "kind",
    "worse",
)  # fmt: skip


def compare(
    run_a: str | os.PathLike[str],
    run_b: str | os.PathLike[str],
) -> DataFrame:
    """The differences between two run folders that exceed the noise, one row a value.

    Parameters
    ----------
    run_a, run_b : run folders; `a` is before, `b` is after. Cells are matched by study, integrator, scenario and
        options: the code that measured them may differ, which is the point. Where one folder has tables only (a
        published baseline) the tables of both are compared, rows matched by the keys of the studies' `Table`s.

    Numbers may differ by NOISE, or by FLOOR.

    Returns
    -------
    DataFrame with columns study, integrator, scenario, options, column, before, after, difference (relative
    to the larger magnitude, NaN where that makes no sense), noise, kind and worse. `kind` is "status", "value", or
    "time" (the median ratio of the timings of a cell, after over before); rows that only one run has are counted, one
    line a study, method and scenario, as "missing" (in a only) or "new" (in b only):
    that is no regression. `worse` is True for what `regressions` returns.

    Timings are compared where they were measured alone, on one kind of machine (see `other_machine`). Raises
    `TcbenchError` when a folder holds no run, or both have no row in common.
    """
    import pandas

    expect("compare", locals(), {"run_a": "a path", "run_b": "a path"})
    a, b = Store.read(run_a), Store.read(run_b)
    pairs = pairs_of(a, b)
    found = list(_one_sided(pairs))
    known = [{(pair[0]["study"], name) for pair in pairs.both for name in pair[side]} for side in (1, 2)]
    absent = known[0] ^ known[1]  # columns that another version has: no run has changed by them
    told_of = merged(a.declared(), b.declared())
    tables = {name: (table,) for name, table in known_tables(told_of).items()} | tables_by_study(told_of)
    timings = not other_machine(a, b)
    for cell, *rows in pairs.both:
        columns = partial(_columns_of, tables.get(cell["study"], ()))
        common = [{n: v for n, v in row.items() if (cell["study"], n) not in absent} for row in rows]
        found += _row_changes(columns, cell, *common)
        found += [entry for entry in [_time(columns, cell, *rows)] if entry] if timings else []
    changes = pandas.DataFrame(found, columns=list(COLUMNS))
    told = {(c["study"], name) for c, *rows in pairs.both for row in rows for name, v in row.items() if _given(v)}
    alone = [f"Only one of the runs has the column {name} of {study}." for study, name in sorted(absent & told)]
    changes.attrs["problems"] = [*a.problems, *b.problems, *pairs.problems, *alone]
    return changes


def other_machine(run_a: str | os.PathLike[str] | Store, run_b: str | os.PathLike[str] | Store) -> str:
    """A sentence where two runs were not measured on one kind of machine; else ""."""
    names = []
    for run in (run_a, run_b):
        store = run if isinstance(run, Store) else Store.read(run)
        # those that measured the rows, or else the one that wrote the tables
        kinds = [facts.get("machine") for facts in store.provenances().values() or [store.manifest()]]
        names.append(sorted({machine_name(k) if isinstance(k, Mapping) else "an unknown machine" for k in kinds}))
    if names[0] == names[1] and len(names[0]) == 1:
        return ""
    where = " and ".join(" or ".join(kinds) for kinds in names)
    return f"The runs were measured on different machines ({where}): their timings are left out."


def regressions(changes: DataFrame) -> DataFrame:
    """The changes for the worse: newly failed cells, larger errors, longer timings, ...

    Values whose better direction is not known are changes, not regressions; nor is what only one run has.
    """
    return changes[changes["worse"].astype(bool)].reset_index(drop=True)


def in_both(changes: DataFrame) -> DataFrame:
    """The changes of what both runs have; timings are none."""
    return changes[~changes["kind"].isin((*ONE_SIDED, "time"))].reset_index(drop=True)


def one_sided(changes: DataFrame, run_a: object = "the first run", run_b: object = "the second run") -> list[str]:
    """Sentences on what only one of the runs has, by method and scenario."""
    sentences = []
    for kind, run in zip(ONE_SIDED, (run_a, run_b), strict=True):
        by_method: dict[str, dict[str, list[str]]] = {}
        for row in changes[changes["kind"] == kind].to_dict("records"):
            number = row["before"] if kind == "missing" else row["after"]
            rows = by_method.setdefault(row["integrator"], {}).setdefault(row["scenario"], [])
            rows.append(f"{number:g} of {row['study']}")
        found = [_only(method, rows) for method, rows in by_method.items()]
        sentences += [f"Only {run} has {text}." for text in found[:MOST_SAID]]
        if len(found) > MOST_SAID:
            sentences.append(f"Only {run} has rows of {len(found) - MOST_SAID} more methods.")
    return sentences


def _only(method: str, rows: Mapping[str, Sequence[str]]) -> str:
    if len(rows) > 3:
        studies = sorted({text.rpartition(" ")[2] for found in rows.values() for text in found})
        where = f"on {len(rows)} scenarios ({', '.join(studies)})"
    else:
        where = "; ".join(f"on {scenario} ({', '.join(found)})" for scenario, found in rows.items())
    return f"rows of {method or 'no method'} {where}"


def _one_sided(pairs: Pairs) -> Iterator[dict[str, Any]]:
    for kind, cells in zip(ONE_SIDED, (pairs.before, pairs.after), strict=True):
        counts = Counter(tuple(named(cell).values()) for cell in cells)
        for names, count in counts.items():
            cell = dict(zip(("study", "integrator", "scenario"), names, strict=True))
            before, after = (count, None) if kind == "missing" else (None, count)
            yield _entry(cell, kind, "rows", before, after)


class Pairs(NamedTuple):
    """The cells of both runs with their two rows, the cells of one alone, and a sentence on rows that nothing tells
    apart."""

    both: list[tuple[dict[str, Any], dict[str, Any], dict[str, Any]]]
    before: list[dict[str, Any]]
    after: list[dict[str, Any]]
    problems: list[str]


def pairs_of(a: Store, b: Store) -> Pairs:
    """The rows of two runs, or the rows of their tables where one of them has tables only (a published baseline)."""
    problems: list[str] = []
    sides = [_lines(store) for store in (a, b)]
    if not all(sides):
        sides = [_table_lines(store, problems) for store in (a, b)]
    for store, lines in zip((a, b), sides, strict=True):
        if not lines:
            raise TcbenchError(f"The run in {store.folder} has no rows to compare. Run it first.")
        changed = [n for n, (_, row) in lines.items() if row.get("exception_type") == ChangedError.__name__]
        if changed:
            problems.append(f"{len(changed)} rows of {store.folder} were not measured, and are not compared.")
        for name in changed:
            del lines[name]
    before, after = sides
    if not before.keys() & after.keys():
        raise TcbenchError(
            f"{a.folder} and {b.folder} have no row in common, so that nothing can be compared: {_held(before)}, and "
            f"{_held(after)}. Run the same methods, scenarios and studies into both."
        )
    return Pairs(
        [(cell, row, after[name][1]) for name, (cell, row) in before.items() if name in after],
        [cell for name, (cell, _) in before.items() if name not in after],
        [cell for name, (cell, _) in after.items() if name not in before],
        problems,
    )


def _held(lines: Mapping[str, Line]) -> str:
    """Which methods and scenarios a side has, in a few words."""
    pairs = sorted({f"{cell.get('integrator')} on {cell.get('scenario')}" for cell, _ in lines.values()})
    return f"one has {', '.join(pairs[:2])}{f' and {len(pairs) - 2} more' if len(pairs) > 2 else ''}"


def _lines(store: Store) -> dict[str, Line]:
    keys = latest_rows(store)[0]
    return {identity_of(line["cell"]): (line["cell"], line["row"]) for line in store.lines() if line["key"] in keys}


def _table_lines(store: Store, problems: list[str]) -> dict[str, Line]:
    found = [(canonical_json(cell), cell, row) for cell, row in _rows_of_tables(store)]
    times = Counter(name for name, _, _ in found)
    alike = Counter(cell["study"] for name, cell, _ in found if times[name] > 1)
    problems += [
        f"{count} rows of the table {table} in {store.folder} cannot be told apart and are not compared."
        for table, count in alike.items()
    ]
    return {name: (cell, row) for name, cell, row in found if times[name] == 1}


def _rows_of_tables(store: Store) -> Iterator[Line]:
    schemas = known_tables(store.declared())
    for table, frame in read_tables(store).items():
        schema = schemas.get(table)
        if schema and schema.derived:
            continue
        keys = [name for name in (schema.key if schema else ANY_KEY) if name in frame]
        for record in frame.to_dict("records"):
            row = {str(name): value for name, value in record.items()}
            names = {name: row.pop(name) for name in (*NAMES[1:], "ensemble") if isinstance(row.get(name), str)}
            options = {name: _rounded(row.pop(name)) for name in keys}
            cell = {"integrator": "", "scenario": names.get("ensemble", "")} | names
            cell |= {"study": table, "options": {k: v for k, v in options.items() if v is not None}}
            yield cell, row | {"timed": bool(schema and schema.timed)}


def _rounded(value: Any) -> Any:
    """A key as it is matched: the last digits of a step may differ. None where there is none."""
    if isinstance(value, float):
        return None if math.isnan(value) else float(f"{value:.12g}")
    return value


def named(cell: Mapping[str, Any]) -> dict[str, str]:
    return {name: str(cell.get(name, "")) for name in NAMES}


# -- timings: how they compare


def _time(
    columns: Columns, cell: Mapping[str, Any], before: Mapping[str, Any], after: Mapping[str, Any]
) -> dict[str, Any] | None:
    """The median ratio of what was timed in a cell that both runs measured alone."""
    statuses = {row.get("status", "ok") for row in (before, after)}
    if not (cell.get("timed") or before.get("timed")) or statuses != {"ok"}:
        return None
    old, new = dict(_flat(_cut(before, after))), dict(_flat(_cut(after, before)))
    ratios = []
    for name in old.keys() & new.keys():
        a, b, path = old[name], new[name], columns(name)
        timing = path[-1].timing and path[-1].worse and all(one.compared for one in path)
        if timing and _is_number(a) and _is_number(b) and a > 0 and b > 0:
            ratios.append(b / a)
    if not ratios:
        return None
    ratio = median(ratios)
    return _entry(cell, "time", "time", 1.0, ratio, 1 - min(ratio, 1 / ratio))


# -- everything else: value by value


def _row_changes(
    columns: Columns, cell: Mapping[str, Any], before: Mapping[str, Any], after: Mapping[str, Any]
) -> list[dict[str, Any]]:  # fmt: skip
    """What differs between two rows of one cell: the status, or else the values beyond noise."""
    old, new = before.get("status", "ok"), after.get("status", "ok")
    if old != new:
        return [_entry(cell, "status", "status", before=old, after=new, worse=old == "ok")]
    found = []
    if cell.get("timed") or before.get("timed"):
        before, after = _cut(before, after), _cut(after, before)
    old_values, new_values = dict(_flat(before)), dict(_flat(after))
    for name in dict.fromkeys([*old_values, *new_values]):
        path, a, b = columns(name), old_values.get(name), new_values.get(name)
        if not all(one.compared for one in path) or path[-1].timing or name == "status":
            continue
        if (difference := _difference(a, b)) > NOISE:
            worse = any(_worse(one, a, b) for one in path)
            relative = math.nan if math.isinf(difference) else difference
            found.append(_entry(cell, "value", _with_rungs(name, before, after), a, b, relative, NOISE, worse))
    return found


def _columns_of(tables: tuple[Table, ...], name: str) -> list[Column]:
    """Of points[3].errors.q those of points, errors and q, as the tables of the study say."""
    return [column(part.split("[")[0], *(tables or NO_TABLE)) for part in name.split(".")]


def _cut(row: Mapping[str, Any], other: Mapping[str, Any]) -> dict[str, Any]:
    """A timed row without the rungs that the other has not: how far a ladder goes depends on the time that it takes."""
    lists = [name for name, value in row.items() if isinstance(value, list) and isinstance(other.get(name), list)]
    return dict(row) | {name: row[name][: len(other[name])] for name in lists}


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
        rungs = dict(enumerate(row[group])) if isinstance(row.get(group), list) else {}
        rung = point if isinstance(point := rungs.get(int(index)), Mapping) else {}
        values = {str(row.get("control", key)) if key == "value" else key: rung[key] for key in ANY_KEY if key in rung}
        said = [f"{key}={value:.6g}" if _is_number(value) else f"{key}={value}" for key, value in values.items()]
        if said and rest not in ANY_KEY:
            return f"{group}[{', '.join(said)}].{rest}"
    return name


def _difference(a: Any, b: Any) -> float:
    """Relative difference of two values; infinite where they differ in kind, 0 where they are equal."""
    a, b = (v if _given(v) else None for v in (a, b))
    if a == b:
        return 0.0
    if _is_number(a) and _is_number(b) and math.isfinite(a) and math.isfinite(b):
        return abs(a - b) / max(abs(a), abs(b)) if abs(a - b) > FLOOR else 0.0
    return math.inf


def _given(value: Any) -> bool:
    return not (value is None or value == "" or (isinstance(value, float) and math.isnan(value)))


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _worse(known: Column, a: Any, b: Any) -> bool:
    if known.good:
        return a in known.good and b not in known.good
    numbers = [_is_number(v) and not math.isnan(v) for v in (a, b)]
    if all(numbers):
        larger = known.worse == "larger" and abs(b) > abs(a)
        return bool(larger or (known.worse == "higher" and b > a) or (known.worse == "lower" and b < a))
    return bool(known.worse) and numbers[0]  # a number became NaN or nothing


def _entry(
    cell: Mapping[str, Any], kind: str, column: str, before: Any = None, after: Any = None,
    difference: float = math.nan, noise: float = math.nan, worse: bool = False,
) -> dict[str, Any]:  # fmt: skip
    values = (canonical_json(cell.get("options", {})), column, before, after, difference, noise, kind, worse)
    return named(cell) | dict(zip(COLUMNS[3:], values, strict=True))
