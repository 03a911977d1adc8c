"""The equations of consistent collocation on any system, as formulas from the cut of the graphs of energy and entropy.

E = F(y(z)) with y at most quadratic, which are carried as polynomials of their own; so is S. At the nodes

    z_j = z0 + h sum A_jl K_l                 y'_j = grad y(z_j) . K_j
    y(xi_g) = y0 + h sum Ahat_gl y'_l         F_j = sum_g W_jg F_y(y(xi_g))        DE_j = sum_y F_j grad y(z_j)
    K_j = reversible(z_j, DE_j, DS_j) + irreversible(z_j, DE_j, DS_j)

Then sum b DE_j . K_j is the change of E, which vanishes node by node, and that of S is no less than 0; what is
quadratic and invariant under symmetries of the y stays. Slopes that are constant, as of a kinetic energy, are not
projected, and y on which none depends are not carried.

Of springs these are stresses and temperatures, and the y are strain measures and entropies. Springs had formulas of
their own, which eliminated the positions and solved for the conduction alone; both is found in the graph:

- *positions* are variables whose rates depend on none of them and on no projected slope, as dq/dt = p/m. Their rates
  at the nodes follow from those of the others, which alone are unknown, and change them within the iteration;
- the *block* are those of the others that act back on themselves but for positions, as temperatures conduct: the
  matrix of an iteration is theirs. What is left contracts as the square of the step. Where positions follow the block,
  as with friction, that would not be so; there, and where there are no positions, all variables are the block.

Springs so take nearly the time that they took with formulas of their own: adaptive runs 1.06 times as long in the mean.
See `step`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import reduce
from typing import Any

import numpy as np

from tcbench.compiler import derivatives as trace
from tcbench.compiler.array_states import entries, refilled
from tcbench.compiler.arrays import total, variable
from tcbench.compiler.cut import Cut
from tcbench.compiler.derivatives import Symbol, lifted
from tcbench.compiler.kernels import Kernel
from tcbench.compiler.once import once
from tcbench.errors import TcbenchError
from tcbench.solver.mending import by_variable, mending_kernels, round_off
from tcbench.systems.momenta import lengthening, restored_momenta
from tcbench.systems.system import System

from .formulas import Formulas

MOST = 0.1  # of the kinetic energy that is free to change: what mending may move
EPSILON = 2.0**-53  # of what the terms of the energy are: its round-off, and what a quadrature may leave


@once
def any_formulas(symbolic: System) -> tuple[Formulas, list[Kernel]]:
    """Those of all systems of one structure, by their `System.symbolic`: start, motion, slopes, forces, positions, the
    Jacobian of all, the round-off of the energy, the move of momenta; and of the mending start, mend, hold."""
    with trace.tracing() as table:
        *mending, fixed = mending_kernels(symbolic)
        z, K = (symbolic.state(trace.variables(name, symbolic.size)) for name in "zK")
        parts = parts_of(symbolic, z, K)
        y, start, motion, slopes, means = (
            [x for part in parts for x in getattr(part, name)] for name in ("y", "start", "motion", "slopes", "means")
        )
        rates, others = [lifted(x) for x in rates_of(symbolic, z, parts)], list(z)
        jacobian = trace.jacobian([lifted(x) for x in symbolic.vector_field(z)], others)
        there = np.array([[not trace.is_const(x, 0.0) for x in row] for row in jacobian], bool)
        positions = positions_of(rates, others, means)
        rest = [i for i in range(len(rates)) if i not in positions]
        block = [rest[i] for i in cycles(there[np.ix_(rest, rest)])]
        if not positions or there[np.ix_(positions, block)].any():
            positions, rest, block = [], [], list(range(len(rates)))
        rest = [*(i for i in rest if i not in block), *block]
        order = [*positions, *rest]
        at_nodes = [*(K[i] for i in order), *(z[i] for i in order)]
        field_at, _, *energy = started(symbolic, z)
        sizes = by_variable(symbolic, z, z)  # as arrays, which turn with the axes
        ends = [symbolic.layout[name][:2] for name in symbolic.variables]
        counts = [b - a for a, b in ends for _ in range(a, b)]
        weights = [c**-0.5 / (1.0 + (lifted(x) / c).sqrt()) for x, c in zip(sizes, counts, strict=True)]
        of = [i for i, (a, b) in enumerate(ends) for _ in range(a, b)]
        patterns = [there[np.ix_(x, x)] for x in (block, order)]
        of_block, of_all = (
            [-x for x in jacobian[np.ix_(x, x)][p]] for x, p in zip((block, order), patterns, strict=True)
        )
        first = [*(field_at[i] for i in rest), *(weights[i] for i in rest), *energy, *start, *of_block]
        first.append(bound_of(patterns[0], of_block))
        bodies: list[tuple[list[Any], list[Any]]] = [
            (others, first),
            (at_nodes, motion),
            (y, slopes),
            ([*at_nodes, *means], [rates[i] for i in rest]),
            (at_nodes, [rates[i] for i in positions]),
            (others, of_all),
            (others, [noise_of(symbolic, z)]),
            moved(symbolic, z),
        ]
        split = order, len(positions), len(block), [of[i] for i in rest]
        return Formulas.of(symbolic, bodies, table, fixed, patterns, split), mending


def positions_of(rates: Sequence[Symbol], z: Sequence[Symbol], means: Sequence[Symbol]) -> list[int]:
    """Of the variables those, the first that are found, whose rates depend on none of them and on no mean."""
    found: list[int] = []
    sees = [set(trace.topological([rate])) for rate in rates]
    for i, seen in enumerate(sees):
        free = not seen.intersection([*means, z[i]])
        if free and not any(z[j] in seen or z[i] in sees[j] for j in found):
            found.append(i)
    return found


def cycles(there: Any) -> list[int]:
    """Which variables act back on themselves, by the entries of a matrix."""
    reached = there
    for _ in range(len(there).bit_length()):
        reached = reached | (reached @ reached)
    return np.flatnonzero(np.diag(reached)).tolist()


def bound_of(pattern: Any, values: Sequence[Symbol]) -> Any:
    """Of the rates of a matrix with these values: the largest sum of a column's sizes."""
    sums: dict[int, Any] = {}
    for j, x in zip(np.nonzero(pattern)[1].tolist(), values, strict=True):
        sums[j] = sums.get(j, lifted(0.0)) + abs(x)
    return reduce(trace.maximum, sums.values(), lifted(0.0))


