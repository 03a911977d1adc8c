"""Trajectory -> numbers. Every metric is dimensionless unless it says otherwise, and covers completed steps only."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..solver.implicit_step import compiled_flows
from ..systems.multipliers import multipliers
from ..systems.outside import is_open, supplied
from .invariants import lost_in
from .trajectory import Trajectory

FORCES = 50  # recorded states at which multipliers are looked at
MOST_TRIED = 2000  # numbers of a state up to which the terms of an invariant are found by trying
CANCELLED = 1e-12  # a sum that is smaller than this part of its terms is their round-off


def invariant_errors(run: Trajectory) -> dict[str, float]:
    """NAME_error_max of each invariant: largest |I_k - I_0| / |I_0|.

    Where I_0 is round-off of its terms, the departure is over their size: see `invariant_scale`.
    """
    errors = run.summary.invariant_error_max
    return {f"{name}_error_max": error / invariant_scale(run, name) for name, error in errors.items()}


def invariant_scale(run: Trajectory, name: str) -> float:
    """|I_0|; where it is round-off of its terms (or 0) their size; 1 if that is 0.

    Their size is |q_0| |p_0| for the angular momentum (and for all in large systems of masses),
    sum |dI/dz_i z_i| for others (differences of I).
    """
    initial, model, z = abs(float(run.invariants[name][0])), run.scenario.model, run.z[0]
    start = model.state(z)
    if {"q", "p"} <= set(model.variables) and (name == "angular_momentum" or model.size > MOST_TRIED):
        size = float(np.linalg.norm(start.q) * np.linalg.norm(start.p))
    else:
        index, moved = model.invariant_names.index(name), np.flatnonzero(z)
        steps = np.eye(len(z))[moved] * (1e-4 * z[moved])[:, None]
        up, down = (np.array([model.momenta(z + sign * step)[index] for step in steps]) for sign in (1, -1))
        terms = np.abs(up - down) / 2e-4  # |dI/dz_i z_i|
        size = float(terms.sum()) if len(terms) else 0.0
    return initial if initial > CANCELLED * size else size or 1.0


def constraint_errors(run: Trajectory) -> dict[str, float]:
    """Of each multiplier NAME, at the recorded states: NAME_constraint_max, the largest |g|, and its rate, the hidden
    constraint, NAME_constraint_speed_max; NAME_max, the largest |lam|, at some of them. None of systems without."""
    model = run.scenario.model
    if (solved := multipliers(model)) is None:
        return {}
    rows, errors = np.ascontiguousarray(run.z), dict[str, float]()
    missed, speeds = model.constraint_values(rows), model.constraint_speeds(rows)
    some = rows[np.unique(np.linspace(0, len(rows) - 1, FORCES).astype(int))]
    forces, names = np.array([solved.values(z) for z in some]), np.array(solved.names)
    for name in model.multipliers:
        for column, values in (("constraint_max", missed), ("constraint_speed_max", speeds), ("max", forces)):
            errors[f"{name}_{column}"] = float(np.abs(values[:, names == name]).max(initial=0.0))
    return errors


def newton_iterations(run: Trajectory) -> float:
    """Newton's corrections in the whole run, also those of tries that were given up; NaN where the integrator solves by
    itself and does not report them."""
    return np.nan if "newton_iterations" in run.solver.unknown else float(run.solver.newton_iterations)


def newton_iterations_mean(run: Trajectory) -> float:
    """Newton iterations per completed step, all solves of the step together; NaN if they are not known."""
    return newton_iterations(run) / run.steps if run.steps else np.nan


def inner_steps_mean(run: Trajectory) -> float:
    """Steps that the method took inside of one that was asked for, on average: 1 of formulas, whose step is solved as a
    whole or fails; more where a method divides a step that it cannot solve. NaN where it does not tell."""
    if run.integrator.kind == "flows":
        return 1.0
    return run.solver.inner_steps / run.steps if run.solver.inner_steps and run.steps else np.nan


def evaluations(run: Trajectory) -> float:
    """Evaluations of the run, a count that no machine changes: of a formula those of its residual (one a Newton
    iteration, Jacobian included, and one a step of each explicit flow), of a solver those of the right-hand side. NaN
    where neither is told.
    """
    if run.integrator.kind == "flows":
        flows = compiled_flows(run.integrator.flows, run.scenario.model.symbolic)
        return newton_iterations(run) + run.steps * sum(flow.n_unknowns == 0 for flow in flows)
    return float(run.solver.rhs_evaluations) or np.nan


def us_per_step(run: Trajectory) -> float:
    """Wall time per completed step of this run, diagnostics included, in microseconds.

    One run beside others: a first impression. The work_precision study measures time with care.
    NaN of an adaptive solver that does not count its steps: `steps` then counts the output times.
    """
    return 1e6 * run.wall_time_s / run.steps if run.steps and "steps" not in run.solver.unknown else np.nan


def conservation(run: Trajectory) -> dict[str, Any]:
    """One row of the conservation table; most are the run's `Summary`, departures in units of V_0, which unlike E_0
    does not depend on the arbitrary constant of the energy."""
    told = run.summary
    scenario = run.scenario
    return {
        "status": run.status,
        "blowup_time": np.nan if run.ok else float(run.t[-1]),
        "t_final": float(run.t[-1]),
        "steps": run.steps,
        "inner_steps_mean": inner_steps_mean(run),
        "energy_error_max": told.energy_error_max,
        "energy_error_final": float(abs(run.energy[-1] - run.energy[0])) / scenario.initial_exergy,
        "energy_round_off": scenario.energy_round_off / scenario.initial_exergy,
        "energy_drift": told.energy_drift,
        "entropy_increment_min": told.entropy_increment_min,
        "second_law_violations": told.second_law_violations,
        **invariant_errors(run),
        **constraint_errors(run),
        **({f"{kind}_supplied": float(x[-1]) for kind, x in supplied(run).items()} if is_open(scenario.model) else {}),
        **({"constraints_dependent": said} if (said := run.constraints_dependent) else {}),
        **({"invariants_lost": said} if (said := "; ".join(x.sentence for x in lost_in(run))) else {}),
        "lyapunov_increment_max": told.lyapunov_increment_max,
        "residual_max": told.residual_max,
        "newton_iterations_mean": newton_iterations_mean(run),
        "us_per_step": us_per_step(run),
        "failure": run.failure,
    }
