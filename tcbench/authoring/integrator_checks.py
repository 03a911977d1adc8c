"""The lines of `tcbench check`, one function each: (integrator) -> Line."""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from .. import plugins
from ..analysis.theorems import SEED, admissible_states, defects
from ..compiler import derivatives as trace
from ..integrator import Flow, Integrator
from ..simulation.run import simulate
from ..simulation.trajectory import Trajectory
from ..solver.equations import states_of
from ..solver.formula import called
from ..solver.quotients import REMEDY, zero_over_zero
from ..systems.as_written import place
from ..systems.scenario import Scenario
from ..systems.system import System
from .check_line import FAIL, NONE, OK, Line, line
from .gaps import given_gap, march_gap, outputs_gap, stands_still, traced_gap, workspace_gap

PREFERRED = ("bound_equilibrium", "gas_containers")  # scenarios that no method finds hard, one a system
SOLVED = {"flows": 1e-12, "step": 1e-10, "adaptive": 1e-6}  # what may be left of a conserved quantity, relative
ROUNDOFF = 1e-11  # an error that no order can be read from
RUN_STEPS = 200  # of a run in plain Python
RANDOM_STEPS = 40
LONGEST = 30.0  # times the scenario's own step, for laws that are claimed of every step
GENTLE = 0.1  # part of the scenario's own step at which every method runs, explicit ones too
REPEATED = 5  # steps or output times at which two ways of a method are compared
RAISE = "Who stands still keeps every law: raise an error where a step is not found, so that its row says so."
MEANT = {"energy": " It is kept where the gradient D that is put in has D . (z1 - z0) = E(z1) - E(z0)."}
SHORTEST = (1e-4, 1e-5)  # steps of the limit h -> 0, as parts of the scenario's own


def scenarios(method: Integrator) -> list[Scenario]:
    """One scenario of every system that the method is for."""
    chosen: dict[type, Scenario] = {}
    for scenario in sorted(plugins.scenarios_for(method), key=lambda s: (s.name not in PREFERRED, s.name)):
        chosen.setdefault(scenario.system, scenario)
    return list(chosen.values())


def start_at(scenario: Scenario, z: Any, t_end: float) -> Scenario:
    """The scenario started from state z, one step of t_end by default."""
    return scenario.replace(**scenario.model.initial_of(z), t_end=t_end, dt=t_end)


def run(method: Integrator, scenario: Scenario, dt: float, steps: int) -> Trajectory:
    """steps of dt; an adaptive solver at its default tolerance over the same time."""
    return simulate(method, scenario, dt=None if method.kind == "adaptive" else dt, t_end=steps * dt)


# ---- what is declared


def metadata(method: Integrator) -> Line:
    laws = {"energy", "entropy"} | {n for s in plugins.scenarios().values() for n in s.model.invariant_names}
    for claim in sorted(method.claims - laws):
        close = difflib.get_close_matches(claim, sorted(laws), n=1)
        text = f"no system has an invariant {claim!r}"
        return Line("metadata", FAIL, text, f"Write {close[0]!r}." if close else f"Claims: {', '.join(sorted(laws))}.")
    if not method.source:
        return Line("metadata", FAIL, "source is empty", 'Say where the method is from: source="paper, equation".')
    claims = ", ".join(sorted(method.claims)) or "nothing"
    return Line("metadata", OK, f"order {method.order}, claims {claims}, source {method.source!r}")


# ---- behaviour as a function


