"""The statements of section 6 of Romero (2009), each measured with the printed data and a converged Newton iteration.

An entry names the integrators and the scenario that a statement is about, and a function that measures it. What agrees
with the statement is decided in that function, from the run; the words of the verdict follow from it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..analysis import theorems
from ..analysis.theorems import SEED, LedgerRow, energy_defect, shell_name
from ..integrator import Integrator
from ..simulation.run import simulate
from ..simulation.trajectory import Trajectory
from ..systems.scenario import Scenario

CONSERVED = 1e-10  # over the whole horizon: round-off of some thousand steps
ORDER_MARGIN = 0.03  # how far a measured order may be from the stated one
NEAR_ZERO = 10.0  # a temperature that "tends to zero" falls below this; all start near 300
IN_TIME = 0.2  # "at t = 12" is within a fifth of it
TURNS = 3  # that make an oscillation: there, back and there again
TURN = 0.01  # of a curve's range, a turn that a figure shows
VISIBLE = 1e-3  # an oscillation of the energy that a figure shows, in units of V0


@dataclass(frozen=True)
class Entry:
    """A statement: about which integrators and scenarios (by name), and how it is measured."""

    integrators: tuple[str, ...]
    scenarios: tuple[str, ...]
    measure: Callable[[Integrator, Scenario], Iterator[LedgerRow]]


def _simulate(integrator: Integrator, scenario: Scenario, **options: Any) -> tuple[Trajectory, str]:
    """A run, and the command that repeats it."""
    words = f"tcbench simulate {shell_name(integrator)} {scenario.name} --dt {options.get('dt', scenario.dt):g}"
    return simulate(integrator, scenario, **options), words + (
        " --plain" if options.get("continuation") is False else ""
    )


def _outcome(run: Trajectory) -> str:
    """How a run ended, in few words."""
    return f"runs to t = {run.t[-1]:g}" if run.ok else f"{run.status} after {run.steps} steps, t = {run.t[-1]:g}"


# ---- the laws over a whole run


def conservation(integrator: Integrator, scenario: Scenario) -> Iterator[LedgerRow]:
    """E exact, S only grows, J exact, over the whole horizon at the scenario's own step: for what the method claims."""
    run, command = _simulate(integrator, scenario)
    laws = {
        "energy": ("energy is exact", "|E - E0|/max(V0, |E0|) = 0"),
        "entropy": ("entropy only grows", "no fall of S"),
        "angular_momentum": ("angular momentum is exact", "|J - J0| = 0"),
    }
    for name, measure in theorems.defects(integrator, scenario.model).items():
        (words, expected), worst = laws[name], measure(run)
        yield LedgerRow(
            f"{integrator.name}, {scenario.name}: {words}", "section 6", expected,
            f"{worst:.1e}; {_outcome(run)}", run.ok and worst <= CONSERVED, command,
            yes=f"Over {run.steps} steps of {run.dt:g} it is kept to round-off (limit {CONSERVED:.0e}).",
            no=run.failure or f"It is lost by {worst:.1e}, which round-off does not explain.",
        )  # fmt: skip
    if {"energy", "entropy"} <= integrator.claims:
        rise = theorems.lyapunov_rise(run)
        yield LedgerRow(
            f"{integrator.name}, {scenario.name}: E - theta_ref S never rises, step by step", "Theorem 6, eq. (37)",
            "rise = 0", f"{rise:.1e}; {_outcome(run)}", run.ok and rise <= theorems.SOLVED, command,
            yes=f"None of {run.steps} steps raises it beyond round-off ({theorems.SOLVED:.0e}).",
            no=run.failure or f"A step raises it by {rise:.1e}.",
        )  # fmt: skip


def order(integrator: Integrator, scenario: Scenario) -> Iterator[LedgerRow]:
    """The stated order in q, p and s, measured by the convergence study."""
    from .convergence import measure

    fits = {row["variable"]: row for row in measure(integrator, scenario, {})["orders"]}
    orders = {name: fits[name]["order"] for name in ("q", "p", "s")}
    declared = integrator.order or 0
    agrees = all(abs(value - declared) <= ORDER_MARGIN for value in orders.values())
    values = ", ".join(f"{name} {value:.3f}" for name, value in orders.items())
    yield LedgerRow(
        f"{integrator.name} is of order {declared}", "section 6", f"{declared} in q, p and s", values, agrees,
        theorems.command(integrator, scenario, "convergence"),
        yes=f"Slopes over {fits['all']['points_used']} points against certified states agree.",
        no="The slope over the asymptotic window is another, or there is none.",
    )  # fmt: skip


