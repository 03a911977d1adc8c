"""Simplified Newton for stiff conduction among more than two elements, with M = dG/ds (e, e) at the start of a step.

The correction dU (k, e) of the entropy rates solves (I - hA x M) dU = N - U, a Kronecker product. In the eigenvectors
of A it falls apart into (I - h z M) x = r, complex (e, e), one for each pair of eigenvalues z; factors are made once a
step. No pivoting: conduction takes from one element what it gives to others, so these matrices are as good as
diagonally dominant. They are sparse (`sparse`). Of two elements M has rank one, and the kernels on vectors solve for it
(`step`).
"""

from __future__ import annotations

from tcbench.compiler.language import Floats, call, fill, rare

from . import sparse
from .memory import Work

TURNS, EARLY = 8, 4  # of the power method for a large one, and those that are not counted
STIFF = 0.1  # decay times in a step from which on the conduction is solved for


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
    """Factors for steps of length h from z, if its conduction is stiff; else it is left to the iteration."""
    fastest = set_matrix(w, z)
    w.stiff[1] = -fastest
    if w.large:
        sparse.set_noise(w.sparse, z, w.inverse_sizes)
        w.stiff[2] = 1.0 if h * fastest * w.numbers.largest > w.sparse.bound else 0.0
    else:
        w.stiff[2] = 1.0 if h * fastest > STIFF else 0.0
    if w.stiff[2] > 0.0 and w.n_lanes > 0:
        w.stiff[0], w.stiff[3] = h, 0.0
        call(w.to_factor, w.sparse.values, w.stiff, w.factors)
    elif w.stiff[2] > 0.0:
        factor_pairs(w, h)


@rare
def factor_pairs(w: Work, h: float) -> None:
    """LU factors for each pair of eigenvalues of A."""
    for j in range(w.numbers.pairs):
        sparse.factor(w.sparse, j, h * w.numbers.eigen_re[j], h * w.numbers.eigen_im[j])


@rare
def keep(w: Work) -> None:
    """Note the rates of the entropies before an iteration."""
    for i in range(w.e):
        for l in range(w.k):
            w.before[i, l] = w.U[w.n + i, l]


@rare
def correct(w: Work) -> None:
    """U of the entropies = what it was + (I - hA x M)^-1 (N - what it was)."""
    c, n = w.numbers, w.n
    for i in range(w.e):
        for j in range(c.pairs):
            x, y = 0.0, 0.0
            for l in range(w.k):
                change = w.N[n + i, l] - w.before[i, l]
                x += c.into_re[j, l] * change
                y += c.into_im[j, l] * change
            w.vector[2 * j, i], w.vector[2 * j + 1, i] = x, y
    for j in range(c.pairs):
        sparse.solve(w.sparse, j, w.vector[2 * j], w.vector[2 * j + 1])
    for i in range(w.e):
        for l in range(w.k):
            total = w.before[i, l]
            for j in range(c.pairs):
                total += c.back_re[l, j] * w.vector[2 * j, i] - c.back_im[l, j] * w.vector[2 * j + 1, i]
            w.U[n + i, l] = total


@rare
def damp(w: Work, defects: Floats) -> None:
    """(I - hM)^-1 of the entropies' defects, in place: what the flow leaves of them."""
    y = w.vector[1]
    fill(y, 0.0)
    sparse.solve(w.sparse, w.numbers.pairs, defects, y)
