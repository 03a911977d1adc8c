"""One cell to its row: look the names up, call the study, say where the numbers come from."""

from __future__ import annotations

import functools
import importlib
import time
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

from .. import plugins
from ..compiler.code_hash import content_hash
from ..errors import ChangedError
from ..integrator import Integrator
from ..store.cells import Cell
from ..store.provenance import package_version
from ..store.store import Rows
from ..studies.base import find_study
from ..systems.scenario import Scenario
from .fingerprint import UNHASHABLE, method_mark, method_sources, system_sources, worker_finds

if TYPE_CHECKING:
    from .local import Event, Summary
    from .planning import Job

MEASURE = "tcbench.engine.measure:measure_cell"


def measure_cell(cell: dict[str, Any], context: dict[str, Any]) -> dict[str, Any]:
    """Measure one cell in a worker: look the names up, call the study, add where the numbers come from."""
    _prepare(tuple(context.get("folders", ())))
    method = plugins.find_integrator(cell["integrator"])
    custom = context.get("scenarios", {}).get(cell["scenario"])
    scenario = _rebuild(custom) if custom else plugins.find_scenario(cell["scenario"])
    _refuse_edited(method.name, method_sources(method), context.get("integrator_sources", {}))
    _refuse_edited(scenario.name, system_sources(scenario.system), context.get("scenario_sources", {}))
    from ..simulation import shared_runs
    from ..solver import foresight

    with foresight.within(context.get("timeout")), shared_runs.kept_in(context.get("shared_runs")):
        return _measure(method, scenario, cell) | {"shared_runs": shared_runs.found()}


def _refuse_edited(name: str, sources: list[str], planned: Mapping[str, list[str]]) -> None:
    """A worker reads files when it starts, perhaps in the middle of a run: no row of theirs for those of the plan."""
    expected = planned.get(name, sources)
    if sources != expected and not any(mark.startswith(UNHASHABLE) for mark in expected):
        raise ChangedError(
            f"The files of {name} are not those that the run was planned with: edited meanwhile, or others on this "
            "machine. Run again, and what they say now is measured."
        )


def _measure(method: Integrator, scenario: Scenario, cell: Mapping[str, Any]) -> dict[str, Any]:
    row = find_study(cell["study"]).measure(method, scenario, dict(cell["options"]))
    origin = plugins.registry().origins.get(method.plugin)
    return row | {
        "plugin": str(origin) if origin and origin.distribution else method.plugin,
        "source_hash": method_mark(method_sources(method)),
        "scenario_hash": scenario.hash,
        "tcbench_version": package_version("tcbench"),
    }


def measure_here(
    cells: Sequence[Cell], job: Job, store: Rows, summary: Summary, retry_failed: bool = False,
    on_event: Callable[[Event], None] | None = None,
) -> None:  # fmt: skip
    """Cells of what exists only in this process (a notebook, say): no isolation, no deadline. Counts in `summary`."""
    from .local import Ledger, plan

    began = time.monotonic()
    todo = plan(cells, store, retry_failed)
    summary.planned += len(todo.to_run) + todo.finished
    summary.already_finished += todo.finished
    ledger = Ledger(store, summary, on_event, summary.run + len(todo.to_run))
    try:
        for cell in todo.to_run:
            ledger.start(cell, 1)
            ledger.write(cell, _row_here(cell, *job.here[cell.key]), 0)
    except KeyboardInterrupt:
        summary.interrupted = True
    summary.elapsed_s += time.monotonic() - began


def _row_here(cell: Cell, method: Integrator, scenario: Scenario) -> dict[str, Any]:
    from .worker import complete_row

    return complete_row(
        lambda: _measure(method, scenario, cell.as_dict()),
        {"timed": cell.timed, "source_hash": method_mark(method_sources(method))},
    )


def scenario_data(scenario: Scenario) -> dict[str, Any] | None:
    """A scenario that is not registered, as JSON, to be made again in each worker; None where a worker cannot."""
    system = scenario.system
    if not worker_finds(system) or (code := content_hash(system)) is None:
        return None
    return scenario.as_dict() | {
        "system": f"{system.__module__}:{system.__qualname__}", "code": code, "name": scenario.name, "dt": scenario.dt,
        "t_converge": scenario.t_converge, "ladder": list(scenario.ladder),
    }  # fmt: skip


def _rebuild(data: Mapping[str, Any]) -> Scenario:
    module, _, name = data["system"].partition(":")
    system: Any = functools.reduce(getattr, name.split("."), importlib.import_module(module))
    if content_hash(system) != data["code"]:
        raise ChangedError(
            f"The system {name} of {module} is not what its file says: it was changed in the session that started the "
            "run, or its file was edited after it was imported. Start Python anew, or give the system to "
            "tcbench.run from a script or notebook cell."
        )
    return Scenario(**{k: v for k, v in data.items() if k not in ("system", "code")}, system=system)


@cache
def _prepare(folders: tuple[str, ...]) -> None:
    plugins.use_folders(folders)
