"""One cell to its row: look the names up, call the study, say where the numbers come from."""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

from .. import plugins
from ..integrator import Integrator
from ..store.cells import Cell
from ..store.provenance import package_version
from ..store.store import Rows
from ..studies.base import find_study
from ..systems.scenario import Scenario
from .fingerprint import source_hash

if TYPE_CHECKING:
    from .planning import Job

MEASURE = "tcbench.engine.measure:measure_cell"


def measure_cell(cell: dict[str, Any], context: dict[str, Any]) -> dict[str, Any]:
    """Measure one cell in a worker: look the names up, call the study, add where the numbers come from."""
    _prepare(tuple(context.get("folders", ())))
    method = plugins.find_integrator(cell["integrator"])
    custom = context.get("scenarios", {}).get(cell["scenario"])
    scenario = _rebuild(custom) if custom else plugins.find_scenario(cell["scenario"])
    return _measure(method, scenario, cell)


def _measure(method: Integrator, scenario: Scenario, cell: Mapping[str, Any]) -> dict[str, Any]:
    row = find_study(cell["study"]).measure(method, scenario, dict(cell["options"]))
    origin = plugins.registry().origins.get(method.plugin)
    return row | {
        "plugin": str(origin) if origin and origin.distribution else method.plugin,
        "source_hash": source_hash(method.plugin)[:12],
        "scenario_hash": scenario.hash,
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
        scenario = _rebuild(custom) if custom else plugins.find_scenario(cell.scenario)
        try:
            row = _measure(job.objects[cell.integrator], scenario, cell.as_dict())
        except Exception as error:
            row = exception_row(error)
        store.append(cell.key, row, cell.as_dict())


def scenario_data(scenario: Scenario) -> dict[str, Any]:
    """A scenario that is not registered, as JSON: rebuilt in each worker."""
    system = scenario.system
    return scenario.as_dict() | {
        "system": f"{system.__module__}:{system.__qualname__}", "name": scenario.name, "dt": scenario.dt,
        "t_converge": scenario.t_converge, "ladder": list(scenario.ladder),
    }  # fmt: skip


def _rebuild(data: Mapping[str, Any]) -> Scenario:
    module, _, name = data["system"].partition(":")
    system = getattr(importlib.import_module(module), name)
    return Scenario(**{k: v for k, v in data.items() if k != "system"}, system=system)


@cache
def _prepare(folders: tuple[str, ...]) -> None:
    plugins.use_folders(folders)
