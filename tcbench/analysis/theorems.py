"""The theorems, checked on random admissible states, not only on those of scenarios.

A finding is a statement, what was expected, what was measured, and a verdict that follows from the measurement.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import TcbenchError
from ..integrator import Integrator
from ..reference.digits import exactly
from ..simulation.run import simulate
from ..simulation.trajectory import Trajectory
from ..systems.pendulum import Pendulum
from ..systems.scenario import Scenario
from ..systems.state import State
from ..systems.system import System
from . import structure

HOLDS = "holds"
NOT_WITH_DATA = "does not hold with the printed data"
CONTRADICTS = "contradicts the printed equations"

SEED = 20090706  # any number would do; a fixed one makes the table repeatable
PATIENCE = 100  # inadmissible random states in a row after which their distance from the start is halved
STATES = 200  # random pairs of states for the operators
RANDOM_STEPS = 100  # random steps for each integrator
ROUNDOFF = 1e-13  # relative, of operators, which are sums of some ten terms of one size
LAST_DIGITS, SHAKEN = 4 * float(np.finfo(float).eps), 8  # how far, and how often, states are moved to see round-off
CLOSE, SECOND, AGREED = (1e-2, 1e-3), 1.9, 20  # distances of states; the least slope that counts as order 2; pairs
SOLVED = 1e-12  # relative residual that a converged Newton iteration leaves
PROBE = 1e-8  # relative move of a state that shows how fast its positive quantities change
EQUIVARIANT = 1e-9  # gap of two solves of one step in turned coordinates: round-off times the condition number
SMALLEST = 1e-3  # of the energy magnitude: the least scale of energy errors, where a system has next to no energy
SOLVED_SHARE = 0.9  # share of the random steps that must be solved for a verdict
DIFFERENCE_STEP = 1e-4  # relative step of central differences: their error is 1e-8
DT_RANGE = (1e-3, 3.0)

Floats = NDArray[np.float64]
Sample = list[tuple[State, State]]
Row = Callable[[str, str, str, float, float, str], "LedgerRow"]


@dataclass(frozen=True)
class LedgerRow:
    """One row of the ledger. agrees : the measurement agrees with the claim. command : repeats the measurement.
    yes, no : sentences for rows that agree and for others. impossible : the printed equations exclude the claim."""

    claim: str
    section: str
    expected: str
    measured: str
    agrees: Any
    command: str
    yes: str
    no: str = ""
    impossible: Any = False

    @property
    def verdict(self) -> str:
        if self.agrees:
            return HOLDS
        return CONTRADICTS if self.impossible else NOT_WITH_DATA

    @property
    def why(self) -> str:
        """The sentence for the verdict."""
        return self.yes if self.agrees else self.no or self.yes

    def as_dict(self) -> dict[str, Any]:
        names = ("claim", "section", "expected", "measured", "verdict", "why", "command")
        return {name: getattr(self, name) for name in names}


def command(integrator: Integrator, scenario: Scenario, study: str = "claims") -> str:
    """The command line that measures a pair again."""
    return f"tcbench run --study {study} -i {shell_name(integrator)} -s {scenario.name}"


def shell_name(integrator: Integrator) -> str:
    """The name for a shell: brackets of variants are quoted."""
    return f"'{integrator.name}'" if "[" in integrator.name else integrator.name


# ---- random admissible states


def admissible_states(scenario: Scenario, rng: np.random.Generator, reach: float = 1.0) -> Iterator[State]:
    """Endless random states around the scenario's start, with positive temperatures and measures at least a tenth of
    those at the start; nearer to it where few are admissible. reach : distance, over that of `nearby`."""
    model, z0 = scenario.model, scenario.z0
    laws = 2 + len(model.invariant_names)  # observables before temperatures and measures
    least = np.asarray(model.observe(z0))[laws:] * np.repeat(
        [1e-3, 0.01], [model.n_temperatures, len(model.shapes(z0))]
    )
    refused, near = 0, reach
    while True:
        with np.errstate(all="ignore"):
            z = model.nearby(z0, rng) if near == 1 else model.state(z0 + near * (model.nearby(z0, rng) - z0))
            seen = np.asarray(model.observe(z))
            good = bool(np.all(np.isfinite([*z, *seen])) and np.all(seen[laws:] > least))
        refused = 0 if good else refused + 1
        if good:
            yield z
        elif refused == PATIENCE and near < DIFFERENCE_STEP:
            raise TcbenchError(
                f"No state near the start of {scenario.name!r} has finite laws and what must be positive."
            )
        elif refused == PATIENCE:
            refused, near = 0, near / 2


def _pairs(scenario: Scenario, rng: np.random.Generator) -> Iterator[tuple[State, State]]:
    """Admissible pairs whose distance is anything from 1e-4 of a state's size to all of it."""
    states = admissible_states(scenario, rng)
    for z0, other in zip(states, states, strict=True):
        yield z0, scenario.model.state(z0 + 10.0 ** rng.uniform(-4, 0) * (other - z0))


