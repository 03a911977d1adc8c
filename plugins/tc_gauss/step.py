"""Gauss collocation that keeps both laws, of any order 2k, for any `System`; compiled, without allocation.

Collocation at the Gauss nodes c_j for (q, p, s), with two changes: the strain measures pi are carried as polynomials of
their own, and stress and temperature at a node are projections of the element slopes,

    q_j = q0 + h sum A_jl v_l,  v = p/m       p_j = p0 + h sum A_jl F_l         pi'_j = (dpi/dq)(q_j) v_j
    pi(xi_g) = pi0 + h sum Ahat_gl pi'_l      s(xi_g) = s0 + h sum Ahat_gl G_l  (xi_g: M further Gauss points)
    sigma_j = sum_g W_jg e_pi(pi_g, s_g)      theta_j = sum_g W_jg e_s(pi_g, s_g)
    F_j = -(dpi/dq)(q_j)^T sigma_j            G_j = conduction(theta_j)

Then sum b (v . F + sigma pi') = 0 and theta . G = 0 node by node, so that E is kept as exactly as the M points
integrate it; pi(1) = shape(q1), because pi is quadratic and Gauss is exact on it; momenta are kept because F_j is a
force of springs; and b > 0 with 1 . G >= 0 lets S rise only.

Solved by fixed point in U = (F, G), with its stiff part inverted exactly: the conduction, of rank one, which decays at
a rate lambda < 0 in a direction u with theta . u = 0, by (I - h lambda A)^-1. The iteration starts with few quadrature
points and ends with as many as the energy needs.

Adaptive runs iterate to a residual that belongs to the tolerance; to go on to round-off would take up to three times as
many iterations. Entropies rise all the same, as G is the conduction of some temperatures. Energy and invariants miss by
about the residual, and are mended: p is changed by as little, to the values with which the run began. Where that can't
be done, because hardly anything moves, the iteration goes on to round-off, and nothing is missing.
"""

from __future__ import annotations

import math

import numpy as np

from tcbench.compiler.language import Floats, call, copy_into, fill, rare
from tcbench.solver.linear_algebra import dot, solve_pivoted

from . import any_system, conduction
from .any_system import FAILED, SOLVED
from .formulas import ON_VECTORS
from .memory import LEVELS, POINTS, Work

COARSE = 2  # how a step ended, beside SOLVED and FAILED: the quadrature does not keep the energy
POINTS_0, POINTS_1, POINTS_2, POINTS_3 = POINTS
MAX_ITERATIONS = 60
CONVERGED = 1e-15  # scaled residual, beside which rounding is larger
STAGNATED = 2e-14  # below this a residual that no longer shrinks is round-off
ROUNDED = 4.0  # the same in residuals: where conduction is stiff, round-off is about one (see `fixed_point`)
ROUGH = 1e-3  # residual down to which the coarsest quadrature will do
MENDED = 10.0  # residuals: by how much mending may change momenta
MOST = 0.1  # of the kinetic energy that is free to change: what mending may move
SLOW = 0.6  # contraction above which the fixed point is given up
STIFFLY = 3.0  # times its round-off, by how much the energy of a stiff system may miss
POOR, POOR_DOWN_TO = 0.1, 1e-8  # contraction above which, and residual down to which, a large one's matrix is made anew
RENEWED = 5  # times that the matrix is, of any system, before
MAX_NEWTON = 12
INCREMENT = 1e-7  # of the difference quotients of the fallback: they steer, the residual decides


def points_of(level: int) -> int:
    """Points of a quadrature."""
    return POINTS_0 if level == 0 else POINTS_1 if level == 1 else POINTS_2 if level == 2 else POINTS_3


@rare
def rates(w: Work, h: float, z: Floats, level: int) -> int:
    """N = (F, G) that the equations give for U = (F, G); FAILED if a shape or temperature is not positive."""
    a, k, n, e = w.numbers, w.k, w.n, w.e
    for j in range(k):
        for i in range(n):
            total = 0.0
            for l in range(k):
                total += a.A[j, l] * w.U[i, l]
            w.V[i, j] = w.at_nodes[j, i] = (z[n + i] + h * total) * w.inverse_mass[i]
    for j in range(k):
        for i in range(n):
            total = 0.0
            for l in range(k):
                total += a.A[j, l] * w.V[i, l]
            w.at_nodes[j, n + i] = z[i] + h * total
        call(w.to_motion, w.at_nodes[j], w.c, w.drift[j])
        for i in range(e):
            w.drift[j, e + i] = w.U[n + i, j]
    return any_system.projected(w, h, points_of(level), level)


