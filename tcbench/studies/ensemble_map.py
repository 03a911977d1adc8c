"""Maps of where: the share of random scenarios on which a method fails, over a constant and the step.

Axes are written as those of the stability map, `name=low:high:n[:log]`. `dt` is the step, at n values; the name of a
range of the family (stiffness, conductivity, ...) is cut into n bins. In a bin that number is drawn from the bin
and everything else as always, from the same seeds, so that neighbouring cells differ by it alone.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from .. import plugins
from ..analysis.statistics import wilson
from ..errors import TcbenchError, unknown_name
from ..integrator import Integrator
from ..study import Cells, Row, Study, Tables
from ..systems.scenario import Scenario
from ..table import Table
from .ensemble import APART, members, numbers_hash, whole
from .map import Axis, axes

SIZE = 30  # scenarios in a cell
LARGEST = 10_000
FAILURES = Table("failure_map", key=("x_name", "x_low", "x_high", "y_name", "y_low", "y_high", "first_seed", "runs"))


def bins(axis: Axis) -> list[tuple[float, float]]:
    """(low, high) of each place on an axis; equal for steps."""
    if axis.name == "dt":
        return [(value, value) for value in axis.values]
    low, high, n = axis.values[0], axis.values[-1], len(axis.values)
    edges = np.geomspace(low, high, n + 1) if axis.log else np.linspace(low, high, n + 1)
    spelled = [float(f"{edge:.6g}") for edge in edges]
    return list(itertools.pairwise(spelled))


def family_axes(scenario: Scenario, options: Mapping[str, Any]) -> tuple[Axis, Axis]:
    """The axes as written, of numbers that the scenario's family has a range for, or the step."""
    family = plugins.find_family(plugins.split_name(scenario.name)[0])
    x, y = axes(options)
    for axis in (x, y):
        if axis.name != "dt" and axis.name not in family.ranges:
            raise unknown_name(f"axis of a map of {family.name!r}", axis.name, ["dt", *family.ranges])
    return x, y


def plan(integrators: Sequence[Integrator], scenarios: Sequence[Scenario], options: Mapping[str, Any]) -> Cells:
    """One cell a row of the map; options: x, y (axes as written), size (scenarios in a cell), seed."""
    size = whole(options, "size", SIZE, 2, LARGEST)
    first = APART * whole(options, "seed", 0, 0, 10**9)
    cells: Cells = []
    for scenario in scenarios:
        _, y = family_axes(scenario, options)
        for method in integrators:
            if method.kind == "adaptive":
                raise TcbenchError(f"{method.name!r} chooses its steps; a map needs a method with a step.")
            cell = {"x": options["x"], "y": options["y"], "seeds": [first, first + size]}
            cells += [(method, scenario, cell | {"row": row}) for row in range(len(bins(y)))]
    return cells


def _places(scenario: Scenario, options: Mapping[str, Any]) -> list[tuple[tuple[float, float], float, dict[str, str]]]:
    """Each place of a row of the map: (low, high) along x, the step, and the ranges of its scenarios."""
    x, y = family_axes(scenario, options)
    places = []
    for along in bins(x):
        spans = {x.name: along, y.name: bins(y)[options["row"]]}
        dt = spans.pop("dt", (scenario.dt, scenario.dt))[0]
        places.append((along, dt, {axis: f"{low!r}:{high!r}" for axis, (low, high) in spans.items()}))
    return places


def drawn(scenario: Scenario, options: Row) -> list[str]:
    """The numbers of all scenarios of a row of the map."""
    return [numbers_hash(scenario, options["seeds"], **ranges) for _, _, ranges in _places(scenario, options)]


def measure(integrator: Integrator, scenario: Scenario, options: Row) -> Row:
    """One row of the map: at each place of x how many runs there were, and how many failed in which way."""
    from . import ensemble_runs as runs

    x, y = family_axes(scenario, options)
    cells = []
    for along, dt, ranges in _places(scenario, options):
        block = members(scenario, options["seeds"], **ranges)
        fitting = [member if dt <= member.t_end else replace(member, t_end=dt) for member in block]
        kinds = [runs.KINDS[k] for k in runs.shares(integrator, fitting, [dt])[0]["kinds"]]
        failed = {kind: kinds.count(kind) for kind in runs.KINDS[1:6]}
        cells.append({"x_low": along[0], "x_high": along[1], "runs": len(kinds), "kinds": failed})
    family, across = plugins.split_name(scenario.name)[0], list(bins(y)[options["row"]])
    return {"status": "ok", "cells": cells, "names": [x.name, y.name], "across": across, "family": family}


def tabulate(records: Sequence[Row]) -> Tables:
    """`failure_map`: a row a cell, with the share of failures and its 95 % interval. Rows that were lost are absent."""
    import pandas as pd

    rows: list[Row] = []
    for record in records:
        for cell in record.get("cells") or []:
            failed = sum(cell["kinds"].values())
            low, high = wilson(failed, cell["runs"])
            rows.append(
                {"ensemble": record["family"], "integrator": record["integrator"]}
                | {"x_name": record["names"][0], "x_low": cell["x_low"], "x_high": cell["x_high"]}
                | {"y_name": record["names"][1], "y_low": record["across"][0], "y_high": record["across"][1]}
                | {"runs": cell["runs"], "failed": failed, "share": failed / cell["runs"], "low": low, "high": high}
                | cell["kinds"] | {"first_seed": record["seeds"][0]}
            )  # fmt: skip
    table = pd.DataFrame(rows)
    return {"failure_map": table.sort_values(["integrator", "y_low", "x_low"], ignore_index=True)} if rows else {}


STUDY = Study(
    name="ensemble_map",
    description="share of random scenarios on which a method fails, over a constant and the step",
    tables=(FAILURES,),
    plan=plan,
    measure=measure,
    tabulate=tabulate,
    by_default=False,
    sampled=True,
    drawn=drawn,
)