def turned(z: Any, angle: float) -> Floats:
    """A pendulum's state in axes turned by `angle`: positions and momenta are plane vectors."""
    Q = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    plane = np.asarray(z, float)[:8].reshape(4, 2) @ Q.T
    return np.concatenate([plane.ravel(), np.asarray(z, float)[8:]])


def _is_pendulum(scenario: Scenario) -> bool:
    return issubclass(scenario.system, Pendulum)


# ---- the operators


def operators(integrator: Integrator, scenario: Scenario) -> list[LedgerRow]:
    """Conditions (1), (2), (8) and (9) on the operators of the scenario's system, on random states."""
    rng = np.random.default_rng(SEED)
    pairs = _pairs(scenario, rng)
    sample = [next(pairs) for _ in range(STATES)]
    repeat = command(integrator, scenario)

    def row(claim: str, section: str, expected: str, worst: float, limit: float, why: str) -> LedgerRow:
        failed = f"The condition is violated by {worst:.1e}, beyond round-off ({limit:.0e})."
        measured = f"{worst:.1e} on {STATES} random admissible pairs of states"
        return LedgerRow(claim, section, expected, measured, worst <= limit, repeat, why, failed)

    def owed(*labels: Any) -> LedgerRow:
        finding = row(*labels)
        return replace(finding, no=f"{finding.no} {labels[-1]}")

    rows = [*_gradient_rows(row, scenario, sample, rng)]
    return [*rows, *structure.findings(owed, scenario.model, sample, rng)]


def _gradient_rows(row: Row, scenario: Scenario, sample: Sample, rng: np.random.Generator) -> Iterator[LedgerRow]:
    model = scenario.model
    consistency = max(_relative(model.discrete_gradient(z, z), model.gradient(z)) for z, _ in sample)
    yield row("the discrete gradient is directional: DE . (z1 - z0) = E(z1) - E(z0)", "eq. (8)",
              "defect 0, relative to |DE| |z1 - z0|", *_directionality(scenario, sample),
              "Every operation of the energy is replaced by its exact divided difference.")  # fmt: skip
    yield row(
        "the discrete gradient is consistent: DE(z, z) = grad E(z)", "section 3", "defect 0, relative", consistency,
        ROUNDOFF, "Divided differences tend to derivatives, and are evaluated in closed form at zero increment.",
    )  # fmt: skip
    order = _agreement(model, sample[:AGREED])
    yield row("the discrete gradient is that of the midpoint up to second order", "eq. (7)",
              "|DE(z1, z0) - grad E((z0 + z1)/2)| falls as |z1 - z0|^2", max(0.0, SECOND - order), 0.0,
              f"From a distance of {CLOSE[0]:g} to {CLOSE[1]:g} it falls with the power {order:.2f}.")  # fmt: skip
    if _is_pendulum(scenario):
        worst = max(_turning(model, *pair, float(rng.uniform(0, 2 * np.pi))) for pair in sample)
        yield row("the discrete gradient is equivariant under rotation", "section 3", "defect 0, relative", worst,
                  ROUNDOFF, "It sees positions only through squared lengths, which rotations keep.")  # fmt: skip


def _relative(value: Any, exact: Any) -> float:
    gap = float(np.abs(np.asarray(value) - np.asarray(exact)).max())
    return gap and gap / float(np.abs(np.asarray(exact)).max())  # an energy may be constant


