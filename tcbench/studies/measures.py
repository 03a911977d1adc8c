"""Measures that others use of geometric integrators: the error over a trajectory, at a fixed coarse step; how far a
step is from symplectic where nothing dissipates; how the energy error grows over long runs. Run where it is named.

Everything is dimensionless. Errors are max |z - z_ref|/max(1, |z_ref|) at EIGHT equally spaced times up to a horizon,
at the scenario's own step and at four times that, so that a trajectory that is right at its end only is told apart.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..analysis.timing import solved
from ..errors import TcbenchError
from ..integrator import Integrator
from ..reference.certified import gap
from ..simulation.run import simulate
from ..simulation.stepper import stepper
from ..study import Cells, Row, Study, Tables
from ..systems.element_system import ElementSystem
from ..systems.scenario import Scenario
from ..table import Column, Table
from .base import settings
from .convergence import groups
from .frames import table_of
from .work_precision import errors_of

EIGHT = 8
HORIZON = 25.0  # of trajectories: chaotic ones are not longer known
COARSE = 4  # times the scenario's own step
TOLERANCE = 1e-6  # of solvers that choose their steps
LONG = 2**14  # steps of the run whose energy error is followed
OCTAVES = 6  # the last ones of it, to which the exponent is fitted
SUBSTEPS = 20  # of each formula of a splitting alone
NUDGE = 1e-5  # of the components, for the slopes of a step: what is left of them is 1e-9
MEASURES = Table(
    "measures",
    (
        "integrator", "scenario", "dt", "tolerance", "status",
        Column("error_end", "error of the state at the end", "end", worse="larger"),
        Column("error_path_max", "largest error over the trajectory", "path max", worse="larger"),
        Column("error_path_rms", "root mean square of the error over the trajectory", "path rms", worse="larger"),
        "error_theta", "error_entropy_produced",
        Column("symplecticity_defect", "|M L Mᵀ − L| of a step without dissipation", "symplecticity", worse="larger"),
        Column("reversibility_defect", "|z − Φ₋ₕ(Φₕ(z))|, a step and its way back", "reversibility", worse="larger"),
        Column("substep_energy_error_max", "largest |ΔE| / V₀ of a sub-step", "sub-step dE", worse="larger"),
        Column("substep_entropy_fall_max", "largest fall of S in a sub-step", "sub-step dS", worse="higher"),
        Column("energy_growth_exponent", "a of |E − E₀| ~ tᵃ", "growth", worse="higher"),
        Column("energy_growth_end", "|E − E₀| / V₀ of the last half of a long run", "dE long", worse="larger"), "t",
        "failure",
    ),
    key=("dt", "tolerance"),
)  # fmt: skip
NOT_OF_ALL = (  # without temperature, dissipation, L, a step of its own, sub-steps
    "error_theta", "error_entropy_produced", "symplecticity_defect", "reversibility_defect", "substep_energy_error_max",
    "substep_entropy_fall_max",
)  # fmt: skip


def plan(integrators: Sequence[Integrator], scenarios: Sequence[Scenario], options: Mapping[str, Any]) -> Cells:
    """One cell a pair and step: the scenario's own and a coarse one, or those that are asked for."""
    cells: Cells = []
    for scenario in scenarios:
        steps = options.get("dt") or (scenario.dt, COARSE * scenario.dt)
        cells += [(i, scenario, run) for i in integrators if not i.lacks for run in settings(i, steps, [TOLERANCE])]
    return cells


def measure(integrator: Integrator, scenario: Scenario, options: Row) -> Row:
    row = path_errors(integrator, scenario, options)
    row["symplecticity_defect"] = symplecticity_defect(integrator, scenario, options)
    row["reversibility_defect"] = reversibility_defect(integrator, scenario, options)
    return row | substep_laws(integrator, scenario, options) | energy_growth(integrator, scenario, options)