def symmetric(integrator: Integrator, scenario: Scenario) -> Iterator[LedgerRow]:
    """That the bracket makes a step irreversible: a step and its way back, at the scenario's own step."""
    from .measures import reversibility_defect

    defect = reversibility_defect(integrator, scenario, {"dt": scenario.dt})
    yield LedgerRow(
        f"{integrator.name}: the bracket spoils the symmetry of a step in time ({scenario.name})", "section 6, p. 708",
        "a step of h and one of -h do not lead back", f"they end {defect:.1e} from the start",
        defect > theorems.EQUIVARIANT, theorems.command(integrator, scenario, "measures"),
        yes="A step backwards is another one.",
        no="(A1) is its own adjoint: z0 and z1 change places with the sign of h.",
        impossible=defect <= theorems.EQUIVARIANT,
    )  # fmt: skip


def sub_steps(integrator: Integrator, scenario: Scenario) -> Iterator[LedgerRow]:
    """That each part of a splitting has both laws, not only their composition."""
    from .measures import SUBSTEPS, substep_laws

    losses = substep_laws(integrator, scenario, {"dt": scenario.dt})
    lost, fell = losses["substep_energy_error_max"], losses["substep_entropy_fall_max"]
    yield LedgerRow(
        f"{integrator.name}, {scenario.name}: every sub-step keeps energy and lowers no entropy", "Theorems 2 and 4",
        "|E1 - E0|/V0 = 0, no fall of S", f"{lost:.1e}, {fell:.1e} over {SUBSTEPS} steps of each",
        lost <= CONSERVED and fell <= CONSERVED, theorems.command(integrator, scenario, "measures"),
        yes="The reversible part leaves S, the irreversible one E; round-off is left.",
        no="A part alone breaks a law, which the other makes good or not.",
    )  # fmt: skip


# ---- example 1


def large_step(integrator: Integrator, scenario: Scenario) -> Iterator[LedgerRow]:
    run, command = _simulate(integrator, scenario, dt=2.0)
    plain = {h: _simulate(integrator, scenario, dt=h, continuation=False)[0].ok for h in (0.5, 0.62, 2.0, 2.5, 3.0)}
    words = ", ".join(f"{'runs' if ok else 'fails'} at {h:g}" for h, ok in plain.items())
    yield LedgerRow(
        f"{integrator.name} runs example 1 with h = 2", "section 6, example 1", "the run completes",
        f"{_outcome(run)}; plain Newton from z0 {words}", run.ok, command,
        yes="A TC step of these springs has a root for every h; whether an iteration finds it is its own property.",
        no=f"{run.failure}.",
    )  # fmt: skip


def temperature_blows_up(integrator: Integrator, scenario: Scenario) -> Iterator[LedgerRow]:
    run, command = _simulate(integrator, scenario, dt=0.3)
    agrees = not run.ok and abs(run.t[-1] - 12) <= IN_TIME * 12
    yield LedgerRow(
        f"{integrator.name} blows up at t = 12 in example 1, h = 0.3", "section 6, example 1", "blow-up at t = 12",
        f"{_outcome(run)}; E {run.energy[0]:.1f} -> {run.energy[-1]:.1f}", agrees, command,
        yes=run.failure,
        no=f"With every step solved, E moves by {_swing(run.energy):.2g} only." if run.ok else run.failure,
    )  # fmt: skip


def _swing(values: Any) -> float:
    return float(values.max() - values.min())


def _turns(values: Any) -> int:
    """How often a sequence turns, between rising and falling, by more than TURN of its range: what a figure shows."""
    threshold, turns, direction, extreme = TURN * _swing(values), 0, 0, values[0]
    for value in values[1:]:
        move = value - extreme
        if move * direction > 0 or (direction == 0 and abs(move) > threshold):  # onwards
            direction, extreme = (1 if move > 0 else -1), value
        elif abs(move) > threshold and direction:
            direction, extreme, turns = -direction, value, turns + 1
    return turns


