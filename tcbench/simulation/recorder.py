"""From the records of a run, of whichever kind, to a `Trajectory`; from the code of its end to a sentence."""

from __future__ import annotations

import math
from typing import Any, TypeVar

import numpy as np

from ..errors import ending
from ..integrator import Integrator
from ..solver.implicit_step import BLOWUP, COLD, COLLAPSED, FOLDED, NO_ROOT, NO_WARM_ROOT, NONCONVERGED, NONFINITE, OK
from ..systems.scenario import Scenario
from ..systems.system import System
from .compiled_loop import FIRST_INVARIANT, E, Run, S
from .trajectory import SolverCounts, Summary, Trajectory

Made = TypeVar("Made")

_STATUS = {
    OK: ("ok", ""),
    NONCONVERGED: ("nonconverged", "the solver found no root"),
    NO_ROOT: ("no_root", "the principal branch of solutions ended"),
    NONFINITE: ("nonfinite", "the new state is not finite"),
    COLLAPSED: ("unphysical", "{collapsed}"),
    COLD: ("unphysical", "a temperature is not positive"),
    NO_WARM_ROOT: ("unphysical", "the principal root has a temperature that is not positive"),
    FOLDED: ("ok", ""),  # the run was to end at the first fold
    BLOWUP: ("blowup", "|E - E0| exceeded {factor}the initial exergy V0 = {V0:.6g}"),
}


def cause_of(reason: int, model: System, method: Integrator) -> str:
    """Why a step was not done, in words."""
    if reason == NONFINITE and method.nonfinite:
        return method.nonfinite
    return _STATUS[reason][1].replace("{collapsed}", model.collapsed)


def explain(reason: int, done: int, dt: float, scenario: Scenario, method: Integrator) -> tuple[str, str]:
    """Status and sentence for the way a run ended."""
    status, cause = _STATUS[reason]
    if not cause:
        return status, ""
    cause = cause_of(reason, scenario.model, method)
    step = done if reason == BLOWUP else done + 1  # the state of a blow-up exists; otherwise the next step failed
    factor = "" if scenario.blowup_factor == 1 else f"{scenario.blowup_factor:g} times "
    cause = cause.format(factor=factor, V0=scenario.initial_exergy)
    return status, f"step {step} (t = {step * dt:.6g}, dt = {dt:g}): {cause}"


def assemble(
    integrator: Integrator,
    scenario: Scenario,
    run: Run,
    status: str,
    failure: str,
    wall: float,
    way: str = "",
    solver: SolverCounts | None = None,
) -> Trajectory:
    """The Trajectory of the completed steps; solver : counts of a solver that the tally does not count."""
    tally, dt, every, model = run.tally.as_numbers(), float(run.h), run.every, scenario.model
    done = tally.steps
    rows = -(-done // every) + 1
    numbers = np.arange(rows)
    t = (numbers if every == 1 else np.minimum(numbers * every, done)) * dt
    names, observed = model.invariant_names, run.records[:rows]
    first = FIRST_INVARIANT + len(names)
    if solver is None:
        solver = at_once(
            SolverCounts,
            newton_iterations=tally.iterations, retried=tally.retried, tracked=tally.tracked,
            continuation_tries=tally.tries, arcs=tally.arcs, folds=tally.folds, audited=tally.audited,
            wrong_roots=tally.wrong_roots, way=way,
        )  # fmt: skip
    return at_once(
        Trajectory,
        integrator=integrator, scenario=scenario, dt=dt, t=t, z=run.states[:rows],
        energy=observed[:, E], entropy=observed[:, S],
        invariants={name: observed[:, FIRST_INVARIANT + i] for i, name in enumerate(names)},
        temperatures=observed[:, first : first + model.n_temperatures],
        status=status, failure=failure, steps=done, newton_iterations=run.counts[: rows - 1],
        wall_time_s=wall, summary=summarise(run, tally, dt, names, scenario.initial_exergy), solver=solver,
    )  # fmt: skip


def at_once(kind: type[Made], **values: Any) -> Made:
    """A frozen dataclass of these fields; its own `__init__` sets them one by one, in a tenth of a short run."""
    item = object.__new__(kind)
    object.__setattr__(item, "__dict__", values)
    return item


def summarise(run: Run, tally: Any, dt: float, names: tuple[str, ...], exergy: float) -> Summary:
    steps, departures = tally.steps, dict(zip(names, run.departures.tolist(), strict=True))
    if not steps:
        nan = math.nan
        return Summary(nan, nan, nan, 0, nan, nan, dict.fromkeys(departures, nan), nan)
    spread = steps * tally.sum_tt - tally.sum_t**2
    slope = steps * tally.sum_te - tally.sum_t * tally.sum_e
    return at_once(
        Summary,
        energy_error_max=tally.energy_error / exergy,
        energy_drift=slope / spread / exergy if steps > 1 and spread > 0 else math.nan,
        entropy_increment_min=tally.entropy_min,
        second_law_violations=tally.violations,
        first_entropy_fall=tally.first_fall * dt if tally.first_fall else math.nan,
        lyapunov_increment_max=tally.lyapunov_max / exergy,
        invariant_error_max=departures,
        residual_max=tally.residual_max if run.residuals else math.nan,
    )


def raised(error: BaseException, step: int, t: float) -> tuple[str, str]:
    """Status and one line for an exception of a method: where it stopped, and what was raised."""
    status, cause = ending(error)
    return status, f"step {step} (t = {t:.6g}): {cause}"
