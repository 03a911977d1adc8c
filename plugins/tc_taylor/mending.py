"""What a Taylor step leaves of the laws is mended: momenta are turned back, missing energy becomes heat.

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

ROUND_OFF = 4e-15  # of the heat: what the energy of a mended state may miss
SMALLEST_SHARE = 1e-12  # of the energy, as kinetic energy free to change: below it nothing is taken from there


def mending_kernels(system: System) -> tuple[Kernel, Kernel, list[trace.Symbol]]:
    """(mend, hold, constants): (y, E0, S_floor, invariants; given) -> (y mended, S, margin).

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

    def total(momenta: Any, warm: Any) -> Any:
        return sum(0.5 * momenta**2 / inertia) + sum(sym.element_energy(pi, sym.entropies(q, warm)))

    s = list(sym.entropies(q, theta))
    slopes = [trace.jacobian([s[i]], [theta[i]])[0, 0] for i in range(len(s))]
    warm = theta
    for _ in range(2):  # Newton for the part by which all temperatures grow: exact at once where heat is linear in them
        heat = sum(t * t * x for t, x in zip(warm, slopes, strict=True))
        warm = warm * (1.0 + (energy - total(p, warm)) / heat)

    def outputs(momenta: Any, warm: Any, s: Any) -> list[trace.Symbol]:
        allowed = ROUND_OFF * sum(t * t * x for t, x in zip(theta, slopes, strict=True)) - abs(
            energy - total(momenta, warm)
        )
        return [*q, *momenta, *warm, sum(s), reduce(trace.minimum, [*warm, *pi, allowed])]

    mended = outputs(p, warm, sym.entropies(q, warm))

    s = np.array(s, dtype=object)
    s = s + (floor - sum(s)) / len(s)
    held = sym.temperatures(np.concatenate([q, p, s]))
    missing = energy - total(p, held)
    kinetic = sum(free * free / inertia) / 2
    least = SMALLEST_SHARE * (1.0 + abs(energy))
    x = trace.maximum(missing * kinetic / (kinetic * kinetic + least * least), trace.const(-1.0))
    held = outputs(p + lengthening(free, x), held, s)
    constants = constant_part([*mended, *held], list(given))
    places = {x: f"b[{len(system.constant_values) + i}]" for i, x in enumerate(constants)}
    inputs = {x: f"a[{i}]" for i, x in enumerate(given)} | system.constant_symbols() | places
    return kernel(inputs, mended), kernel(inputs, held), constants
