"""What one cell of the study `ensemble` measures: a method, or the references, on a block of random scenarios."""

from __future__ import annotations

import math
import random
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..analysis.stable_step import outcome_of
from ..analysis.timing import solved, warm_up
from ..integrator import Integrator
from ..simulation.run import simulate
from ..simulation.trajectory import Trajectory
from ..study import Row
from ..systems.element_system import ElementSystem
from ..systems.scenario import Scenario
from .columns import LAW_TOLERANCE

TOLERANCES = (1e-3, 1e-5, 1e-7, 1e-9, 1e-11, 1e-13)  # of adaptive solvers
COARSEST = 64  # steps over the horizon at the first rung of a ladder; each next rung has twice as many
RUNGS = 16
MOST_REPEATS = 5
PARTS = (1 / 64, 1 / 8)  # of the horizon: an adaptive run whose part takes long is not made
KINDS = ("ok", "solver", "branch", "physical", "law", "exception", "too slow")  # rows have places in it: add at the end


def shares(integrator: Integrator, scenarios: Sequence[Scenario], steps: Sequence[float]) -> list[Row]:
    """One row a step: `kinds` (an index into KINDS for each scenario), `laws` (largest error, each) and `sentences`.

    sentences : of the runs that failed, by the scenario's place in the block.
    """
    rows = []
    for dt in steps:
        runs = [simulate(integrator, scenario, dt, record_every=None) for scenario in scenarios]
        outcomes = [outcome(integrator, run) for run in runs]
        rows.append({
            "dt": dt,
            "kinds": [KINDS.index(kind) for kind, _ in outcomes],
            "laws": by_law([laws(run) for run in runs]),
            "broken": by_law([broken(run) for run in runs]),
            "sentences": {str(i): sentence for i, (_, sentence) in enumerate(outcomes) if sentence},
        })  # fmt: skip
    return rows


def outcome(integrator: Integrator, run: Trajectory) -> tuple[str, str]:
    """Kind of failure, one of KINDS, and the sentence; a run that ended well and broke a claimed law has failed too."""
    if run.status == "exception":
        return "exception", run.failure
    end = outcome_of(run)
    if not end.ok:
        return end.kind, end.failure
    lost = [law for law, is_broken in broken(run).items() if is_broken and law in integrator.claims]
    return ("law", f"{', '.join(lost)} not kept") if lost else ("ok", "")


def laws(run: Trajectory) -> dict[str, float]:
    """Largest error of each law over the completed steps; NaN where there are none. Dimensionless.

    energy: |E - E0|/V0; entropy: the largest fall in a step; invariants: their departure over the size of their terms,
    |q0| |p0| (random momenta may cancel), at least 1e-12 of it; of others over their value or magnitude.
    """
    error = run.summary.energy_error_max
    within = error * run.scenario.initial_exergy <= run.scenario.energy_round_off
    losses = {"energy": 0.0 if within else error, "entropy": max(0.0, -run.summary.entropy_increment_min)}
    model = run.scenario.model
    if not isinstance(model, ElementSystem):
        magnitudes = dict(zip(model.invariant_names, model.law_magnitudes[2:].tolist(), strict=True))
        sizes = {name: max(magnitudes[name], abs(float(values[0]))) for name, values in run.invariants.items()}
        return losses | {name: error / sizes[name] for name, error in run.summary.invariant_error_max.items()}
    start = model.state(run.z[0])
    size = float(np.linalg.norm(start.q) * np.linalg.norm(start.p)) or 1.0
    return losses | {name: error / size for name, error in run.summary.invariant_error_max.items()}


def broken(run: Trajectory) -> dict[str, bool]:
    """Which laws the run broke beyond round-off, whether the method claims them or not."""
    worst = {name: bool(error > LAW_TOLERANCE) for name, error in laws(run).items()}
    return worst | {"entropy": run.summary.second_law_violations > 0}


def by_law(rows: Sequence[dict[str, Any]]) -> dict[str, list[Any]]:
    return {name: [row[name] for row in rows] for name in rows[0]} if rows else {}


# -- references


def references(scenarios: Sequence[Scenario]) -> list[Row]:
    """Of each scenario at its t_end: `state`, its error bar `gap` and `floor`, and `lyapunov`, the finite-time exponent
    ln(growth)/t_end of a disturbance of the start, per unit of time. None and NaN where there is no reference."""
    from ..reference.lookup import ends_of

    rows: list[Row] = []
    for scenario, (reference, growth) in zip(scenarios, ends_of(scenarios), strict=True):
        lyapunov = math.log(growth) / scenario.t_end if growth > 0 else math.nan
        bars = (None, None) if reference is None else (reference.certificate[0], reference.floor[0])
        gap, floor = (bar if bar is not None and math.isfinite(bar) else None for bar in bars)
        state = None if reference is None else reference.states[0].tolist()
        rows.append({"state": state, "gap": gap, "floor": floor, "lyapunov": lyapunov})
    return rows


# -- error against time


