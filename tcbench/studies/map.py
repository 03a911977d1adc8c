"""Stability maps: the outcome of a run over two parameters, one of them usually the step.

An axis is written `name=low:high:n` or `name=low:high:n:log`. Names: `dt`, the step itself; `energy`, a multiplier of
the initial kinetic energy (momenta are multiplied by its square root); any constant or initial value of the scenario
(stiffness, temperatures, a variable of a general system), a multiplier of the scenario's own value; with an index,
`stiffness[1]`, a multiplier of that entry alone. Everything is dimensionless.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..analysis import stable_step as stability
from ..errors import TcbenchError, unknown_name
from ..integrator import Integrator
from ..study import Cells, Row, Study, Tables
from ..systems.scenario import Scenario
from ..table import Table
from .frames import spread, table_of

_AXIS = re.compile(r"(?P<name>[a-z_]+(\[\d+\])?)=(?P<low>[^:]+):(?P<high>[^:]+):(?P<n>\d+)(?P<log>:log)?\Z")
MULTIPLIED = ("positions", "momenta", "temperatures")  # where a system has them; t_end and constants are multiplied too
MAP = Table(
    "map",
    (
        "integrator", "scenario", "x_name", "x", "y_name", "y", "dt", "outcome", "status", "energy_error_max",
        "blowup_time", "outcome_plain", "folds", "failure",
    ),
    key=("x_name", "x", "y_name", "y"),
)  # fmt: skip


@dataclass(frozen=True)
class Axis:
    """One axis of a map: `values` of the parameter `name`, evenly spaced, in the logarithm if `log`."""

    name: str
    values: tuple[float, ...]
    log: bool


MOST_VALUES = 2000  # on an axis: more than a screen or a page can show


def axes(options: Mapping[str, Any]) -> tuple[Axis, Axis]:
    """Both axes as written; TcbenchError where a map is asked for as other studies are, without axes, or with one."""
    if not options.get("x") or not options.get("y"):
        raise TcbenchError("A map needs its two axes: tcbench map INTEGRATOR SCENARIO --x dt=0.02:4:40:log --y ...")
    x, y = parse_axis(options["x"]), parse_axis(options["y"])
    if x.name == y.name:
        raise TcbenchError(f"Both axes of the map are {x.name!r}; they must differ.")
    return x, y


def parse_axis(text: str) -> Axis:
    """An axis from `name=low:high:n[:log]`."""
    match = _AXIS.match(text.strip())
    if match is None:
        raise TcbenchError(f"Axis {text!r} must read name=low:high:n or name=low:high:n:log, as in dt=0.02:4:40:log.")
    try:
        low, high, n = float(match["low"]), float(match["high"]), int(match["n"])
    except ValueError:
        raise TcbenchError(f"Axis {text!r}: low and high must be numbers.") from None
    if not (math.isfinite(low) and math.isfinite(high) and low < high and n >= 2):
        raise TcbenchError(f"Axis {text!r} needs low < high, both finite, and at least 2 values.")
    if n > MOST_VALUES:
        raise TcbenchError(f"Axis {text!r}: at most {MOST_VALUES} values, not {n}.")
    if low <= 0:
        raise TcbenchError(f"Axis {text!r}: low must be positive.")
    values = np.geomspace(low, high, n) if match["log"] else np.linspace(low, high, n)
    return Axis(match["name"], tuple(float(v) for v in values), bool(match["log"]))


def varied(scenario: Scenario, name: str, value: float) -> tuple[Scenario, float | None]:
    """The scenario with one parameter changed, and the step if that is what `name` says."""
    if name == "dt":
        return scenario, value
    start = [n for n in MULTIPLIED if n in scenario.model.initial_data]
    if name == "energy" and "momenta" in start:
        momenta = math.sqrt(value) * np.asarray(scenario.momenta)
        return scenario.replace(momenta=momenta), None
    base, _, index = name.rstrip("]").partition("[")
    if base in scenario.constants:
        own = np.array(scenario.constants[base], dtype=float)
    elif base in scenario.initial:  # the variables of a general system
        own = np.array(scenario.initial[base], dtype=float)
    elif base in (*start, "t_end"):
        own = np.array(getattr(scenario, base), dtype=float)
    else:
        parameters = ["dt", *(["energy"] if start else []), *start, *scenario.initial, "t_end", *scenario.constants]
        raise unknown_name("parameter of this map", base, parameters)
    if index and not int(index) < own.size:
        raise TcbenchError(f"{base!r} has {own.size} entries, so {name!r} does not exist; the first is {base}[0].")
    where: Any = int(index) if index and own.ndim else ...
    own[where] *= value
    return scenario.replace(**{base: own if own.ndim else float(own)}), None


def measure_cell(
    integrator: Integrator, scenario: Scenario, x: tuple[str, float], y: tuple[str, float], own: float | None = None
) -> Row:
    """The outcome at one point of the map: with the shared solver, with plain Newton, and whether the sheet folds.

    own : the step where no axis is the step; by default the scenario's.
    """
    scenario, dt = varied(scenario, *x)
    scenario, dt_y = varied(scenario, *y)
    dt = next((value for value in (dt, dt_y) if value is not None), own or scenario.dt)
    row: Row = {"x_name": x[0], "x": x[1], "y_name": y[0], "y": y[1], "dt": dt}
    if dt > scenario.t_end:
        return row | {"outcome": "skipped", "status": "skipped", "failure": "dt is longer than the horizon"}
    full = stability.outcome(integrator, scenario, dt)
    plain = stability.outcome(integrator, scenario, dt, continuation=False)
    fold = stability.principal_outcome(integrator, scenario, dt, until_fold=True)
    return row | {
        "outcome": full.kind, "status": full.status, "energy_error_max": full.energy_error,
        "blowup_time": full.blowup_time, "outcome_plain": plain.kind, "folds": fold.folds > 0, "failure": full.failure,
    }  # fmt: skip


def plan(integrators: Sequence[Integrator], scenarios: Sequence[Scenario], options: Mapping[str, Any]) -> Cells:
    """One cell a row of the map; options "x" and "y" are the axes as written."""
    x, y = axes(options)
    if (dt := options.get("dt")) is not None:
        if "dt" in (x.name, y.name):
            raise TcbenchError("The step is an axis of this map already: leave out --dt, or take another axis.")
        if not (math.isfinite(dt) and dt > 0):
            raise TcbenchError(f"The step of a map is a positive number, not {dt:g}.")
    step = {} if dt is None else {"dt": float(dt)}
    cells: Cells = []
    for scenario in scenarios:
        for axis in (x, y):
            varied(scenario, axis.name, axis.values[0])  # a name that does not exist is an error before the first cell
        for integrator in integrators:
            if integrator.kind != "flows":
                raise TcbenchError(f"{integrator.name!r} is not given by flows; a map needs one that is.")
            cells.extend(
                (integrator, scenario, {"x": options["x"], "y": options["y"], **step, "row": j})
                for j in range(len(y.values))
            )
    return cells


def measure(integrator: Integrator, scenario: Scenario, options: Row) -> Row:
    """One row of the map: every x at the y of index options["row"]."""
    x, y = axes(options)
    at = (y.name, y.values[options["row"]])
    dt = options.get("dt")
    cells = [measure_cell(integrator, scenario, (x.name, value), at, dt) for value in x.values]
    return {"status": "ok", "cells": cells}


def tabulate(records: Sequence[Row]) -> Tables:
    rows = spread(records, "cells", "x", "y", "row", failed=_lost_row)
    return {"map": table_of(rows, MAP, ("scenario", "integrator", "y", "x"))[MAP.names]}


def _lost_row(record: Mapping[str, Any]) -> Row:
    """A row whose cell did not complete (a crash, a deadline): one entry, so that it is seen."""
    x, y = axes(record)
    return {
        "x_name": x.name, "y_name": y.name, "y": y.values[record["row"]], "outcome": record["status"],
        "status": record["status"], "failure": record.get("failure", ""),
    }  # fmt: skip


STUDY = Study(
    name="map",
    by_default=False,
    description="outcome over two parameters, one cell a row of the map",
    tables=(MAP,),
    plan=plan,
    measure=measure,
    tabulate=tabulate,
    of_random="ensemble_map",
)
