"""Gauss collocation that keeps both laws, of any order 2k, for any `System`; compiled, without allocation.

Collocation at the Gauss nodes c_j for z, with two changes (the cut of E = F(y(z)), and of S, is in `formulas`): the y
are carried as polynomials of their own, and the slopes of F at a node are projections,

    z_j = z0 + h sum A_jl K_l                 y'_j = grad y(z_j) . K_j
    y(xi_g) = y0 + h sum Ahat_gl y'_l         F_j = sum_g W_jg F_y(y(xi_g))        DE_j = sum_y F_j grad y(z_j)
    K_j = reversible(z_j, DE_j, DS_j) + irreversible(z_j, DE_j, DS_j)              (xi_g: M further Gauss points)

Then sum b DE_j . K_j is the change of E, which vanishes node by node, as exactly as the M points integrate it, and that
of S is no less than 0; y(1) = y(z1), because y is at most quadratic and Gauss is exact on it; what is quadratic and
invariant under symmetries of the y stays.

Solved by simplified Newton in all K, with the Jacobian M of the rates at the start of a step: the correction dK of the
stages solves (I - hA x M) dK = K(K) - K, a Kronecker product, which in the eigenvectors of A falls apart into complex
(I - h w M) x = r, one for each pair of eigenvalues w. On vectors M is that of the variables which act back on
themselves (`vectors`), the others are iterated. Where that does not contract, the matrix of all variables is made, at
the mean of the stages. The iteration starts with few quadrature points and ends with as many as the energy needs.

Adaptive runs iterate to a residual that belongs to the tolerance; to go on to round-off would take up to three times as
many iterations. Laws miss by about the residual, and are mended: the state is moved by as little, to the values with
which the run began. Where that can't be done the iteration goes on to round-off, and nothing is missing.
"""

from __future__ import annotations

import math

import numpy as np

from tcbench.compiler.language import Floats, call, copy_into, fill, rare
from tcbench.solver.mending import mended

from .memory import LEVELS, ON_VECTORS, POINTS, Work
from .newton_matrix import prepare, renew, solve_stages

SOLVED, FAILED, COARSE = 0, 1, 2  # how a step ended; COARSE: the quadrature does not keep the energy
POINTS_0, POINTS_1, POINTS_2, POINTS_3 = POINTS
MAX_ITERATIONS = 60
CONVERGED = 1e-15  # scaled residual, beside which rounding is larger
STAGNATED = 2e-14  # below this a residual that no longer shrinks is round-off
ROUNDED = 4.0  # the same in residuals: where rates are stiff, round-off is about one (see `iterated`)
ROUGH = 1e-3  # residual down to which the coarsest quadrature will do
MENDED = 10.0  # residuals: by how much mending may move
FARTHEST = 0.1  # of its size, by how much a fixed step may leave its constraints
SLOW = 0.6  # contraction above which the iteration is given up
EPSILON = 2.0**-53
FINER = 0.25  # of what a mended energy may miss: what a quadrature may leave
STIFFLY = 3.0  # times that, by how much the energy of a stiff system may miss
POOR, POOR_DOWN_TO = 0.1, 1e-8  # contraction above which, and residual down to which, a large one's matrix is made anew
RENEWED = 5  # times that the matrix is, before


# the iteration --------------------------------------------------------------------------------------------------------


def points_of(level: int) -> int:
    """Points of a quadrature."""
    return POINTS_0 if level == 0 else POINTS_1 if level == 1 else POINTS_2 if level == 2 else POINTS_3


def begin_step(w: Work, h: float, z: Floats) -> None:
    """A step from z, of which `start` has the rates, weights and carried variables."""
    w.c[0] = h
    w.solve.whole = False
    if w.n_kinks > 0 and in_kink(w):
        for i in range(w.m):
            for j in range(w.k):
                w.U[i, j] = w.start[i]
        renew(w, h, z)
        return
    if w.n_lanes == 0:
        prepare(w, h, z)
        return
    copy_into(w.vectors, z)
    copy_into(w.weights, w.inverse_sizes)
    copy_into(w.carried, w.start_y)
    w.solve.stiff = True
    call(w.to_factor, w.start, w.c, w.factors)


