"""Sparse LU of I - (re + i im) M, complex (n, n), without pivoting; its fill is found once, in advance.

A row for each variable; behind them, of a large system, a row for each number that all of an array read, such as a
mean: as an unknown of its own it keeps the matrix sparse. What belongs to one entry alone comes first in the order, so
that it is condensed before the rest. Why no pivots are needed: `conduction`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tcbench.compiler.language import Floats, Matrix, ShortInts, late, rare
from tcbench.compiler.records import Record, sized

EPSILON = 2.0**-53
# iterations that factors cost, and each entry of these that meets its row; contraction above which there is no choice
WORTH, MEETING, MOST_CONTRACTED, DIGITS = 12.0, 0.03, 0.5, 35.0
# unknowns, and their mean distance from those that they see, above both of which no fill is kept
FILLED, NARROW = 10_000, 50.0
SHARED = 10  # times the root of their number: unknowns that see more are of what all share


class Sparse(Record):
    """A matrix of n rows in compressed rows, with room for its fill; 0: the system has none."""

    n: int
    nnz: int
    n_factors: int
    bound: float  # contraction of the iteration without it, above which its factors cost less
    size: int  # of the state: rows in the order from there on are those of shared numbers
    n_values: int
    rows: ShortInts = sized("n + 1")  # its entries, in the order of the state: their first, by rows,
    sees: ShortInts = sized("n_values")  # their columns,
    at: ShortInts = sized("n_values")  # and where they stand in the factors
    values: Floats = sized("n_values + 1")  # -M; of a shared number its row; behind them what is fixed writes
    first: ShortInts = sized("n + 1")  # the factors, in the order of elimination
    columns: ShortInts = sized("nnz")
    diagonal: ShortInts = sized("n")
    order: ShortInts = sized("n")  # their row and column i belong to this unknown
    place: ShortInts = sized("n")  # what is written on
    factors_re: Matrix = sized("n_factors", "nnz")
    factors_im: Matrix = sized("n_factors", "nnz")
    x: Matrix = sized("2", "n")
    noise: Floats = sized("1")  # what the round-off of a state makes of its rates, over the sizes of its numbers


@late
def fastest(s: Sparse, turns: int, early: int) -> float:
    """The size of the largest eigenvalue of M, nearly, by the power method: mean growth, as pairs of them turn, of all
    but the early turns."""
    x, y = s.x[0], s.x[1]
    for i in range(s.size):
        x[i] = 1.0 + 0.5 * (i % 2) - 0.1 * (i % 3)
    for i in range(s.size, s.n):
        x[i] = 0.0
    grown = 1.0
    for turn in range(turns):
        for i in range(s.size, s.n):  # shared numbers, whose rows are 0 and end with their own
            x[i] -= along(s, i, x) / s.values[s.rows[i + 1] - 1]
        largest = 0.0
        for i in range(s.size):
            y[i] = -along(s, i, x)
            largest = max(largest, abs(y[i]))
        if not largest > 0.0:
            return 0.0
        for i in range(s.size):
            x[i] = y[i] / largest
        if turn >= early:
            grown *= largest ** (1.0 / (turns - early))
    return grown


def along(s: Sparse, i: int, x: Floats) -> float:
    """Row i times x."""
    total = 0.0
    for k in range(s.rows[i], s.rows[i + 1]):
        total += s.values[k] * x[s.sees[k]]
    return total


@rare
def set_noise(s: Sparse, z: Floats, inverse_sizes: Floats) -> None:
    """How well the rates at z can be known, from the round-off of its numbers."""
    largest = 0.0
    for i in range(s.size):
        total = 0.0
        for k in range(s.rows[i], s.rows[i + 1]):
            total += abs(s.values[k] * z[s.sees[k]]) if s.sees[k] < s.size else 0.0
        largest = max(largest, total * inverse_sizes[i])
    s.noise[0] = EPSILON * largest


@late
def factor(s: Sparse, which: int, re: float, im: float) -> None:
    """LU factors of I - (re + i im) M, with the reciprocals of the pivots."""
    a, b, first, columns, diagonal, place = (
        s.factors_re[which], s.factors_im[which], s.first, s.columns, s.diagonal, s.place
    )  # fmt: skip
    for i in range(s.n):
        mine = s.order[i]
        own = mine < s.size
        for k in range(first[i], first[i + 1]):
            a[k], b[k] = 0.0, 0.0
            place[columns[k]] = k + 1
        for k in range(s.rows[mine], s.rows[mine + 1]):
            a[s.at[k]] = re * s.values[k] if own else s.values[k]
            b[s.at[k]] = im * s.values[k] if own else 0.0
        a[diagonal[i]] += 1.0 if own else 0.0
        for k in range(first[i], diagonal[i]):
            row, u, v = columns[k], a[k], b[k]
            if u != 0.0 or v != 0.0:
                at = diagonal[row]
                p, q = u * a[at] - v * b[at], u * b[at] + v * a[at]
                a[k], b[k] = p, q
                for m in range(at + 1, first[row + 1]):
                    j = place[columns[m]]
                    if j > 0:
                        a[j - 1] -= p * a[m] - q * b[m]
                        b[j - 1] -= p * b[m] + q * a[m]
        for k in range(first[i], first[i + 1]):
            place[columns[k]] = 0
        at = diagonal[i]
        size = a[at] * a[at] + b[at] * b[at]
        a[at], b[at] = a[at] / size, -b[at] / size


@rare
def solve(s: Sparse, which: int, x: Floats, y: Floats) -> None:
    """x + i y = (factors)^-1 (x + i y)."""
    a, b, u, v = s.factors_re[which], s.factors_im[which], s.x[0], s.x[1]
    for i in range(s.n):
        at = s.order[i]
        re, im = 0.0, 0.0
        if at < s.size:
            re, im = x[at], y[at]
        for k in range(s.first[i], s.diagonal[i]):
            j = s.columns[k]
            re -= a[k] * u[j] - b[k] * v[j]
            im -= a[k] * v[j] + b[k] * u[j]
        u[i], v[i] = re, im
    for m in range(s.n):
        i = s.n - 1 - m
        re, im = u[i], v[i]
        for k in range(s.diagonal[i] + 1, s.first[i + 1]):
            j = s.columns[k]
            re -= a[k] * u[j] - b[k] * v[j]
            im -= a[k] * v[j] + b[k] * u[j]
        k = s.diagonal[i]
        u[i], v[i] = re * a[k] - im * b[k], re * b[k] + im * a[k]
        if s.order[i] < s.size:
            x[s.order[i]], y[s.order[i]] = u[i], v[i]


def sparse(size: int, rows: Any, columns: Any, n: int, n_factors: int) -> tuple[Sparse, Any]:
    """The record of a matrix of n rows with these entries, and where in its values each of them is."""
    keys, places = np.unique(rows * n + columns, return_inverse=True)
    order, filled = elimination(n, keys // n, keys % n)
    fill = filled.nnz / n
    bound = min(MOST_CONTRACTED, math.exp(-DIGITS / (WORTH + MEETING * fill * fill)))
    return _recorded(size, n, keys, order, filled.indptr, filled.indices, n_factors, bound), places


def of_pattern(pattern: Any, n_factors: int) -> Sparse:
    """The record of a small matrix with these entries, eliminated in their own order; of no rows: there is none."""
    n, there = len(pattern), with_fill(pattern)
    keys, first = np.flatnonzero(pattern), np.r_[0, np.cumsum(there.sum(axis=1))]
    return _recorded(n, n, keys, np.arange(n), first, np.nonzero(there)[1], n_factors, 0.0)


def with_fill(pattern: Any) -> Any:
    """Where factors of I and a matrix of these entries have theirs."""
    there = pattern | np.eye(len(pattern), dtype=bool)
    for m in range(len(there)):
        there[m + 1 :, m + 1 :] |= np.outer(there[m + 1 :, m], there[m, m + 1 :])
    return there


def _recorded(
    size: int, n: int, keys: Any, order: Any, first: Any, columns: Any, n_factors: int, bound: float
) -> Sparse:
    """keys: of the entries, row times n + column; first, columns: the factors, in compressed rows."""
    row, sees = keys // n, keys % n
    back = np.empty(n, np.int64)
    back[order] = np.arange(n)
    all_keys = np.repeat(np.arange(n), np.diff(first)) * n + columns
    tables = {
        "rows": np.searchsorted(row, np.arange(n + 1)), "at": np.searchsorted(all_keys, back[row] * n + back[sees]),
        "sees": sees, "first": first, "columns": columns, "order": order,
        "diagonal": np.searchsorted(all_keys, np.arange(n) * (n + 1)),
    }  # fmt: skip
    sizes = {"size": size, "n": n, "nnz": len(all_keys), "n_factors": n_factors, "n_values": len(keys)}
    return Sparse(bound=bound, **sizes, **{name: table.astype(np.int32) for name, table in tables.items()})


def elimination(n: int, rows: Any, columns: Any) -> tuple[Any, Any]:
    """An order of elimination, and the pattern of both factors in it, a sorted csr_matrix.

    First come unknowns that are given by one other, as positions by momenta: they fill nothing but that one's place.
    """
    from scipy.sparse import bmat, coo_matrix, csr_matrix, identity

    ones = np.ones(len(rows) + n)
    pattern = coo_matrix((ones, (np.r_[rows, np.arange(n)], np.r_[columns, np.arange(n)])), shape=(n, n)).tocsr()
    off = (pattern - csr_matrix(pattern.multiply(identity(n)))).tocsr()
    off.eliminate_zeros()
    counts = np.diff(off.indptr)
    given = np.flatnonzero(counts <= 1)
    by = np.full(n, -1)
    by[counts == 1] = off.indices[off.indptr[:-1][counts == 1]]
    chosen = np.zeros(n, bool)
    chosen[given] = True
    chosen[given] = (by[given] < 0) | ~chosen[by[given]] | (given < by[given])
    chosen &= (by < 0) | ~chosen[by]
    early, late = np.flatnonzero(chosen), np.flatnonzero(~chosen)
    of_early, of_late = pattern[early][:, late], pattern[late][:, early]
    rest = (pattern[late][:, late] + of_late @ of_early).tocsc()
    rest.data[:] = np.random.default_rng(0).uniform(0.5, 1.0, rest.nnz)
    rest = (rest + 2.0 * rest.nnz * identity(len(late))).tocsc()
    place, factors = filled(rest)
    whole = bmat([[identity(len(early)), of_early[:, place]], [of_late[place], factors]]).tocsr()
    whole.sort_indices()
    return np.r_[early, late[place]], whole


def filled(matrix: Any) -> tuple[Any, Any]:
    """An order of elimination of a matrix that needs no pivots, and the pattern of its factors; of a large one whose
    factors are no narrow band they are incomplete, without any fill."""
    from scipy.sparse.csgraph import reverse_cuthill_mckee
    from scipy.sparse.linalg import splu

    n = matrix.shape[0]
    alone = np.diff(matrix.indptr) <= SHARED * np.sqrt(n)
    if n > FILLED:
        both = (matrix + matrix.T).tocsr()
        order = reverse_cuthill_mckee(both[alone][:, alone].tocsr(), symmetric_mode=True)
        order = np.r_[np.flatnonzero(alone)[order], np.flatnonzero(~alone)]
        wide = both[order][:, order].tocoo()
        if np.mean(np.abs(wide.row - wide.col)) > NARROW:
            return order, wide
    spec, options = "MMD_AT_PLUS_A" if alone.all() else "COLAMD", {"SymmetricMode": True}
    lu = splu(matrix, permc_spec=spec, diag_pivot_thresh=0.0, relax=1, panel_size=1, options=options)
    return np.argsort(lu.perm_c), abs(lu.L) + abs(lu.U)
