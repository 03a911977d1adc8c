"""The tables of a run folder as they are now, whether the run has ended or not."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import TcbenchError, UnknownNameError, matching
from ..studies.base import find_study, in_order, study_names
from ..study import Study
from .cells import UNHASHABLE, identity_of
from .provenance import machine_name
from .rows import Rows
from .store import Store

if TYPE_CHECKING:
    from pandas import DataFrame


def read_tables(source: str | Path | Store) -> dict[str, DataFrame]:
    """Every table of a run by name, in the order of the studies.

    Made from the rows (the latest of each cell: a folder may hold rows of older sources too); read from `tables/` where
    there are none, as in a published run that keeps its tables only, or where rows cannot be tabulated.
    """
    store = source if isinstance(source, Store) else Store.read(source)
    latest, older = latest_rows(store)
    store.problems += older
    chosen, others = _studies(store)
    known = [name for study in chosen for name in study.tables]
    kept = [name for name in store.tables() if not latest or (others and name not in known)]
    store.problems += [f"No study is called {name!r} here: its tables are those that were written." for name in others]
    tables, failed = make_tables(chosen, store, latest)
    kept += [name for study in failed for name in store.tables() if name in study.tables]
    for name in kept:
        if name not in tables:
            try:
                tables[name] = store.read_table(name)
            except TcbenchError as error:
                store.problems.append(str(error))
    return {name: table for name, table in tables.items() if len(table)}


def _studies(store: Rows) -> tuple[list[Study], list[str]]:
    """tcbench's own studies and those of plugins that have rows, in their order; and the names that no study has."""
    rows = {line["cell"]["study"] for line in store.lines() if line["cell"]}
    found, others = [*map(find_study, study_names())], []
    for name in sorted(rows.difference(study_names())):
        try:
            found.append(find_study(name))
        except UnknownNameError:
            others.append(name)
    return [*in_order(found).values()], others


def latest_rows(store: Rows) -> tuple[set[str], list[str]]:
    """The keys of the rows that tables are made of, the last of each cell but for those of other code; and sentences:
    how many are left out and why, and where timings of several machines stand together.

    A folder has the rows of all runs into it, and rows of two formulas, data or scenarios under one name would be
    judged as one. So what the last rows were measured with counts, and a row that was measured with another is older.
    """
    cells = {identity_of(line["cell"]): line for line in store.lines() if line["cell"]}
    now: dict[tuple[str, str], str] = {}
    keys: set[str] = set()
    older: dict[str, list[str]] = {}
    for line in reversed(cells.values()):
        facts = _facts(line, store)
        other = [name for name, mark in facts.items() if now.get(name, mark) != mark]
        if other:
            older.setdefault(str(line["cell"].get("integrator")), []).append(_cause(other[0]))
        else:
            now |= facts
            keys.add(line["key"])
    told = [_told(name, causes) for name, causes in sorted(older.items())]
    return keys, [*told, *_machines(store, [line for line in cells.values() if line["key"] in keys])]


NOTED = {"files": "another {0}", "folders": "other files in {0}", "environment": "another value of {0}",
         "packages": "another version of {0}"}  # fmt: skip


def _facts(line: Mapping[str, Any], store: Rows) -> dict[tuple[str, str], str]:
    """What a row was measured with: everything that must be one thing in a table."""
    row, cell = line["row"], line["cell"]
    own = {
        ("code", ""): row.get("measured_by") or row.get("tcbench_version"),
        ("scenario", str(cell.get("scenario"))): row.get("scenario_fields") or row.get("scenario_hash"),
        ("method", str(cell.get("integrator"))): row.get("source_hash") if row.get("source_hash") != UNHASHABLE else "",
    }
    noted = (store.inputs(str(row["inputs"])) or {}) if row.get("inputs") else {}
    read = {(kind, name): mark for kind in NOTED for name, mark in noted.get(kind, {}).items()}
    if noted.get("unseen"):  # another each time, perhaps within one run: known by its code
        read = {key: mark for key, mark in read.items() if key[1].endswith(".py")}
    return {key: str(mark) for key, mark in (read | own).items() if mark or key in read}


def _cause(fact: tuple[str, str]) -> str:
    kind, name = fact
    if kind in NOTED:
        return NOTED[kind].format(name.rpartition("/")[2])
    return {"code": "another tcbench, or other packages under it", "scenario": f"another scenario {name}"}.get(
        kind, "an older version of its formula"
    )


def _told(name: str, causes: Sequence[str]) -> str:
    count = len(causes)
    rows, are, them = ("rows", "are", "them") if count > 1 else ("row", "is", "it")
    return (
        f"{count} {rows} of {name} that {'were' if count > 1 else 'was'} measured with "
        f"{' or '.join(sorted(set(causes)))} {are} not in the tables (cells.jsonl still has {them}); the command that "
        f"measured {them} measures what is there now."
    )


def _machines(store: Rows, lines: Sequence[Mapping[str, Any]]) -> list[str]:
    """Where the timings of a table are those of several machines."""
    known = store.provenances() if isinstance(store, Store) else {}
    kinds = {name: machine_name(data.get("machine") or {}) for name, data in known.items()}
    found = Counter(
        str(line["row"].get("machine") or line["cell"].get("machine") or kinds.get(line["provenance"]) or "")
        for line in lines
    )
    found.pop("", None)
    if len(found) < 2:
        return []
    counted = "; ".join(f"{name}: {count} rows" for name, count in found.most_common())
    return [f"These rows were measured on {len(found)} machines, whose times are not to be compared ({counted})."]


def make_tables(
    chosen: Iterable[Study], store: Store, keys: set[str] | None = None
) -> tuple[dict[str, DataFrame], list[Study]]:
    """Tables of the rows in the store, of these keys only, when given; and the studies that cannot make theirs.

    Rows of another version of a study, or a plugin's mistake, cost the tables of that study: `store.problems` says why.
    """
    tables, failed = dict[str, "DataFrame"](), []
    for study in chosen:
        records = [r for r in store.records(study.name) if keys is None or r["key"] in keys]
        if records:
            try:
                tables |= study.tabulated([{k: v for k, v in r.items() if k not in ("study", "key")} for r in records])
            except TcbenchError as error:
                store.problems.append(str(error))
                failed.append(study)
    return tables, failed


def only(tables: Mapping[str, DataFrame], column: str, names: Sequence[str]) -> dict[str, DataFrame]:
    """The rows of these names in the tables that have the column, the other tables as they are; all if none is named.

    A table need not have rows of each (that of blow-ups has the methods that failed); a name that none has is an error.
    A name may be a pattern, as in "tc_*".
    """
    known = {str(value) for table in tables.values() if column in table for value in table[column].dropna()}
    if not names:
        return dict(tables)
    chosen = [one for name in names for one in matching(f"{column} of this run", name, known)]
    return {
        key: table[table[column].astype(str).isin(chosen)] if column in table else table
        for key, table in tables.items()
    }
