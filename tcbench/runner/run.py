"""`run`: integrators x scenarios x studies -> rows on disk -> tables. Resumes what an earlier run left."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import expect
from ..integrator import Integrator
from ..progress import of_cells, waiting
from ..studies.base import in_order
from ..systems.scenario import Scenario
from .declared import merged
from .eta import Remaining
from .ledger import Ledger, Summary, check_limits, plan
from .plan import Job, plan_job
from .provenance import machine_name, provenance, usable_cores, utc_now
from .rows import Store
from .scheduler import run_cells
from .tables import latest_rows, make_tables, read_tables, tables_by_source
from .worker import MEASURE, complete_row, measured

if TYPE_CHECKING:
    from pandas import DataFrame

    from .ledger import Event

DEFAULT_OUTPUT = Path("results") / "latest"


@dataclass(frozen=True, eq=False)
class Results:
    """What `run` and `load` return: the requested tables by name, and what the engine did.

    Attributes
    ----------
    tables : mapping of str to DataFrame
        Of the requested studies, one row for a run or a fit; units and formulas of the columns: docs/measures.md.
    output : Path
        The folder, whose tables/ have the rows of every run into it.
    summary : Summary
        What was measured now (`run`) and what was finished before and used again (`already_finished`), together
        `planned`; `elapsed_s` in seconds.
    left_out : sequence of str
        Sentences: why requested methods are not in a study.
    statuses : mapping of str to int
        How its cells ended, those finished before included.
    problems : sequence of str
        Sentences: lines that could not be read, rows of older formulas.
    every : mapping of str to DataFrame
        Tables of all runs into this folder.
    notes : sequence of str
        Sentences: absent peers, steps that do not apply, plugins that did not load.
    without_tables : sequence of str
        Studies whose `tabulate` failed; `problems` says why, and their rows are kept.

    References
    ----------
    docs/measures.md.
    """

    tables: Mapping[str, DataFrame]
    output: Path
    summary: Summary
    left_out: Sequence[str] = ()
    statuses: Mapping[str, int] = field(default_factory=dict)
    problems: Sequence[str] = ()
    every: Mapping[str, DataFrame] = field(default_factory=dict)
    notes: Sequence[str] = ()
    without_tables: Sequence[str] = ()

    def _repr_html_(self) -> str:
        """What a notebook shows: the tables and how many rows each has, and the first of them."""
        rows = "".join(f"<tr><td>{name}</td><td>{len(table)}</td></tr>" for name, table in self.tables.items())
        first = next(iter(self.tables.values()), None)
        shown = "" if first is None else first.head(20).to_html(index=False)
        return f"<table><tr><th>table</th><th>rows</th></tr>{rows}</table>{shown}"

    def __repr__(self) -> str:
        return f"<Results in {str(self.output)!r}: {', '.join(self.tables)}>"


KINDS_OF_ARGUMENTS = {
    "output": "a path", "dt": "numbers or nothing", "options": "a mapping or nothing",
    "jobs": "a number or nothing", "timeout": "a number", "memory_limit": "a whole number or nothing",
    "fresh": "True or False", "retry_failed": "True or False", "dask": "a word or nothing",
    "security": "a mapping or nothing", "on_event": "a function or nothing", "progress": "True or False or nothing",
}  # fmt: skip


def run(
    integrators: Iterable[str | Integrator] | None = None,
    scenarios: Iterable[str | Scenario] | None = None,
    studies: Iterable[str] | None = None,
    output: str | Path = DEFAULT_OUTPUT,
    *,
    dt: Sequence[float] | None = None,
    options: Mapping[str, Any] | None = None,
    jobs: int | None = None,
    timeout: float = 300.0,
    memory_limit: int | None = None,
    fresh: bool = False,
    retry_failed: bool = False,
    dask: str | None = None,
    security: Mapping[str, str] | None = None,
    on_event: Callable[[Event], None] | None = None,
    progress: bool | None = None,
) -> Results:
    """Run studies: many integrators on many scenarios, in parallel, into a folder.

    Finished cells of the same folder are not run again.

    Parameters
    ----------
    integrators, scenarios, studies : iterable of str, or of Integrator, Scenario; optional
        None means all of a kind.
    output : str or Path
        Folder for the rows (cells.jsonl), tables/ (CSV and Parquet) and manifest.json.
    dt : sequence of float, optional
        Steps of the ladder studies, in each scenario's (dimensionless) time, instead of each scenario's own.
    options : mapping, optional
        Of single studies, by name, such as {"size": 100, "seed": 1} of the ensemble (docs/ensembles.md).
    jobs : int, optional
        Worker processes; one for each usable core by default.
    timeout : float
        Seconds that one cell may take.
    memory_limit : int, optional
        Bytes that one worker may use.
    fresh : bool
        Forget earlier rows.
    retry_failed : bool
        Run again whatever did not end well.
    dask : str, optional
        Address of a scheduler whose workers are to be used instead.
    security : mapping of str, optional
        Files of keys and certificates for it, as `distributed.Security` takes them.
    on_event : function, optional
        Called with each event of the engine.
    progress : bool, optional
        None: a bar on a terminal and in Jupyter, nothing in a pipe; True: in a pipe a line a minute; False: nothing.

    Returns
    -------
    Results
        The tables of what was asked for. Times in them are in seconds, or in the unit that their name ends in; all else
        is dimensionless (docs/measures.md).

    Raises
    ------
    TcbenchError
        For unknown names, options that a study does not have, limits that are no numbers, and a folder that is in use
        or cannot be written. A cell that fails raises nothing: its row says so.

    References
    ----------
    docs/measures.md says what every column is and by which formula.
    """
    expect("run", locals(), KINDS_OF_ARGUMENTS)
    with waiting("planning", progress):
        job = plan_job(integrators, scenarios, studies, dt=dt, options=options)
    limits = {"jobs": jobs, "timeout": timeout, "memory_limit": memory_limit, "retry_failed": retry_failed}
    return execute(job, output, limits, fresh=fresh, dask=dask, security=security, on_event=on_event, progress=progress)


def execute(
    job: Job, output: str | Path, limits: Mapping[str, Any], *, fresh: bool = False, dask: str | None = None,
    security: Mapping[str, str] | None = None, on_event: Callable[[Event], None] | None = None,
    progress: bool | None = None,
) -> Results:  # fmt: skip
    """Run the cells of a job that have no final row yet; write rows, tables and manifest.

    limits : jobs, timeout, memory_limit and retry_failed, of the engine.
    """
    check_limits(*(limits.get(name) for name in ("jobs", "timeout", "memory_limit")))
    started, machine, run_all = utc_now(), machine_name(), run_cells
    if dask is not None:
        from .dask import knock, run_on_dask

        knock(dask)  # before anything is written
        run_all, machine = partial(run_on_dask, address=dask, security=security), ""
    with Store.open(output, fresh=fresh) as store:
        store.add_provenance(origin := provenance(packages=job.packages))
        retry, made_by = bool(limits.get("retry_failed")), job.context["made_by"]
        todo, _ = plan(job.cells, store, retry, made_by, job.local, machine)
        # a cluster's workers come and go
        remaining = None if dask else Remaining(todo, limits.get("jobs") or usable_cores(), store.raw())
        with of_cells(progress, remaining) as show:

            def tell(event: Event) -> None:
                show(event)
                if on_event is not None:
                    on_event(event)

            remote = [cell for cell in job.cells if cell.key not in job.local]
            summary = run_all(remote, MEASURE, job.context, store, on_event=tell, machine=machine, **limits)
            if not summary.interrupted:
                _measure_here(job, store, summary, tell)
        with waiting("writing tables", progress):
            keys = {cell.key for cell in job.cells}
            tables, failed = make_tables([*in_order(job.studies).values()], store, keys)
            alone = keys == latest_rows(store)[0] and not failed  # no other run has been into this folder
            from_rows, from_files = (tables, {}) if alone else tables_by_source(store)
            from_rows = {name: table for name, table in from_rows.items() if len(table)}
            before = set(store.manifest().get("tables", [])).difference(from_files)
            store.write_tables(from_rows, before)
            every = from_rows | from_files
            store.write_declared(merged(store.declared(), job.declared()))
            lines = [line for cell in job.cells if (line := store.line(cell.key))]
            statuses = Counter(str(line["row"].get("status")) for line in lines)
        ended = {"provenance_id": store.provenance_id, "started": started, "ended": utc_now(), "cells": len(job.cells)}
        store.write_manifest(origin | ended | {"interrupted": summary.interrupted, "tables": sorted(every)})
        problems = tuple(dict.fromkeys(store.problems))
        without = [study.name for study in failed]
        return Results(tables, Path(output), summary, job.left_out, statuses, problems, every, job.notes, without)


def _measure_here(job: Job, store: Store, summary: Summary, on_event: Callable[[Event], None]) -> None:
    """Cells of what exists only in this process (a notebook, say): no isolation, no deadline, never used again."""
    began, cells = time.monotonic(), [cell for cell in job.cells if cell.key in job.local]
    summary.planned += len(cells)
    ledger = Ledger(store, summary, on_event, summary.run + len(cells), job.context["made_by"])
    try:
        for cell in cells:
            ledger.start(cell, 1)
            row = complete_row(partial(measured, *job.local[cell.key], cell.as_dict()), {"timed": cell.timed})
            ledger.write(cell, row, 0)
    except KeyboardInterrupt:
        summary.interrupted = True
    summary.elapsed_s += time.monotonic() - began


def load(folder: str | Path) -> Results:
    """The results of an earlier run, as `run` returned them, also of one that is still running or that was published.

    Parameters
    ----------
    folder : str or Path
        Of the run. Nothing is measured and no plugin is needed.

    Returns
    -------
    Results
        Its tables; units as of `run`.

    Raises
    ------
    TcbenchError
        Where there is no run.

    References
    ----------
    docs/measures.md says what every column is and by which formula.
    """
    expect("load", locals(), {"folder": "a path"})
    store = Store.read(folder)
    tables = read_tables(store)
    lines = store.raw()
    statuses = Counter(str(line["row"].get("status")) for line in lines)
    summary = Summary(planned=len(lines), already_finished=len(lines))
    return Results(tables, Path(folder), summary, (), statuses, tuple(dict.fromkeys(store.problems)), tables)
