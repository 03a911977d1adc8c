"""What a Taylor step leaves of the laws of elements is mended: momenta are turned back, missing energy becomes heat.

Into heat, because there it disturbs least: an error ds of the entropies is one of theta ds in the energy, so the energy
tells the entropies 300 times more precisely than the momenta. Where the entropy would then be lower than before it is
held, and what is missing goes into the part of the momenta that carries no invariant.
"""

from __future__ import annotations

from functools import reduce
from typing import Any

import numpy as np

from tcbench import System
from tcbench.compiler import derivatives as trace
from tcbench.compiler.kernels import Kernel, constant_part, kernel
from tcbench.systems.momenta import lengthening, restored_momenta

from .series import Monomial, Normal

ROUND_OFF = 4e-15  # of the heat: what the energy of a mended state may miss
TOGETHER = 4  # temperatures in one logarithm at most: more could overflow
SMALLEST_SHARE = 1e-12  # of the energy, as kinetic energy free to change: below it nothing is taken from there


def start_kernel(system: System) -> Kernel:
    """(q, p, s) -> (q, p, theta), energy, entropy, invariants: what a run is to keep."""
    sym = system.symbolic
    z = trace.variables("z", system.size)
    laws = [sym.energy(z), sym.entropy(z), *sym.momenta(z)]
    inputs = {x: f"a[{i}]" for i, x in enumerate(z)} | system.constant_symbols()
    return kernel(inputs, [*sym.temperature_variables(z), *laws])


def mending_kernels(system: System) -> tuple[Kernel, Kernel, Kernel, list[trace.Symbol]]:
    """(start, mend, hold, constants). mend, hold: (y, E0, S_floor, invariants; given) -> (y mended, S, margin).

    The second keeps the entropy at S_floor. given: the system's constant_values, then the constants of the list.
    margin: the least of temperatures, shapes and what the energy may miss less what it does; positive in a good state.
    """
    sym, n, size = system.symbolic, system.n_positions, system.size
    given = trace.variables("y", size + 2 + len(system.invariant_names))
    q, p, theta = given[:n], given[n : 2 * n], given[2 * n : size]
    energy, floor = given[size], given[size + 1]
    targets = dict(zip(system.invariant_names, given[size + 2 :], strict=True))
    p, free = restored_momenta(sym.state(np.concatenate([q, p, theta])), sym, targets)
    pi = sym.shape(q)
    inertia = sym.inertia()
    y, s = list(given[:size]), list(sym.entropies(q, theta))
    warmth = _simpler(y, list(sym.element_energy(pi, np.array(s, dtype=object))))
    heats = _simpler(y, [t * t * trace.jacobian([x], [t])[0, 0] for x, t in zip(s, theta, strict=True)])
    capacity = [trace.jacobian([x], [t])[0, 0] for x, t in zip(warmth, theta, strict=True)]
    linear = not set(theta) & set(trace.topological(capacity))

    def total(momenta: Any, warm: Any) -> Any:
        return sum(0.5 * momenta**2 / inertia) + sum(at(warmth, warm))

    def at(formulas: list[trace.Symbol], warm: Any) -> list[trace.Symbol]:
        return trace.substitute(formulas, dict(zip(theta, warm, strict=True)))

    warm = theta
    for _ in range(1 if linear else 2):  # Newton for the part by which all temperatures grow
        warm = warm * (1.0 + (energy - total(p, warm)) / sum(at(heats, warm)))

    def outputs(momenta: Any, warm: Any, s: Any) -> list[trace.Symbol]:
        allowed = ROUND_OFF * sum(heats) - abs(energy - total(momenta, warm))
        return [*q, *momenta, *warm, sum(s), reduce(trace.minimum, [*warm, *pi, allowed])]

    mended = outputs(p, warm, at([_total_entropy(y, 2 * n, s)], warm))

    s = np.array(s, dtype=object)
    s = s + (floor - sum(s)) / len(s)
    held = sym.temperatures(np.concatenate([q, p, s]))
    missing = energy - total(p, held)
    kinetic = sum(free * free / inertia) / 2
    least = SMALLEST_SHARE * (1.0 + abs(energy))
    x = trace.maximum(missing * kinetic / (kinetic * kinetic + least * least), trace.const(-1.0))
    held = outputs(p + lengthening(free, x), held, s)
    constants = constant_part([*mended, *held], list(given))
    places = {x: f"b[{system.n_constant_values + i}]" for i, x in enumerate(constants)}
    inputs = {x: f"a[{i}]" for i, x in enumerate(given)} | system.constant_symbols() | places
    return start_kernel(system), kernel(inputs, mended, size), kernel(inputs, held, size), constants


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