def _agreement(model: System, sample: Sample) -> float:
    """The power of |z1 - z0| with which DE approaches the gradient at the midpoint: the median of pairs, as the leading
    term of some nearly vanishes; 2 where both are equal. Distances are parts of a state and of its positive numbers:
    a hundredth of a state may be many thin cells of a gas."""
    powers = []
    for z, other in sample:
        gaps = []
        way = (other - z) / np.linalg.norm((other - z) / np.maximum(1.0, np.abs(z)))
        least, moved = (np.concatenate([model.temperatures(x), model.shapes(x)]) for x in (z, z + PROBE * way))
        way = way / max(1.0, float((np.abs(moved - least) / least).max(initial=0.0)) / PROBE)
        for part in CLOSE:
            z1 = model.state(z + part * way)
            exact = np.asarray(model.gradient((z + z1) / 2))
            gaps.append(
                float(np.linalg.norm(model.discrete_gradient(z, z1) - exact) / (np.linalg.norm(exact) + 1e-300))
            )
        resolved = min(gaps) > ROUNDOFF
        powers.append(float(np.log(gaps[0] / gaps[1]) / np.log(CLOSE[0] / CLOSE[1])) if resolved else 2.0)
    return float(np.median(powers))


def _directionality(scenario: Scenario, sample: Sample) -> tuple[float, float]:
    """Largest defect of (8), and the part that round-off explains: ROUNDOFF, or the change of DE by the last digits of
    the two states, where the author's terms cancel. E(z1) - E(z0) is computed with 30 digits."""
    model, rng, worst, limit = scenario.model, np.random.default_rng(SEED), 0.0, ROUNDOFF
    energies = iter(exactly(scenario, "energy", [z for pair in sample for z in pair]))
    for z0, z1 in sample:
        DE, (E0,), (E1,) = np.asarray(model.discrete_gradient(z0, z1)), next(energies), next(energies)
        dz = [Fraction(b) - Fraction(a) for a, b in zip(z0.tolist(), z1.tolist(), strict=True)]
        gained = sum((Fraction(d) * x for d, x in zip(DE.tolist(), dz, strict=True)), Fraction(0))
        size = float(np.linalg.norm(DE) * np.linalg.norm(z1 - z0))
        defect = float(abs(gained - (E1 - E0)))
        defect = defect and defect / size  # an energy may be constant
        if defect > max(worst, limit):
            shifts = 1 + LAST_DIGITS * rng.choice([-1.0, 1.0], (SHAKEN, 2, model.size))
            moved = [np.asarray(model.discrete_gradient(model.state(a * z0), model.state(b * z1))) for a, b in shifts]
            limit = max(limit, SHAKEN * max(float(np.linalg.norm(x - DE)) for x in moved) / float(np.linalg.norm(DE)))
        worst = max(worst, defect)
    return worst, limit


def _turning(model: System, z0: State, z1: State, angle: float) -> float:
    """Gap between the turned discrete gradient and the discrete gradient of the turned states."""
    gradient = model.discrete_gradient(turned(z0, angle), turned(z1, angle))
    return _relative(gradient, turned(model.discrete_gradient(z0, z1), angle))


# ---- one step of a method


def steps(integrator: Integrator, scenario: Scenario) -> Iterator[LedgerRow]:
    """What an integrator claims, on random steps: one row for each of its claims."""
    runs = random_steps(integrator, scenario)
    # a step that leaves the energy bound is a solved step too
    good = [run for run in runs if run.steps == 1 + integrator.memory]
    enough = len(good) >= SOLVED_SHARE * len(runs)
    claims = integrator.claims

    def row(claim: str, section: str, expected: str, measure: Callable[[Trajectory], float], limit: float) -> LedgerRow:
        worst = max((measure(run) for run in good), default=float("nan"))
        measured = f"{worst:.1e} on {len(good)} random steps"
        measured += f" ({len(runs) - len(good)} of {len(runs)} were not solved)" if len(good) < len(runs) else ""
        return LedgerRow(
            f"{integrator.name}: {claim}", section, expected, measured, enough and worst <= limit,
            command(integrator, scenario),
            f"No step with dt from {DT_RANGE[0]:g} to {DT_RANGE[1]:g} violates it beyond round-off ({limit:.0e}).",
            f"A random step violates it by {worst:.1e}, which is no round-off."
            if enough else "Too few of the random steps were solved for a verdict.",
        )  # fmt: skip

    labels_of = {
        "energy": ("a step keeps energy", "Theorem 1", "|E1 - E0|/max(V0, |E0|) = 0"),
        "entropy": ("a step never lowers entropy", "Theorem 2", "fall of S = 0, relative"),
    }
    measures = defects(integrator, scenario.model)
    for name, measure in measures.items():
        of_momentum = (f"a step keeps {name.replace('_', ' ')}", "section 3", "|J1 - J0| = 0, relative")
        yield row(*labels_of.get(name, of_momentum), measure, SOLVED)
    if {"energy", "entropy"} <= claims:
        yield row("E - theta_ref S never rises in a step", "Theorem 6, eq. (37)",
                  "rise = 0, relative to max(V0, |E0|)", lyapunov_rise, SOLVED)  # fmt: skip
    if _is_pendulum(scenario) and measures:
        yield row("a step commutes with rotations", "section 3", "defect 0, relative", _equivariance, EQUIVARIANT)


