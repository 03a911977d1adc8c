"""`run`: integrators x scenarios x studies -> rows on disk -> tables. Resumes what an earlier run left."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import plugins
from .cells import Cell, fingerprint, fingerprint_sources
from .errors import TcbenchError
from .integrator import Integrator
from .provenance import machine_name, manifest, package_version, provenance, utc_now, versions
from .scenario import Scenario
from .store import Rows, Store
from .studies import NAMES, Study, find_study

if TYPE_CHECKING:
    from pandas import DataFrame

    from .engine import Event, Plan, Summary

MEASURE = "tcbench.runner:measure_cell"
ABSENT = "absent"  # tag of peers whose package is not installed: listed, and run only when they are named
CLOSED_FORM = "closed-form conduction"  # tag of integrators that ask for System.conduction_flow
DEFAULT_OUTPUT = Path("results") / "latest"


@dataclass(frozen=True)
class Results:
    """What `run` returns: tables by name, the folder they are in, and what the engine did."""

    tables: Mapping[str, DataFrame]
    output: Path
    summary: Summary
    left_out: Sequence[str] = ()  # sentences: why methods that were asked for are not in a study
    problems: Sequence[str] = ()  # sentences: lines of the folder that could not be read and were measured again

    def __repr__(self) -> str:
        return f"<Results in {str(self.output)!r}: {', '.join(self.tables)}>"


@dataclass(frozen=True)
class Job:
    """Everything that a run will do, before it does it."""

    cells: list[Cell]
    context: dict[str, Any]
    studies: list[Study]
    objects: dict[str, Integrator]  # integrators that workers cannot look up by name: measured in this process
    left_out: Sequence[str] = ()  # why methods that were asked for by name are in none of a study's cells


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
) -> Results:
    """Run studies; None means all of a kind. Finished cells of the same folder are not run again.

    dt : steps of the ladder studies, instead of each scenario's own.
    output : folder for the rows (cells.jsonl), tables/ (CSV and Parquet) and manifest.json.
    jobs, timeout (s), memory_limit (bytes) : of the worker processes. fresh : forget earlier rows.
    retry_failed : run again whatever did not end well. dask : address of a scheduler to use instead.
    """
    job = plan_job(integrators, scenarios, studies, dt=dt, options=options)
    return execute(job, output, jobs, timeout, memory_limit, fresh, retry_failed, dask, security, on_event)


def execute(
    job: Job, output: str | Path, jobs: int | None = None, timeout: float = 300.0, memory_limit: int | None = None,
    fresh: bool = False, retry_failed: bool = False, dask: str | None = None, security: Mapping[str, str] | None = None,
    on_event: Callable[[Event], None] | None = None,
) -> Results:  # fmt: skip
    """Run the cells of a job that have no final row yet; write rows, tables and manifest."""
    started = utc_now()
    with Store.open(output, fresh=fresh) as store:
        store.add_provenance(provenance())
        local = [cell for cell in job.cells if cell.integrator in job.objects]
        remote = [cell for cell in job.cells if cell.integrator not in job.objects]
        limits: dict[str, Any] = {
            "jobs": jobs, "timeout": timeout, "memory_limit": memory_limit, "retry_failed": retry_failed,
        }  # fmt: skip
        summary = _run_cells(remote, job.context, store, limits, on_event, dask, security)
        measure_here(local, job, store)
        tables = make_tables(job.studies, store, {cell.key for cell in job.cells})
        store.write_tables(tables)
        data = {"cells": len(job.cells), "interrupted": summary.interrupted, "tables": sorted(tables)}
        store.write_manifest(manifest(store.provenance_id, started, utc_now(), data))
        return Results(tables, Path(output), summary, job.left_out, tuple(store.problems))


def _run_cells(
    cells: list[Cell], context: dict[str, Any], store: Store, limits: dict[str, Any],
    on_event: Callable[[Event], None] | None, dask: str | None, security: Mapping[str, str] | None,
) -> Summary:  # fmt: skip
    if dask is None:
        from .engine import run_cells

        return run_cells(cells, MEASURE, context, store, on_event=on_event, **limits)
    from .cluster import run_on_dask

    if (jobs := limits.pop("jobs")) is not None:
        limits["jobs_per_share"] = jobs
    return run_on_dask(cells, MEASURE, context, store, address=dask, security=security, on_event=on_event, **limits)


def plan_job(
    integrators: Iterable[str | Integrator] | None = None,
    scenarios: Iterable[str | Scenario] | None = None,
    studies: Iterable[str] | None = None,
    *,
    dt: Sequence[float] | None = None,
    options: Mapping[str, Any] | None = None,
) -> Job:
    """Look everything up and plan the cells; raises TcbenchError before anything is written."""
    registry = plugins.registry()
    present = [name for name, method in registry.integrators.items() if ABSENT not in method.tags]
    methods = plugins.expand_integrators(present if integrators is None else integrators)
    scenes = [plugins.find_scenario(s) for s in (registry.scenarios if scenarios is None else scenarios)]
    chosen = [find_study(name) for name in (NAMES if studies is None else dict.fromkeys(studies))]
    if len({s.name for s in scenes}) < len(scenes):
        raise TcbenchError("Two scenarios of one run have the same name; give variants a name: replace(name=...).")
    settings = {"dt": _checked_steps(dt, scenes), **(options or {})}
    cells, objects, seen = [], {}, set()
    for study in chosen:
        for method, scene, cell_options in study.plan(methods, scenes, settings):
            if not _suits(method, scene):
                continue
            seen.add((method.name, study.name))
            if registry.integrators.get(method.base or method.name, None) is None or not _registered(method):
                objects[method.name] = method
            cells.append(_cell(study, method, scene, cell_options))
    left_out = [] if integrators is None else _left_out(methods, chosen, scenes, seen, studies is not None)
    if not cells:
        raise TcbenchError(
            " ".join(["There is nothing to run: no integrator, scenario and step fit together.", *left_out])
        )
    custom = {s.name: _scenario_data(s) for s in scenes if not _can_be_named(s)}
    context = {"folders": [str(p) for p in plugins.plugin_folders()], "scenarios": custom}
    return Job(list({c.key: c for c in cells}.values()), context, chosen, objects, left_out)


def _left_out(
    methods: Sequence[Integrator], chosen: Sequence[Study], scenes: Sequence[Scenario], seen: set[tuple[str, str]],
    by_name: bool,
) -> list[str]:  # fmt: skip
    """Why methods have no cell: in a study that was asked for by name, or in any."""
    sentences = []
    for method in methods:
        missing = [study for study in chosen if (method.name, study.name) not in seen]
        if by_name or len(missing) == len(chosen):
            sentences += [_why_not(method, study, scenes) for study in missing[: None if by_name else 1]]
    return sentences


def _why_not(method: Integrator, study: Study, scenes: Sequence[Scenario]) -> str:
    """Why a method that was asked for by name has no cell in a study."""
    suited = any(_suits(method, scene) for scene in scenes)
    if ABSENT in method.tags:
        why = f"its package is not installed ({method.source})"
    elif not suited and method.only_for:
        why = f"it is written for {', '.join(sorted(method.only_for))} only"
    elif not suited and CLOSED_FORM in method.tags:
        why = "no system of these scenes has a closed form of its conduction"
    elif not suited:
        why = "these scenes need a method that is written for their system"
    elif method.kind == "adaptive":
        why = "a method that chooses its steps has no step size to vary"
    elif method.kind == "step":
        why = "it follows the roots of a residual, which a step in Python does not show"
    else:
        why = "none of these scenes and steps fits"
    return f"{method.name} is not in the study {study.name}: {why}."


def _can_be_named(scene: Scenario) -> bool:
    """Does a worker find the same scene by its name?"""
    try:
        return plugins.find_scenario(scene.name) == scene
    except TcbenchError:
        return False


def _suits(method: Integrator, scene: Scenario) -> bool:
    """Methods with an exact conduction step are for systems that have its closed form, others for one system only;
    elsewhere they refuse."""
    from .system import System

    if method.only_for or scene.model.by_arrays:  # what is too large to be traced needs a method that knows the system
        return scene.system.name in method.only_for
    return CLOSED_FORM not in method.tags or scene.system.conduction_flow is not System.conduction_flow


def _checked_steps(dt: Sequence[float] | None, scenes: Sequence[Scenario]) -> list[float] | None:
    """The steps asked for; each must fit at least the longest scene."""
    if dt is None:
        return None
    from .simulation import checked_dt

    longest = max(scenes, key=lambda s: s.t_end)
    return [checked_dt(value, longest) for value in dt]


def _registered(method: Integrator) -> bool:
    """Can a worker find the same integrator by its name?"""
    try:
        return plugins.find_integrator(method.name).flows == method.flows and bool(method.plugin)
    except TcbenchError:
        return False


def _cell(study: Study, method: Integrator, scene: Scenario, options: dict[str, Any]) -> Cell:
    mark = fingerprint(
        integrator=[source_hash(p) for p in (method.plugin, *method.uses)],
        scenario=scene.as_dict(), study=_study_hash(study.name), versions=_versions(), order=method.order,
    )  # fmt: skip
    machine = _machine() if study.timed else ""
    return Cell(study.name, method.name, scene.name, options, study.timed, mark, machine)


@cache
def _versions() -> dict[str, str]:
    return versions()


@cache
def _machine() -> str:
    return machine_name()


@cache
def source_hash(plugin: str) -> str:
    """Hash of a plugin's file and of the local modules that it imports; "" for objects of this session."""
    origin = plugins.registry().origins.get(plugin)
    return fingerprint_sources(origin.path) if origin and origin.path else ""