def deterministic(method: Integrator) -> Line:
    """The same start gives the same bits, also when the method has been elsewhere in between."""
    name, (scenario, *others) = "deterministic", scenarios(method)
    first = run(method, scenario, scenario.dt * GENTLE, 5)
    for other in others or [scenario.replace(**scenario.model.initial_of(1.001 * scenario.z0))]:
        run(method, other, other.dt * GENTLE, 3)
    again = run(method, scenario, scenario.dt * GENTLE, 5)
    if first.z.shape == again.z.shape and np.array_equal(first.z, again.z):
        if gap := workspace_gap(method, scenario, scenario.dt * GENTLE):
            remedy = "What `step` returns may not depend on what its workspace holds; `march` alone may go on with it."
            return Line(name, FAIL, f"one step twice, with one workspace, differs by {gap:.1e}", remedy)
        return Line(name, OK, "two runs agree to the last bit, with another scenario in between")
    gap = np.abs(first.z - again.z).max() if first.z.shape == again.z.shape else math.inf
    remedy = "A step may use z0, h and the system only: no random numbers, no memory of earlier steps, no globals."
    return Line(name, FAIL, f"two runs from one start differ by {gap:.1e}", remedy)


def keeps_its_input(method: Integrator) -> Line:
    """Neither z0 nor z1 (nor the times of output) are written to."""
    name, (scenario, *others) = "input unchanged", scenarios(method)
    if method.kind == "flows":
        models = [one.model for one in (scenario, *others)]
        changing = [f.residual.__name__ for f in method.flows if any(_overwrites(f, model) for model in models)]
        return line(name, not changing, f"{', '.join(changing)} changes its arguments" if changing else "", _COPY)
    z0, times = scenario.model.state(scenario.z0.copy()), np.linspace(0, scenario.dt, 3)
    before = z0.copy(), times.copy()
    if method.step is not None:
        earlier = (tuple(z0.copy() for _ in range(method.memory)),) if method.memory else ()
        method.step(z0, scenario.dt, scenario.model, *earlier, *method.held_by_a_run(scenario.model))
    else:
        assert method.adaptive is not None
        method.adaptive(scenario.model, z0, times, 1e-6, 1e-6)
    same = np.array_equal(z0, before[0]) and np.array_equal(times, before[1])
    return line(name, same, "" if same else "z0 is changed in place", _COPY)


def quotients(method: Integrator) -> Line:
    """No formula divides 0 by 0 where nothing moves: Newton starts at z1 = z0, and a run may come to rest."""
    name = "quotients"
    if method.kind != "flows":
        return Line(name, NONE, "for formulas only")
    for scenario in scenarios(method):
        z = next(admissible_states(scenario, np.random.default_rng(SEED)))
        for flow in method.flows:
            if place := zero_over_zero(flow, scenario.model, z, scenario.dt):
                return Line(name, FAIL, f"0/0 at z1 = z0 ({place})", f"{REMEDY}.")
    return Line(name, OK, "none is 0/0 at z1 = z0")


SECOND_WAYS: dict[str, tuple[str, Callable[..., Any], str, str]] = {  # the first way, how far from it, what for, remedy
    "march": ("step", march_gap, "is for a compiled loop of your own",
              "march(z, h, count, system) returns what step returns in the next steps, shape (count, n)."),
    "outputs": ("adaptive", outputs_gap, "ends the runs of an adaptive solver where they fail",
                "outputs(system, z0, t_eval, rtol, atol) returns an iterator of the rows of adaptive, and a dict."),
}  # fmt: skip


def second_way(name: str, method: Integrator) -> Line:
    """`march` gives what `step` gives, and as often as was asked for; `outputs` what `adaptive` gives, one by one."""
    first, gap_of, purpose, remedy = SECOND_WAYS[name]
    if getattr(method, name) is None:
        return Line(name, NONE, f"none is given ({name}= {purpose})")
    for scenario in scenarios(method):
        shape, gap = gap_of(method, scenario, scenario.dt * GENTLE, REPEATED)
        if not gap <= ROUNDOFF * np.abs(scenario.z0).max():
            return Line(name, FAIL, f"shape {shape}, {gap:.1e} from what {first} gives ({scenario.name})", remedy)
    return Line(name, OK, f"{REPEATED} rows as by {first}")


