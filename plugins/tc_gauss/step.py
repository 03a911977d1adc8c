"""A step of consistent collocation, of any order 2k, for any `System` (any_system.py); compiled, without allocation.

The unknowns U are the rates of all variables but the positions at the nodes. An iteration gives positions the rates
that follow, then N, the rates that the equations give for all the others, and solves for the block with its part of
the Jacobian, where that is stiff; the rest is a fixed point, whose contraction goes as the square of a step. Where it
does not contract, simplified Newton with the Jacobian of all variables begins the step anew. The iteration starts with
few quadrature points and ends with as many as the energy needs.

Adaptive runs iterate to a residual that belongs to the tolerance; to go on to round-off would take up to three times as
many iterations. Energy and invariants miss by about the residual, and the entropy may: the state is mended, to the
values with which the run began (solver.mending). Where that moves it by more than belongs to the residual, the
iteration goes on to round-off, and nothing is missing.
"""

from __future__ import annotations

import math

import numpy as np

from tcbench.compiler.language import Floats, Matrix, call, copy_into, fill, rare
from tcbench.solver.mending import mended

from . import stiffness
from .memory import LEVELS, POINTS, Work

SOLVED, FAILED, COARSE = 0, 1, 2  # how a step ended; COARSE: the quadrature does not keep the energy
ON_VECTORS = 2  # quadratures: steps that need more are too long for the iteration
POINTS_0, POINTS_1, POINTS_2, POINTS_3 = POINTS
MAX_ITERATIONS = 60
CONVERGED = 2e-15  # scaled residual, beside which rounding is larger
STAGNATED = 2e-14  # below this a residual that no longer shrinks is round-off,
RESTS = 1e-12  # and below this one that does not twice
ROUNDED = 4.0  # the same in residuals: where dissipation is stiff, round-off is about one (see `fixed_point`)
LAST = 1e-2  # contraction from which on a correction of some residuals leaves nothing for the next
MILD = 1e3  # decay times in a step up to which corrections shrink so evenly that the next one can be told
ROUGH = 1e-3  # residual down to which the coarsest quadrature will do
MENDED = 10.0  # residuals: by how much mending may move a state
FAR = 0.1  # of its size, by how much the rates at the start may move the block
SLOW = 0.6  # contraction above which a residual does not shrink,
RATE = 0.5  # and the least in the mean of all since the second correction: see `fixed_point`
STIFFLY = 6.0  # times its round-off, by how much the energy may miss where nothing finer is left to do
CLEARLY = 100.0  # times the round-off of the energy at the start of a run: no round-off that a state has
POOR, POOR_DOWN_TO = 0.1, 1e-8  # contraction above which, and residual down to which, a large one's matrix is made anew
RENEWED = 5  # times that the matrix is, of any system, before


def points_of(level: int) -> int:
    """Points of a quadrature."""
    return POINTS_0 if level == 0 else POINTS_1 if level == 1 else POINTS_2 if level == 2 else POINTS_3


def begin(w: Work, h: float, z: Floats) -> None:
    """A step from z, whose energy, weights and carried variables `start` has."""
    w.c[0] = h
    copy_into(w.begun, z)
    if w.to_whole != 0 and h >= w.whole_from[0]:
        stiffness.prepare_whole(w, h, z)
    else:
        stiffness.prepare(w, h, z)


def iterate(w: Work, h: float, z: Floats, level: int) -> float:
    """One iteration with a quadrature; the scaled size of the correction, NaN where U is out of the formulas' range."""
    kernel = w.to_iterate if level == 0 else w.to_iterate_finer if level == 1 else 0
    if kernel != 0 and w.stiff[4] == 0.0 and (w.n_lanes > 0 or w.stiff[2] == 0.0):
        call(kernel, w.vectors, w.c, w.found)
        return h * math.sqrt(w.found[len(w.found) - 1])
    stiffness.keep(w)
    if kernel != 0:
        call(kernel, w.vectors, w.c, w.found)
    elif rates(w, h, z, points_of(level), level) != SOLVED:
        return np.nan
    return corrected(w, h)


