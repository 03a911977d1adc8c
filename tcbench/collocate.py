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

Solved by fixed point in U = (F, G). The stiff part of the conduction is rank one: in the direction u, with
theta . u = 0, it decays at a rate lambda < 0, and (I - h lambda A) is inverted exactly.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .jit import call, fill, inlined, lean
from .newton import solve_pivoted

# columns of `plan` (int64): addresses of the kernels, those on vectors last (0: none), then sizes
START, MOTION, SLOPES, FORCES, ITERATE, STIFF, EXTRAPOLATE, CLOSE, N_Q, N_E, STAGES, LEVELS, PLAN_SIZE = range(13)
# how a step ended, and what was counted
SOLVED, FAILED, COARSE = 0, 1, 2  # COARSE: the quadrature does not keep the energy
STEPS, REJECTED_STEPS, ITERATIONS, NEWTONS, HALVED, RAISED, COUNTS_SIZE = range(7)

MAX_ITERATIONS = 60
CONVERGED = 5e-16  # scaled residual, beside which rounding is larger
STAGNATED = 2e-14  # below this a residual that no longer shrinks is round-off
SLOW = 0.6  # contraction above which the fixed point is given up
MAX_NEWTON = 12
INCREMENT = 1e-7  # of the difference quotients of the fallback: they steer, the residual decides


class Work(NamedTuple):
    """The arrays of one step; k stages, n positions, e elements, m = n + e rates, M quadrature points.

    Row i of `found` holds variable i at WIDTH nodes, of which k are used: U, N and V are views of it, T of `given`.
    """

    c: Any  # the time step, the constants of the system, and what depends on them only
    inverse_mass: Any  # (n,)
    given: Any  # what `gauss_kernels.iteration` reads
    found: Any  # and what it writes
    U: Any  # (WIDTH, m) the iterate
    N: Any  # (WIDTH, m) the rates that it gives
    V: Any  # (WIDTH, n) velocities
    room_T: Any  # T by columns, h, decay
    T: Any  # (WIDTH, k)
    rates: Any  # N, then V
    ratio: Any  # (1,) this step over the last
    sums: Any  # what `gauss_kernels.closing` writes
    start: Any  # what the first kernel gives at the start of the step
    end: Any  # and at its end
    scale: Any  # (3,) of forces and of heat in a residual, and the contraction that was seen
    at_nodes: Any  # (k, 2 n + 2 e) velocities, positions, stresses, temperatures
    drift: Any  # (k, 2 e) rates of shapes and entropies
    at_points: Any  # (M, 2 e) shapes and entropies
    slopes: Any  # (M, 2 e) stresses and temperatures
    FG: Any  # (m,)
    rho: Any  # (k,)
    block: Any  # (k, k)
    J: Any  # (k m, k m) of Newton's method
    right: Any  # (k m,)
    base: Any  # (k m,)
    x0: Any  # (2 e,) shapes and entropies at the start
    dz: Any  # (2 n + e,)
    z1: Any  # (2 n + e,)


@lean
def rates(plan, a, w, h, z, level):  # type: ignore[no-untyped-def]
    """N = (F, G) that the equations give for U = (F, G); FAILED if a shape or temperature is not positive."""
    k, n, e, points = plan[STAGES], plan[N_Q], plan[N_E], a.points[level]
    for j in range(k):
        for i in range(n):
            total = 0.0
            for l in range(k):
                total += a.A[j, l] * w.U[l, i]
            w.V[j, i] = w.at_nodes[j, i] = (z[n + i] + h * total) * w.inverse_mass[i]
    for j in range(k):
        for i in range(n):
            total = 0.0
            for l in range(k):
                total += a.A[j, l] * w.V[l, i]
            w.at_nodes[j, n + i] = z[i] + h * total
        call(plan[MOTION], w.at_nodes[j], w.c, w.drift[j])
        for i in range(e):
            w.drift[j, e + i] = w.U[j, n + i]
    for g in range(points):
        for i in range(2 * e):
            total = 0.0
            for l in range(k):
                total += a.Ahats[level, g, l] * w.drift[l, i]
            w.at_points[g, i] = w.x0[i] + h * total
        for i in range(e):
            if not w.at_points[g, i] > 0.0:
                return FAILED
        call(plan[SLOPES], w.at_points[g], w.c, w.slopes[g])
    for j in range(k):
        for i in range(2 * e):
            total = 0.0
            for g in range(points):
                total += a.Ws[level, j, g] * w.slopes[g, i]
            w.at_nodes[j, 2 * n + i] = total
        for i in range(e):
            if not w.at_nodes[j, 2 * n + e + i] > 0.0:
                return FAILED
        call(plan[FORCES], w.at_nodes[j], w.c, w.FG)
        for i in range(n + e):
            w.N[j, i] = w.FG[i]
    return SOLVED