def random_steps(integrator: Integrator, scenario: Scenario) -> list[Trajectory]:
    """RANDOM_STEPS single steps from random admissible states, dt log-uniform in DT_RANGE."""
    rng = np.random.default_rng(SEED)
    states = admissible_states(scenario, rng)
    runs = []
    for _ in range(RANDOM_STEPS):
        start = _from_state(scenario, next(states))
        dt = float(np.exp(rng.uniform(*np.log(DT_RANGE))))
        runs.append(simulate(integrator, start, dt=dt, t_end=(1 + integrator.memory) * dt))
    return runs


def _from_state(scenario: Scenario, z: State) -> Scenario:
    return scenario.replace(**scenario.model.initial_of(z))


def _scale(run: Trajectory) -> float:
    return max(
        run.scenario.initial_exergy, abs(float(run.energy[0])), SMALLEST * float(run.scenario.model.energy_magnitude)
    )


def defects(integrator: Integrator, model: System) -> dict[str, Callable[[Trajectory], float]]:
    """Law -> defect of a run, for the laws that a method claims and the system has."""
    measures: dict[str, Callable[[Trajectory], float]] = {"energy": energy_defect, "entropy": entropy_fall}
    measures |= {name: _momentum(name) for name in model.invariant_names}
    return {name: measure for name, measure in measures.items() if name in integrator.claims}


def energy_defect(run: Trajectory) -> float:
    """Largest |E_k - E_0| over max(V0, |E0|): round-off of E is in proportion to E, which may exceed V0."""
    return run.summary.energy_error_max * run.scenario.initial_exergy / _scale(run)


def entropy_fall(run: Trajectory) -> float:
    """Largest S_k - S_{k+1}, not below 0, over |S0| or its magnitude."""
    size = max(float(run.scenario.model.entropy_magnitude), abs(float(run.entropy[0])))
    return max(0.0, -run.summary.entropy_increment_min) / size


def lyapunov_rise(run: Trajectory) -> float:
    """Largest rise of E - theta_ref S in a step, not below 0, over max(V0, |E0|)."""
    return max(0.0, run.summary.lyapunov_increment_max) * run.scenario.initial_exergy / _scale(run)


def _momentum(name: str) -> Callable[[Trajectory], float]:
    """Largest |J_k - J_0| over |J0|, or its magnitude, and over the terms that J is the sum of, whose round-off it has:
    after a large explicit step they may be 1e5 of it."""

    def defect(run: Trajectory) -> float:
        which = run.scenario.model.invariant_names.index(name)
        terms = max(float(_terms(run.scenario.model, z)[which]) for z in run.z[[0, -1]])
        magnitude = float(run.scenario.model.law_magnitudes[2 + which])
        size = max(magnitude, abs(float(run.invariants[name][0])), terms)
        return run.summary.invariant_error_max[name] / size

    return defect


def _terms(model: System, z: Floats) -> Floats:
    """The sum of |z_i dJ/dz_i| for each invariant J, by differences."""
    moves = DIFFERENCE_STEP * np.diag(np.abs(z))
    with np.errstate(all="ignore"):
        jumps: Floats = np.abs(np.asarray(model.momenta(z + moves)) - np.asarray(model.momenta(z - moves))).sum(axis=1)
    return np.nan_to_num(jumps / (2 * DIFFERENCE_STEP))


def _equivariance(run: Trajectory) -> float:
    """Gap between the turned step and the step from the turned state; inf if that one is not solved."""
    angle = 2 * np.pi * float(np.random.default_rng(int(abs(run.energy[0]) * 1e6)).random())
    start = _from_state(run.scenario, run.scenario.model.state(turned(run.z[0], angle)))
    other = simulate(run.integrator, start, dt=run.dt, t_end=run.steps * run.dt)
    return _relative(other.z[-1], turned(run.z[-1], angle)) if other.steps == run.steps else float("inf")