@rare
def in_kink(w: Work) -> bool:
    """Does a step begin exactly where a rate may jump, so that its slope there is that of the jump?"""
    found, first = False, w.n_ends - w.n_kinks
    for i in range(first, first + w.n_kinks // 2):
        found = found or w.start[i] == 0.0
    return found


def guess(w: Work) -> None:
    """U = the rates at the start, at every node; of what is solved for 0: first comes a linearly implicit step."""
    for i in range(w.m):
        stiff = w.acts[i] > 0.0 if w.n_lanes > 0 else w.solve.stiff
        for j in range(w.k):
            w.U[i, j] = 0.0 if stiff else w.start[i]


def iterate(w: Work, h: float, z: Floats, level: int) -> float:
    """One iteration with a quadrature; the scaled size of the correction, not finite where U is out of range."""
    if w.n_lanes > 0 and not w.solve.whole:
        if level < ON_VECTORS:
            call(w.to_iterate if level == 0 else w.to_iterate_finer, w.vectors, w.c, w.found)
            return h * w.found[len(w.found) - 1]
        renew(w, h, z)
    rates(w, h, z, level)
    return corrected(w, h)


@rare
def rates(w: Work, h: float, z: Floats, level: int) -> None:
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
    points = points_of(level) if w.n_slopes > 0 else 0
    for g in range(points):
        for i in range(w.n_carried):
            total = 0.0
            for l in range(k):
                total += a.Ahats[level, g, l] * w.drift[l, i]
            w.at_points[g, i] = w.start_y[i] + h * total
        call(w.to_slopes, w.at_points[g], w.c, w.slopes[g])
    for j in range(k):
        for i in range(w.n_slopes):
            total = 0.0
            for g in range(points):
                total += a.Ws[level, j, g] * w.slopes[g, i]
            w.at_nodes[j, 2 * m + i] = total
        call(w.to_forces, w.at_nodes[j], w.c, w.forces)
        for i in range(m):
            w.N[i, j] = w.forces[i]


@rare
def corrected(w: Work, h: float) -> float:
    """U as the simplified Newton has it from N; returns the scaled size of the correction, NaN if it is."""
    size = 0.0
    for i in range(w.m):
        for j in range(w.k):
            w.before[i, j] = w.U[i, j]
            w.U[i, j] = w.N[i, j]
    if w.solve.stiff:
        solve_stages(w)
    for i in range(w.m):
        for j in range(w.k):
            r = abs(w.U[i, j] - w.before[i, j]) * w.inverse_sizes[i]
            size = r if r > size or r != r else size
    return h * size


def iterated(w: Work, h: float, z: Floats, level: int, residual: float) -> int:
    """Iterate from U, in place, until U and N agree to the residual. SOLVED or FAILED."""
    previous, slow, first, shrunk, since, renewed, here, taken = np.inf, 0, 0.0, 0.0, 0, 0, 0, 0
    w.solve.contraction = 0.0
    still = max(STAGNATED, ROUNDED * residual, ROUNDED * h * w.sparse.noise[0])  # what does not shrink is round-off
    for _ in range(MAX_ITERATIONS):
        w.counts.iterations += 1
        size = iterate(w, h, z, here)
        if not size < np.inf:
            return FAILED
        if here < level and size <= max(ROUGH, residual):
            here, since, taken, previous = level, 0, 0, np.inf
            continue
        since += 1
        if since == 1:
            first = size
        elif size > STAGNATED:
            shrunk, taken = size, since - 1
        # with factors what is left at the end may weigh more in stiff parts than its size tells
        stiffly = w.large and w.solve.stiff
        done = size <= residual and not (stiffly and residual <= CONVERGED and size < 0.25 * previous)
        if done or (size <= still and size > 0.5 * previous):
            if taken > 0:  # the contraction, for the choice of the next step
                w.solve.contraction = (shrunk / first) ** (1.0 / taken)
            return SOLVED
        slow = slow + 1 if size > SLOW * previous else 0
        poor = stiffly and since > 1 and size > max(POOR * previous, POOR_DOWN_TO)
        # a shorter step on vectors costs less than the loops of a long one, which is taken where its length is fixed
        if (slow >= 2 or poor) and renewed < RENEWED and (w.n_lanes == 0 or residual <= CONVERGED):
            renew(w, h, z)
            renewed, slow = renewed + 1, 0
        if slow >= 2 or w.counts.iterations > w.budget.limit:
            return FAILED
        previous = size
    return FAILED


def extrapolate(w: Work, ratio: float) -> None:
    """U = the last step's polynomials N at this step's nodes, `ratio` = this step over the last (barycentric form)."""
    a, k, m = w.numbers, w.k, w.m
    if w.n_lanes > 0:
        w.ratio[0] = ratio
        call(w.to_extrapolate, w.ratio, w.c, w.found)
        return
    for j in range(k):
        x = 1.0 + ratio * a.nodes[j]
        total = 0.0
        for i in range(m):
            w.U[i, j] = 0.0
        for l in range(k):
            weight = a.barycentric[l] / (x - a.nodes[l])
            total += weight
            for i in range(m):
                w.U[i, j] += weight * w.N[i, l]
        for i in range(m):
            w.U[i, j] /= total


def take_corrected(w: Work) -> None:
    """N = U of what is solved for. The rates N of an iterate that is not at round-off yet are off by its error times
    the stiffness, which would leave the end of the step off the slow manifold."""
    for i in range(w.m):
        if w.n_lanes == 0 or w.solve.whole or w.acts[i] > 0.0:
            for j in range(w.k):
                w.N[i, j] = w.U[i, j]


def close(w: Work, h: float) -> None:
    """dz of the step, and its polynomials of the rates at both ends, into `sums`."""
    a, k, m = w.numbers, w.k, w.m
    if w.n_lanes > 0:
        call(w.to_close, w.rates, w.c, w.sums)
        return
    fill(w.sums, 0.0)
    for j in range(k):
        for i in range(m):
            w.sums[i] += h * a.b[j] * w.N[i, j]
            w.sums[m + i] += a.at_start[j] * w.N[i, j]
            w.sums[2 * m + i] += a.at_end[j] * w.N[i, j]


# a step ---------------------------------------------------------------------------------------------------------------


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


def noise_of(w: Work, z: Floats, miss: float) -> float:
    """The round-off of the energy at z, or a bound below it that the miss does not reach."""
    least = EPSILON * (w.least_energy + abs(w.end_energy[0]))
    if miss <= least:
        return least
    call(w.to_laws, z, w.c, w.now)
    return FINER * w.now_miss[0]


def try_step(w: Work, h: float, z: Floats, known: bool, coarsest: int, residual: float) -> int:
    """One step of length h from z, which has begun: dz; `end` is what the first kernel gives at z + dz.

    known: U is a guess. When the energy of a converged step is not kept to round-off, or mending would change more than
    the residual, the quadrature was too coarse for this step: finer ones follow, from `coarsest`, and then convergence,
    before it is COARSE. A step to round-off has all quadratures. A fixed step leaves constraints by its error, and is
    mended by that.
    """
    levels = LEVELS if residual <= CONVERGED else ON_VECTORS
    if not known:
        guess(w)
    level, before = coarsest, np.inf
    while True:
        w.solve.level = level
        if iterated(w, h, z, level, residual) != SOLVED:
            return FAILED
        if residual > CONVERGED and w.solve.stiff:
            take_corrected(w)
        close(w, h)
        for i in range(w.m):
            w.dz[i] = w.sums[i]
            w.z1[i] = z[i] + w.dz[i]
        if w.solve.leaves:
            return SOLVED if mend(w, FARTHEST) else FAILED
        if residual > CONVERGED and mend(w, MENDED * residual):
            return SOLVED
        call(w.to_start, w.z1, w.c, w.end)
        if not abs(w.end_energy[0]) < np.inf:
            return FAILED
        miss = abs(w.end_energy[0] - w.start_energy[0])
        noise = noise_of(w, w.z1, miss)
        if residual > CONVERGED:
            # what earlier steps left behind, as where masses nearly collide, is mended whatever its size
            if miss <= noise and mend(w, math.inf):
                return SOLVED
        else:
            noise = min(noise, noise_of(w, z, miss))  # where a step begins at a steep slope much would be
            if miss <= noise or (miss > 0.5 * before and miss <= STIFFLY * noise):
                return SOLVED  # what a finer quadrature leaves is round-off in what is stiff
        before = miss
        if level + 1 < levels:
            level += 1
            w.counts.raised += 1
        elif residual > CONVERGED:
            residual = CONVERGED
        else:
            return COARSE