@rare
def rates(w: Work, h: float, z: Floats, points: int, level: int) -> int:
    """N, the rates that the equations give for those in U."""
    a, k, n, m, size = w.numbers, w.k, w.n, w.m, w.size
    for j in range(k):
        here = w.at_nodes[j]
        for i in range(m):
            total = 0.0
            for l in range(k):
                total += a.A[j, l] * w.U[i, l]
            here[n + i] = w.U[i, j]
            here[size + n + i] = z[w.order[n + i]] + h * total
        if n > 0:
            call(w.to_positions, here, w.c, w.FG)
        for i in range(n):
            w.V[i, j] = here[i] = w.FG[i]
    for j in range(k):
        here = w.at_nodes[j]
        for i in range(n):
            total = 0.0
            for l in range(k):
                total += a.A[j, l] * w.V[i, l]
            here[size + i] = z[w.order[i]] + h * total
        call(w.to_motion, here, w.c, w.drift[j])
    projected(w, h, points, level)
    return SOLVED


@rare
def projected(w: Work, h: float, points: int, level: int) -> None:
    """N from what is known at the nodes: with the slopes at the points of a quadrature, projected."""
    a, k, first = w.numbers, w.k, w.n_nodes - w.n_slopes
    for g in range(points if w.n_slopes > 0 else 0):
        for i in range(w.n_carried):
            total = 0.0
            for l in range(k):
                total += a.Ahats[level, g, l] * w.drift[l, i]
            w.at_points[g, i] = w.x0[i] + h * total
        call(w.to_slopes, w.at_points[g], w.c, w.slopes[g])
    for j in range(k):
        for i in range(w.n_slopes):
            total = 0.0
            for g in range(points):
                total += a.Ws[level, j, g] * w.slopes[g, i]
            w.at_nodes[j, first + i] = total
        call(w.to_forces, w.at_nodes[j], w.c, w.FG)
        for i in range(w.m):
            w.N[i, j] = w.FG[i]


@rare
def corrected(w: Work, h: float) -> float:
    """U from N and what it was; returns the scaled size of the correction, NaN if it is."""
    block = w.m - w.n_block
    for i in range(w.m):
        for j in range(w.k):
            w.U[i, j] = w.N[i, j]
    if w.stiff[4] > 0.0:
        stiffness.correct(w, w.whole, -w.n)
    elif w.stiff[2] > 0.0:
        if w.n_lanes > 0 and w.stiff[3] < 1.0:
            if w.stiff[3] == 0.0:
                copy_into(w.sparse.values, w.entries)
            stiffness.factor(w, w.sparse, h)
            w.stiff[3] = 1.0
        stiffness.correct(w, w.sparse, block)
    return h * math.sqrt(max(changed(w, w.U), w.share[0] * w.share[0] * changed(w, w.N)))


def changed(w: Work, rates: Matrix) -> float:
    """The square of the scaled size of what they differ by from U before the iteration, NaN if it is."""
    size = 0.0
    for j in range(w.k):
        total = 0.0
        for i in range(w.m):
            total += ((rates[i, j] - w.before[i, j]) * w.start[w.m + i]) ** 2
            if w.ends[i] > 0:
                size = total if total > size or total != total else size
                total = 0.0
    return size


@rare
def renew(w: Work, h: float, z: Floats) -> None:
    """The matrix anew: that of all variables at the start, and the iteration from there, or, where the block is all
    there are, at the mean of the stages as they are by now."""
    if w.to_whole != 0:
        stiffness.prepare_whole(w, h, z)
        guess(w, h)
        return
    copy_into(w.z1, z)
    for i in range(w.m):
        total = 0.0
        for j in range(w.k):
            for l in range(w.k):
                total += w.numbers.A[j, l] * w.U[i, l]
        w.z1[w.order[w.n + i]] += h * total / w.k
    stiffness.prepare_anew(w, h, w.z1)


