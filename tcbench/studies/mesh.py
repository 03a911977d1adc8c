"""Mesh: how far nodes are from where the finest mesh and step have them, against mesh and step.

A cell is a method on one mesh with one step, to the end of the scenario. Meshes of a family share the nodes that stand
at one place at the start; the finest run of a method is the one with most numbers, and of these with the shortest step.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..integrator import Integrator
from ..simulation.fields import mesh_of, points_at
from ..simulation.run import simulate
from ..study import Cells, Row, Study, Tables
from ..systems.scenario import Scenario
from ..table import Column, Table
from .frames import table_of

SCENARIOS = tuple(f"ring[n={n}]" for n in (12, 24, 48, 96))
STEPS = (4.0, 2.0, 1.0, 0.5)  # times the scenario's own
DIGITS = 6  # of a place at the start, over the size of the whole, by which nodes of two meshes are one
MESH = Table(
    "mesh",
    (
        "integrator", "family", "scenario", "numbers", "dt", "status",
        Column("mesh_error", "largest distance of a node from where the finest run has it", "distance", worse="higher"),
        Column("common_nodes", "nodes that the finest mesh has, too", "nodes"), "energy_error_max", "failure",
    ),
    key=("numbers", "dt"),
)  # fmt: skip


def plan(integrators: Sequence[Integrator], scenarios: Sequence[Scenario], options: Mapping[str, Any]) -> Cells:
    """One cell a method with a step, mesh and step."""
    stepping = [i for i in integrators if i.kind != "adaptive" and not i.lacks]
    steps = {s.name: options.get("dt") or [f * s.dt for f in STEPS] for s in scenarios}
    return [(i, s, {"dt": dt}) for s in scenarios for i in stepping if not i.suits(s.model) for dt in steps[s.name]]


def measure(integrator: Integrator, scenario: Scenario, options: Row) -> Row:
    """Where nodes are at the start and at the end. TcbenchError where nothing has a place."""
    run = simulate(integrator, scenario, dt=options["dt"], record_every=None)
    mesh = mesh_of(scenario.model, scenario.z0)
    start, end = (points_at(scenario.model, run.z[k], mesh) for k in (0, -1))
    nodes = {"start": start.tolist(), "end": end.tolist()} if run.ok else {}
    return nodes | {
        "family": scenario.system.name, "numbers": scenario.model.size, "status": run.status, "failure": run.failure,
        "energy_error_max": run.summary.energy_error_max,
    }  # fmt: skip


def tabulate(records: Sequence[Row]) -> Tables:
    """A row a method, mesh and step; NaN for the finest run, with which the others are compared."""
    rows = []
    done = [r for r in records if r.get("start")]
    for _, group in itertools.groupby(sorted(done, key=_group), _group):
        *others, finest = sorted(group, key=lambda r: (r["numbers"], -r["dt"]))
        rows += [r | distance(r, finest) for r in others] + [finest]
    rows += [{"family": r["scenario"].partition("[")[0]} | r for r in records if not r.get("start")]
    kept = [{k: v for k, v in r.items() if k not in ("start", "end")} for r in rows]
    return {"mesh": table_of(kept, MESH, ("family", "integrator", "numbers", "dt"))}


def _group(row: Row) -> tuple[str, str]:
    return row["family"], row["integrator"]


def distance(row: Row, finest: Row) -> Row:
    """The largest distance at the end of nodes that both meshes have at the start, and how many these are."""
    size = np.ptp(np.asarray(finest["start"], dtype=float), axis=0).max()
    places = (np.round(np.asarray(r["start"]) / size, DIGITS) + 0.0 for r in (row, finest))
    ends = (np.asarray(r["end"], dtype=float) for r in (row, finest))
    mine, theirs = (dict(zip(map(tuple, of.tolist()), end, strict=True)) for of, end in zip(places, ends, strict=True))
    common = mine.keys() & theirs.keys()
    if not common:
        return {"common_nodes": 0, "failure": "no node stands where one of the finest mesh does at the start"}
    return {"mesh_error": max(float(np.linalg.norm(mine[k] - theirs[k])) for k in common), "common_nodes": len(common)}


STUDY = Study(
    name="mesh",
    place=71,
    description="error against mesh and step, on rings of more and more nodes: distance from the finest run",
    tables=(MESH,),
    plan=plan,
    measure=measure,
    tabulate=tabulate,
    by_default=False,
    scenarios=SCENARIOS,
)
