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

import numpy as np

from .jit import call, fill, lean
from .newton import solve_pivoted

# columns of `plan` (int64): addresses of the kernels, then sizes
START, MOTION, SLOPES, FORCES, LANES, N_Q, N_E, STAGES, LEVELS, BASE, PLAN_SIZE = range(11)
# how a step ended, and what was counted
SOLVED, FAILED, COARSE = 0, 1, 2  # COARSE: the quadrature does not keep the energy
STEPS, REJECTED_STEPS, ITERATIONS, NEWTONS, HALVED, RAISED, COUNTS_SIZE = range(7)

MAX_ITERATIONS = 60
CONVERGED = 5e-16  # scaled residual, beside which rounding is larger
STAGNATED = 2e-14  # below this a residual that no longer shrinks is round-off
SLOW = 0.6  # contraction above which the fixed point is given up
MAX_NEWTON = 12
INCREMENT = 1e-7  # of the difference quotients of the fallback: they steer, the residual decides


@lean
def rates(plan, c, h, q0, p0, x0, inverse_mass, A, Ahat, W, points, U, N, V, R, D, X, Y, FG):  # type: ignore[no-untyped-def]
    """N = (F, G) that the equations give for U = (F, G); SOLVED, or FAILED if a shape or temperature is not positive.

    V: the velocities. R, D, X, Y and FG are scratch.
    """
    k, n, e = plan[STAGES], plan[N_Q], plan[N_E]
    for j in range(k):
        for i in range(n):
            total = 0.0
            for l in range(k):
                total += A[j, l] * U[l, i]
            V[j, i] = R[j, i] = (p0[i] + h * total) * inverse_mass[i]
    for j in range(k):
        for i in range(n):
            total = 0.0
            for l in range(k):
                total += A[j, l] * V[l, i]
            R[j, n + i] = q0[i] + h * total
        call(plan[MOTION], R[j], c, D[j])
        for i in range(e):
            D[j, e + i] = U[j, n + i]
    for g in range(points):
        for i in range(2 * e):
            total = 0.0
            for l in range(k):
                total += Ahat[g, l] * D[l, i]
            X[g, i] = x0[i] + h * total
        for i in range(e):
            if not X[g, i] > 0.0:
                return FAILED
        call(plan[SLOPES], X[g], c, Y[g])
    for j in range(k):
        for i in range(2 * e):
            total = 0.0
            for g in range(points):
                total += W[j, g] * Y[g, i]
            R[j, 2 * n + i] = total
        for i in range(e):
            if not R[j, 2 * n + e + i] > 0.0:
                return FAILED
        call(plan[FORCES], R[j], c, FG)
        for i in range(n + e):
            N[j, i] = FG[i]
    return SOLVED


@lean
def stiff_block(k, h, decay, A, T, block):  # type: ignore[no-untyped-def]
    """T = (I - h decay A)^-1 h A, by elimination (safe without pivoting: decay <= 0)."""
    for i in range(k):
        for j in range(k):
            block[i, j] = (1.0 if i == j else 0.0) - h * decay * A[i, j]
            T[i, j] = h * A[i, j]
    for m in range(k):
        inverse = 1.0 / block[m, m]
        for i in range(m + 1, k):
            factor = block[i, m] * inverse
            for j in range(m + 1, k):
                block[i, j] -= factor * block[m, j]
            for j in range(k):
                T[i, j] -= factor * T[m, j]
    for m in range(k - 1, -1, -1):
        inverse = 1.0 / block[m, m]
        for j in range(k):
            total = T[m, j]
            for i in range(m + 1, k):
                total -= block[m, i] * T[i, j]
            T[m, j] = total * inverse


