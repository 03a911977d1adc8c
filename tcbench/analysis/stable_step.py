"""The maximum stable step of a method, the cause of its limit, and the sensitivity of blow-up times.

Definitions (docs/stability.md tells the story):
- a run fails when its status is not "ok", or when its entropy falls by more than 1e-10 in a step;
- `solver`: Newton found no root where the arc finds one (or the arc could not decide); `branch`: the principal root has
  ended; `positivity`, of limits alone: what must be positive came to 0; `physical`: the roots exist, and the run left
  the exergy bound, a temperature or spring collapsed, or the entropy fell; `none`: no failure up to the cap;
- rungs are the powers 2^(k/64), so that every search meets the same ones.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..integrator import Integrator
from ..simulation.run import run_flows, simulate
from ..simulation.stepper import stepper
from ..simulation.trajectory import Trajectory
from ..solver.implicit_step import PRINCIPAL, STOP_AT_FOLD, Rules
from ..systems.scenario import Scenario

FINE = 64  # rungs an octave
COARSE = 16  # fine rungs in a coarse one: 2^(k/4)
WINDOW = 16  # rungs of the window of dt_half
LOWEST, FINEST, START, CAP = -10 * FINE, -6 * FINE, -5 * FINE, 2 * FINE  # 2^-10, 2^-6, 2^-5 and 4
BELOW = 2 * FINE  # the fine ladder starts two octaves below the first coarse failure, which errs by up to 2x
LONG = 3000  # steps of a run above which the fine ladder starts one octave below
LONGEST = 12_000  # steps of a run above which the coarse ladder does not start at a rung
FOLD_BELOW = 2 * COARSE
SPREAD, SAMPLES = 0.01, 41  # relative spread and number of the steps whose blow-up times are compared
FACTORS = (0.5, 1.0, 4.0)  # of the blow-up bound

OK, SOLVER, BRANCH, PHYSICAL, NONE = "ok", "solver", "branch", "physical", "none"
POSITIVE = "positivity"  # kind of a limit: a temperature, or a value of measures(), comes to 0
EDGE, HALVINGS = 1e-6, 40  # part of it that is left at the limit; halvings towards the last h with a root


@dataclass(frozen=True, eq=False)
class Outcome:
    """The outcome of one run. Dimensionless.

    kind : ok, solver, branch or physical; blowup_time : when it failed (NaN if it did not);
    energy_error : max |E - E0| / V0 over completed steps (NaN if there are none); continuation_steps : solves that
    needed more than Newton; folds : folds that were met.
    """

    dt: float
    kind: str
    status: str
    blowup_time: float
    energy_error: float
    continuation_steps: int
    folds: int
    failure: str

    @property
    def ok(self) -> bool:
        return self.kind == OK


def outcome_of(run: Trajectory) -> Outcome:
    """The outcome of a trajectory."""
    kinds = {"ok": OK, "nonconverged": SOLVER, "exception": SOLVER, "no_root": BRANCH}
    kind, time, failure = kinds.get(run.status, PHYSICAL), float(run.t[-1]), run.failure
    fall = run.summary.first_entropy_fall
    if math.isfinite(fall) and (kind == OK or fall <= time):
        kind, time, failure = PHYSICAL, fall, f"t = {fall:.6g}: the entropy fell by more than 1e-10 in a step"
    return Outcome(
        dt=run.dt, kind=kind, status=run.status, blowup_time=math.nan if kind == OK else time,
        energy_error=run.summary.energy_error_max,
        continuation_steps=run.solver.tracked, folds=run.solver.folds, failure=failure,
    )  # fmt: skip


def outcome(integrator: Integrator, scenario: Scenario, dt: float, continuation: bool = True) -> Outcome:
    """The outcome of `simulate`, with the shared solver or with plain Newton from z0."""
    return outcome_of(simulate(integrator, scenario, dt, continuation=continuation, record_every=None))


def principal_outcome(integrator: Integrator, scenario: Scenario, dt: float, until_fold: bool = False) -> Outcome:
    """The outcome when every root is taken from the arc: the method's own, whatever Newton does.

    until_fold : end the run at the first fold (then kind is ok and folds > 0).
    """
    steps = scenario.steps(dt)
    rules = Rules(audit=STOP_AT_FOLD if until_fold else PRINCIPAL)
    return outcome_of(run_flows(integrator, scenario, dt, steps, max(1, steps), rules))


def step_of(rung: int) -> float:
    """The step 2^(rung/64)."""
    return float(2.0 ** (rung / FINE))


@dataclass(eq=False)
class Ladder:
    """Outcomes on rungs, each computed once."""

    evaluate: Callable[[float], Outcome]
    cap: int
    start: int = START
    dear: int = LOWEST  # runs on rungs below this have more than LONG steps
    seen: dict[int, Outcome] = field(default_factory=dict)

    def __getitem__(self, rung: int) -> Outcome:
        if rung not in self.seen:
            self.seen[rung] = self.evaluate(step_of(rung))
        return self.seen[rung]

    def first_failure(self, rungs: Iterable[int]) -> int | None:
        return next((rung for rung in rungs if not self[rung].ok), None)

    def points(self) -> list[Outcome]:
        return [self.seen[rung] for rung in sorted(self.seen)]


@dataclass(frozen=True)
class Boundary:
    """Rungs where runs begin to fail; None where there is no such rung."""

    stable: int | None
    unstable: int | None
    half: int | None
    non_monotone: bool


def cap_rung(scenario: Scenario) -> int:
    """The largest step tried: 4, or the horizon if that is shorter."""
    return min(CAP, math.floor(FINE * math.log2(scenario.t_end) + 1e-9))


def ladder_of(scenario: Scenario, evaluate: Callable[[float], Outcome]) -> Ladder:
    """The ladder of a scenario, none of its rungs evaluated yet."""
    dear, start = (FINE * math.log2(scenario.t_end / steps) for steps in (LONG, LONGEST))
    return Ladder(evaluate, cap_rung(scenario), max(START, COARSE * math.ceil(start / COARSE)), math.ceil(dear))


def boundary(ladder: Ladder, below: int = BELOW) -> Boundary:
    """The boundary by the coarse ladder up to the cap, then the fine one from `below` its first failure (less where
    runs are dear) until half of the rungs fail."""
    coarse = range(ladder.start, ladder.cap + 1, COARSE)
    failed = ladder.first_failure(coarse)
    if failed is None:
        return Boundary(ladder.cap, None, None, False)
    low = max(FINEST, failed - below, min(ladder.dear, failed - FINE))
    if failed == ladder.start:
        low = next((r for r in range(ladder.start - COARSE, LOWEST - 1, -COARSE) if ladder[r].ok), LOWEST)
    unstable = ladder.first_failure(range(low, failed + 1))
    assert unstable is not None
    stable = unstable - 1 if unstable - 1 in ladder.seen and ladder[unstable - 1].ok else None
    half = next((r for r in range(unstable, ladder.cap + 1) if _half_fails(ladder, r)), None)
    later = any(ladder[r].ok for r in [*coarse, *ladder.seen] if r > unstable)
    return Boundary(stable, unstable, half, later)


def _half_fails(ladder: Ladder, centre: int) -> bool:
    """Do at least half of the 16 rungs around this one fail?"""
    window = range(centre - WINDOW // 2, centre + WINDOW // 2)
    rungs = [r for r in window if r <= ladder.cap]
    return 2 * sum(not ladder[r].ok for r in rungs) >= len(rungs)


def first_fold(integrator: Integrator, scenario: Scenario, cap: int, unstable: int | None) -> int | None:
    """First rung on which the principal sheet of some step folds before its run ends.

    Coarse rungs from the cap down, until two octaves in a row are free of folds; then the fine ladder below the last.
    """

    def folds(rung: int) -> bool:
        return principal_outcome(integrator, scenario, step_of(rung), until_fold=True).folds > 0

    lowest, free = None, 0
    top = cap - (cap - START) % COARSE
    for rung in range(top, START - 1, -COARSE):
        if folds(rung):
            lowest, free = rung, 0
        else:
            free += 1
        if free * COARSE > BELOW and (unstable is None or rung < unstable - COARSE):
            break
    if lowest is None:
        return None
    return next(rung for rung in range(lowest - FOLD_BELOW, lowest + 1) if rung == lowest or folds(rung))


def confirmed(integrator: Integrator, scenario: Scenario, limits: Boundary) -> tuple[str, bool]:
    """(kind of limit, do the arc's own runs at both ends say the same?)."""
    ends: list[Outcome | None] = [
        None if rung is None else principal_outcome(integrator, scenario, step_of(rung))
        for rung in (limits.stable, limits.unstable)
    ]
    below, above = ends
    below_ok = below is None or below.ok
    if above is None:
        return NONE, below_ok
    kind = SOLVER if above.ok else above.kind
    return limit_of(integrator, scenario, above.dt, kind), below_ok and not above.ok


def limit_of(integrator: Integrator, scenario: Scenario, dt: float, kind: str) -> str:
    """The kind of a limit: `positivity` where a positive quantity is not positive after the step dt, or comes to 0 as a
    step without a root is shortened to the last h that has one; else `kind`."""
    run = simulate(integrator, scenario, dt, record_every=None)
    if run.status == "unphysical":
        return POSITIVE
    if kind not in (SOLVER, BRANCH) or run.ok or integrator.kind != "flows" or integrator.memory:
        return kind
    model, z, step = scenario.model, run.z[-1], stepper(integrator, scenario.model)

    def watched(state: Any) -> Any:
        return np.concatenate([np.ravel(model.temperatures(state)), np.ravel(model.shapes(state))])

    low, high, last = 0.0, dt, z
    for _ in range(HALVINGS):
        h = (low + high) / 2
        try:
            low, last = h, step(z, h)
        except ArithmeticError:
            high = h
    return POSITIVE if (watched(last) < EDGE * watched(z)).any() else kind


def plain_limit(integrator: Integrator, scenario: Scenario, limits: Boundary, ladder: Ladder) -> str:
    """The cause of plain Newton's first failure.

    `solver` unless the run with the arc's own roots fails as well by the time at which plain Newton gives up.
    """
    if limits.unstable is None:
        return NONE
    plain = ladder[limits.unstable]
    method = principal_outcome(integrator, scenario, plain.dt)
    if method.ok or method.blowup_time > plain.blowup_time + 0.5 * plain.dt:
        return SOLVER
    return method.kind


def maximum_step(integrator: Integrator, scenario: Scenario) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """One row of the `stability` table and the rows of `stability_points`, for a method that is given by flows."""
    ladders = {
        solver: ladder_of(scenario, lambda dt, c=continuation: outcome(integrator, scenario, dt, c))  # type: ignore[misc]
        for solver, continuation in (("continuation", True), ("plain", False))
    }
    full, plain = boundary(ladders["continuation"]), boundary(ladders["plain"])
    limit, certified = confirmed(integrator, scenario, full)
    row = _limits(full, ladders["continuation"], limit) | {
        "dt_fold": _step(first_fold(integrator, scenario, cap_rung(scenario), full.unstable)),
        "dt_stable_plain": _step(plain.stable),
        "limit_plain": plain_limit(integrator, scenario, plain, ladders["plain"]),
        "dt_unstable_plain": _step(plain.unstable), "dt_half_plain": _step(plain.half),
        "non_monotone_plain": plain.non_monotone, "certified": certified,
    }  # fmt: skip
    points = [
        point | {"continuation_steps": p.continuation_steps, "folds": p.folds}
        for solver, ladder in ladders.items() for p, point in _points(solver, ladder)
    ]  # fmt: skip
    return row, points


def maximum_own_step(integrator: Integrator, scenario: Scenario) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """`maximum_step` for a method that is given by a step function: one ladder of runs, without the arc.

    limit : `solver` where the step function gave up (it raised an exception), `positivity` and `physical` where the run
    was bad.
    """
    ladder = ladder_of(scenario, lambda dt: outcome(integrator, scenario, dt))
    limits = boundary(ladder, below=COARSE)  # stable runs in Python are dear: one coarse interval, not eight
    limit = NONE
    if limits.unstable is not None:
        limit = limit_of(integrator, scenario, step_of(limits.unstable), ladder[limits.unstable].kind)
    return _limits(limits, ladder, limit), [point for _, point in _points("own", ladder)]


def _limits(bounds: Boundary, ladder: Ladder, limit: str) -> dict[str, Any]:
    return {
        "dt_stable": _step(bounds.stable), "dt_unstable": _step(bounds.unstable), "dt_half": _step(bounds.half),
        "limit": limit, "non_monotone": bounds.non_monotone, "dt_cap": step_of(ladder.cap),
        "cause": "" if bounds.unstable is None else ladder[bounds.unstable].failure,
    }  # fmt: skip


def _points(solver: str, ladder: Ladder) -> Iterator[tuple[Outcome, dict[str, Any]]]:
    for p in ladder.points():
        yield p, {
            "solver": solver, "dt": p.dt, "status": p.status, "kind": p.kind, "blowup_time": p.blowup_time,
            "energy_error_max": p.energy_error,
        }  # fmt: skip


def _step(rung: int | None) -> float:
    return math.nan if rung is None else step_of(rung)


def sensitivity(integrator: Integrator, scenario: Scenario, dt: float) -> list[dict[str, Any]]:
    """Blow-up time under 0.5, 1 and 4 times the bound, and over 41 runs with steps within 1 % of dt.

    One row a factor; earliest, median and latest over the runs that fail (NaN if none does), failed of `runs`.
    """
    rows = []
    for factor in FACTORS:
        stricter = scenario.replace(blowup_factor=factor * scenario.blowup_factor)
        steps = dt * np.linspace(1 - SPREAD, 1 + SPREAD, SAMPLES)
        times = np.array([outcome(integrator, stricter, float(h)).blowup_time for h in steps])
        failed = times[np.isfinite(times)]
        earliest, median, latest = np.quantile(failed, (0.0, 0.5, 1.0)) if len(failed) else (math.nan,) * 3
        rows.append({
            "dt": dt, "factor": factor, "blowup_time": outcome(integrator, stricter, dt).blowup_time,
            "earliest": float(earliest), "median": float(median), "latest": float(latest),
            "failed": len(failed), "runs": SAMPLES,
        })  # fmt: skip
    return rows