def fixed_point(w: Work, h: float, z: Floats, level: int, residual: float) -> int:
    """Iterate from U, in place, until U and N agree to the residual. SOLVED or FAILED.

    An iteration that wanders magnifies round-off, by which it would be chance whether it ends at a solution, and at
    which: from the start corrections halve in the mean, or the matrix is made anew, or the step has no solution in
    reach.
    """
    previous, due, first, shrunk, since, renewed, here, taken, slow = np.inf, 0.0, 0.0, 0.0, 0, 0, 0, 0, 0
    loosely, mild, most, before = residual > CONVERGED, False, RENEWED, 0.0
    w.seen[0], w.share[0] = 0.0, 0.0
    if loosely and not w.large:
        # of stiff parts the end of an adaptive step has N, and what it misses is not damped later; its round-off is
        # theirs, times the step over their decay time
        decays = h * w.entries[len(w.entries) - 1]
        w.share[0], mild = min(1.0, residual / CONVERGED / (1.0 + decays)), decays <= MILD
        if w.to_iterate != 0 and w.to_whole != 0:
            most = 0  # the whole matrix is not on vectors: two shorter steps cost less
    still = max(STAGNATED, ROUNDED * residual, ROUNDED * h * w.sparse.noise[0])  # what does not shrink is round-off
    rough, told = max(ROUGH, residual), residual if mild else 0.0
    for _ in range(MAX_ITERATIONS):
        w.counts.iterations += 1
        size = iterate(w, h, z, here)
        if here < level and size <= rough:
            here, since, taken, previous, before = level, 0, 0, np.inf, 0.0
            continue
        since += 1
        if since == 1:
            first = size
        elif size > STAGNATED:
            shrunk, taken = size, since - 1
        due = max(first, size) if since <= 2 else RATE * due
        slow = slow + 1 if size > SLOW * previous else 0
        # with factors what is left at the end may weigh more in stiff parts than its size tells
        stiffly = w.large and w.stiff[2] > 0.0
        astray = slow >= (2 if mild else 3) or not size < np.inf if loosely else not size <= due
        ends = size <= residual and not (stiffly and not loosely and size < 0.25 * previous)
        ends = ends or (since > 1 and size <= ROUNDED * residual and size < LAST * previous)
        # or the next correction would be below the residual, if it shrinks as the last two did
        ends = ends or (size * previous <= told * before and size * size <= told * previous)
        if astray or size > 0.5 * previous:
            ends = ends or size <= still or (size <= RESTS and (slow >= 2 or size > due))
        if ends:
            if taken > 0:  # the contraction, for the choice of the next step
                w.seen[0] = (shrunk / first) ** (1.0 / taken)
            w.seen[2] = size
            return SOLVED
        if w.counts.iterations > w.budget[2]:
            return FAILED
        if astray or (stiffly and since > 1 and size > max(POOR * previous, POOR_DOWN_TO)):
            if w.stiff[4] > 0.0 or (not size < np.inf and w.to_whole == 0):
                return FAILED
            if renewed < most:
                renew(w, h, z)
                renewed, since, taken, slow, size = renewed + 1, 0, 0, 0, np.inf
            elif astray:
                return FAILED
        before = previous if since > 1 else 0.0
        previous = size
    return FAILED


def guess(w: Work, h: float) -> None:
    """U = the rates at the start, at every node; where a matrix is stiff, and they lead far, 0: first comes a linearly
    implicit step."""
    m, block, far = w.m, w.m - w.n_block, 0.0
    if w.stiff[2] > 0.0:
        for i in range(block, m):
            far = max(far, h * abs(w.start[i]) * w.start[m + i])
    first = 0 if w.stiff[4] > 0.0 else block if far > FAR else m
    for j in range(w.k):
        for i in range(m):
            w.U[i, j] = 0.0 if i >= first else w.start[i]


def extrapolate(w: Work, ratio: float) -> None:
    """U = the last step's polynomials N at this step's nodes, `ratio` = this step over the last (barycentric form)."""
    a, k, m = w.numbers, w.k, w.m
    if w.to_extrapolate != 0:
        w.ratio[0] = ratio
        call(w.to_extrapolate, w.ratio, w.c, w.found)
        return
    for j in range(k):
        x = 1.0 + ratio * a.nodes[j]
        total = 0.0
        for i in range(m):
            w.U[i, j] = 0.0
        for l in range(k):
            factor = a.barycentric[l] / (x - a.nodes[l])
            total += factor
            for i in range(m):
                w.U[i, j] += factor * w.N[i, l]
        for i in range(m):
            w.U[i, j] /= total


def close(w: Work, h: float) -> None:
    """dz of the step, and its polynomials of the rates at both ends, into `sums`."""
    a, k, n, m = w.numbers, w.k, w.n, w.m
    if w.to_close != 0:
        w.c[0] = h
        call(w.to_close, w.rates, w.c, w.sums)
        return
    fill(w.sums, 0.0)
    for j in range(k):
        for i in range(n):
            w.sums[w.order[i]] += h * a.b[j] * w.V[i, j]
        for i in range(m):
            w.sums[w.order[n + i]] += h * a.b[j] * w.N[i, j]
            w.sums[n + m + i] += a.at_start[j] * w.N[i, j]
            w.sums[n + 2 * m + i] += a.at_end[j] * w.N[i, j]


def is_noise(w: Work, z: Floats, least: float, miss: float, times: float) -> bool:
    """Is what the energy misses so many times its round-off, which is no less than given?"""
    return miss <= times * least or miss <= times * noise(w, z)


