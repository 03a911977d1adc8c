"""The lines of `tcbench check` for a scenario and its system."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import plugins
from ..analysis.structure import FORMULAS, rates_of, written
from ..analysis.theorems import SEED, admissible_states, operators
from ..compiler.derivatives import INFINITE
from ..simulation.invariants import lost_by
from ..simulation.run import simulate
from ..systems.as_written import place
from ..systems.element_system import ElementSystem
from ..systems.plane import segments
from ..systems.scenario import Scenario
from ..systems.system import System
from . import geometry
from .check_line import FAIL, NONE, OK, Line, line

LARGE = 80  # numbers of a state from which on it is traced once
LINES, PIECES, HALVINGS = 40, 65, 50  # that are searched for jumps, each cut by so many states, then halved
JUMP, POLE = 1e-3, 100.0  # parts of its own size by which what jumps does, and no pole
STARTS = 4  # random states from which steps are taken
MOST_TRIED = 4000  # states of a descent
METHODS = ("tc_monolithic", "tc_staggered", "tc_strang", "midpoint_entropy", "midpoint_temperature")
REMEDIES = {  # of elements, by the first words of a finding of theorems.operators
    "the discrete gradient": "shape() must be linear or quadratic in q; element_energy() must act element by element.",
    "irreversible keeps": "theta @ conduction(theta) must vanish, and written as a difference of temperatures.",
    "irreversible never": "sum(conduction(theta)) must not be negative: heat flows from hot to cold.",
}


def metadata(scenario: Scenario) -> Line:
    missing = [name for name in ("shows", "source") if not getattr(scenario, name)]
    if missing:
        remedy = "Say what a reader should look at (shows=) and where the numbers are from (source=)."
        return Line("metadata", NONE, f"{' and '.join(missing)} empty", remedy)
    text = f"system {scenario.system.name}, t_end {scenario.t_end:g}, dt {scenario.dt:g}, {scenario.source!r}"
    return Line("metadata", OK, text)


def formulas(scenario: Scenario) -> list[Line]:
    """Everything that the author writes can be traced, and is the same whenever it is called."""
    model, z0 = scenario.model, scenario.z0
    if isinstance(model, ElementSystem):
        return []  # each is asked for what it owes
    for name in DERIVED:
        getattr(model, name)(z0)
    if model.defines("points"):
        segments(model, np.asarray(z0)[None])
    rates = model.state(np.asarray(model.vector_field(z0)))
    if names := [name for name in model.variables if not (np.abs(getattr(rates, name)) < INFINITE).all()]:
        said = f"{_not_finite(model, z0)}: at the start the rate of {', '.join(names)} is not finite"
        return [Line("formulas", FAIL, said, "Look for 0/0: a root of 0 has no slope, nor has a power below 1.")]
    if not np.any([rates, *(model.vector_field(model.nearby(z0, np.random.default_rng(i))) for i in range(3))]):
        remedy = "reversible(z, dE, dS) or irreversible(z, dE, dS), or a matrix in its place, gives rates by name."
        return [Line("formulas", FAIL, "nothing moves, at the start or near it", remedy)]
    if model.size > LARGE:  # whose traces are long, and made once
        return [Line("formulas", OK, "traced")]
    changing = [name for name in DERIVED if model.formula(name) != model.formula(name)]
    remedy = "A formula reads its arguments, constants of self and what does not change: no counter, no random numbers."
    said = f"traced twice, {', '.join(changing)} is not the same" if changing else "traced twice, they are the same"
    text = "".join(model.formula(name)[0] for name in (*DERIVED, *["constraint_values"] * bool(model.multipliers)))
    sizes = [math.prod(shape) for shape in model.constants.values()]
    first = np.cumsum([1, *sizes])  # of each constant, where it stands in b
    unread = [
        name
        for name, k, n in zip(model.constants, first, sizes, strict=False)
        if np.any(getattr(model, name))  # what is 0 is traced as 0, and in no text
        and not any(f"b[{i}]" in text for i in range(k, k + n))
    ]
    if unread and not changing:
        return [Line("formulas", OK, f"{said}; none reads {', '.join(unread)}", "Is a term missing?")]
    return [line("formulas", not changing, said, remedy)]


def _not_finite(model: System, z: Any) -> str:
    """Where the formula stands from which rates are not finite: an energy's slope, or a rate's own."""
    with np.errstate(all="ignore"):
        covectors = [np.asarray(x) for x in (model.gradient(z), model.entropy_gradient(z))]
        slopes_and_rates = *covectors, *rates_of(model, z, *covectors)
    names = zip(("energy", "entropy", *FORMULAS), slopes_and_rates, strict=True)
    name = next(name for name, values in names if not (np.abs(values) < INFINITE).all())
    return f"{written(model, name)}{', its slope' * (name in ('energy', 'entropy'))}"


def smooth(scenario: Scenario) -> Line:
    """E, S and their slopes do not jump: on lines through the start, halved where each changes most."""
    model, z0 = scenario.model, np.asarray(scenario.z0)
    if model.size > LARGE:
        return Line("smooth", NONE, "not looked at: the state is large")
    states, laws = admissible_states(scenario, np.random.default_rng(SEED)), 2 + len(model.invariant_names)

    def row_of(z: NDArray[np.float64]) -> NDArray[np.float64]:
        """A row of (E, S, slopes of E, slopes of S) for each state."""
        values = [model.energy(z)[:, None], model.entropy(z)[:, None], model.gradient(z), model.entropy_gradient(z)]
        return np.concatenate(values, axis=1)

    def sound(z: NDArray[np.float64]) -> bool:
        numbers = np.asarray(model.observe(z))
        return bool(np.isfinite(numbers).all() and (numbers[:, laws:] > 0).all() and np.isfinite(row_of(z)).all())

    for _ in range(LINES):
        away = np.linspace(-8, 8, PIECES)[:, None] * (np.asarray(next(states)) - z0)
        line_ = next((z for z in (z0 + away / 2**i for i in range(6)) if sound(z)), z0[None].repeat(3, axis=0))
        values = row_of(line_)
        first = abs(np.diff(values, 2, axis=0)).argmax(axis=0)
        low, high, below, above = line_[first], line_[first + 2], *(values[first + i].diagonal() for i in (0, 2))
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            value = row_of(middle).diagonal()
            left = abs(value - below) > abs(above - value)
            low, below = np.where(left, low.T, middle.T).T, np.where(left, below, value)
            high, above = np.where(left, middle.T, high.T).T, np.where(left, value, above)
        jumps, size = abs(above - below), abs(values).max(axis=0)
        for k in np.flatnonzero((jumps > JUMP * size) & (jumps < POLE * size))[:1]:
            name = "entropy" if k == 1 or k >= 2 + model.size else "energy"
            of = f"slope by {model.component_names[(k - 2) % model.size]}" if k > 1 else "value"
            where = f"{place(getattr(type(model), name))}, {name}()"
            text = f"{where}: its {of} jumps from {below[k]:.3g} to {above[k]:.3g}"
            if k > 1:
                return Line("smooth", NONE, text, "Both laws hold across a kink; a method's order does not.")
            return Line("smooth", FAIL, text, "Let it be continuous: at a jump there is no discrete gradient.")
    return Line("smooth", OK, "no jump seen near the start, of E, S or their slopes")


def units(scenario: Scenario) -> list[Line]:
    """The formulas agree with the units that the author declares."""
    if not scenario.model.units:
        return [Line("units", NONE, "none declared: units = {'q': 'm', ...} has them checked")]
    from .units import check_units  # pint takes a second

    check_units(scenario.model)
    return [
        Line("units", OK, f"every sum and every rate agrees with the {len(scenario.model.units)} that are declared")
    ]


def laws(scenario: Scenario) -> list[Line]:
    """The conditions of the theory on the system's operators, on random states."""
    method = plugins.find_integrator("tc_monolithic")
    lines = []
    for finding in operators(method, scenario):
        remedies = REMEDIES if isinstance(scenario.model, ElementSystem) else {}
        remedy = next((text for start, text in remedies.items() if finding.claim.startswith(start)), finding.why)
        lines.append(line(finding.claim.partition(":")[0], finding.agrees, finding.measured, remedy))
    return lines


