"""The matrices that iterations are solved with: Jacobians of the vector field at the start of a step.

A correction dU of rates obeys (I - hA x J) dU = N - U, which the eigenvectors of A take apart into one system I - hzJ
of complex numbers for each pair of its eigenvalues z. Their factors are found once a step. No pivoting: what dissipates
takes from one what it gives to others, so these matrices are as good as diagonally dominant. They are sparse
(`sparse`). Most steps need the block (any_system.py), `Work.sparse`; where the others are too fast
for a fixed point it is all of them, `Work.whole`, which eliminates the positions first.
"""

from __future__ import annotations

from tcbench.compiler.language import Floats, call, copy_into, fill, rare

from . import sparse
from .memory import Work
from .sparse import Sparse

TURNS, EARLY = 8, 4  # of the power method for a large one, and those that are not counted
STIFF = 0.1  # decay times in a step from which on the block is solved for


@rare
def set_matrix(w: Work, z: Floats) -> None:
    """The block at any z."""
    if w.to_matrix != 0:
        call(w.to_matrix, z, w.c, w.sparse.values)
        return
    call(w.to_start, z, w.c, w.end)
    copy_into(w.sparse.values, w.end[len(w.end) - len(w.entries) :])


@rare
def rate_of(w: Work, z: Floats, turns: int, early: int) -> float:
    """The fastest at z of the block: see `sparse.fastest`."""
    set_matrix(w, z)
    return sparse.fastest(w.sparse, turns, early)


def prepare(w: Work, h: float, z: Floats) -> None:
    """Factors of the block for steps of length h from z; on vectors always, else if it is stiff."""
    w.stiff[0], w.stiff[3], w.stiff[4] = h, 0.0, 0.0
    if w.n_lanes > 0:
        w.stiff[2] = 1.0
        call(w.to_factor, w.entries, w.stiff, w.factors)
    elif stiff(w, h, z):
        w.stiff[2] = 1.0
        factor(w, w.sparse, h)
    else:
        w.stiff[2] = 0.0


@rare
def prepare_whole(w: Work, h: float, z: Floats) -> None:
    """The same of all variables."""
    call(w.to_whole, z, w.c, w.whole.values)
    factor(w, w.whole, h)
    w.stiff[4] = 1.0


@rare
def stiff(w: Work, h: float, z: Floats) -> bool:
    """Is the block too fast for a fixed point? It is set."""
    s = w.sparse
    if w.to_matrix == 0:
        copy_into(s.values, w.entries)
        return h * w.entries[s.n_values] > STIFF
    call(w.to_matrix, z, w.c, s.values)
    sparse.set_noise(s, z, w.start[w.m :])
    return h * sparse.fastest(s, TURNS, EARLY) * w.numbers.largest > s.bound


@rare
def prepare_anew(w: Work, h: float, z: Floats) -> None:
    """Factors of the block at any z, whether or not it seemed stiff."""
    set_matrix(w, z)
    w.stiff[0], w.stiff[2], w.stiff[3] = h, 1.0, -1.0
    if w.n_lanes > 0:
        call(w.to_factor, w.sparse.values, w.stiff, w.factors)
    else:
        factor(w, w.sparse, h)


@rare
def factor(w: Work, s: Sparse, h: float) -> None:
    """LU factors for each pair of eigenvalues of A."""
    for j in range(w.numbers.pairs):
        sparse.factor(s, j, h * w.numbers.eigen_re[j], h * w.numbers.eigen_im[j])


@rare
def keep(w: Work) -> None:
    """Note U before an iteration."""
    for i in range(w.m):
        for l in range(w.k):
            w.before[i, l] = w.U[i, l]


@rare
def correct(w: Work, s: Sparse, first: int) -> None:
    """U = what it was + (I - hA x J)^-1 (N - what it was) for those from the first on, of which those before U, the
    positions, miss nothing."""
    c = w.numbers
    for i in range(s.size):
        for j in range(c.pairs):
            x, y = 0.0, 0.0
            for l in range(w.k if first + i >= 0 else 0):
                change = w.N[first + i, l] - w.before[first + i, l]
                x += c.into_re[j, l] * change
                y += c.into_im[j, l] * change
            w.vector[2 * j, i], w.vector[2 * j + 1, i] = x, y
    for j in range(c.pairs):
        sparse.solve(s, j, w.vector[2 * j], w.vector[2 * j + 1])
    for i in range(max(0, -first), s.size):
        for l in range(w.k):
            total = w.before[first + i, l]
            for j in range(c.pairs):
                total += c.back_re[l, j] * w.vector[2 * j, i] - c.back_im[l, j] * w.vector[2 * j + 1, i]
            w.U[first + i, l] = total


@rare
def damp(w: Work, s: Sparse, first: int, defects: Floats) -> None:
    """(I - hJ)^-1 of the defects of U's variables, in place: what the flow leaves of them. See `correct`."""
    x, y = w.vector[0], w.vector[1]
    fill(y, 0.0)
    for i in range(s.size):
        x[i] = defects[first + i] if first + i >= 0 else 0.0
    sparse.solve(s, w.numbers.pairs, x, y)
    for i in range(max(0, -first), s.size):
        defects[first + i] = x[i]
