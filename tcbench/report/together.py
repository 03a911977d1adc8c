"""Several runs on one page: rows under one name a method, times over a yardstick, and what can be compared."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..runner.declared import RATES
from ..runner.rows import Store
from ..runner.tables import read_tables
from ..studies.base import table_schemas
from ..studies.columns import column
from .page_data import names
from .pairs import PAIR, timed_steps, to_numbers

if TYPE_CHECKING:
    from pandas import DataFrame

COMPARABLE = (
    "Statuses, errors, laws, orders and steps of these runs compare as they are. A method that an earlier run has, "
    "too, is NAME[run=FOLDER]."
)
NAMING = ("integrator", "best_peer", "best_scipy")  # columns of names of methods


def together(
    store: Store, tables: Mapping[str, DataFrame], others: Sequence[str | Path]
) -> tuple[dict[str, DataFrame], dict[str, Any], list[str]]:
    """The tables of a run and of others, what they declare, and sentences on what can be compared.

    A method that an earlier run has is NAME[run=FOLDER], a scenario that an earlier run defines otherwise likewise.
    Times of another machine are multiplied by the median ratio of the times of a step that both runs have.
    """
    import pandas as pd

    first, said, labels = dict(store.declared()), list[str](), Counter([store.folder.resolve().name])
    every, declared = {name: [table] for name, table in tables.items()}, first | {"absent": {}}
    for folder in others:
        run = Store.read(folder)
        theirs, more, name = read_tables(run), run.declared(), run.folder.resolve().name
        labels[name] += 1
        label = name if labels[name] == 1 else f"{name} {labels[name]}"
        store.problems += [problem for problem in run.problems if problem not in store.problems]
        taken = {kind: {n for of in every.values() for t in of if kind in t for n in t[kind].dropna()} for kind in PAIR}
        scenes, defined = more.get("scenarios", {}), declared.get("scenarios", {})
        changed = [s for s in scenes if s in defined and not _alike(scenes[s], defined[s])]
        shared = taken["integrator"].intersection(names(theirs, "integrator"))
        renamed = {kind: {n: _of_run(n, label) for n in of} for kind, of in zip(PAIR, (shared, changed), strict=True)}
        factor, why = _yardstick({name: of[0] for name, of in every.items()}, theirs, store, run, label, changed)
        schemas = table_schemas(more)
        for name, table in theirs.items():
            if name not in every or "integrator" in table:
                own = (schemas[name],) if name in schemas else ()
                every.setdefault(name, []).append(_renamed(_scaled(table, factor, own), renamed))
        for kind, key in (("integrator", "integrators"), ("scenario", "scenarios")):
            of = {renamed[kind].get(name, name): facts for name, facts in more.get(key, {}).items()}
            declared[key] = of | declared.get(key, {})
        declared |= {key: more.get(key, {}) | declared.get(key, {}) for key in ("metrics", "tables")}
        said += [why, *([f"{label} defines {', '.join(changed)} otherwise."] if changed else [])]
    said.insert(0, COMPARABLE)
    whole = {name: pd.concat(of, ignore_index=True) for name, of in every.items()}
    return whole, declared, said


def _alike(one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """Do two runs say the same of a scenario, in all that both say? Another version may say more; rates are of a
    machine's last digits."""
    return all(one[key] == other[key] for key in (one.keys() & other.keys()) - {RATES})


def _of_run(name: str, label: str) -> str:
    return f"{name[:-1]},run={label}]" if name.endswith("]") else f"{name}[run={label}]"


def _renamed(table: DataFrame, names: Mapping[str, Mapping[str, str]]) -> DataFrame:
    kinds = {**dict.fromkeys(NAMING, names["integrator"]), "scenario": names["scenario"]}
    return table.assign(**{of: table[of].map(lambda n, to=to: to.get(n, n)) for of, to in kinds.items() if of in table})


def _scaled(table: DataFrame, factor: float, schemas: tuple[Any, ...]) -> DataFrame:
    timed = [name for name in map(str, table) if column(name, *schemas).timing and table[name].dtype.kind in "if"]
    return table if factor == 1.0 else table.assign(**{name: table[name] * factor for name in timed})


def _yardstick(
    tables: Mapping[str, DataFrame], others: Mapping[str, DataFrame], store: Store, run: Store, label: str,
    changed: Sequence[str],
) -> tuple[float, str]:  # fmt: skip
    """By how much the times of a run are multiplied, and why."""
    here, where = machine(store.manifest()), machine(run.manifest())
    if here and here == where:
        return 1.0, f"{label} was measured on the same kind of machine ({here}): its times are as they were."
    beside = where or "a machine that it does not name"
    for name, of_a_step in (("work_precision", timed_steps), ("conservation", _of_a_step)):
        if name in tables and name in others:
            mine, theirs = (of_a_step(of[name]) for of in (tables, others))
            ratio = (mine / theirs[~theirs.index.get_level_values("scenario").isin(changed)]).dropna()
            if len(ratio):
                factor, of = (
                    float(ratio.median()),
                    f"of a step's time over {len(ratio)} pair{'s' * (len(ratio) > 1)} of method and scenario",
                )
                start = f"{label} was measured on {beside}: its times are multiplied by {factor:.2g}, the median ratio"
                return factor, f"{start} {of} that both have."
    return 1.0, f"{label} was measured on {beside} and shares no timed method: its times do not compare."


def _of_a_step(table: DataFrame) -> Any:
    """Microseconds a step by method and scenario."""
    return to_numbers(table, "us_per_step").groupby([table[name].astype(str) for name in PAIR]).median()


def machine(manifest: Mapping[str, Any], *more: str) -> str:
    """The processor and the cores that a run had, and more of what its manifest says of them."""
    facts = manifest.get("machine")
    if not isinstance(facts, Mapping):
        return ""
    cores = facts.get("usable_cores") or facts.get("cores")
    others = [str(facts.get(name) or "") for name in ("cpu", *more)]
    return ", ".join(filter(None, [others[0], f"{cores} cores" if cores else "", *others[1:]]))