@cache
def _study_hash(name: str) -> str:
    """Hash of a study and of everything in tcbench that it imports: the solvers, the metrics, the references."""
    return fingerprint_sources(Path(__file__).parent / "studies" / f"{name}.py")


def _scenario_data(scene: Scenario) -> dict[str, Any]:
    """A scenario that is not registered, as JSON: rebuilt in each worker."""
    system = scene.system
    return scene.as_dict() | {
        "system": f"{system.__module__}:{system.__qualname__}", "name": scene.name, "dt": scene.dt,
        "t_converge": scene.t_converge, "ladder": list(scene.ladder),
    }  # fmt: skip


def _rebuild(data: Mapping[str, Any]) -> Scenario:
    module, _, name = data["system"].partition(":")
    system = getattr(importlib.import_module(module), name)
    return Scenario(**{k: v for k, v in data.items() if k != "system"}, system=system)


@cache
def _prepare(folders: tuple[str, ...]) -> None:
    plugins.use_folders(folders)


def measure_cell(cell: dict[str, Any], context: dict[str, Any]) -> dict[str, Any]:
    """Measure one cell in a worker: look the names up, call the study, add where the numbers come from."""
    _prepare(tuple(context.get("folders", ())))
    method = plugins.find_integrator(cell["integrator"])
    custom = context.get("scenarios", {}).get(cell["scenario"])
    scene = _rebuild(custom) if custom else plugins.find_scenario(cell["scenario"])
    return _measure(method, scene, cell)