def entropy_rule_oscillates(integrator: Integrator, scenario: Scenario) -> Iterator[LedgerRow]:
    run, command = _simulate(integrator, scenario, dt=0.3)
    swing, turns, falls = _swing(run.energy), _turns(run.energy), run.summary.second_law_violations
    rate = least_production(scenario)
    yield LedgerRow(
        f"{integrator.name}: E oscillates in example 1", "section 6, example 1", "visible oscillation of E",
        f"E between {run.energy.min():.2f} and {run.energy.max():.2f}, visible turns: {turns}",
        swing > VISIBLE * scenario.initial_exergy and turns >= TURNS, command,
        yes="The midpoint rule keeps no discrete energy: E goes to and fro.",
        no=f"E goes, turns {turns} time{'s' * (turns != 1)} and settles elsewhere.",
    )  # fmt: skip
    yield LedgerRow(
        f"{integrator.name}: S oscillates in example 1", "section 6, example 1", "S falls at times",
        f"S falls in {falls} of {run.steps} steps, least increment {run.summary.entropy_increment_min:.1e}",
        falls > 0, command, yes=f"S falls in {falls} steps.", no=_cannot_fall(rate), impossible=rate >= 0,
    )  # fmt: skip


def least_production(scenario: Scenario) -> float:
    """Least entropy rate of the printed conduction law over 10,000 random pairs of positive temperatures."""
    theta = 300 * np.exp(2 * np.random.default_rng(SEED).standard_normal((2, 10_000)))
    return float(scenario.model.conduction(theta).sum(axis=0).min())


def _cannot_fall(rate: float) -> str:
    return (
        "By (A2) a step adds h kappa (theta_b/theta_a + theta_a/theta_b - 2) at midpoint temperatures to S; "
        f"over 10,000 random positive temperatures the least rate is {rate:.1e}, so S cannot fall."
    )


def entropy_rule_fails(integrator: Integrator, scenario: Scenario) -> Iterator[LedgerRow]:
    run, command = _simulate(integrator, scenario, dt=0.5)
    plain, _ = _simulate(integrator, scenario, dt=0.5, continuation=False)
    finder = "Newton's iteration from the old state" if plain.ok else "continuation in h"
    yield LedgerRow(
        f"{integrator.name} fails after 5 steps of h = 0.5 in example 1", "section 6, example 1",
        "no solution after 5 steps", f"{_outcome(run)}; plain Newton from z0: {_outcome(plain)}",
        not run.ok and 4 <= run.steps <= 6, command,
        yes=run.failure, no=f"Every step has a root, which {finder} finds." if run.ok else run.failure,
    )  # fmt: skip


# ---- example 2


def temperature_rule_fails(integrator: Integrator, scenario: Scenario) -> Iterator[LedgerRow]:
    run, command = _simulate(integrator, scenario, dt=0.3)
    plain, _ = _simulate(integrator, scenario, dt=0.3, continuation=False)
    agrees = any(not r.ok and 26 <= r.steps <= 30 for r in (run, plain))
    yield LedgerRow(
        f"{integrator.name} fails after 28 steps in example 2", "section 6, example 2", "failure after 28 steps",
        f"{_outcome(run)}; plain Newton from z0: {_outcome(plain)}", agrees, command,
        yes=plain.failure,
        no=f"Plain Newton from z0: {_outcome(plain)}; continuation solves every step." if run.ok else run.failure,
    )  # fmt: skip


def entropy_rule_decays(integrator: Integrator, scenario: Scenario) -> Iterator[LedgerRow]:
    run, command = _simulate(integrator, scenario, dt=0.3)
    rate, falls = least_production(scenario), run.summary.second_law_violations
    moved, coldest = run.energy[-1] - run.energy[0], float(run.temperatures.min())
    yield LedgerRow(
        f"{integrator.name}: E falls and temperatures tend to zero in example 2", "section 6, example 2",
        "E falls without end, theta near 0",
        f"E moves by {_swing(run.energy):.2g} of {run.energy[0]:.0f}, least temperature {coldest:.0f}",
        moved < -VISIBLE * scenario.initial_exergy and coldest < NEAR_ZERO, command,
        yes=run.failure or "Both are seen.",
        no=f"With every step solved, E ends {moved:+.2g} from its start and no element cools below {coldest:.0f}.",
    )  # fmt: skip
    yield LedgerRow(
        f"{integrator.name}: S falls in example 2", "section 6, example 2", "S falls",
        f"S {run.entropy[0]:.4f} -> {run.entropy[-1]:.4f}, falls in {falls} of {run.steps} steps",
        falls > 0, command, yes=f"S falls in {falls} steps.", no=_cannot_fall(rate), impossible=rate >= 0,
    )  # fmt: skip


