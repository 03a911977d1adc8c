"""The linear system of a step of Gauss collocation: the Jacobian M of the rates, factors of I - h w M for each pair of
eigenvalues w of A, and what they are applied to. Equations: see `step`."""

from __future__ import annotations

from tcbench.compiler.language import Floats, call, fill, late, rare

from . import sparse
from .memory import Work

STIFF = 0.1  # decay times in a step from which on factors are made
TURNS, EARLY = 8, 4  # of the power method for a large one, and those that are not counted


@rare
def set_matrix(w: Work, z: Floats) -> float:
    """M at z; returns the largest sum of a column's sizes, which bounds its rates, or of a large one the fastest."""
    s = w.sparse
    call(w.to_matrix, z, w.c, s.values)
    if w.large:
        return sparse.fastest(s, TURNS, EARLY)
    sums, largest = s.x[0], 0.0
    fill(sums, 0.0)
    for k in range(s.n_values):
        sums[s.sees[k]] += abs(s.values[k])
    for i in range(s.n):
        largest = max(largest, sums[i])
    return largest


@rare
def rate_of(w: Work, z: Floats, turns: int, early: int) -> float:
    """The fastest at z: see `sparse.fastest`."""
    fastest = set_matrix(w, z)
    return fastest if w.large else sparse.fastest(w.sparse, turns, early)


@rare
def prepare(w: Work, h: float, z: Floats) -> None:
    """Factors for steps of length h from z, if its rates are stiff; else they are left to the iteration."""
    fastest = set_matrix(w, z)
    if w.large:
        sparse.set_noise(w.sparse, z, w.inverse_sizes)
        w.solve.stiff = h * fastest * w.numbers.largest > w.sparse.bound
    else:
        w.solve.stiff = h * fastest > STIFF
    if w.solve.stiff:
        factor(w, h)


@rare
def factor(w: Work, h: float) -> None:
    """LU factors for each pair of eigenvalues of A."""
    for j in range(w.numbers.pairs):
        sparse.factor(w.sparse, j, h * w.numbers.eigen_re[j], h * w.numbers.eigen_im[j])


@rare
def renew(w: Work, h: float, z: Floats) -> None:
    """The matrix of all variables anew, at the mean of the stages as they are by now."""
    for i in range(w.m):
        total = 0.0
        for j in range(w.k):
            for l in range(w.k):
                total += w.numbers.A[j, l] * w.U[i, l]
        w.z1[i] = z[i] + h * total / w.k
    w.solve.whole = True
    if not w.large:
        prepare(w, h, w.z1)
        return
    call(w.to_matrix, w.z1, w.c, w.sparse.values)  # of a large system whether or not it seemed stiff
    w.solve.stiff = True
    factor(w, h)


@late
def solve_stages(w: Work) -> None:
    """U = what it was + (I - hA x M)^-1 (N - what it was)."""
    c = w.numbers
    for i in range(w.m):
        for j in range(c.pairs):
            x, y = 0.0, 0.0
            for l in range(w.k):
                change = w.N[i, l] - w.before[i, l]
                x += c.into_re[j, l] * change
                y += c.into_im[j, l] * change
            w.vector[2 * j, i], w.vector[2 * j + 1, i] = x, y
    for j in range(c.pairs):
        sparse.solve(w.sparse, j, w.vector[2 * j], w.vector[2 * j + 1])
    for i in range(w.m):
        for l in range(w.k):
            total = w.before[i, l]
            for j in range(c.pairs):
                total += c.back_re[l, j] * w.vector[2 * j, i] - c.back_im[l, j] * w.vector[2 * j + 1, i]
            w.U[i, l] = total


@late
def damp(w: Work, h: float) -> None:
    """(I - hM)^-1 of the two columns of `sides`, in place: what the flow leaves of defects."""
    if w.n_lanes > 0:
        call(w.to_damp, w.factors, w.c, w.sides)
        return
    sparse.factor(w.sparse, w.numbers.pairs, h, 0.0)
    x, y = w.vector[0], w.vector[1]
    for i in range(w.m):
        x[i], y[i] = w.sides[i, 0], w.sides[i, 1]
    sparse.solve(w.sparse, w.numbers.pairs, x, y)
    for i in range(w.m):
        w.sides[i, 0], w.sides[i, 1] = x[i], y[i]