def _overwrites(flow: Flow, model: System) -> bool:
    """Does the formula put other symbols into the arrays that it is given?"""
    system = model.symbolic
    chosen = [flow.chosen(system)] if callable(flow.chosen) else []
    count = 2 + flow.stages
    states = [system.state(trace.variables("z", model.size)) for _ in range(count + flow.memory)]
    start = system.state(trace.variables("start", model.size))
    before = [list(state) for state in states]
    extra = [*([states[2:count]] if flow.stages else []), *([start] * states_of(flow) if flow.of_step else [])]
    extra += [tuple(states[count:])] if flow.memory else []
    called(flow, [states[0], states[1], trace.variable("h"), system, *extra, *chosen])
    return any(a is not b for z, old in zip(states, before, strict=True) for a, b in zip(z, old, strict=True))


_MUST_STEP = "The method must do a small step from any admissible state; the sentence says what stopped it."
_COPY = "Write z = z0 + ..., never z0 += ... or z0[...] = ...; or begin with z0 = z0.copy()."


def restart(method: Integrator) -> Line:
    """n + m steps are n steps and then m steps from where they ended, whatever happened in between."""
    name, (scenario, *others) = "restart", scenarios(method)
    if method.kind == "adaptive":
        return Line(name, NONE, "an adaptive solver chooses its steps anew")
    if method.memory:
        return Line(name, NONE, f"a multistep method starts with steps of {method.starter}")
    n, m, h = 7, 5, scenario.dt * GENTLE
    whole, first = run(method, scenario, h, n + m), run(method, scenario, h, n)
    for other in others:
        run(method, other, other.dt * GENTLE, 3)
    if not (whole.steps == n + m and first.steps == n):
        return Line(name, FAIL, whole.failure or first.failure, f"The method must run {n + m} steps of {h:g}.")
    rest = simulate(method, start_at(scenario, first.z[-1], m * h), dt=h, t_end=m * h)
    gap = float(np.abs(whole.z[-1] - rest.z[-1]).max())
    # the restart rounds the entropies, which pass through temperatures
    remedy = "Keep nothing from step to step. A multistep method says memory=k and is given the k states before z0."
    return line(name, gap <= 1e-9, f"{n} + {m} steps against {n}, then {m}: gap {gap:.1e}", remedy)


# ---- accuracy


def consistent(method: Integrator) -> Line:
    """(z1 - z0)/h tends to the vector field as h -> 0, from the scenario's start and from random states."""
    name, worst = "consistent", 0.0
    if method.kind == "adaptive":
        return Line(name, NONE, "an adaptive solver has no h; see order")
    for scenario in scenarios(method):
        states = admissible_states(scenario, np.random.default_rng(SEED))
        for z in [scenario.model.state(scenario.z0), *(next(states) for _ in range(3))]:
            try:
                gaps = [_slope_gap(method, scenario, z, part * scenario.dt) for part in SHORTEST]
            except _NoStep as failed:
                return Line(name, FAIL, f"on {scenario.name}, no step: {failed}", _MUST_STEP)
            if not (math.isfinite(gaps[1]) and gaps[1] <= max(0.3 * gaps[0], 1e-7)):  # first order: a tenth
                text = (
                    f"on {scenario.name}, |(z1 - z0)/h - dz/dt| / |dz/dt| is {gaps[0]:.1e}, then {gaps[1]:.1e} at h/10"
                )
                remedy = (
                    "Look for a wrong sign, a missing term or a factor of h: the step must tend to system.vector_field."
                )
                return Line(name, FAIL, text, remedy)
            worst = max(worst, gaps[1])
    return Line(name, OK, f"the step tends to the vector field (gap {worst:.0e} at the smallest h)")


def _slope_gap(method: Integrator, scenario: Scenario, z: Any, h: float) -> float:
    steps = 1 + method.memory  # the first ones of a multistep method are its starter's
    one = simulate(method, start_at(scenario, z, steps * h), dt=h)
    if one.steps != steps:
        raise _NoStep(one.failure)
    field = np.asarray(scenario.model.vector_field(one.z[-2]))
    return float(np.linalg.norm((one.z[-1] - one.z[-2]) / h - field) / np.linalg.norm(field))