def reaches_equilibrium(integrator: Integrator, scenario: Scenario) -> Iterator[LedgerRow]:
    """That strains settle by t_end: with the printed data, and with data that bind the masses."""
    from .equilibrium import measure

    summary = measure(integrator, scenario, {"dt": scenario.dt})["summary"]
    growth = (summary["growth_a"], summary["growth_b"])
    measured = f"strains grow by {growth[0]:.2f} and {growth[1]:.2f} per unit of ln t"
    if summary["equilibrium"] != "distant":
        measured = f"entropy gap {summary['entropy_gap']:.1e}, strain gap {summary['strain_gap']:.1e}"
    where = "example 2" if summary["equilibrium"] == "distant" else "qualitative"
    yield LedgerRow(
        f"{integrator.name}: a relative equilibrium is reached by t = {scenario.t_end:g} ({scenario.name})",
        f"section 6, {where}", "strains settle", measured, summary["equilibrium"] == "approached",
        theorems.command(integrator, scenario, "equilibrium"),
        yes=summary["note"], no=summary["note"],
    )  # fmt: skip


# ---- one number changed


def stiff(integrator: Integrator, scenario: Scenario) -> Iterator[LedgerRow]:
    """The qualitative claims of section 6, with the one number changed that brings them out: C_b = 300."""
    run, command = _simulate(integrator, scenario, dt=0.3)
    if "energy" in integrator.claims:
        worst = energy_defect(run)
        yield LedgerRow(
            f"{integrator.name} is stable where midpoint rules are not ({scenario.name})", "section 6, qualitative",
            "E exact to the end", f"{worst:.1e}; {_outcome(run)}", run.ok and worst <= CONSERVED, command,
            yes="Energy and the second law together bound every state.", no=run.failure or "Energy is lost.",
        )  # fmt: skip
        return
    unbounded, _ = _simulate(integrator, scenario.replace(blowup_factor=1e12), dt=0.3)
    gain = (unbounded.energy.max() - run.energy[0]) / scenario.initial_exergy
    yield LedgerRow(
        f"{integrator.name} blows up ({scenario.name})", "section 6, qualitative",
        "|E - E0| exceeds V0",
        f"{_outcome(run)}; left to go on, E rises from {run.energy[0]:.0f} up to {unbounded.energy.max():.0f} (a "
        f"gain of {gain:.0f} V0) and {_outcome(unbounded)}",
        run.status == "blowup", command,
        yes="Nothing in the rule bounds the energy; V0 is all that the exact motion could ever exchange.",
        no="The energy stays within V0.",
    )  # fmt: skip


TC = ("tc_monolithic", "tc_staggered", "tc_strang")
MIDPOINT = ("midpoint_entropy", "midpoint_temperature")
LEDGER: dict[str, Entry] = {
    "conservation": Entry(TC + MIDPOINT, ("short_term", "long_term"), conservation),
    "order": Entry(TC + MIDPOINT, ("short_term",), order),
    "symmetric": Entry(TC[:1], ("short_term",), symmetric),
    "sub_steps": Entry(TC[1:], ("short_term",), sub_steps),
    "large_step": Entry(TC[:2], ("short_term",), large_step),
    "temperature_blows_up": Entry(MIDPOINT[1:], ("short_term",), temperature_blows_up),
    "entropy_rule_oscillates": Entry(MIDPOINT[:1], ("short_term",), entropy_rule_oscillates),
    "entropy_rule_fails": Entry(MIDPOINT[:1], ("short_term",), entropy_rule_fails),
    "temperature_rule_fails": Entry(MIDPOINT[1:], ("long_term",), temperature_rule_fails),
    "entropy_rule_decays": Entry(MIDPOINT[:1], ("long_term",), entropy_rule_decays),
    "reaches_equilibrium": Entry(TC[:1], ("relative_equilibrium", "bound_equilibrium"), reaches_equilibrium),
    "stiff": Entry(TC + MIDPOINT, ("stiff_spring",), stiff),
}
