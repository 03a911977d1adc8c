"""Which rows of two runs belong together: those that agree in all that says what they are, and no others."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from ..errors import ChangedError, TcbenchError
from .cells import identity_of
from .encoding import canonical_json
from .store import Store
from .tables import latest_rows, read_tables

NAMES = ("integrator", "scenario", "ensemble")
# What tells the rows of a table apart, beside NAMES. A test makes every table and asks whether it does.
KEYS = {
    "conservation": ("dt", "tolerance"), "convergence": ("variable",), "convergence_points": ("variable", "dt"),
    "equilibrium": ("dt", "t"), "equilibrium_summary": ("dt",), "claims": ("claim", "section", "group"),
    "stability": (), "stability_points": ("solver", "dt"), "blowup_sensitivity": ("dt", "factor"),
    "stable_tolerances": (), "work_precision": ("control", "value"), "size": ("numbers",),
    "failure_share": ("dt", "tolerance", "first_seed", "runs"), "ensemble_laws": ("law", "first_seed", "runs"),
    "ensemble_accuracy": ("control", "value", "first_seed"), "ensemble_scenarios": ("seed",),
    "ensemble_points": ("seed", "control", "value"),
    "literature": ("claim",), "literature_errors": ("dt",), "measures": ("dt", "tolerance"),
    "map": ("x_name", "x", "y_name", "y"),
    "failure_map": ("x_name", "x_low", "x_high", "y_name", "y_low", "y_high", "first_seed", "runs"),
}  # fmt: skip
# Sums of other tables, and the rows of a chart: their changes are told by the tables that they are made of.
DERIVED = ("time_to_accuracy", "cost", "series", "opening", "performance_profile", "first_share", "size_exponents",
           "ensemble_seeds")  # fmt: skip
TIMED = ("work_precision", "ensemble_points", "size")  # tables of cells that ran alone
ANY_KEY = ("variable", "dt", "tolerance", "t", "measure", "target", "claim", "factor", "tau", "control", "value",
           "seed", "first_seed")  # fmt: skip # of tables of other versions

Line = tuple[dict[str, Any], dict[str, Any]]  # cell, row


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
    sides: list[dict[str, Line]] = [_lines(store) for store in (a, b)]
    if not all(sides):
        sides = [_table_lines(store, problems) for store in (a, b)]
    for store, lines in zip((a, b), sides, strict=True):
        if not lines:
            raise TcbenchError(f"The run in {store.folder} has no rows to compare. Run it first.")
    before, after = sides
    for store, lines in zip((a, b), sides, strict=True):  # what nobody measured is neither run's
        changed = {name: row for name, (_, row) in lines.items() if row.get("exception_type") == ChangedError.__name__}
        before, after = ({n: x for n, x in side.items() if n not in changed} for side in (before, after))
        if changed:
            count = (
                f"{len(changed)} rows of {store.folder} were" if len(changed) > 1 else f"A row of {store.folder} was"
            )
            problems.append(
                f"{count} not measured, and not compared. {next(iter(changed.values())).get('failure') or ''}"
            )
    return Pairs(
        [(cell, row, after[name][1]) for name, (cell, row) in before.items() if name in after],
        [cell for name, (cell, _) in before.items() if name not in after],
        [cell for name, (cell, _) in after.items() if name not in before],
        problems,
    )


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
    for table, frame in read_tables(store).items():
        if table in DERIVED:
            continue
        keys = [name for name in KEYS.get(table, ANY_KEY) if name in frame]
        for record in frame.to_dict("records"):
            row = {str(name): value for name, value in record.items()}
            named = {name: row.pop(name) for name in NAMES if isinstance(row.get(name), str)}
            options = {name: _rounded(row.pop(name)) for name in keys}
            cell = {"integrator": "", "scenario": named.get("ensemble", "")} | named
            cell |= {"study": table, "options": {k: v for k, v in options.items() if v is not None}}
            yield cell, row | {"timed": table in TIMED}


def _rounded(value: Any) -> Any:
    """A key as it is matched: the last digits of a step may differ. None where there is none."""
    if isinstance(value, float):
        return None if math.isnan(value) else float(f"{value:.12g}")
    return value


def named(cell: Mapping[str, Any]) -> dict[str, str]:
    return {name: str(cell.get(name, "")) for name in ("study", "integrator", "scenario")}