def entropies(scenario: Scenario) -> Line:
    """entropies() is the inverse of theta = de/ds."""
    model, worst = scenario.model, 0.0
    if not model.defines("entropies"):
        return positive(scenario)
    states = admissible_states(scenario, np.random.default_rng(SEED))
    for _ in range(20):
        z = next(states)
        back = np.asarray(model.entropies(np.asarray(z.q), np.asarray(model.temperatures(z))))
        worst = max(worst, float(np.abs(back - z.s).max() / max(1.0, float(np.abs(z.s).max()))))
    inverse = np.abs(np.asarray(model.temperatures(scenario.z0)) / scenario.temperatures - 1).max()
    worst = max(worst, float(inverse))
    remedy = "Solve theta = d(element_energy)/ds for s."
    return line("entropies", worst <= 1e-10, f"inverse of theta = de/ds, gap {worst:.0e}", remedy)


def positive(scenario: Scenario) -> Line:
    """Temperatures and measures at the start."""
    model, z0 = scenario.model, scenario.z0
    numbers = np.concatenate([np.asarray(model.temperatures(z0)), np.asarray(model.shapes(z0))])
    if not numbers.size:
        return Line("positive", NONE, "no temperature(z, dE, dS) and no measures(z): nothing is watched")
    said = f"{numbers.size} temperatures and measures, the least {numbers.min():.4g} at the start"
    remedy = "temperature(z, dE, dS) is absolute, dE by dS: dE.s where S = s, 1 / dS.u where E = u."
    return line("positive", bool(numbers.min() > 0), said, remedy)