def path_errors(integrator: Integrator, scenario: Scenario, options: Row) -> Row:
    """Errors at eight times, and of temperatures and of the entropy produced at the last of them."""
    from ..reference.lookup import reference_for

    t_end = min(HORIZON, scenario.t_end)
    times = [t_end * (k + 1) / EIGHT for k in range(EIGHT)]
    reference = reference_for(scenario, times)
    status, failure, states = _states(integrator, scenario.replace(t_end=t_end), options, times)
    row: Row = {"status": status, "failure": failure, "t": t_end}
    if states is None:
        return row
    errors = [
        gap(groups(scenario.model, z)["all"], groups(scenario.model, exact)["all"])
        for z, exact in zip(states, reference.states, strict=True)
    ]
    end = errors_of(scenario, states[-1], reference.states[-1], 10.0 * float(reference.floor[-1]))
    names = ("error_theta", "error_entropy_produced")
    return row | {
        "error_end": errors[-1], "error_path_max": max(errors),
        "error_path_rms": float(np.sqrt(np.mean(np.square(errors)))), **{n: end[n] for n in names if n in end},
    }  # fmt: skip


def _states(integrator: Integrator, scenario: Scenario, options: Row, times: Sequence[float]) -> Any:
    """(status, failure, states at the times or None): steps are as long as is asked for, or the next shorter that
    divides the times."""
    if integrator.kind == "adaptive":
        end = solved(integrator, scenario, [0.0, *times], options["tolerance"])
        return (end.status, end.failure, None) if end.failure else ("ok", "", np.asarray(end.states)[1:])
    every = max(1, math.ceil(scenario.t_end / EIGHT / options["dt"] - 1e-9))
    run = simulate(integrator, scenario, dt=scenario.t_end / (EIGHT * every), record_every=every)
    return run.status, run.failure, run.z[1:] if run.ok else None


def without_dissipation(scenario: Scenario) -> Scenario | None:
    """The scenario where nothing dissipates; None of elements that have no conductivity to be 0."""
    kind = scenario.system
    if not issubclass(kind, ElementSystem):
        no: Row = {"irreversible": lambda self, z, dE, dS: {}}
        if kind.defines("friction"):
            no = {"friction": lambda self, z: np.zeros((self.size, self.size))}
        return replace(scenario, name="still", system=type(kind.__name__, (kind,), no))
    still = scenario.replace(name="still", **{name: 0.0 for name in ("conductivity",) if name in scenario.constants})
    model, z0 = still.model, still.z0
    lost = np.abs(model.irreversible(z0, model.gradient(z0), model.entropy_gradient(z0))).max()
    return None if lost > 0 else still


def symplecticity_defect(integrator: Integrator, scenario: Scenario, options: Row) -> float:
    """max |M L(z0) M^T - L(z1)| over max |L|, M the slopes of one step where nothing dissipates; by differences, so
    that 1e-8 is none. NaN where a system dissipates in other ways, and where a step fails."""
    still = without_dissipation(scenario)
    if still is None:
        return math.nan
    model, z0 = still.model, np.asarray(still.z0)
    h = options.get("dt", scenario.dt)

    def step(z: Any) -> Any:
        start = still.replace(name="moved", t_end=h, **model.initial_of(z))
        return _one_step(integrator, start, h, options)

    def poisson(z: Any) -> Any:
        dS = model.entropy_gradient(z)
        return np.array([model.reversible(z, model.state(e), dS) for e in np.eye(len(z))]).T

    try:
        z1, slopes = step(z0), []
        for i, size in enumerate(NUDGE * np.maximum(model.state_magnitudes, np.abs(z0))):
            d = size * np.eye(len(z0))[i]
            slopes.append((step(z0 + d) - step(z0 - d)) / (2 * size))
    except ArithmeticError:
        return math.nan
    M, L0, L1 = np.array(slopes).T, poisson(z0), poisson(z1)
    scale = np.abs(L1).max()
    return float(np.abs(M @ L0 @ M.T - L1).max() / scale) if scale else math.nan