@rare
def noise(w: Work, z: Floats) -> float:
    """Of the energy at a state."""
    call(w.to_noise, z, w.c, w.FG)
    return w.FG[0]


def mend(w: Work, limit: float, closely: bool) -> bool:
    """The end of the step on the laws of the run; False, and nothing is done, if that moves it by more than the limit,
    or none is near. closely: what it misses is compared with the round-off there, not with that of the start only."""
    size, energy = w.size, 2 * w.m
    copy_into(w.laws, w.z1)
    wanted, least, miss = w.run[0], w.laws[size + 1], abs(w.end[energy] - w.run[0])
    clearly = not closely or miss > CLEARLY * w.run[1]
    if miss <= w.run[1] or (not clearly and is_noise(w, w.z1, w.end[energy + 1], miss, 1.0)):
        wanted = w.end[energy]  # right to round-off, which would disturb the rest
    if w.by_momenta:  # of which energy and invariants are no more than quadratic: one move is right
        n = w.n_moved
        w.laws[size] = wanted - w.end[energy]
        call(w.to_move, w.laws, w.c, w.mended)
        w.laws[size] = w.run[0]
        for i in range(n):
            if not abs(w.mended[i]) <= limit * (1.0 + abs(w.z1[n + i])):
                return False
        for i in range(n):
            w.dz[n + i] += w.mended[i]  # with the digits of a small one
            w.z1[n + i] += w.mended[i]
        w.end[energy] = wanted
        return True
    w.laws[size] = wanted
    call(w.to_mend, w.laws, w.c, w.mended)
    w.laws[size] = w.run[0]
    if w.mended[size + 1] > 0.0 and w.mended[size] >= least - w.laws[size + 2]:
        w.laws[size + 1] = max(w.mended[size], least)
        return True  # nothing is missed
    if not settled(w):
        return False
    for i in range(size):
        if not abs(w.laws[i] - w.z1[i]) <= limit * (1.0 + abs(w.z1[i])):
            w.laws[size + 1] = least
            return False
    for i in range(size):
        w.dz[i] += w.laws[i] - w.z1[i]
        w.z1[i] = w.laws[i]
    call(w.to_start, w.z1, w.c, w.end)
    return True


@rare
def settled(w: Work) -> bool:
    """The move that was found, and those that it needs on."""
    copy_into(w.laws, w.mended[: w.size])
    return mended(w.to_mend, w.to_hold, w.laws, w.c, w.mended)


def try_step(w: Work, h: float, z: Floats, known: bool, coarsest: int, residual: float) -> int:
    """One step of length h from z: dz; `start` and `end` are what the first kernel gives at z and z + dz.

    known: U is a guess. When the energy of a converged step is not kept to round-off, or mending would change more than
    the residual, the quadrature was too coarse for this step: finer ones follow, from `coarsest`, and then convergence,
    before it is COARSE. A step to round-off has all quadratures.
    """
    energy = 2 * w.m
    careful = residual <= CONVERGED
    levels = LEVELS if careful else ON_VECTORS
    begin(w, h, z)
    if not known:
        guess(w, h)
    level, before = coarsest, np.inf
    while True:
        w.seen[1] = level
        if fixed_point(w, h, z, level, residual) != SOLVED:
            return FAILED
        close(w, h)
        for i in range(w.size):
            w.dz[i] = w.sums[i]
            w.z1[i] = z[i] + w.dz[i]
        call(w.to_start, w.z1, w.c, w.end)
        total = w.end[energy]
        if not abs(total) < np.inf:
            return FAILED
        miss = abs(total - w.start[energy])
        if residual > CONVERGED:
            # what earlier steps left behind, as where masses nearly collide, is mended whatever its size
            if mend(w, MENDED * residual, False):
                return SOLVED
            if mend(w, np.inf if is_noise(w, w.z1, w.end[energy + 1], miss, 1.0) else MENDED * residual, True):
                return SOLVED
        else:
            # what a finer quadrature leaves is round-off, which in what is stiff is that of the iteration
            rests = miss > 0.5 * before or level + 1 == levels
            if is_noise(w, z, w.start[energy + 1], miss, STIFFLY * (1.0 + w.seen[2] / CONVERGED) if rests else 1.0):
                return SOLVED
        before = miss
        if level + 1 < levels:
            level += 1
            w.counts.raised += 1
        elif residual > CONVERGED:
            residual = CONVERGED
        else:
            return COARSE
