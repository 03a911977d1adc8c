"""Trajectory -> numbers. Every metric is dimensionless unless it says otherwise, and covers completed steps only."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..solver.implicit_step import compiled_flows
from .trajectory import Trajectory


def energy_error_max(run: Trajectory) -> float:
    """Largest departure from the initial energy over the initial exergy, max_k |E_k - E_0| / V_0.

    At the level of round-off for a method that conserves energy (Theorem 1). V_0, unlike E_0, does not depend on the
    arbitrary constant of the energy.
    """
    return run.summary.energy_error_max


def energy_error_final(run: Trajectory) -> float:
    """|E_n - E_0| / V_0 after the last completed step."""
    return float(abs(run.energy[-1] - run.energy[0])) / run.scenario.initial_exergy


def energy_drift(run: Trajectory) -> float:
    """Least-squares slope of (E_k - E_0) / V_0 in time; per unit of time."""
    return run.summary.energy_drift


def entropy_increment_min(run: Trajectory) -> float:
    """Least S_{k+1} - S_k; not below round-off for a method that obeys the second law (Theorem 2)."""
    return run.summary.entropy_increment_min


def second_law_violations(run: Trajectory) -> int:
    """Number of steps on which the entropy fell by more than 1e-13 max(1, |S|)."""
    return run.summary.second_law_violations


MOST_TRIED = 2000  # numbers of a state up to which the terms of an invariant are found by trying
CANCELLED = 1e-12  # a sum that is smaller than this part of its terms is their round-off


def angular_momentum_error_max(run: Trajectory) -> float:
    """Largest |J_k - J_0| / |J_0|; NaN for a system without angular momentum. As of any invariant: see below."""
    return invariant_errors(run).get("angular_momentum_error_max", np.nan)


def invariant_errors(run: Trajectory) -> dict[str, float]:
    """NAME_error_max of each invariant: largest |I_k - I_0| / |I_0|.

    Where I_0 is round-off of its terms, the departure is over their size: see `invariant_scale`.
    """
    found = run.summary.invariant_error_max
    return {f"{name}_error_max": error / invariant_scale(run, name) for name, error in found.items()}


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


def lyapunov_increment_max(run: Trajectory) -> float:
    """Largest increase of E - theta_ref S in a step, over V_0; not positive for TC methods (Theorem 6)."""
    return run.summary.lyapunov_increment_max


def residual_max(run: Trajectory) -> float:
    """Largest scaled residual of an accepted step, over the steps and unknowns; NaN for explicit methods."""
    return run.summary.residual_max


def newton_iterations(run: Trajectory) -> float:
    """Newton's corrections in the whole run, also those of tries that were given up; NaN where the integrator solves by
    itself and does not report them."""
    return np.nan if "newton_iterations" in run.solver.unknown else float(run.solver.newton_iterations)


def newton_iterations_mean(run: Trajectory) -> float:
    """Newton iterations per completed step, all solves of the step together; NaN if they are not known."""
    return newton_iterations(run) / run.steps if run.steps else np.nan


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


def blowup_time(run: Trajectory) -> float:
    """Time at which the run could not go on; NaN if it completed."""
    return float("nan") if run.ok else float(run.t[-1])


def conservation(run: Trajectory) -> dict[str, Any]:
    """One row of the conservation table."""
    return {
        "status": run.status,
        "blowup_time": blowup_time(run),
        "t_final": float(run.t[-1]),
        "steps": run.steps,
        "energy_error_max": energy_error_max(run),
        "energy_error_final": energy_error_final(run),
        "energy_drift": energy_drift(run),
        "entropy_increment_min": entropy_increment_min(run),
        "second_law_violations": second_law_violations(run),
        **invariant_errors(run),
        "lyapunov_increment_max": lyapunov_increment_max(run),
        "residual_max": residual_max(run),
        "newton_iterations_mean": newton_iterations_mean(run),
        "us_per_step": us_per_step(run),
        "failure": run.failure,
    }
