"""Trajectory -> numbers. Every metric is dimensionless unless it says otherwise, and covers completed steps only."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..solver.implicit_step import compiled_flows
from ..systems.multipliers import multipliers
from ..systems.outside import is_open, supplied
from .invariants import lost_in
from .trajectory import Trajectory

FORCES = 50  # recorded states at which multipliers are computed
MOST_TRIED = 2000  # length of a state up to which differences show the terms of an invariant
CANCELLED = 1e-12  # a sum below this part of its terms is their round-off


def invariant_errors(run: Trajectory) -> dict[str, float]:
    """NAME_error_max of each invariant: largest |I_k - I_0| / |I_0|.

    Where I_0 is round-off of its terms, the departure is over their size: see `invariant_scale`.
    """
    errors = run.summary.invariant_error_max
    return {f"{name}_error_max": error / invariant_scale(run, name) for name, error in errors.items()}


def invariant_scale(run: Trajectory, name: str) -> float:
    """The scale of an invariant's errors, in its unit: |I_0|, or the size of its terms where I_0 is their round-off; 1
    where both are 0.

    That size is |q_0| |p_0| for the angular momentum (and for all invariants of large systems of masses), sum
    |dI/dz_i z_i| for others, by differences of I.
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
    """Of each multiplier NAME: NAME_constraint_max, the largest |g| at the recorded states; NAME_constraint_speed_max,
    the largest |dg/dt|; NAME_max, the largest |lam| at some of them. {} without multipliers."""
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
    """Newton iterations of the whole run, those of rejected tries too; NaN where they are not reported."""
    return np.nan if "newton_iterations" in run.solver.unknown else float(run.solver.newton_iterations)


def newton_iterations_mean(run: Trajectory) -> float:
    """Newton iterations per completed step, all solves of the step together; NaN if they are not known."""
    return newton_iterations(run) / run.steps if run.steps else np.nan


def inner_steps_mean(run: Trajectory) -> float:
    """Steps that the method took for one step that was asked for, on average: 1 of formulas, more where a method
    divides a step that it cannot solve, NaN where it does not report them."""
    if run.integrator.kind == "flows":
        return 1.0
    return run.solver.inner_steps / run.steps if run.solver.inner_steps and run.steps else np.nan


def evaluations(run: Trajectory) -> float:
    """Evaluations in the run: of a formula's residual (one a Newton iteration, Jacobian included, and one a step of
    each explicit flow), of a solver's right-hand side; NaN where the solver does not report them.
    """
    if run.integrator.kind == "flows":
        flows = compiled_flows(run.integrator.flows, run.scenario.model.symbolic)
        return newton_iterations(run) + run.steps * sum(flow.n_unknowns == 0 for flow in flows)
    return float(run.solver.rhs_evaluations) or np.nan


def us_per_step(run: Trajectory) -> float:
    """Wall time per completed step of this run, diagnostics included, in microseconds.

    A first impression, as other runs share the machine: the work_precision study measures times. NaN of an adaptive
    solver that does not count its steps.
    """
    return 1e6 * run.wall_time_s / run.steps if run.steps and "steps" not in run.solver.unknown else np.nan


def conservation(run: Trajectory) -> dict[str, Any]:
    """One row of the conservation table: the run's `Summary` and what is derived from the records. Errors of the energy
    are over V_0, which unlike E_0 does not depend on the arbitrary constant of the energy."""
    summary, scenario = run.summary, run.scenario
    return {
        "status": run.status,
        "blowup_time": np.nan if run.ok else float(run.t[-1]),
        "t_final": float(run.t[-1]),
        "steps": run.steps,
        "inner_steps_mean": inner_steps_mean(run),
        "energy_error_max": summary.energy_error_max,
        "energy_error_final": float(abs(run.energy[-1] - run.energy[0])) / scenario.initial_exergy,
        "energy_round_off": scenario.energy_round_off / scenario.initial_exergy,
        "energy_drift": summary.energy_drift,
        "entropy_increment_min": summary.entropy_increment_min,
        "second_law_violations": summary.second_law_violations,
        **invariant_errors(run),
        **constraint_errors(run),
        **({f"{kind}_supplied": float(x[-1]) for kind, x in supplied(run).items()} if is_open(scenario.model) else {}),
        **({"constraints_dependent": said} if (said := run.constraints_dependent) else {}),
        **({"invariants_lost": said} if (said := "; ".join(x.sentence for x in lost_in(run))) else {}),
        "lyapunov_increment_max": summary.lyapunov_increment_max,
        "residual_max": summary.residual_max,
        "newton_iterations_mean": newton_iterations_mean(run),
        "us_per_step": us_per_step(run),
        "failure": run.failure,
    }