def parts_of(system: Any, z: Any, K: Any) -> list[Part]:
    """Of the energy and of the entropy at a state with these rates: of numbers, or of arrays."""
    return [Part(system.cut(name), entries(z), entries(K)) for name in ("energy", "entropy")]


def rates_of(system: Any, z: Any, parts: Sequence[Part]) -> Any:
    """Of the state at a node, with the projected gradients."""
    gradients = [system.state(refilled(z, part.gradient)) for part in parts]
    return system.reversible(z, *gradients) + system.irreversible(z, *gradients)


def started(system: Any, z: Any) -> list[Any]:
    """What a state begins with: rates, 1/sizes, the energy, NaN where a temperature or a measure is negative, and what
    it may miss at least: a part of `noise_of`."""
    energy = lifted(system.energy(z))
    least = EPSILON * (1.0 + 2.0 * abs(energy) + lifted(abs(system.gradient(z) * z).sum()))
    positive = [lifted(x) for x in entries(system.temperatures(z), system.shapes(z))]
    if positive:
        energy = trace.guarded(energy, [reduce(trace.minimum, (total("min", x, x.space) for x in positive)).sqrt()])
    return [system.vector_field(z), 1.0 / (1.0 + abs(z)), energy, least]


def moved(system: Any, z: Any) -> tuple[list[Any], list[Any]]:
    """Of elements the move of momenta that makes up for what the energy misses, which stands after the state, and gives
    it these invariants; of others nothing."""
    told = list(trace.variables("law", 4 + 2 * len(system.invariant_names)))
    return [*z, *told], by_momenta(system, z, told[0], told[4::2]) if system.defines("element_energy") else []


def by_momenta(system: Any, z: Any, missing: Symbol, wanted: Sequence[Symbol]) -> list[Any]:
    """A move of the momenta of elements that makes up for what energy and invariants miss: entropies stay."""
    try:
        p, free = restored_momenta(z, system, dict(zip(system.invariant_names, wanted, strict=True)))
    except TcbenchError:  # not linear in the momenta
        return [math.inf] * len(z.p)  # where no state is
    turned = p - z.p
    missing = missing - sum(turned * (turned + 2.0 * z.p) / system.inertia()) / 2
    x = missing / (sum(free * free / system.inertia()) / 2)
    x = x + 0.0 * (MOST * MOST - x * x).sqrt()  # NaN, and no state is near, where it would be much of what is free
    return list(turned + lengthening(free, x))


def noise_of(system: Any, z: Any) -> Symbol:
    """Of the energy: what it may miss."""
    return EPSILON * (1.0 + round_off(lifted(system.energy(z)), entries(z)))


class Part:
    """The energy or the entropy: y, start (y of z), motion (their rates), slopes of F that vary, means (symbols for
    these at a node) and the gradient there."""

    def __init__(self, cut: Cut, z: Sequence[Symbol], K: Sequence[Symbol]) -> None:
        varies = [bool(trace.depends_on([slope], cut.y)) and slope.op != "const" for slope in cut.slopes]
        self.slopes = [slope for slope, v in zip(cut.slopes, varies, strict=True) if v]
        needed = set(trace.topological(self.slopes))
        carried = [i for i, y in enumerate(cut.y) if y in needed]
        self.y = [cut.y[i] for i in carried]
        values, rows = cut.values(z), cut.gradients(z)
        moved = cut.moved(rows, K)
        self.start, self.motion = ([x[i] for i in carried] for x in (values, moved))
        self.means: list[Symbol] = [variable("mean", slope.space) for slope in self.slopes]
        means = iter(self.means)
        self.gradient = cut.joined([next(means) if v else s for s, v in zip(cut.slopes, varies, strict=True)], rows)
