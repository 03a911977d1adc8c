"""Stiff conduction among more than two elements: its matrix M = dG/ds at the start of a step, solved for in iterations.

A correction dU of the rates of the entropies obeys (I - hA x M) dU = N - U, which the eigenvectors of A take apart into
one system I - hzM of complex numbers for each pair of its eigenvalues z. Their factors are found once a step. No
pivoting: conduction takes from one element what it gives to others, so these matrices are as good as diagonally
dominant. Matrices stand by columns, along which all loops go; those of large systems are sparse (`sparse`). Of two
elements the conduction is a matrix of rank one, which the kernels on vectors solve for (`step`).
"""

from __future__ import annotations

import math

from tcbench.compiler.language import Floats, call, fill, rare

from . import sparse
from .memory import Work

STIFF = 0.1  # decay times in a step from which on the conduction is solved for


@rare
def set_matrix(w: Work, z: Floats) -> float:
    """M at z; returns the largest sum of a column's sizes, which bounds its rates, or of a large one the fastest."""
    if w.sparse.n > 0:
        call(w.to_matrix, z, w.c, w.sparse.values)
        return sparse.fastest(w.sparse)
    call(w.to_matrix, z, w.c, w.entries)
    largest = 0.0
    for j in range(w.e):
        total = 0.0
        for i in range(w.e):
            total += abs(w.matrix[j, i])
        largest = max(largest, total)
    return largest


@rare
def rate_of(w: Work, z: Floats, turns: int, settled: int) -> float:
    """The fastest at z, by the power method, which goes round in circles where that is a motion: the mean growth of
    its turns from the settled one on."""
    rate, e = set_matrix(w, z), w.e
    if w.sparse.n > 0:
        return rate
    x, y = w.vector[0], w.vector[1]
    for i in range(e):
        x[i] = 1.0 + 0.5 * (i % 2) - 0.1 * (i % 3)
    grown = 1.0
    for turn in range(turns):
        fill(y, 0.0)
        for j in range(e):
            for i in range(e):
                y[i] += w.matrix[j, i] * x[j]
        largest = 1e-300
        for i in range(e):
            largest = max(largest, abs(y[i]))
        for i in range(e):
            x[i] = y[i] / largest
        if turn >= settled:
            grown *= largest ** (1.0 / (turns - settled))
    return grown


@rare
def prepare(w: Work, h: float, z: Floats) -> None:
    """Factors for steps of length h from z, if its conduction is stiff; else it is left to the iteration."""
    fastest = set_matrix(w, z)
    w.stiff[1] = -fastest
    if w.sparse.n > 0:
        sparse.set_noise(w.sparse, z, w.start[w.m :])
        w.stiff[2] = 1.0 if h * fastest * largest_eigenvalue(w) > w.sparse.bound else 0.0
    else:
        w.stiff[2] = 1.0 if h * fastest > STIFF else 0.0
    if w.stiff[2] > 0.0 and w.n_lanes > 0:
        w.stiff[0], w.stiff[3] = h, 0.0
        call(w.to_factor, w.entries, w.stiff, w.factors)
    elif w.stiff[2] > 0.0:
        factor_pairs(w, h)


@rare
def factor_pairs(w: Work, h: float) -> None:
    """LU factors for each pair of eigenvalues of A."""
    for j in range(w.numbers.pairs):
        factor(w, j, h * w.numbers.eigen_re[j], h * w.numbers.eigen_im[j])


@rare
def largest_eigenvalue(w: Work) -> float:
    """The size of the largest of A's."""
    largest = 0.0
    for j in range(w.numbers.pairs):
        largest = max(largest, math.hypot(w.numbers.eigen_re[j], w.numbers.eigen_im[j]))
    return largest


@rare
def factor(w: Work, which: int, re: float, im: float) -> None:
    """LU factors of I - (re + i im) M, with the reciprocals of the pivots."""
    if w.sparse.n > 0:
        sparse.factor(w.sparse, which, re, im)
        return
    a, b, e = w.factors_re[which], w.factors_im[which], w.e
    for j in range(e):
        for i in range(e):
            a[j, i] = (1.0 if i == j else 0.0) - re * w.matrix[j, i]
            b[j, i] = -im * w.matrix[j, i]
    for m in range(e):
        size = a[m, m] * a[m, m] + b[m, m] * b[m, m]
        p, q = a[m, m] / size, -b[m, m] / size
        a[m, m], b[m, m] = p, q
        for i in range(m + 1, e):
            a[m, i], b[m, i] = a[m, i] * p - b[m, i] * q, a[m, i] * q + b[m, i] * p
        for j in range(m + 1, e):
            u, v = a[j, m], b[j, m]
            if u != 0.0 or v != 0.0:
                for i in range(m + 1, e):
                    a[j, i] -= a[m, i] * u - b[m, i] * v
                    b[j, i] -= a[m, i] * v + b[m, i] * u


@rare
def solve(w: Work, which: int, x: Floats, y: Floats) -> None:
    """x + i y = (factors)^-1 (x + i y)."""
    if w.sparse.n > 0:
        sparse.solve(w.sparse, which, x, y)
        return
    a, b, e = w.factors_re[which], w.factors_im[which], w.e
    for j in range(e):
        u, v = x[j], y[j]
        for i in range(j + 1, e):
            x[i] -= a[j, i] * u - b[j, i] * v
            y[i] -= a[j, i] * v + b[j, i] * u
    for m in range(e):
        j = e - 1 - m
        u, v = x[j] * a[j, j] - y[j] * b[j, j], x[j] * b[j, j] + y[j] * a[j, j]
        x[j], y[j] = u, v
        for i in range(j):
            x[i] -= a[j, i] * u - b[j, i] * v
            y[i] -= a[j, i] * v + b[j, i] * u


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
        solve(w, j, w.vector[2 * j], w.vector[2 * j + 1])
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
    solve(w, w.numbers.pairs, defects, y)
