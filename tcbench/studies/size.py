"""Size: what methods cost on systems that grow, and what they keep there.

A cell is a method on a system of one size, in a process that has run nothing else. There a step on the pendulum loads
what every run needs; then, with no kernel at hand, comes the first step: tables, trace, compilation. A step is timed
over runs that are warm, by what more of them take than one, and the laws are those of such a run. Times are the
processor's: what else a machine does is no part of them.
"""

from __future__ import annotations

import itertools
import math
import os
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from .. import cache, plugins
from ..integrator import Integrator
from ..simulation import metrics
from ..simulation.run import simulate
from ..simulation.trajectory import Trajectory
from ..solver.foresight import seconds_a_step
from ..solver.implicit_step import compiled_flows
from ..study import Cells, Row, Study, Tables
from ..systems.scenario import Scenario
from ..table import Column, Table
from .cost import exponent
from .frames import table_of

SCENARIOS = (
    *(f"chain[n={n}]" for n in (100, 1000, 10_000, 100_000)), *(f"net[nx={n},ny={n}]" for n in (10, 20, 50, 100)),
)  # fmt: skip
PENDULUM = "short_term"
WORK, FEWEST, MOST = 300_000, 5, 1000  # numbers times steps of a timed run; steps of one
REPEATS = 3
SIZE = Table(
    "size",
    (
        "integrator", "family", "scenario", "numbers", "dt", "status",
        Column("first_step_s", "time to the first step", "first step", "s", "higher", timing=True), "us_per_step",
        Column("us_foreseen", "time per step that is foreseen", "foreseen", "µs"),
        Column("memory_mb", "memory", "MB", "MB", "higher", timing=True), "steps", "energy_error_max",
        "entropy_increment_min", "angular_momentum_error_max", "newton_iterations_mean", "way", "failure",
        Column("*_error_max", worse="larger"),
    ),
    key=("numbers",),
    timed=True,
    terminal=(
        "integrator", "numbers", "status", "first_step_s", "us_per_step", "memory_mb", "energy_error_max",
        "entropy_increment_min", "angular_momentum_error_max",
    ),
)  # fmt: skip
GROWING = {"first_step_s": "exponent_first", "us_per_step": "exponent_step", "memory_mb": "exponent_memory"}
EXPONENTS = Table(
    "size_exponents",
    (
        "integrator", "family", "dt", "smallest", "largest",
        *(
            Column(name, short=f"{what} ~ size^", timing=True)
            for name, what in zip(GROWING.values(), ("first", "step", "memory"), strict=True)
        ),
    ),
    derived=True,
)  # fmt: skip


def plan(integrators: Sequence[Integrator], scenarios: Sequence[Scenario], options: Mapping[str, Any]) -> Cells:
    """One cell a method with a step, scenario and step; the scenario's own step unless others are asked for."""
    stepping = [i for i in integrators if i.kind != "adaptive" and not i.lacks]
    return [(i, s, {"dt": dt}) for s in scenarios for i in stepping for dt in options.get("dt") or [s.dt]]


def measure(integrator: Integrator, scenario: Scenario, options: Row) -> Row:
    dt, numbers = options["dt"], scenario.model.size
    pendulum = plugins.find_scenario(PENDULUM)
    if not integrator.suits(pendulum.model):
        simulate(integrator, pendulum, dt=pendulum.dt, t_end=pendulum.dt)
    before = peak_memory()
    with no_kernels():
        first, run = _seconds(integrator, scenario, dt, dt)
        row = {"family": scenario.system.name, "numbers": numbers, "first_step_s": first}
        if run.ok:
            steps = max(FEWEST, min(MOST, WORK // numbers))
            one = min(_seconds(integrator, scenario, dt, dt)[0] for _ in range(REPEATS))
            many = [_seconds(integrator, scenario, dt, dt * steps) for _ in range(REPEATS)]
            run = many[-1][1]
            row["us_per_step"] = 1e6 * (min(seconds for seconds, _ in many) - one) / (steps - 1)
    if integrator.kind == "flows":
        flows = compiled_flows(integrator.flows, scenario.model.symbolic)
        row["us_foreseen"] = 1e6 * seconds_a_step(flows)
    more = max(peak_memory() - before, 0.0)  # Linux counts pages in parts: a peak may read some of them less
    return metrics.conservation(run) | row | {"way": run.solver.way, "memory_mb": more}


def _seconds(integrator: Integrator, scenario: Scenario, dt: float, t_end: float) -> tuple[float, Trajectory]:
    """A run, and what the processor took for it."""
    begin = time.process_time()
    run = simulate(integrator, scenario, dt=dt, t_end=t_end, record_every=None)
    return time.process_time() - begin, run


@contextmanager
def no_kernels() -> Iterator[None]:
    """Nothing is found in the cache of compiled code."""
    before = os.environ.get(cache.FOLDER)
    with tempfile.TemporaryDirectory() as folder:
        os.environ[cache.FOLDER] = folder
        try:
            yield
        finally:
            os.environ.pop(cache.FOLDER)
            if before is not None:
                os.environ[cache.FOLDER] = before


def peak_memory() -> float:
    """The largest memory that this process has had so far, MB; NaN where the system does not tell."""
    try:  # on Linux ru_maxrss would be that of the parent where that had more
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
        return next(float(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM"))
    except (OSError, StopIteration):
        pass
    try:
        import resource
    except ImportError:  # pragma: no cover -- Windows
        return math.nan
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)


def tabulate(records: Sequence[Row]) -> Tables:
    """`size`: a row a method and size; `size_exponents`: how its times and its memory grow with the numbers of a state,
    a row a method, family and step."""
    import pandas as pd

    rows = [{"family": r["scenario"].partition("[")[0]} | r for r in records]  # crashes have none
    table = table_of(rows, SIZE, ("family", "integrator", "dt", "numbers"))
    fits = []
    done = sorted((r for r in records if r.get("status") == "ok"), key=_group)
    for (kind, name, dt), group in itertools.groupby(done, _group):
        rows = sorted(group, key=lambda r: r["numbers"])
        fits.append(
            {"integrator": name, "family": kind, "dt": dt, "smallest": rows[0]["numbers"]}
            | {"largest": rows[-1]["numbers"]}
            | {to: exponent([(r["numbers"], r[of]) for r in rows]) for of, to in GROWING.items()}
        )
    return {"size": table, "size_exponents": pd.DataFrame(fits)}


def _group(row: Row) -> tuple[Any, ...]:
    return row["family"], row["integrator"], row["dt"]


STUDY = Study(
    name="size",
    place=70,
    description="chains and nets that grow: seconds to the first step, time a step, memory, and the laws",
    tables=(SIZE, EXPONENTS),
    plan=plan,
    measure=measure,
    tabulate=tabulate,
    by_default=False,
    timed=True,
    scenarios=SCENARIOS,
    fresh=True,
)
