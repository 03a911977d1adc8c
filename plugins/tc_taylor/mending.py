"""Projection of a step of elements onto the laws: momenta get their invariants back, missing energy becomes heat.

Into heat, because there it disturbs least: an error ds of the entropies is one of theta ds in the energy, so the energy
tells the entropies 300 times more precisely than the momenta. Where the entropy would then be lower than before it is
held, and what is missing goes into the part of the momenta that carries no invariant.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from typing import Any

import numpy as np

from tcbench import System
from tcbench.compiler import derivatives as trace
from tcbench.compiler.array_states import entries, is_array, refilled
from tcbench.compiler.arrays import total as all_of
from tcbench.systems.momenta import lengthening, restored_momenta

from .series import Monomial, Normal

ROUND_OFF = 4e-15  # of the heat: what the energy of a mended state may miss
TOGETHER = 4  # temperatures in one logarithm at most: more could overflow
SMALLEST_SHARE = 1e-12  # of the energy, as kinetic energy free to change: below it nothing is taken from there


def mending_kernels(system: System) -> tuple[Any, Any, Any, list[trace.Symbol]]:
    """(start, mend, hold, constants) of systems of one structure, or of one kind: as tcbench.solver.mending has them.

    start: (q, p, s) -> (q, p, theta), energy, entropy, invariants: what a run is to keep.
    mend, hold: (y, E0, S_floor, invariants; given) -> (y mended, S, margin). The second keeps the entropy at S_floor.
    given: the system's constant_values, then the constants of the list.
    margin: the least of temperatures, shapes and what the energy may miss less what it does; positive in a good state.
    """
    z, y = system.unknowns("z"), system.unknowns("y")
    told = trace.variables("law", 2 + len(system.invariant_names))
    moves = _moves(system, y, told)
    constants = system.hoisted(moves, [y, told])
    mend, hold = (system.compiled([y, told], move, constants, len(entries(y))) for move in moves)
    start = [system.temperature_variables(z), system.energy(z), system.entropy(z), *system.momenta(z)]
    return system.compiled([z], start), mend, hold, constants


def _moves(sym: Any, y: Any, told: Sequence[trace.Symbol]) -> tuple[list[Any], list[Any]]:
    """What mend and hold give, a state and numbers."""
    q, theta, (energy, floor, *invariants) = y.q, sym.named(y, "theta").theta, told
    names = list(sym.invariants(q, y.p))
    p, free = restored_momenta(y, sym, dict(zip(names, invariants, strict=True)))
    pi, inertia, s = sym.shape(q), sym.inertia(), sym.entropies(q, theta)
    warmth = _simpler(entries(y), entries(sym.element_energy(pi, s)))
    own = list(zip(entries(s), entries(theta), strict=True))
    heats = _simpler(entries(y), [t * t * trace.jacobian([x], [t])[0, 0] for x, t in own])
    capacity = [trace.jacobian([x], [t])[0, 0] for x, t in zip(warmth, entries(theta), strict=True)]
    linear = not set(entries(theta)) & set(trace.topological(capacity))

    def total(momenta: Any, warm: Any) -> Any:
        return np.sum(0.5 * momenta**2 / inertia) + np.sum(at(warmth, warm))

    def at(formulas: list[trace.Symbol], warm: Any) -> Any:
        return refilled(theta, trace.substitute(formulas, dict(zip(entries(theta), entries(warm), strict=True))))

    warm = theta
    for _ in range(1 if linear else 2):  # Newton for the part by which all temperatures grow
        warm = warm * (1.0 + (energy - total(p, warm)) / np.sum(at(heats, warm)))

    def outputs(momenta: Any, warm: Any, entropy: Any) -> list[Any]:
        allowed = ROUND_OFF * np.sum(refilled(theta, heats)) - abs(energy - total(momenta, warm))
        least = reduce(trace.minimum, (all_of("min", x, x.space) for x in entries(warm, pi, allowed)))
        return [refilled(y, entries(q, momenta, warm)), entropy, least]

    entropy = _total_entropy(entries(y), len(entries(q, y.p)), entries(s)) if not is_array(s) else np.sum(s)
    here = dict(zip(entries(theta), entries(warm), strict=True))
    mended = outputs(p, warm, trace.substitute([entropy], here)[0])

    s = s + (floor - np.sum(s)) / sym.n_elements
    held = sym.temperatures(np.concatenate([q, p, s]))
    missing = energy - total(p, held)
    kinetic = np.sum(free * free / inertia) / 2
    least = SMALLEST_SHARE * (sym.least_energy + abs(energy))
    x = trace.maximum(missing * kinetic / (kinetic * kinetic + least * least), trace.const(-1.0))
    return mended, outputs(p + lengthening(free, x), held, np.sum(s))


def _simpler(y: list[trace.Symbol], formulas: list[trace.Symbol]) -> list[trace.Symbol]:
    """Formulas in y = (q, p, theta) brought to normal form: no exponential of a logarithm, no factor that cancels."""
    normal = Normal(y)
    return normal.symbols(normal.of(formulas), y)


def _total_entropy(y: list[trace.Symbol], first: int, s: list[trace.Symbol]) -> trace.Symbol:
    """The sum of the entropies; logarithms of temperatures (y from `first` on) are those of products: nothing else
    needs them one by one."""
    normal = Normal(y)
    (form,) = normal.of([sum(s, trace.const(0.0))])
    alike: dict[trace.Symbol, list[trace.Symbol]] = {}  # temperatures by the weight of their logarithms
    rest = {}
    for key, weight in form.items():
        of = _logarithm_of(key)
        if of >= first:
            alike.setdefault(weight, []).append(y[of])
        else:
            rest[key] = weight
    logs = [weight * reduce(trace.mul, temperatures[i : i + TOGETHER]).log()
            for weight, temperatures in alike.items() for i in range(0, len(temperatures), TOGETHER)]  # fmt: skip
    return reduce(trace.add, [*normal.symbols([rest], y), *logs])


def _logarithm_of(key: Monomial) -> int:
    """Place in y of what this is the logarithm of; -1 if it is another formula."""
    x, power = key[0] if len(key) == 1 else (None, 0)
    return x.parts[0].index if x and x.kind == "log" and power == 1 and x.parts[0].kind == "var" else -1