@lean
def correct(plan, h, start, scale, T, rho, U, N):  # type: ignore[no-untyped-def]
    """U += N - U with the stiff part of G solved for; returns the scaled residual."""
    k, n, e = plan[STAGES], plan[N_Q], plan[N_E]
    first = n + 2 * e + 3  # u, then v, behind (F, G, pi, E, round-off of E, decay)
    size = 0.0
    for j in range(k):
        rho[j] = 0.0
        for i in range(n):
            r = abs(N[j, i] - U[j, i]) * scale[0]
            size = r if not r <= size else size
            U[j, i] = N[j, i]
        for i in range(e):
            rho[j] += start[first + e + i] * (N[j, n + i] - U[j, n + i])
    for j in range(k):
        total = 0.0
        for l in range(k):
            total += T[j, l] * rho[l]
        for i in range(e):
            step = N[j, n + i] - U[j, n + i] + start[first + i] * total
            r = abs(step) * scale[1]
            size = r if not r <= size else size
            U[j, n + i] += step
    return h * size


@lean
def fixed_point(  # type: ignore[no-untyped-def]
    plan, c, h, q0, p0, x0, start, scale, inverse_mass, A, Ahat, W, points,
    IN, OUT, U, N, V, R, D, X, Y, T, rho, block, FG,
    counts,
):  # fmt: skip
    """Iterate from U, in place; the converged U and N agree to round-off. SOLVED or FAILED.

    For the coarsest quadrature an iteration is one kernel on vectors, where the system's formulas have such a form;
    U, N, V and T are views of IN and OUT.
    """
    stiff_block(plan[STAGES], h, start[plan[N_Q] + 2 * plan[N_E] + 2], A, T, block)
    at_once = plan[LANES] != 0 and points == plan[BASE]
    previous, slow, first = np.inf, 0, 0.0
    c[0] = h
    scale[2] = 0.0
    for iteration in range(MAX_ITERATIONS):
        counts[ITERATIONS] += 1
        if at_once:
            call(plan[LANES], IN, c, OUT)
            size = h * OUT[len(OUT) - 1]
        elif rates(plan, c, h, q0, p0, x0, inverse_mass, A, Ahat, W, points, U, N, V, R, D, X, Y, FG) == SOLVED:
            size = correct(plan, h, start, scale, T, rho, U, N)
        else:
            return FAILED
        if not size < np.inf:
            return FAILED
        if size <= CONVERGED or (size <= STAGNATED and size > 0.5 * previous):
            return SOLVED
        slow = slow + 1 if size > SLOW * previous else 0
        if slow >= 2:
            return FAILED
        if iteration == 1:
            first = size
        elif iteration > 1 and size > STAGNATED:  # the contraction, for the choice of the next step
            scale[2] = (size / first) ** (1.0 / (iteration - 1))
        previous = size
    return FAILED


