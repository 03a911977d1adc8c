"""One cell to its row: look the names up, call the study, say where the numbers come from."""

from __future__ import annotations

import pkgutil
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import plugins
from ..compiler.code_hash import content_hash
from ..errors import ChangedError
from ..inputs import watching
from ..inputs.marks import installed_version
from ..integrator import Integrator
from ..loading.registry import watched
from ..store.cells import Cell
from ..store.provenance import machine_name
from ..store.rows import Rows
from ..studies.base import find_study
from ..systems.scenario import Scenario
from .fingerprint import own_sources, scenario_mark, worker_finds

if TYPE_CHECKING:
    from .local import Event, Summary
    from .planning import Job

MEASURE = "tcbench.engine.measure:measure_cell"


def measure_cell(cell: dict[str, Any], context: dict[str, Any]) -> dict[str, Any]:
    """Measure one cell in a worker: look the names up, call the study, add where the numbers come from."""
    if own_sources() != context["tcbench"]:
        raise ChangedError(
            "tcbench is not what the run was planned with: its files were edited meanwhile, or this machine has "
            "another version. Run again; on a cluster install one version everywhere."
        )
    plugins.use_index(context["index"])
    method = plugins.find_integrator(cell["integrator"])
    custom = context.get("scenarios", {}).get(cell["scenario"])
    scenario = _rebuild(custom) if custom else plugins.find_scenario(cell["scenario"])
    planned = context["marks"]["scenarios"]
    if scenario_mark(scenario) != planned.get(scenario.name, scenario_mark(scenario)):
        raise ChangedError(
            f"The scenario {scenario.name} is not what the run was planned with: what it is made from was edited "
            "meanwhile, or is another on this machine. Run again, and it is measured as it is now."
        )
    from ..simulation import shared_runs
    from ..solver import foresight

    with foresight.within(context.get("timeout")), shared_runs.kept_in(context.get("shared_runs")):
        return _measure(method, scenario, cell) | {"shared_runs": shared_runs.found()}


def _measure(method: Integrator, scenario: Scenario, cell: Mapping[str, Any]) -> dict[str, Any]:
    row = find_study(cell["study"]).measured(method, scenario, cell["options"])
    origin = plugins.registry().origins.get(method.plugin)
    return row | {
        "plugin": str(origin) if origin and origin.distribution else method.plugin,
        "scenario_hash": scenario.hash,
        "tcbench_version": installed_version("tcbench") or None,
        **({"machine": machine_name()} if cell["timed"] else {}),
    }


def measure_here(
    cells: Sequence[Cell], job: Job, store: Rows, summary: Summary, retry_failed: bool = False,
    on_event: Callable[[Event], None] | None = None,
) -> None:  # fmt: skip
    """Cells of what exists only in this process (a notebook, say): no isolation, no deadline. Counts in `summary`."""
    from .local import Ledger, plan
    from .worker import complete_row

    began = time.monotonic()
    to_run, found = plan(cells, store, retry_failed, here={cell.key for cell in cells})  # what it is made of: not noted
    summary.planned += found.planned
    summary.already_finished += found.already_finished
    ledger = Ledger(store, summary, on_event, summary.run + len(to_run), job.context["marks"])
    try:
        for cell in to_run:
            ledger.start(cell, 1)
            row = complete_row(partial(_measure, *job.here[cell.key], cell.as_dict()), {"timed": cell.timed})
            ledger.write(cell, row, 0)
    except KeyboardInterrupt:
        summary.interrupted = True
    summary.elapsed_s += time.monotonic() - began


def scenario_data(scenario: Scenario) -> dict[str, Any] | None:
    """A scenario that is not registered, as JSON, to be made again in each worker; None where a worker cannot."""
    system = scenario.system
    if not worker_finds(system) or (code := content_hash(system)) is None:
        return None
    place = f"{system.__module__}:{system.__qualname__}"
    return scenario.as_dict() | {
        "system": place, "label": module_label(place), "code": code, "name": scenario.name, "dt": scenario.dt,
        "t_converge": scenario.t_converge, "ladder": list(scenario.ladder),
    }  # fmt: skip


def module_label(system: str) -> str:
    """Whose code a system ("module:class") is: a plugin's label, or its module; "" for tcbench's own."""
    module = system.partition(":")[0]
    if module.partition(".")[0] in ("tcbench", "tcbench_plugins"):
        return ""
    file = getattr(sys.modules.get(module), "__file__", None)
    labels = (label for label, origin in plugins.registry().origins.items() if file and origin.path == file)
    return next(labels, f"module {module.partition('.')[0]}")


def module_folder(system: str) -> str:
    """Where the package or module of a system lies: imports of it begin there."""
    top = sys.modules[system.partition(":")[0].partition(".")[0]]
    if hasattr(top, "__path__"):
        return str(Path(next(iter(top.__path__))).parent)
    return str(Path(top.__file__ or ".").parent)


_REBUILT: list[Any] = []  # data and scenario of the cell before, which is often of the same one


def _rebuild(data: Mapping[str, Any]) -> Scenario:
    if data["label"]:
        return _made(data)  # of a plugin: what it reads is noted for each cell
    if not _REBUILT or _REBUILT[0] != data:
        _REBUILT[:] = data, _made(data)
    found: Scenario = _REBUILT[1]
    return found


def _made(data: Mapping[str, Any]) -> Scenario:
    module, _, name = data["system"].partition(":")
    if data["label"].startswith("module "):
        watching.begin()  # before it is imported
    elif data["label"]:
        plugins.registry().need(data["label"])
    system: Any = pkgutil.resolve_name(data["system"])
    if data["label"].startswith("module "):
        watched(data["label"], module_folder(data["system"]))
    if content_hash(system) != data["code"]:
        raise ChangedError(
            f"The system {name} of {module} is not what its file says: it was changed in the session that started the "
            "run, or its file was edited after it was imported. Start Python anew, or give the system to "
            "tcbench.run from a script or notebook cell."
        )
    return Scenario(**{k: v for k, v in data.items() if k not in ("system", "code", "label")}, system=system)