class _NoStep(Exception):
    """A step that was to be looked at was not done; the message says why."""


def order(method: Integrator) -> Line:
    """The measured order against the declared one, on one scenario of each system that has a reference."""
    from ..studies import convergence

    name, orders, higher = "order", [], ""
    if method.kind == "adaptive":
        return _adaptive_order(method)
    for scenario in scenarios(method):
        row = convergence.measure(method, scenario, {"dt": ladder(method, scenario)})
        fit = next(item for item in row["orders"] if item["variable"] == "all")
        orders.append(f"{scenario.name} {fit['order']:.2f}")
        if fit["verdict"] == "undetermined" and _least_error(row) <= ROUNDOFF:
            return Line(name, NONE, f"on {scenario.name} errors reach round-off before one order shows")
        text = f"declared {method.order}, measured {fit['order']:.2f} on {scenario.name} ({fit['verdict']})"
        if fit["verdict"] == "higher than declared":  # no fault where it shows on others: a splitting of one part only
            higher, remedy = text, _order_remedy(fit["verdict"], fit["order"])
            orders.pop()
        elif fit["verdict"] != "as declared":
            return Line(name, FAIL, text, _order_remedy(fit["verdict"], fit["order"]))
    if higher and not orders:
        return Line(name, FAIL, higher, remedy)
    return Line(name, OK, f"declared {method.order}, measured on {', '.join(orders)}")


def _least_error(row: dict[str, Any]) -> float:
    errors = [point["error"] for point in row["points"] if point["variable"] == "all"]
    return min((error for error in errors if math.isfinite(error)), default=math.inf)


def ladder(method: Integrator, scenario: Scenario) -> list[float]:
    """Halvings; closer steps for high orders, which reach round-off in few."""
    if (method.order or 0) > 6:
        return [scenario.t_converge / n for n in (1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32)]
    last = 12 if method.kind == "flows" else 10
    return [scenario.t_converge / 2**k for k in range(2, last + 1)]


def _order_remedy(verdict: str, measured: float) -> str:
    if verdict == "undetermined" or not math.isfinite(measured):
        return (
            "No range of h shows one order: does the solver's own tolerance show, or does the method fail at small h?"
        )
    return f"Declare order={round(measured)}, or find what loses it: in a splitting, a half step at one end only."


def _adaptive_order(method: Integrator) -> Line:
    """An adaptive solver has no order in h: its error must follow the tolerance, unless that is its own."""
    from ..reference.lookup import reference_for

    if "fixed tolerance" in method.tags:
        return Line("order", "-", "its tolerance is fixed")
    scenario, errors = scenarios(method)[0], []
    exact = reference_for(scenario, [scenario.t_converge]).states[0]
    for tolerance in (1e-4, 1e-8):
        one = simulate(method, scenario, t_end=scenario.t_converge, tolerance=tolerance)
        errors.append(float(np.abs(one.z[-1] - exact).max()) if one.ok else math.inf)
    good = errors[1] <= max(0.05 * errors[0], 1e-7) and errors[1] <= 1e-4
    text = f"errors {errors[0]:.0e} and {errors[1]:.0e} at tolerances 1e-4 and 1e-8"
    return line("order", good, text, "Pass rtol and atol on to the solver, and return states at t_eval.")


# ---- claims


