"""`tcbench simulate`, apart from parsing: a newcomer's first command, with nothing that it does not need."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from .. import plugins
from ..errors import TcbenchError, needs_folder, writing
from ..files import written
from ..progress import waiting
from ..report.verdicts import verdicts
from ..simulation import metrics
from ..simulation.run import simulate
from ..simulation.views import columns
from . import terminal
from .options import words

AGAIN_S = 10.0  # a run of a solver of its own that took less is repeated for its time


def one_of(kind: str, chosen: Sequence[Any], many: str) -> Any:
    """The one integrator or scenario (or its name) that was selected."""
    if len(chosen) == 1:
        return chosen[0]
    if not chosen:
        raise TcbenchError(f"Say which {kind}: {many}")
    names = ", ".join(getattr(item, "name", item) for item in chosen)
    raise TcbenchError(f"One {kind} is needed here, not {len(chosen)} ({names}). {many}")


def simulate_command(
    names: tuple[str, ...], integrators: tuple[str, ...], scenarios: tuple[str, ...], *,
    dt: float | None, t_end: float | None, tolerance: float | None, plain: bool, record_every: int, audit_roots: bool,
    csv: Path | None, fields: Path | None, as_json: bool,
) -> None:  # fmt: skip
    many = "tcbench simulate INTEGRATOR SCENARIO; tcbench run takes many."
    methods, chosen = words(names, integrators, scenarios)
    integrator = one_of("integrator", plugins.expand_integrators(methods), many)
    scenario = one_of("scenario", plugins.expand_scenarios(chosen), many)
    for path in (csv, fields):
        if path is not None:
            needs_folder(path)
    if dt is not None and integrator.kind == "adaptive":
        raise TcbenchError(f"{integrator.name!r} chooses its steps: give --tolerance instead of --dt.")
    go = partial(
        simulate, integrator, scenario, dt, t_end, tolerance=tolerance, continuation=not plain,
        record_every=record_every, residuals=True, audit_roots=audit_roots,
    )  # fmt: skip
    with waiting(f"{integrator.name} on {scenario.name}"):
        run_ = go()
        if integrator.kind == "adaptive" and run_.wall_time_s < AGAIN_S:
            run_ = go()  # the first one compiled: a time a step is told of a warm one
    row = {"integrator": run_.integrator.name, "scenario": run_.scenario.name, "dt": run_.dt}
    row |= metrics.conservation(run_)
    row |= {name: value for name, value in asdict(run_.solver).items() if value and name != "unknown"}
    if csv is not None:
        _write_csv(run_, csv)
    shown = None if fields is None else run_.write(fields)
    if as_json:
        terminal.print_json(row)
    else:
        notes = verdicts(integrator, row)
        if run_.t[-1] > (end := run_.scenario.t_end) * (1 + 1e-9):  # whole steps do not fit
            notes["t_final"] = f"the last of {run_.steps} steps ends past t_end = {end:g}"
        terminal.print_row(row, notes)
        if csv is not None:
            terminal.say(f"{len(run_.t)} states in {csv}")
        if shown is not None:
            terminal.say(f"{len(run_.t)} states in {shown}")


def _write_csv(run_: Any, path: Path) -> None:
    """t, z, energy, entropy, invariants and temperatures, all digits."""
    data = columns(run_)
    with writing(repr(str(path))), written(path) as temporary:
        table = np.column_stack([*data.values()])
        np.savetxt(temporary, table, delimiter=",", header=",".join(data), comments="", fmt="%.17g")
