"""What changed between two runs, row by row of their tables; and which of the changes are for the worse.

Numbers, statuses and orders are judged. Of timings the ratio is shown, without a verdict: asv judges time.
"""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from statistics import median
from typing import TYPE_CHECKING, Any, NamedTuple

from ..errors import ChangedError, TcbenchError, expect
from ..studies.base import table_schemas
from ..studies.columns import column
from ..table import Column, Table
from .codec import canonical_json, flat
from .declared import merged
from .provenance import machine_name
from .rows import Store
from .tables import read_tables

if TYPE_CHECKING:
    from pandas import DataFrame

NOISE = 1e-9  # relative differences up to here mean nothing
FLOOR = 1e-12  # absolute: differences of round-off size mean nothing, whatever their ratio
ONE_SIDED = ("missing", "new")
ANY_KEY = ("variable", "dt", "tolerance", "t", "measure", "target", "claim", "factor", "tau", "control", "value",
           "seed", "first_seed")  # fmt: skip # what may tell the rows of a table apart of which no study says it
COLUMNS = (
    "study", "integrator", "scenario", "options", "column", "before", "after", "difference", "noise", "kind",
    "worse",
)  # fmt: skip
Row = dict[str, Any]


class Place(NamedTuple):
    """Which row of a run it is: of a table, a method and a scenario, and the values of the table's keys as JSON."""

    study: str
    integrator: str
    scenario: str
    options: str


def compare(
    run_a: str | os.PathLike[str],
    run_b: str | os.PathLike[str],
) -> DataFrame:
    """The differences between the tables of two run folders that exceed the noise, one row a value.

    Parameters
    ----------
    run_a, run_b : run folders; `a` is before, `b` is after. Rows are matched by table, integrator, scenario and the
        keys of the study's `Table`: the code that measured them may differ, which is the point.

    Numbers may differ by NOISE, or by FLOOR.

    Returns
    -------
    DataFrame with columns study (the table's name), integrator, scenario, options, column, before, after, difference
    (relative to the larger magnitude, NaN where that makes no sense), noise, kind and worse. `kind` is "status",
    "value", or "time" (the median ratio of the timings of a row, after over before); rows that only one run has are
    counted, one line a table, method and scenario, as "missing" (in a only) or "new" (in b only): that is no
    regression. `worse` is True for what `regressions` returns.

    Timings are compared where they were measured alone, on one kind of machine (see `other_machine`). Raises
    `TcbenchError` when a folder holds no run, or both have no row in common.
    """
    import pandas

    expect("compare", locals(), {"run_a": "a path", "run_b": "a path"})
    stores, problems = (Store.read(run_a), Store.read(run_b)), list[str]()
    declared = merged(*(store.declared() for store in stores))
    schemas = table_schemas(declared)
    before, after = (_rows(store, schemas, problems) for store in stores)
    if not before.keys() & after.keys():
        held = ", and ".join(_contents(side) for side in (before, after))
        raise TcbenchError(
            f"{stores[0].folder} and {stores[1].folder} have no row in common, so that nothing can be compared: {held}."
            " Run the same methods, scenarios and studies into both."
        )
    common = before.keys() & after.keys()
    columns = [{(p.study, name) for p in common for name in side[p]} for side in (before, after)]
    absent = columns[0] ^ columns[1]  # columns that another version has: no run has changed by them
    entries = [*_one_sided(before, after, schemas)]
    timings = not other_machine(*stores)
    for place in (place for place in before if place in common):
        schema = schemas.get(place.study, Table(place.study))
        names = [n for n in {**before[place], **after[place]} if (place.study, n) not in absent]
        values = [(column(n, schema), before[place].get(n), after[place].get(n)) for n in names]
        entries += _changes(place, values)
        if timings and schema.timed:
            entries += _time(place, values)
    filled = {(p.study, n) for p in common for side in (before, after) for n, v in side[p].items() if _is_filled(v)}
    alone = [f"Only one of the runs has the column {name} of {study}." for study, name in sorted(absent & filled)]
    changes = pandas.DataFrame(entries, columns=list(COLUMNS))
    changes.attrs["problems"] = [*stores[0].problems, *stores[1].problems, *problems, *alone]
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


def one_sided(changes: DataFrame) -> DataFrame:
    """How many rows one of the runs has alone, by method and study: "missing" from the second, or "new" in it."""
    rows = changes[changes["kind"].isin(ONE_SIDED)]
    counted = rows.assign(rows=rows["before"].fillna(rows["after"]).astype(float))
    by = counted.groupby(["kind", "integrator", "study"], as_index=False)
    table: DataFrame = by.agg(scenarios=("scenario", "nunique"), rows=("rows", "sum"))
    return table