@inlined
def stiff_block(plan, a, w, h):  # type: ignore[no-untyped-def]
    """T = (I - h decay A)^-1 h A, by elimination (safe without pivoting: decay <= 0)."""
    k, decay = plan[STAGES], w.start[plan[N_Q] + 2 * plan[N_E] + 2]
    if plan[STIFF] != 0:
        w.room_T[len(w.room_T) - 2], w.room_T[len(w.room_T) - 1] = h, decay
        call(plan[STIFF], w.room_T, w.c, w.room_T)
        return
    for i in range(k):
        for j in range(k):
            w.block[i, j] = (1.0 if i == j else 0.0) - h * decay * a.A[i, j]
            w.T[i, j] = h * a.A[i, j]
    for m in range(k):
        inverse = 1.0 / w.block[m, m]
        for i in range(m + 1, k):
            factor = w.block[i, m] * inverse
            for j in range(m + 1, k):
                w.block[i, j] -= factor * w.block[m, j]
            for j in range(k):
                w.T[i, j] -= factor * w.T[m, j]
    for m in range(k - 1, -1, -1):
        inverse = 1.0 / w.block[m, m]
        for j in range(k):
            total = w.T[m, j]
            for i in range(m + 1, k):
                total -= w.block[m, i] * w.T[i, j]
            w.T[m, j] = total * inverse


@inlined
def correct(plan, w, h):  # type: ignore[no-untyped-def]
    """U += N - U with the stiff part of G solved for; returns the scaled residual."""
    k, n, e = plan[STAGES], plan[N_Q], plan[N_E]
    first = n + 2 * e + 3  # u, then v, behind (F, G, pi, E, round-off of E, decay)
    size = 0.0
    for j in range(k):
        w.rho[j] = 0.0
        for i in range(n):
            r = abs(w.N[j, i] - w.U[j, i]) * w.scale[0]
            size = r if not r <= size else size
            w.U[j, i] = w.N[j, i]
        for i in range(e):
            w.rho[j] += w.start[first + e + i] * (w.N[j, n + i] - w.U[j, n + i])
    for j in range(k):
        total = 0.0
        for l in range(k):
            total += w.T[j, l] * w.rho[l]
        for i in range(e):
            step = w.N[j, n + i] - w.U[j, n + i] + w.start[first + i] * total
            r = abs(step) * w.scale[1]
            size = r if not r <= size else size
            w.U[j, n + i] += step
    return h * size


@inlined
def fixed_point(plan, a, w, h, z, level, counts):  # type: ignore[no-untyped-def]
    """Iterate from U, in place; the converged U and N agree to round-off. SOLVED or FAILED.

    With the coarsest quadrature an iteration is one kernel on vectors, where the system's formulas have such a form.
    """
    at_once = plan[ITERATE] != 0 and level == 0
    previous, slow, first, shrunk, taken = np.inf, 0, 0.0, 0.0, 0
    w.c[0], w.scale[2] = h, 0.0
    stiff_block(plan, a, w, h)
    for iteration in range(MAX_ITERATIONS):
        counts[ITERATIONS] += 1
        if at_once:
            call(plan[ITERATE], w.given, w.c, w.found)
            size = h * w.found[len(w.found) - 1]
        elif rates(plan, a, w, h, z, level) == SOLVED:
            size = correct(plan, w, h)
        else:
            return FAILED
        if not size < np.inf:
            return FAILED
        if size <= CONVERGED or (size <= STAGNATED and size > 0.5 * previous):
            if taken > 0:  # the contraction, for the choice of the next step
                w.scale[2] = (shrunk / first) ** (1.0 / taken)
            return SOLVED
        slow = slow + 1 if size > SLOW * previous else 0
        if slow >= 2:
            return FAILED
        if iteration == 1:
            first = size
        elif iteration > 1 and size > STAGNATED:
            shrunk, taken = size, iteration - 1
        previous = size
    return FAILED