def claims(method: Integrator) -> Line:
    """Each claim on every scenario over the first steps, and on single steps from random states."""
    name, limit = "claims", SOLVED[method.kind]
    if not method.claims:
        return Line(name, NONE, "nothing is claimed")
    worst: dict[str, float] = {}
    stuck, done = "", 0
    for one, where in _claim_runs(method):
        if one.steps == 0:  # as in the report: a law is judged on the steps that a method completes
            stuck = stuck or f"{where}: {one.failure}"
            continue
        done += 1
        if stands_still(one):
            return Line(
                name, FAIL, f"a step gives the very state that it began with, which is at no rest ({where})", RAISE
            )
        for law, missed in defects(method, one.scenario.model).items():
            worst[law] = max(worst.get(law, 0.0), value := missed(one))
            if not value <= limit:
                return Line(name, FAIL, f"{law} is violated by {value:.1e} ({where})", _claim_remedy(method, law))
    if not done:
        return Line(name, FAIL, stuck, "Not one step is completed where the claims are to hold; see the sentence.")
    if not worst:
        return Line(name, NONE, "nothing that is claimed can be measured; see metadata")
    text = ", ".join(f"{law} {value:.0e}" for law, value in sorted(worst.items()))
    return Line(name, OK, f"{text}; judged on completed steps (none in {stuck})" if stuck else text)


def _claim_remedy(method: Integrator, law: str) -> str:
    if method.kind == "step":
        return f'Remove "{law}" from claims, or solve each step to 1e-12: what a loose solver leaves is a drift too.'
    if method.kind == "adaptive":
        return f'Remove "{law}" from claims, or mend the solver.'
    where = ", ".join(dict.fromkeys(place(flow.residual) for flow in method.flows))
    return f'Remove "{law}" from claims, or mend the formula ({where}).{MEANT.get(law, "")}'


def _claim_runs(method: Integrator) -> Iterator[tuple[Trajectory, str]]:
    reach = LONGEST if method.kind == "flows" else 1.0
    for scenario, steps in claim_lengths(method):
        yield run(method, scenario, scenario.dt, steps), f"{scenario.name}, {steps} steps of {scenario.dt:g}"
    for scenario in scenarios(method):
        rng = np.random.default_rng(SEED)
        states = admissible_states(scenario, rng)
        for _ in range(RANDOM_STEPS):
            dt = float(np.exp(rng.uniform(np.log(1e-3), np.log(reach * scenario.dt))))
            one = run(method, start_at(scenario, next(states), dt), dt, 1 + method.memory)
            yield one, f"one step of {dt:.2g} from a random state of {scenario.system.name}"


def claim_lengths(method: Integrator) -> list[tuple[Scenario, int]]:
    """The scenarios whose first steps the claims are judged on, and how many steps those are."""
    most = 10 * RUN_STEPS if method.kind == "flows" else RUN_STEPS
    return [(scenario, min(scenario.steps(scenario.dt), most)) for scenario in plugins.scenarios_for(method)]


# ---- derivatives


def jacobian(method: Integrator) -> Line:
    """The Jacobian in use against differences: the traced one, or the one that a method of its own brings."""
    name, function = "Jacobian", method.step or method.adaptive
    if method.kind == "flows":
        worst = max(traced_gap(method, scenario) for scenario in scenarios(method))
        return line(
            name, worst <= 1e-5, f"traced, gap to differences {worst:.0e}", "Report this: the formula is traced wrong."
        )
    own = getattr(function, "jacobian", None)
    if own is None:
        return Line(name, NONE, f"none is given ({method.kind}.jacobian = f would be checked)")
    worst = max(given_gap(function, own, scenario) for scenario in scenarios(method))
    remedy = "Compare entry by entry with differences; a gap near 2 is a wrong sign."
    return line(name, worst <= 1e-5, f"gap to differences {worst:.1e}, relative", remedy)


TESTS: tuple[tuple[str, Callable[[Integrator], Line]], ...] = (
    ("deterministic", deterministic),
    ("input unchanged", keeps_its_input),
    ("quotients", quotients),
    ("consistent", consistent),
    ("order", order),
    ("claims", claims),
    ("restart", restart),
    *((name, partial(second_way, name)) for name in SECOND_WAYS),
    ("Jacobian", jacobian),
)