def stiff_block(w: Work, h: float) -> None:
    """(I - lambda hA)^-1 hA."""
    a, k, n, e = w.numbers, w.k, w.n, w.e
    first = n + 2 * e + 2  # behind (F, G, pi, E, round-off of E): lambda, u, v
    w.stiff[0], w.stiff[1] = h, w.start[first]
    for i in range(e):
        w.u[i], w.v[i] = w.start[first + 1 + i], w.start[first + 1 + e + i]
    if w.to_block != 0:
        call(w.to_block, w.stiff, w.c, w.block)
        return
    for i in range(k):  # a function of A, by its eigenvalues
        for j in range(k):
            w.columns[j, i] = 0.0
            for l in range(a.pairs):
                x, y = h * a.eigen_re[l], h * a.eigen_im[l]
                re, im = 1.0 - w.stiff[1] * x, w.stiff[1] * y
                size = re * re + im * im
                x, y = (x * re - y * im) / size, (y * re + x * im) / size
                u, v = a.into_re[l, j] * x - a.into_im[l, j] * y, a.into_re[l, j] * y + a.into_im[l, j] * x
                w.columns[j, i] += a.back_re[i, l] * u - a.back_im[i, l] * v


def square(w: Work, change: Floats) -> float:
    """Of the scaled size of a change of the rates at a node, which does not depend on the axes; NaN stays."""
    force = change[: w.n]
    largest = dot(force, force) * w.scale[0] * w.scale[0]
    for i in range(w.n, w.m):
        r = (change[i] * w.scale[1]) ** 2
        largest = r if r > largest or r != r else largest
    return largest


def correct(w: Work, h: float) -> float:
    """U += N - U with the conduction solved for; returns the scaled residual."""
    k, n, e = w.k, w.n, w.e
    for j in range(k):
        w.rho[j] = 0.0
        for i in range(e):
            w.rho[j] += w.v[i] * (w.N[n + i, j] - w.U[n + i, j])
    size, change = 0.0, w.FG
    for j in range(k):
        total = 0.0
        for l in range(k):
            total += w.columns[l, j] * w.rho[l]
        for i in range(n + e):
            change[i] = w.N[i, j] - w.U[i, j]
            w.U[i, j] += change[i] if i < n else change[i] + w.u[i - n] * total
        r = square(w, change)
        size = r if r > size or r != r else size
    return h * math.sqrt(size)


def iterate(w: Work, h: float, z: Floats, level: int) -> float:
    """One iteration with a quadrature; the scaled residual, not finite where U is out of the formulas' range."""
    if w.general:
        return any_system.iterate(w, h, z, points_of(level), level)
    if w.stiff[2] == 0.0:
        return iterate_simply(w, h, z, level)
    conduction.keep(w)
    size = iterate_simply(w, h, z, level)
    conduction.correct(w)
    return size


def iterate_simply(w: Work, h: float, z: Floats, level: int) -> float:
    """The same without more of the conduction than a part of rank one.

    It is one kernel on vectors for the coarser quadratures, where the system's formulas have such a form.
    """
    kernel = w.to_iterate if level == 0 else w.to_iterate_finer if level == 1 else 0
    if kernel != 0:
        call(kernel, w.given, w.c, w.found)
        return h * math.sqrt(w.found[len(w.found) - 1])
    return correct(w, h) if rates(w, h, z, level) == SOLVED else np.inf


def fixed_point(w: Work, h: float, z: Floats, level: int, residual: float) -> int:
    """Iterate from U, in place, until U and N agree to the residual. SOLVED or FAILED."""
    previous, slow, first, shrunk, since, renewed, here, taken = np.inf, 0, 0.0, 0.0, 0, 0, 0, 0
    w.seen[0] = 0.0
    # round-off in the conduction is that of entropies, times 1 - h lambda
    w.scale[1] = min(1.0, residual / CONVERGED / (1.0 - h * w.stiff[1])) / w.least_s
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
        stiffly = w.large and w.stiff[2] > 0.0
        done = size <= residual and not (stiffly and residual <= CONVERGED and size < 0.25 * previous)
        if done or (size <= still and size > 0.5 * previous):
            if taken > 0:  # the contraction, for the choice of the next step
                w.seen[0] = (shrunk / first) ** (1.0 / taken)
            return SOLVED
        slow = slow + 1 if size > SLOW * previous else 0
        poor = stiffly and since > 1 and size > max(POOR * previous, POOR_DOWN_TO)
        if w.general and (slow >= 2 or poor) and renewed < RENEWED:
            any_system.renew(w, h, z)
            renewed, slow = renewed + 1, 0
        if slow >= 2 or w.counts.iterations > w.budget[2]:
            return FAILED
        previous = size
    return FAILED