def _measure(method: Integrator, scene: Scenario, cell: Mapping[str, Any]) -> dict[str, Any]:
    row = find_study(cell["study"]).measure(method, scene, dict(cell["options"]))
    origin = plugins.registry().origins.get(method.plugin)
    return row | {
        "plugin": str(origin) if origin and origin.distribution else method.plugin,
        "source_hash": source_hash(method.plugin)[:12],
        "scenario_hash": scene.hash,
        "tcbench_version": package_version("tcbench"),
    }


def measure_here(cells: Sequence[Cell], job: Job, store: Rows) -> None:
    """Cells of integrators that exist only in this process (a notebook, say): no isolation, no deadline."""
    from .worker import exception_row

    finished = store.finished_keys()
    for cell in cells:
        if cell.key in finished and cell.fingerprint:
            continue
        custom = job.context["scenarios"].get(cell.scenario)
        scene = _rebuild(custom) if custom else plugins.find_scenario(cell.scenario)
        try:
            row = _measure(job.objects[cell.integrator], scene, cell.as_dict())
        except Exception as error:
            row = exception_row(error)
        store.append(cell.key, row, cell.as_dict())


def make_tables(studies: Iterable[Study], store: Rows, keys: set[str] | None = None) -> dict[str, DataFrame]:
    """Tables of the rows in the store; of these keys only, when given."""
    tables: dict[str, DataFrame] = {}
    for study in studies:
        records = [r for r in store.records(study.name) if keys is None or r["key"] in keys]
        if records:
            tables |= study.tabulate([{k: v for k, v in r.items() if k not in ("study", "key")} for r in records])
    return tables


def preview(job: Job, output: str | Path, retry_failed: bool, jobs: int | None) -> Plan:
    """What a run would do and for how long, from the rows that are there; nothing is written."""
    from .engine import plan

    store = Store.read(output) if Path(output).exists() else Rows()
    return plan(job.cells, store, retry_failed, jobs)
