"""Newton's correction where the Jacobian is sparse: ILU(0) and BiCGStab, and a whole factorisation where that fails.

In the restricted Python. At usual steps the matrix is near the identity: the incomplete factors are nearly the whole
ones, their pivots have the signs of the whole ones', and the number of iterations does not depend on the size. At steps
of many times the explicit limit it grows as the number of nodes along the mesh: see `Pattern.krylov_steps`.
"""

from __future__ import annotations

import numpy as np

from ..compiler.language import Floats, Matrix, call, copy_into, fill, late, rare
from .flow import CompiledFlow
from .linear_algebra import SOLVED, STEEPEST, dot

LEAST_PIVOT = 1e-2  # of the incomplete factors, over the row's largest entry: below it they are not trusted
FINEST = 1e-10  # relative residual of a linear system that is solved once
FIRST = 1e-4  # ... of a first correction of Newton's
SHARE = 1e-2  # ... of a later one over the correction before, so that it is no larger than what Newton leaves
FLOOR = 1e-8  # ... of a small correction: the next one mends it
RIGHT, SHADOW, SEARCH, IMAGE, MOVED, SMOOTHED, OTHER, SOLUTION = range(8)  # rows of `krylov`


@late
def incomplete_factors(flow: CompiledFlow) -> bool:
    """ILU(0) of the Jacobian into `factors`; False where a pivot is too small or negative, or a slope too steep.

    A small one is not trusted where a whole factorisation is at hand, which takes less time than many iterations.
    """
    first, columns, diagonal, factors, place = flow.first, flow.columns, flow.diagonal, flow.factors, flow.place
    for k in range(flow.nnz):
        factors[k] = flow.entries[k]
    for i in range(flow.ns):
        if flow.steep and too_steep(flow, i):
            factors[diagonal[0]] = 0.0
            return False
        start, stop = first[i], first[i + 1]
        largest = 0.0
        for k in range(start, stop):
            place[columns[k]] = k + 1
            if flow.order[columns[k]] < flow.n_own:  # sums in the place of unknowns have units of their own
                largest = max(largest, abs(factors[k]))
        largest = largest if flow.order[i] < flow.n_own else 1.0  # their rows say sum - terms = 0
        for k in range(start, diagonal[i]):
            row = columns[k]
            factor = factors[k] * factors[diagonal[row]]
            factors[k] = factor
            for m in range(diagonal[row] + 1, first[row + 1]):
                at = place[columns[m]]
                if at > 0:
                    factors[at - 1] -= factor * factors[m]
        for k in range(start, stop):
            place[columns[k]] = 0
        pivot = factors[diagonal[i]]
        if not pivot > (0.0 if flow.too_large else LEAST_PIVOT * largest):
            factors[diagonal[0]] = 0.0  # no inverse pivot: what stands here is half made
            return False
        factors[diagonal[i]] = 1.0 / pivot  # the inverse is kept
    return True


@rare
def too_steep(flow: CompiledFlow, i: int) -> bool:
    """Has equation i a slope, in units of the unknowns, that is next to infinite, as that of sqrt(q) at 0? Newton's
    correction is 0 there, however much is left of the equation, and others may converge beside it."""
    scale, steepest = flow.inverse_sizes, 0.0
    for k in range(flow.first[i], flow.first[i + 1]):
        steepest = max(steepest, abs(flow.entries[k]) / scale[flow.order[flow.columns[k]]])
    return steepest * float(scale[flow.order[i]]) > STEEPEST


@rare
def precondition(flow: CompiledFlow, right: Floats, solution: Floats) -> None:
    """solution = (L U)^-1 right, by the incomplete factors."""
    for i in range(flow.ns):
        solution[i] = forward(flow, i, right[i], solution)
    for i in range(flow.ns - 1, -1, -1):
        solution[i] = backward(flow, i, solution)


def forward(flow: CompiledFlow, i: int, right: float, solution: Floats) -> float:
    """Entry i of L^-1 right, from those before it in `solution`."""
    for k in range(flow.first[i], flow.diagonal[i]):
        right -= flow.factors[k] * solution[flow.columns[k]]
    return right


def backward(flow: CompiledFlow, i: int, solution: Floats) -> float:
    """Entry i of U^-1 solution, from those behind it."""
    total: float = solution[i]
    for k in range(flow.diagonal[i] + 1, flow.first[i + 1]):
        total -= flow.factors[k] * solution[flow.columns[k]]
    return total * float(flow.factors[flow.diagonal[i]])


@rare
def multiply(flow: CompiledFlow, x: Floats, solution: Floats) -> None:
    """solution = J x."""
    first, columns, entries = flow.first, flow.columns, flow.entries
    for i in range(flow.ns):
        total = 0.0
        for k in range(first[i], first[i + 1]):
            total += entries[k] * x[columns[k]]
        solution[i] = total


