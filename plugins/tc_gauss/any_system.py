"""The step of `step` on any system: its formulas from the cut of the graphs of energy and entropy, and their iteration.

E = F(y(z)) with y at most quadratic, which are carried as polynomials of their own; so is S. At the nodes

    z_j = z0 + h sum A_jl K_l                 y'_j = grad y(z_j) . K_j
    y(xi_g) = y0 + h sum Ahat_gl y'_l         F_j = sum_g W_jg F_y(y(xi_g))        DE_j = sum_y F_j grad y(z_j)
    K_j = reversible(z_j, DE_j, DS_j) + irreversible(z_j, DE_j, DS_j)

Then sum b DE_j . K_j is the change of E, which vanishes node by node, and that of S is no less than 0; what is
quadratic and invariant under symmetries of the y stays. Slopes that are constant, as of a kinetic energy, are not
projected, and y on which none depends are not carried.

Springs are the special case y = (pi, s). They have formulas of their own in `step`, which eliminate the positions: here
Newton's matrix of all variables doubles the time, and a fixed step of a small network takes 15 to 18 times as long.
That is no need of the formulas. With positions found in the graph (variables whose rates depend on none of them and on
no projected slope) and the matrix of those others alone that act back on themselves, they take as many instructions a
fixed step as those of springs, and stiff_spring 0.7 times the time. What keeps the springs' own: where a long step is
begun anew with the matrix of all variables, round-off chose between the whole step and halves in 4 of 150 random steps
(1 with theirs), so that a step did not commute with rotations; and adaptive runs took 1.05 to 1.4 times as long.

Solved by simplified Newton in all K with the Jacobian of the vector field, through the eigenvectors of A: `conduction`
with all variables in the place of the entropies.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from tcbench.compiler import derivatives as trace
from tcbench.compiler.array_states import entries, refilled
from tcbench.compiler.arrays import variable
from tcbench.compiler.cut import Cut
from tcbench.compiler.derivatives import Symbol, lifted
from tcbench.compiler.kernels import Kernel
from tcbench.compiler.language import Floats, call, copy_into, rare
from tcbench.compiler.once import once
from tcbench.compiler.round_off import round_off
from tcbench.solver.mending import mended, mending_kernels
from tcbench.systems.constrained import reduced
from tcbench.systems.system import System

from . import conduction
from .formulas import ON_VECTORS, Formulas, kinks_of
from .memory import Work

SOLVED, FAILED = 0, 1  # how a step ended
EPSILON = 2.0**-53  # of what the terms of the energy are: its round-off, and what a quadrature may leave


@once
def any_formulas(symbolic: System) -> tuple[Formulas, list[Kernel]]:
    """Those of all systems of one structure, by their `System.symbolic`: start, motion, slopes, forces, the Jacobian;
    and of the mending start, mend, hold."""
    with trace.tracing() as table:
        *mending, fixed = mending_kernels(symbolic)
        z, K = (symbolic.state(trace.variables(name, symbolic.size)) for name in "zK")
        parts = parts_of(symbolic, z, K)
        y, start, motion, slopes, means = lists_of(parts)
        forces, rate = rates_of(symbolic, z, parts), list(map(lifted, symbolic.vector_field(z)))
        kinks = kinks_of(rate, [*z])
        bodies: list[tuple[list[Any], list[Any]]] = [
            ([*z], [*entries(*started(symbolic, z)), *start, *kinks]),
            ([*K, *z], motion),
            (y, slopes),
            ([*K, *z, *means], list(forces)),
        ]
        made = Formulas.of(symbolic, bodies, table, trace.jacobian(rate, list(z)), fixed)
        return made._replace(n_kinks=len(kinks)), mending


def parts_of(system: Any, z: Any, K: Any) -> list[Part]:
    """Of the energy and of the entropy at a state with these rates: of numbers, or of arrays."""
    return [Part(system.cut(name), entries(z), entries(K)) for name in ("energy", "entropy")]


def lists_of(parts: Sequence[Part]) -> Iterator[list[Any]]:
    """y, start, motion, slopes and means of both."""
    names = ("y", "start", "motion", "slopes", "means")
    return ([x for part in parts for x in getattr(part, name)] for name in names)


def rates_of(system: Any, z: Any, parts: Sequence[Part]) -> Any:
    """Of the state at a node, with the projected gradients."""
    gradients = [system.state(refilled(z, part.gradient)) for part in parts]
    if system.multipliers:
        return reduced(system, z, *gradients)
    return system.reversible(z, *gradients) + system.irreversible(z, *gradients)


def started(system: Any, z: Any) -> list[Any]:
    """What a state begins with: rates, 1/sizes, the energy and what it may miss."""
    energy, least = lifted(system.energy(z)), system.least_of(z)
    noise = EPSILON * (system.least_energy + round_off(energy, entries(z), entries(least)))
    return [system.vector_field(z), 1.0 / (least + abs(z)), energy, noise]


class Part:
    """The energy or the entropy: y, start (y of z), motion (their rates), slopes of F that vary, means (symbols for
    these at a node) and the gradient there."""

    def __init__(self, cut: Cut, z: Sequence[Symbol], K: Sequence[Symbol]) -> None:
        varies = [bool(trace.depends_on([slope], cut.y)) and slope.op != "const" for slope in cut.slopes]
        self.slopes = [slope for slope, v in zip(cut.slopes, varies, strict=True) if v]
        needed = set(trace.topological(self.slopes))
        carried = [i for i, y in enumerate(cut.y) if y in needed]
        self.y = [cut.y[i] for i in carried]
        values, moved = cut.values(z), cut.moved(z, K)
        self.start, self.motion = ([x[i] for i in carried] for x in (values, moved))
        self.means: list[Symbol] = [variable("mean", slope.space) for slope in self.slopes]
        means = iter(self.means)
        self.gradient = cut.joined([next(means) if v else s for s, v in zip(cut.slopes, varies, strict=True)], z)


def begin(w: Work, z: Floats) -> None:
    """A step from z, whose energy, weights and carried variables `start` has."""
    copy_into(w.x0, w.start_y)
    if w.n_lanes > 0:
        copy_into(w.vectors, z)
        copy_into(w.weights, w.inverse_sizes)
        copy_into(w.carried, w.x0)


def iterate(w: Work, h: float, z: Floats, points: int, level: int) -> float:
    """One iteration; the scaled size of the correction, NaN if it is."""
    if w.n_lanes > 0 and w.stiff[2] > 0.0 and level < ON_VECTORS:
        call(w.to_iterate if level == 0 else w.to_iterate_finer, w.vectors, w.c, w.found)
        return h * w.found[len(w.found) - 1]
    rates(w, h, z, points, level)
    return corrected(w, h)


@rare
def rates(w: Work, h: float, z: Floats, points: int, level: int) -> None:
    """N, the rates that the equations give for those in U."""
    a, k, m = w.numbers, w.k, w.m
    for i in range(m):
        for j in range(k):
            total = 0.0
            for l in range(k):
                total += a.A[j, l] * w.U[i, l]
            w.at_nodes[j, i] = w.U[i, j]
            w.at_nodes[j, m + i] = z[i] + h * total
    for j in range(k):
        call(w.to_motion, w.at_nodes[j], w.c, w.drift[j])
    projected(w, h, points, level)


@rare
def projected(w: Work, h: float, points: int, level: int) -> int:
    """N from what is known at the nodes: with the slopes at the points of a quadrature, projected. FAILED if what has
    to be positive there is not."""
    a, k = w.numbers, w.k
    first, some = w.n_nodes - w.n_slopes, w.n_slopes - w.n_positive
    for g in range(points if w.n_slopes > 0 else 0):
        for i in range(w.n_carried):
            total = 0.0
            for l in range(k):
                total += a.Ahats[level, g, l] * w.drift[l, i]
            w.at_points[g, i] = w.x0[i] + h * total
        for i in range(w.n_positive):
            if not w.at_points[g, i] > 0.0:
                return FAILED
        call(w.to_slopes, w.at_points[g], w.c, w.slopes[g])
    for j in range(k):
        for i in range(w.n_slopes):
            total = 0.0
            for g in range(points):
                total += a.Ws[level, j, g] * w.slopes[g, i]
            w.at_nodes[j, first + i] = total
            if i >= some and not total > 0.0:
                return FAILED
        call(w.to_forces, w.at_nodes[j], w.c, w.FG)
        for i in range(w.m):
            w.N[i, j] = w.FG[i]
    return SOLVED


@rare
def corrected(w: Work, h: float) -> float:
    """U as the simplified Newton has it from N; returns the scaled size of the correction, NaN if it is."""
    conduction.keep(w)
    if w.stiff[2] > 0.0:
        if w.n_lanes > 0 and w.stiff[3] == 0.0:
            conduction.factor_pairs(w, h)
            w.stiff[3] = 1.0
        conduction.correct(w)
    size = 0.0
    for i in range(w.m):
        for j in range(w.k):
            if not w.stiff[2] > 0.0:
                w.U[i, j] = w.N[i, j]
            r = abs(w.U[i, j] - w.before[i, j]) * w.inverse_sizes[i]
            size = r if r > size or r != r else size
    return h * size


@rare
def renew(w: Work, h: float, z: Floats) -> None:
    """The matrix anew, at the mean of the stages as they are by now."""
    for i in range(w.m):
        total = 0.0
        for j in range(w.k):
            for l in range(w.k):
                total += w.numbers.A[j, l] * w.U[i, l]
        w.z1[i] = z[i] + h * total / w.k
    if not w.large:
        conduction.prepare(w, h, w.z1)
        return
    call(w.to_matrix, w.z1, w.c, w.sparse.values)  # of a large system whether or not it seemed stiff
    w.stiff[2] = 1.0
    conduction.factor_pairs(w, h)


@rare
def mend(w: Work, limit: float) -> bool:
    """The end of the step on the laws of the run; False, and nothing is done, if that moves it by more than the limit,
    or none is near."""
    m, least = w.m, w.least_entropy[0]
    for i in range(m):
        w.laws[i] = w.z1[i]
    good = mended(w.to_mend, w.to_hold, w.laws, w.c, w.mended)
    for i in range(m):
        good = good and abs(w.laws[i] - w.z1[i]) * w.inverse_sizes[i] <= limit
    if not good:
        w.least_entropy[0] = least
        return False
    for i in range(m):
        w.dz[i] += w.laws[i] - w.z1[i]  # with the digits of a small one
        w.z1[i] = w.laws[i]
    call(w.to_start, w.z1, w.c, w.end)
    return True