@lean
def newton(plan, a, w, h, z, level, counts):  # type: ignore[no-untyped-def]
    """Newton on U - N(U) = 0 with difference quotients, from U, in place: where the fixed point does not contract."""
    m = plan[N_Q] + plan[N_E]
    unknowns = plan[STAGES] * m
    previous = np.inf
    for _ in range(MAX_NEWTON):
        counts[NEWTONS] += 1
        if rates(plan, a, w, h, z, level) != SOLVED:
            return FAILED
        for row in range(unknowns):
            w.base[row] = w.N[row // m, row % m]
        for column in range(unknowns):
            j, i = column // m, column % m
            here = w.U[j, i]
            eps = INCREMENT * max(1.0, abs(here))
            w.U[j, i] = here + eps
            done = rates(plan, a, w, h, z, level)
            w.U[j, i] = here
            if done != SOLVED:
                return FAILED
            for row in range(unknowns):
                w.J[row, column] = (1.0 if row == column else 0.0) - (w.N[row // m, row % m] - w.base[row]) / eps
        for row in range(unknowns):
            w.right[row] = w.base[row] - w.U[row // m, row % m]
        if solve_pivoted(w.J, w.right) == 0.0:
            return FAILED
        size = 0.0
        for row in range(unknowns):
            j, i = row // m, row % m
            w.U[j, i] += w.right[row]
            r = h * abs(w.right[row]) * (w.scale[0] if i < plan[N_Q] else w.scale[1])
            size = r if not r <= size else size
        if not size < np.inf:
            return FAILED
        if size <= CONVERGED or (size <= STAGNATED and size > 0.5 * previous):
            return rates(plan, a, w, h, z, level)
        if size > 2.0 * previous:
            return FAILED
        previous = size
    return FAILED


@inlined
def guess(plan, w):  # type: ignore[no-untyped-def]
    """U = the rates at the start of the step, at every node."""
    for j in range(plan[STAGES]):
        for i in range(plan[N_Q] + plan[N_E]):
            w.U[j, i] = w.start[i]


@inlined
def extrapolate(plan, a, w, ratio):  # type: ignore[no-untyped-def]
    """U = the last step's polynomials N at this step's nodes, `ratio` = this step over the last (barycentric form)."""
    k, m = plan[STAGES], plan[N_Q] + plan[N_E]
    if plan[EXTRAPOLATE] != 0:
        w.ratio[0] = ratio
        call(plan[EXTRAPOLATE], w.ratio, w.c, w.found)
        return
    for j in range(k):
        x = 1.0 + ratio * a.nodes[j]
        total = 0.0
        for i in range(m):
            w.U[j, i] = 0.0
        for l in range(k):
            factor = a.barycentric[l] / (x - a.nodes[l])
            total += factor
            for i in range(m):
                w.U[j, i] += factor * w.N[l, i]
        for i in range(m):
            w.U[j, i] /= total


@inlined
def close(plan, a, w, h):  # type: ignore[no-untyped-def]
    """dz of the step, and its polynomials of the rates at both ends, into `sums`."""
    k, n, m = plan[STAGES], plan[N_Q], plan[N_Q] + plan[N_E]
    if plan[CLOSE] != 0:
        w.c[0] = h
        call(plan[CLOSE], w.rates, w.c, w.sums)
        return
    fill(w.sums, 0.0)
    for j in range(k):
        for i in range(n):
            w.sums[i] += h * a.b[j] * w.V[j, i]
        for i in range(m):
            w.sums[n + i] += h * a.b[j] * w.N[j, i]
            w.sums[n + m + i] += a.at_start[j] * w.N[j, i]
            w.sums[n + 2 * m + i] += a.at_end[j] * w.N[j, i]


@inlined
def try_step(plan, a, w, h, z, known, careful, levels, counts):  # type: ignore[no-untyped-def]
    """One step of length h from z into z1 = z + dz; `start` and `end` are what the first kernel gives there.

    known: U is a guess. careful: Newton, where the fixed point fails. When the energy is not kept to round-off the
    quadrature was too coarse for this step: finer ones follow, `levels` in all, before it is COARSE.
    """
    n, e = plan[N_Q], plan[N_E]
    for i in range(2 * n):
        w.given[i] = z[i]
    for i in range(e):
        w.given[2 * n + i] = w.x0[i] = w.start[n + e + i]
        w.given[2 * n + e + i] = w.x0[e + i] = z[2 * n + i]
    first = len(w.given) - 2 * e - 2
    for i in range(2 * e):
        w.given[first + i] = w.start[n + 2 * e + 3 + i]
    w.given[first + 2 * e], w.given[first + 2 * e + 1] = w.scale[0], w.scale[1]
    for level in range(levels):
        if level > 0:
            counts[RAISED] += 1
        if level == 0 and not known:
            guess(plan, w)
        done = fixed_point(plan, a, w, h, z, level, counts)
        if done != SOLVED and careful:
            guess(plan, w)
            done = newton(plan, a, w, h, z, level, counts)
        if done != SOLVED:
            return FAILED
        close(plan, a, w, h)
        for i in range(len(z)):
            w.dz[i] = w.sums[i]
            w.z1[i] = z[i] + w.dz[i]
        call(plan[START], w.z1, w.c, w.end)
        total = w.end[n + 2 * e]
        if not abs(total) < np.inf:
            return FAILED
        if abs(total - w.start[n + 2 * e]) <= w.start[n + 2 * e + 1]:
            return SOLVED
    return COARSE