def _rows(store: Store, schemas: Mapping[str, Table], problems: list[str]) -> dict[Place, Row]:
    """The rows of a run's tables; those that nothing tells apart, and what was not measured, cost a sentence."""
    rows: list[tuple[Place, Row]] = []
    for name, frame in read_tables(store).items():
        schema = schemas.get(name, Table(name))
        if not schema.derived:
            rows += [_placed(schema, record) for record in flat(frame).to_dict("records")]
    if not rows:
        raise TcbenchError(f"The run in {store.folder} has no rows to compare. Run it first.")
    if edited := [place for place, row in rows if row.get("exception_type") == ChangedError.__name__]:
        problems.append(f"{len(edited)} rows of {store.folder} were not measured, and are not compared.")
    times = Counter(place for place, _ in rows)
    for name, count in Counter(place.study for place, _ in rows if times[place] > 1).items():
        problems.append(
            f"{count} rows of the table {name} in {store.folder} cannot be told apart and are not compared."
        )
    return {place: row for place, row in rows if times[place] == 1 and place not in set(edited)}


def _placed(schema: Table, record: Mapping[Any, Any]) -> tuple[Place, Row]:
    row = {str(name): value for name, value in record.items()}
    names = {n: row.pop(n) for n in ("integrator", "scenario", "ensemble") if isinstance(row.get(n), str)}
    keys = {n: _rounded(row.pop(n)) for n in schema.key or ANY_KEY if n in row}
    scenario = names.get("scenario", names.get("ensemble", ""))
    options = canonical_json({n: v for n, v in keys.items() if v is not None})
    return Place(schema.name, names.get("integrator", ""), scenario, options), row


def _rounded(value: Any) -> Any:
    """A key as it is matched: the last digits of a step may differ. None where there is none."""
    if isinstance(value, float):
        return None if math.isnan(value) else float(f"{value:.12g}")
    return value


def _contents(rows: Mapping[Place, Row]) -> str:
    """Which methods and scenarios a side has, in a few words."""
    pairs = sorted({f"{place.integrator} on {place.scenario}" for place in rows})
    return f"one has {', '.join(pairs[:2])}{f' and {len(pairs) - 2} more' if len(pairs) > 2 else ''}"


def _one_sided(before: Mapping[Place, Row], after: Mapping[Place, Row], schemas: Mapping[str, Table]) -> Iterator[Row]:
    """Counted; how far a timed ladder of a pair goes depends on the time, and is told of no pair that both have."""
    for kind, own, other in zip(ONE_SIDED, (before, after), (after, before), strict=True):
        pairs = {place[:3] for place in other}
        alone = [p for p in own if p not in other]
        counts = Counter(p[:3] for p in alone if not (p[:3] in pairs and p.study in schemas and schemas[p.study].timed))
        for names, count in counts.items():
            sides = (count, None) if kind == "missing" else (None, count)
            yield _entry(Place(*names, "{}"), kind, "rows", *sides)


Values = Sequence[tuple[Column, Any, Any]]  # what is known of a column, and its value before and after


def _changes(place: Place, values: Values) -> list[Row]:
    """What differs between two rows: the status, or else the values beyond noise."""
    old, new = next(((a, b) for one, a, b in values if one.name == "status"), ("ok", "ok"))
    if old != new and _is_filled(old) and _is_filled(new):
        return [_entry(place, "status", "status", old, new, worse=old == "ok")]
    entries = []
    for one, a, b in values:
        if one.compared and not one.timing and one.name != "status" and (difference := _difference(a, b)) > NOISE:
            relative = math.nan if math.isinf(difference) else difference
            entries.append(_entry(place, "value", one.name, a, b, relative, NOISE, _worse(one, a, b)))
    return entries


def _time(place: Place, values: Values) -> list[Row]:
    """The median ratio of what was timed in both rows."""
    ratios = [
        b / a for one, a, b in values
        if one.timing and one.worse and one.compared and _is_number(a) and _is_number(b) and a > 0 and b > 0
    ]  # fmt: skip
    if not ratios:
        return []
    ratio = median(ratios)
    return [_entry(place, "time", "time", 1.0, ratio, 1 - min(ratio, 1 / ratio))]


def _difference(a: Any, b: Any) -> float:
    """Relative difference of two values; infinite where they differ in kind, 0 where they are equal."""
    a, b = (v if _is_filled(v) else None for v in (a, b))
    if a == b:
        return 0.0
    if _is_number(a) and _is_number(b) and math.isfinite(a) and math.isfinite(b):
        return abs(a - b) / max(abs(a), abs(b)) if abs(a - b) > FLOOR else 0.0
    return math.inf


def _is_filled(value: Any) -> bool:
    return not (value is None or value == "" or (isinstance(value, float) and math.isnan(value)))


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _worse(schema: Column, a: Any, b: Any) -> bool:
    if schema.good:
        return a in schema.good and b not in schema.good
    numbers = [_is_number(v) and not math.isnan(v) for v in (a, b)]
    if all(numbers):
        larger = schema.worse == "larger" and abs(b) > abs(a)
        return bool(larger or (schema.worse == "higher" and b > a) or (schema.worse == "lower" and b < a))
    return bool(schema.worse) and numbers[0]  # a number became NaN or nothing


def _entry(
    place: Place, kind: str, column: str, before: Any = None, after: Any = None,
    difference: float = math.nan, noise: float = math.nan, worse: bool = False,
) -> Row:  # fmt: skip
    return dict(zip(COLUMNS, (*place, column, before, after, difference, noise, kind, worse), strict=True))