@lean
def newton(  # type: ignore[no-untyped-def]
    plan, c, h, q0, p0, x0, scale, inverse_mass, A, Ahat, W, points, U, N, V, R, D, X, Y, FG, J, b, base, counts
):
    """Newton on U - N(U) = 0 with difference quotients, from U, in place: where the fixed point does not contract."""
    k, m = plan[STAGES], plan[N_Q] + plan[N_E]
    previous = np.inf
    for _ in range(MAX_NEWTON):
        counts[NEWTONS] += 1
        if rates(plan, c, h, q0, p0, x0, inverse_mass, A, Ahat, W, points, U, N, V, R, D, X, Y, FG) != SOLVED:
            return FAILED
        for row in range(k * m):
            base[row] = N[row // m, row % m]
        for column in range(k * m):
            j, i = column // m, column % m
            here = U[j, i]
            eps = INCREMENT * max(1.0, abs(here))
            U[j, i] = here + eps
            done = rates(plan, c, h, q0, p0, x0, inverse_mass, A, Ahat, W, points, U, N, V, R, D, X, Y, FG)
            U[j, i] = here
            if done != SOLVED:
                return FAILED
            for row in range(k * m):
                J[row, column] = (1.0 if row == column else 0.0) - (N[row // m, row % m] - base[row]) / eps
        for row in range(k * m):
            b[row] = base[row] - U[row // m, row % m]
        if solve_pivoted(J, b) == 0.0:
            return FAILED
        size = 0.0
        for row in range(k * m):
            j, i = row // m, row % m
            U[j, i] += b[row]
            r = h * abs(b[row]) * (scale[0] if i < plan[N_Q] else scale[1])
            size = r if not r <= size else size
        if not size < np.inf:
            return FAILED
        if size <= CONVERGED or (size <= STAGNATED and size > 0.5 * previous):
            return rates(plan, c, h, q0, p0, x0, inverse_mass, A, Ahat, W, points, U, N, V, R, D, X, Y, FG)
        if size > 2.0 * previous:
            return FAILED
        previous = size
    return FAILED


@lean
def guess(plan, start, U):  # type: ignore[no-untyped-def]
    """U = the rates at the start of the step, at every node."""
    for j in range(plan[STAGES]):
        for i in range(plan[N_Q] + plan[N_E]):
            U[j, i] = start[i]


@lean
def extrapolate(plan, ratio, c, weights, N, U):  # type: ignore[no-untyped-def]
    """U = the last step's polynomials N at this step's nodes, `ratio` = this step over the last (barycentric form)."""
    k, m = plan[STAGES], plan[N_Q] + plan[N_E]
    for j in range(k):
        x = 1.0 + ratio * c[j]
        total = 0.0
        for i in range(m):
            U[j, i] = 0.0
        for l in range(k):
            factor = weights[l] / (x - c[l])
            total += factor
            for i in range(m):
                U[j, i] += factor * N[l, i]
        for i in range(m):
            U[j, i] /= total


@lean
def try_step(  # type: ignore[no-untyped-def]
    plan, c, h, z, start, end, scale, inverse_mass, A, b, Ahats, Ws, points, known, careful,
    IN, OUT, U, N, V, R, D, X, Y, T, rho,
    block, FG, J, right, base, x0, dz, z1, counts, levels,
):  # fmt: skip
    """One step of length h from z into z1 = z + dz; `start` and `end` are what the first kernel gives there.

    known: U is a guess. careful: Newton, where the fixed point fails. When the energy is not kept to round-off the
    quadrature was too coarse for this step: finer ones follow, `levels` in all, before it is COARSE.
    """
    n, e, k = plan[N_Q], plan[N_E], plan[STAGES]
    for i in range(e):
        x0[i] = start[n + e + i]
        x0[e + i] = z[2 * n + i]
    q0, p0 = z[:n], z[n : 2 * n]
    for i in range(2 * n):
        IN[i] = z[i]
    for i in range(2 * e):
        IN[2 * n + i] = x0[i]
    first = len(IN) - 2 * e - 2  # behind T, a view of IN
    for i in range(2 * e):
        IN[first + i] = start[n + 2 * e + 3 + i]
    IN[first + 2 * e], IN[first + 2 * e + 1] = scale[0], scale[1]
    for level in range(levels):
        if level > 0:
            counts[RAISED] += 1
        if level == 0 and not known:
            guess(plan, start, U)
        done = fixed_point(
            plan, c, h, q0, p0, x0, start, scale, inverse_mass, A, Ahats[level], Ws[level], points[level],
            IN, OUT, U, N, V, R, D, X, Y, T,
            rho, block, FG, counts,
        )  # fmt: skip
        if done != SOLVED and careful:
            guess(plan, start, U)
            done = newton(
                plan,
                c,
                h,
                q0,
                p0,
                x0,
                scale,
                inverse_mass,
                A,
                Ahats[level],
                Ws[level],
                points[level],
                U,
                N,
                V,
                R,
                D,
                X,
                Y,
                FG,
                J,
                right,
                base,
                counts,
            )
        if done != SOLVED:
            return FAILED
        fill(dz, 0.0)
        for j in range(k):
            for i in range(n):
                dz[i] += h * b[j] * V[j, i]
                dz[n + i] += h * b[j] * N[j, i]
            for i in range(e):
                dz[2 * n + i] += h * b[j] * N[j, n + i]
        for i in range(len(z)):
            z1[i] = z[i] + dz[i]
        call(plan[START], z1, c, end)
        total = end[n + 2 * e]
        if not abs(total) < np.inf:
            return FAILED
        if abs(total - start[n + 2 * e]) <= start[n + 2 * e + 1]:
            return SOLVED
    return COARSE