@late
def krylov(flow: CompiledFlow, tolerance: float) -> bool:
    """BiCGStab (van der Vorst 1992) for J x = krylov[RIGHT], preconditioned, into krylov[SOLUTION]; did it converge?"""
    k: Matrix = flow.krylov
    r, shadow, p, v, y, z, t, x = k[RIGHT], k[SHADOW], k[SEARCH], k[IMAGE], k[MOVED], k[SMOOTHED], k[OTHER], k[SOLUTION]
    n = flow.ns
    copy_into(shadow, r)
    fill(x, 0.0)
    fill(p, 0.0)
    fill(v, 0.0)
    before, alpha, omega = 1.0, 1.0, 1.0
    size = dot(r, r)
    goal = tolerance * tolerance * size
    if not size < np.inf:
        return False
    for _ in range(flow.krylov_steps):
        if size <= goal:
            return True
        rho = dot(shadow, r)
        beta = (rho / before) * (alpha / omega)
        for i in range(n):
            p[i] = r[i] + beta * (p[i] - omega * v[i])
        precondition(flow, p, y)
        multiply(flow, y, v)
        alpha = rho / dot(shadow, v)
        for i in range(n):
            r[i] -= alpha * v[i]
            x[i] += alpha * y[i]
        size = dot(r, r)
        if size <= goal:
            return True
        precondition(flow, r, z)
        multiply(flow, z, t)
        omega = dot(t, r) / dot(t, t)
        for i in range(n):
            x[i] += omega * z[i]
            r[i] -= omega * t[i]
        size = dot(r, r)
        before = rho
        if not size < np.inf:
            return False
    return size <= goal


@rare
def factorised(flow: CompiledFlow) -> float:
    """The solutions for krylov[0] and krylov[1] by a whole factorisation, into `solved`; the determinant's sign."""
    call(flow.factorise, flow.entries, flow.krylov, flow.solved)
    return float(flow.solved[2 * flow.ns])


@rare
def sparse_stuck(flow: CompiledFlow) -> bool:
    """Is an equation with too steep a slope not solved? Of the residual and Jacobian in `derivatives`."""
    for i in range(flow.ns):
        at = flow.order[i]
        if abs(flow.residual[at]) * flow.inverse_sizes[at] > SOLVED and too_steep(flow, i):
            return True
    return False


@rare
def sparse_correction(flow: CompiledFlow, tolerance: float, fresh: bool) -> float:
    """Newton's correction into d[:nx]; returns the sign of the determinant, 1 where the incomplete factors do.

    Of the residual and Jacobian in `derivatives`. fresh: make new incomplete factors, as without any.
    """
    n, order = flow.ns, flow.order
    right, solution = flow.krylov[RIGHT], flow.krylov[SOLUTION]
    for i in range(n):
        right[i] = -flow.residual[order[i]]
    stale = not fresh and flow.factors[flow.diagonal[0]] > 0.0
    if (stale or incomplete_factors(flow)) and krylov(flow, tolerance):
        corrected(flow, solution)
        return 1.0
    if flow.too_large or (flow.steep and sparse_stuck(flow)):
        flow.kept.lost += 1.0
        return 0.0
    for i in range(n):
        right[i] = -flow.residual[order[i]]
    fill(flow.krylov[SHADOW], 0.0)
    sign = factorised(flow)
    corrected(flow, flow.solved)
    return sign


def corrected(flow: CompiledFlow, solution: Floats) -> None:
    """The solution of the linear system into d. Of shared numbers, which the others make, 0: next to a start at which
    they are 0/0 they may move by 1e16, beside which any other correction would seem to be the last."""
    for i in range(flow.ns):
        at = flow.order[i]
        flow.d[at] = solution[i] if at < flow.n_own else 0.0


@late
def sparse_iterate(flow: CompiledFlow, tolerance: float, fresh: bool) -> float:
    """Residual and Jacobian at x, the correction into d[:nx], temperatures behind as `newton` reads them; the sign. See
    `sparse_correction`."""
    call(flow.iterate, flow.w, flow.x, flow.derivatives)
    for i in range(flow.npos):
        flow.temperatures[i] = flow.derivatives[flow.nx + flow.nnz + i]
    return sparse_correction(flow, tolerance, fresh)


@late
def sparse_bordered(flow: CompiledFlow, t: Floats, eta: float) -> float:
    """As `linearise`, where the Jacobian is sparse: the border is eliminated. At x; returns the sign of det B."""
    n, order, scale = flow.nx, flow.order, flow.scale
    call(flow.iterate, flow.w, flow.x, flow.derivatives)
    call(flow.full, flow.w, flow.x, flow.direction)
    for i in range(n):
        at = order[i]
        shift = flow.shift[at] if at < flow.n_own else 0.0
        flow.krylov[0, i] = -(flow.residual[at] + (1.0 - eta) * shift)
        flow.krylov[1, i] = flow.direction[at] * flow.h - shift
    sign = factorised(flow)
    along, across = 0.0, t[n]
    for i in range(n):
        at = order[i]
        size = scale[at] if at < flow.n_own else 0.0  # as in `corrected`
        flow.correction[at], flow.direction[at] = flow.solved[i] * size, flow.solved[n + i] * size
        along += t[at] * flow.correction[at]
        across -= t[at] * flow.direction[at]
    last = -along / across
    for i in range(n):
        flow.correction[i] -= last * flow.direction[i]
        flow.direction[i] = -flow.direction[i] / across
    flow.correction[n], flow.direction[n] = last, 1.0 / across
    return sign if across > 0.0 else -sign if across < 0.0 else 0.0