def _one_step(integrator: Integrator, start: Scenario, h: float, options: Row) -> Any:
    if integrator.kind == "adaptive":
        status, failure, states = _states(integrator, start, options, [h])
    else:
        run = simulate(integrator, start, dt=h, t_end=h)
        status, failure, states = run.status, run.failure, run.z
    if status != "ok":
        raise ArithmeticError(failure)
    return np.asarray(states[-1])


def reversibility_defect(integrator: Integrator, scenario: Scenario, options: Row) -> float:
    """max |z0 - step(step(z0, h), -h)| over the size of each number: 0 of a method that is its own adjoint, dissipation
    or not. NaN of solvers that choose their steps, multistep methods, and where one of the steps cannot be had."""
    if integrator.kind == "adaptive" or integrator.memory:
        return math.nan
    step, z0, h = stepper(integrator, scenario), np.asarray(scenario.z0), options["dt"]
    try:
        back = np.asarray(step(step(z0, h), -h))
    except (ArithmeticError, TcbenchError):
        return math.nan
    return float(np.max(np.abs(back - z0) / np.maximum(scenario.model.state_magnitudes, np.abs(z0))))


def substep_laws(integrator: Integrator, scenario: Scenario, options: Row) -> Row:
    """Of a method that is several formulas one after the other: |E1 - E0| over V0 and the fall of S of each alone, over
    SUBSTEPS steps of its part of h from the start; nothing of other methods (Romero's Theorem 4 is about these)."""
    if integrator.flows is None or len(integrator.flows) < 2 or integrator.memory:
        return {}
    lost, fell = [], []
    for flow in integrator.flows:
        alone = replace(integrator, name="sub_step", flows=(flow,), parameters={}, family=None)
        run = simulate(alone, scenario, dt=options["dt"], t_end=SUBSTEPS * options["dt"])
        lost.append(run.summary.energy_error_max if run.ok else math.nan)
        fell.append(max(0.0, -run.summary.entropy_increment_min) if run.ok else math.nan)
    return {"substep_energy_error_max": max(lost), "substep_entropy_fall_max": max(fell)}


def energy_growth(integrator: Integrator, scenario: Scenario, options: Row) -> Row:
    """a of |E - E0| ~ t^a over the last octaves of a long run where nothing dissipates (if that can be): 0 where it is
    bounded, 1/2 where it is round-off, 1 where it has a bias; and its root mean square over the last half, over V0. NaN
    where the run fails before."""
    none = {"energy_growth_exponent": math.nan, "energy_growth_end": math.nan}
    if integrator.kind == "adaptive":
        return none  # its long run is as long as its tolerance lets it be
    dt = options["dt"]
    run = simulate(integrator, without_dissipation(scenario) or scenario, dt=dt, t_end=LONG * dt)
    if not run.ok:
        return none
    gap = np.abs(run.energy - run.energy[0]) / scenario.initial_exergy
    ends = [LONG // 2**k for k in range(OCTAVES, -1, -1)]
    sizes = [float(np.sqrt(np.mean(gap[a:b] ** 2))) for a, b in itertools.pairwise(ends)]
    grows = min(sizes) > 0
    slope = float(np.polyfit(np.log(ends[1:]), np.log(sizes), 1)[0]) if grows else math.nan
    return {"energy_growth_exponent": slope, "energy_growth_end": sizes[-1]}


def tabulate(records: Sequence[Row]) -> Tables:
    table = table_of(records, MEASURES)
    return {"measures": table.drop(columns=[c for c in NOT_OF_ALL if c in table and table[c].isna().all()])}


STUDY = Study(
    name="measures",
    place=65,
    description="error over the trajectory and at a coarse step, symplecticity of a step, growth of the energy error",
    tables=(MEASURES,),
    plan=plan,
    measure=measure,
    tabulate=tabulate,
    by_default=False,
)