def exergy(scenario: Scenario) -> Line:
    """E - theta_ref S + offset is the scale of energy errors: it must be positive."""
    model = scenario.model
    states = admissible_states(scenario, np.random.default_rng(SEED))
    if not model.reference_temperature:
        return Line(
            "exergy", NONE, f"no reference_temperature: errors are over what moves, {scenario.initial_exergy:.3g}"
        )
    smallest = min(float(model.exergy(next(states))) for _ in range(50))
    good = scenario.initial_exergy > 0 and smallest >= -1e-12 * scenario.initial_exergy
    remedy = "Let exergy_offset() return minus the least value of E - reference_temperature * S."
    text = f"V0 = {scenario.initial_exergy:.6g}, least of 50 random states {smallest:.3g}"
    lowest = _lowest(scenario) if good else smallest
    if lowest > scenario.initial_exergy / 2:
        remedy = f"V0 is mostly offset, which makes errors look small: let exergy_offset() give {-lowest:.6g} more."
        return Line("exergy", OK, f"{text}, least of all near {lowest:.6g}", remedy)
    return line("exergy", good, text, remedy)


def _lowest(scenario: Scenario) -> float:
    """The least exergy that a descent from the start finds, with the invariants held where there is none without them;
    of large systems 0, as where none is found."""
    from scipy.optimize import minimize

    model, z0, V0 = scenario.model, scenario.z0, scenario.initial_exergy
    if model.size > LARGE:
        return 0.0
    kept = np.asarray(model.momenta(z0))

    def exergy(z: Any, held: float = 0.0) -> float:
        with np.errstate(all="ignore"):
            value = float(model.exergy(z)) + held * float(np.sum((np.asarray(model.momenta(z)) - kept) ** 2))
        return value if math.isfinite(value) else sys.float_info.max

    for held in (0.0, 100.0 * V0):
        minimum = minimize(exergy, z0, (held,), "Nelder-Mead", options={"maxfev": MOST_TRIED})
        if minimum.fun >= -1e-6 * V0:
            return float(exergy(minimum.x))
    return 0.0


def paper_methods(scenario: Scenario) -> Line:
    """The methods of the paper take their first steps here with a status, and those that claim energy keep it."""
    statuses: dict[str, int] = {}
    for name in METHODS:
        method = plugins.find_integrator(name)
        if method.suits(scenario.model):
            continue
        one = simulate(method, scenario, dt=scenario.dt, t_end=min(scenario.t_end, 20 * scenario.dt))
        statuses[one.status] = statuses.get(one.status, 0) + 1
        wrong = one.summary.energy_error_max > 1e-10 * max(1.0, abs(float(one.energy[0])) / scenario.initial_exergy)
        if "energy" in method.claims and (not one.ok or wrong):
            remedy = "A method that conserves energy elsewhere must here: look at the energy and at what dissipates."
            return Line("the paper's methods", FAIL, f"{name}: {one.failure or 'energy is lost'}", remedy)
    return Line("the paper's methods", OK, ", ".join(f"{n} {status}" for status, n in statuses.items()))


def invariants_by_steps(scenario: Scenario) -> list[Line]:
    """Real steps of the methods that claim momenta keep every invariant that is declared; or why they do not."""
    model, lines = scenario.model, list[Line]()
    if not model.invariant_names or isinstance(model, ElementSystem):
        return []
    from itertools import islice

    rng = np.random.default_rng(SEED)
    states = islice(admissible_states(scenario, rng), STARTS)
    starts = [scenario, *(scenario.replace(**model.initial_of(z)).consistent() for z in states)]
    seen: dict[str, tuple[Any, list[str]]] = {}
    tried = 0
    for name in (*METHODS, "tc_gonzalez"):
        method = plugins.find_integrator(name)
        if method.suits(model) or "angular_momentum" not in method.claims:
            continue
        tried += 1
        runs = [  # from random states as far as plain Newton comes: a step there may be long beyond reason
            simulate(method, one.replace(t_end=3 * scenario.dt, dt=scenario.dt), continuation=one is scenario)
            for one in starts
        ]
        for loss in lost_by((pair for run in runs for pair in zip(run.z[:-1], run.z[1:], strict=True)), model):
            seen.setdefault(loss.name, (loss, []))[1].append(name)
    for loss, by in seen.values():
        text = f"changes by {loss.change:.1e} of its terms in a step of {', '.join(by)}"
        lines.append(Line(f"{loss.name.replace('_', ' ')} by steps", NONE, text, loss.why))
    names = ", ".join(name.replace("_", " ") for name in model.invariant_names if name not in seen)
    return [*([Line("invariants by steps", OK, f"{names}: kept in steps of {tried} methods")] if names else []), *lines]


DERIVED = ("vector_field", "momenta", "temperatures", "shapes", "exergy")  # in which all that is written enters
TESTS: tuple[tuple[str, Callable[[Scenario], Line | list[Line]]], ...] = (
    ("metadata", metadata),
    ("formulas", formulas),
    ("units", units),
    ("entropies", entropies),
    ("smooth", smooth),
    ("exergy", exergy),
    ("the operators", laws),
    *geometry.TESTS,
    ("the paper's methods", paper_methods),
    ("invariants by steps", invariants_by_steps),
)