def timings(integrator: Integrator, scenarios: Sequence[Scenario], share_s: float, seed: int) -> list[list[Row]]:
    """For each scenario the rungs of a ladder from coarse to fine: value, kind, time_s (least of repeats), repeats,
    state at t_end, energy_error there, and of adaptive runs their laws.

    Every scenario gets `share_s` seconds (of the processor: a busy machine cuts no ladder short): a rung that would
    probably not end within them is not begun, and what is left goes to repeats. Scenarios come in an order shuffled
    anew for each repeat, so that a slow moment of the machine does not meet one of them only.
    """
    control = "tolerance" if integrator.kind == "adaptive" else "dt"
    warm_up(integrator, scenarios[0], ({control: value} for value in ladder(integrator, scenarios[0])))
    order = random.Random(seed)
    spent = [0.0] * len(scenarios)
    ladders: list[list[Row]] = [[] for _ in scenarios]
    for repeat in range(MOST_REPEATS):
        for i in order.sample(range(len(scenarios)), len(scenarios)):
            begin = time.process_time()
            if repeat == 0:
                _first_time(integrator, scenarios[i], ladders[i], share_s)
            else:
                _again(integrator, scenarios[i], ladders[i], share_s - spent[i])
            spent[i] += time.process_time() - begin
    return ladders


def ladder(integrator: Integrator, scenario: Scenario) -> list[float]:
    """Tolerances, or steps that divide the horizon; coarse to fine."""
    if integrator.kind == "adaptive":
        return list(TOLERANCES)
    return [scenario.t_end / (COARSEST * 2**k) for k in range(RUNGS)]


def _first_time(integrator: Integrator, scenario: Scenario, rungs: list[Row], share_s: float) -> None:
    adaptive = integrator.kind == "adaptive"
    begin, growth, took = time.process_time(), 1.5 if adaptive else 2.0, 0.0  # of the processor, as all that is decided
    for value in ladder(integrator, scenario):
        left = share_s - (time.process_time() - begin)
        if growth * took > left:
            break
        if adaptive and not rungs and _too_slow(integrator, scenario, value, left):
            rungs.append({"value": value, "kind": KINDS.index("too slow"), "sentence": "a part of it took too long"})
            break
        started = time.process_time()
        rungs.append({"value": value} | run_once(integrator, scenario, value))
        took = time.process_time() - started
        if adaptive and rungs[-1]["kind"] == 0 and 2.0 * took < share_s - (time.process_time() - begin):
            rungs[-1] |= _observed(integrator, scenario, value)


def _again(integrator: Integrator, scenario: Scenario, rungs: list[Row], left: float) -> None:
    for rung in rungs:
        if rung["kind"] == 0 and rung["time_s"] < left:
            left -= rung["time_s"]
            again = run_once(integrator, scenario, rung["value"])
            if again["kind"] == 0:
                rung["time_s"], rung["repeats"] = min(rung["time_s"], again["time_s"]), rung["repeats"] + 1


def _too_slow(integrator: Integrator, scenario: Scenario, tolerance: float, left: float) -> bool:
    """Would the whole run take longer than is left? From runs over parts of the horizon; the first is made twice, for
    what a method prepares once for a scenario (tc_auto chooses) is no part of a run."""
    run_once(integrator, scenario.replace(t_end=PARTS[0] * scenario.t_end), tolerance)
    for part in PARTS:
        begin = time.process_time()
        run_once(integrator, scenario.replace(t_end=part * scenario.t_end), tolerance)
        if (time.process_time() - begin) * PARTS[1] / PARTS[0] > left:
            return True
    return False


def run_once(integrator: Integrator, scenario: Scenario, value: float) -> Row:
    """One run to t_end: kind, sentence, time_s, repeats = 1, state (of runs that ended well) and energy_error."""

    def moved(z: Any) -> float:
        return abs(float(scenario.model.energy(z)) - float(scenario.model.energy(scenario.z0)))

    if integrator.kind != "adaptive":
        run = simulate(integrator, scenario, value, record_every=None)
        (kind, sentence), seconds, z = outcome(integrator, run), run.wall_time_s, run.z[-1]
    else:
        solution = solved(integrator, scenario, [0.0, scenario.t_end], value)
        kind, sentence, seconds, z = "ok", solution.failure[:200], solution.seconds, None
        if solution.failure:
            kind = "solver" if solution.status == "nonconverged" else solution.status
        elif not (np.isfinite(z := np.asarray(solution.states[-1], dtype=float)).all() and moved(z) <= scenario.bound):
            kind, sentence = "physical", "the end state is not finite, or beyond the exergy bound"
    row: Row = {"kind": KINDS.index(kind), "time_s": seconds, "repeats": 1}
    row |= {"sentence": sentence} if sentence else {}
    if kind == "ok":
        row |= {"state": [float(x) for x in z], "energy_error": moved(z) / scenario.initial_exergy}
    return row


def _observed(integrator: Integrator, scenario: Scenario, tolerance: float) -> Row:
    """The laws of an adaptive run at 200 times, and whether it failed on the way."""
    run = simulate(integrator, scenario, tolerance=tolerance)
    kind, sentence = outcome(integrator, run)
    row: Row = {"laws": laws(run), "broken": broken(run), "kind": KINDS.index(kind)}
    return row | ({"sentence": sentence} if sentence else {})