@rare
def newton(w: Work, h: float, z: Floats, level: int) -> int:
    """Newton on U - N(U) = 0 with difference quotients, from U, in place: where the fixed point does not contract."""
    m = w.m
    unknowns = w.k * m
    previous = np.inf
    for _ in range(MAX_NEWTON):
        w.counts.newtons += 1
        if rates(w, h, z, level) != SOLVED:
            return FAILED
        for row in range(unknowns):
            w.base[row] = w.N[row % m, row // m]
        for column in range(unknowns):
            j, i = column // m, column % m
            here = w.U[i, j]
            eps = INCREMENT * max((w.least_p if i < w.n else w.least_s) / h, abs(here))
            w.U[i, j] = here + eps
            done = rates(w, h, z, level)
            w.U[i, j] = here
            if done != SOLVED:
                return FAILED
            for row in range(unknowns):
                w.J[row, column] = (1.0 if row == column else 0.0) - (w.N[row % m, row // m] - w.base[row]) / eps
        for row in range(unknowns):
            w.J[row, unknowns] = w.base[row] - w.U[row % m, row // m]
        if solve_pivoted(w.J, unknowns, unknowns + 1) == 0.0:
            return FAILED
        for row in range(unknowns):
            w.rhs[row] = w.J[row, unknowns]
        size = 0.0
        for j in range(w.k):
            change = w.rhs[j * m : j * m + m]
            for i in range(m):
                w.U[i, j] += change[i]
            r = h * math.sqrt(square(w, change))
            size = r if r > size or r != r else size
        if not size < np.inf:
            return FAILED
        if size <= CONVERGED or (size <= STAGNATED and size > 0.5 * previous):
            return rates(w, h, z, level)
        if size > 2.0 * previous:
            return FAILED
        previous = size
    return FAILED


def guess(w: Work) -> None:
    """U = the rates at the start, at every node; where any system is stiff 0: first comes a linearly implicit step."""
    for j in range(w.k):
        for i in range(w.m):
            w.U[i, j] = 0.0 if w.general and w.stiff[2] > 0.0 else w.start[i]


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
            w.sums[i] += h * a.b[j] * w.V[i, j]
        for i in range(m):
            w.sums[n + i] += h * a.b[j] * w.N[i, j]
            w.sums[n + m + i] += a.at_start[j] * w.N[i, j]
            w.sums[n + 2 * m + i] += a.at_end[j] * w.N[i, j]


def mend(w: Work, limit: float) -> bool:
    """Change momenta so that the end of the step has the energy and invariants of the run. False, and nothing is done,
    if that is much of the kinetic energy that is free to change, or moves the state by more than the limit."""
    n, size = w.n, len(w.z1)
    total = n + 2 * w.e
    if w.general:
        return any_system.mend(w, limit)
    copy_into(w.laws, w.z1)
    w.laws[size] = w.end[total]
    right = abs(w.end[total] - w.run[0]) <= w.end[total + 1]  # to round-off, which would disturb the momenta
    w.laws[size + 1] = w.end[total] if right else w.run[0]
    call(w.to_mend, w.laws, w.c, w.mended)
    if not abs(w.mended[n]) <= MOST:
        return False
    moved = w.mended[:n]
    if not math.sqrt(dot(moved, moved)) * w.scale[0] <= limit:
        return False
    for i in range(n):
        w.dz[n + i] += moved[i]
    w.end[total] = w.laws[size + 1]
    return True


def try_step(w: Work, h: float, z: Floats, known: bool, coarsest: int, residual: float, whole: bool) -> int:
    """One step of length h from z: dz; `start` and `end` are what the first kernel gives at z and z + dz.

    known: U is a guess. When the energy of a converged step is not kept to round-off, or mending would change more than
    the residual, the quadrature was too coarse for this step: finer ones follow, from `coarsest`, and then convergence,
    before it is COARSE. A step to round-off has all quadratures; one of the length that was asked for (whole), which is
    to be that of the method, has Newton, where the fixed point fails.
    """
    n, e = w.n, w.e
    careful = residual <= CONVERGED
    levels = LEVELS if careful else ON_VECTORS
    w.c[0] = h
    if w.general:
        any_system.begin(w, z)
    else:
        for i in range(2 * n):
            w.state0[i] = z[i]
        for i in range(e):
            w.state0[2 * n + i] = w.x0[i] = w.start[n + e + i]
            w.state0[2 * n + e + i] = w.x0[e + i] = z[2 * n + i]
        stiff_block(w, h)
    if w.to_matrix != 0:
        conduction.prepare(w, h, z)
    if not known:
        guess(w)
    level, before = coarsest, np.inf
    while True:
        w.seen[1] = level
        done = fixed_point(w, h, z, level, residual)
        if done != SOLVED and whole and w.n_newton > 0:
            guess(w)
            done = newton(w, h, z, level)
        if done != SOLVED:
            return FAILED
        close(w, h)
        for i in range(len(z)):
            w.dz[i] = w.sums[i]
            w.z1[i] = z[i] + w.dz[i]
        call(w.to_start, w.z1, w.c, w.end)
        total = w.end[n + 2 * e]
        if not abs(total) < np.inf:
            return FAILED
        miss, noise = abs(total - w.start[n + 2 * e]), w.start[n + 2 * e + 1]
        if w.general:  # where a step begins at a steep slope much would be
            noise = min(noise, w.end[n + 2 * e + 1])
        if residual > CONVERGED:
            # what earlier steps left behind, as where masses nearly collide, is mended whatever its size
            if mend(w, np.inf if miss <= w.end[n + 2 * e + 1] else MENDED * residual):
                return SOLVED
        elif miss <= noise:
            return SOLVED
        elif w.general and miss > 0.5 * before and miss <= STIFFLY * noise:
            return SOLVED  # what a finer quadrature leaves is round-off in what is stiff
        before = miss
        if level + 1 < levels:
            level += 1
            w.counts.raised += 1
        elif residual > CONVERGED:
            residual = CONVERGED
        else:
            return COARSE
