"""Sums that keep what rounding drops, and a small elimination with pivoting. In the restricted Python."""

from __future__ import annotations

from ..compiler.language import Floats, Matrix, copy_into

STEEPEST = 1e16  # a slope that makes round-off of an unknown an error of 1 in its equation: as good as infinite
SOLVED = 1e-12  # what may be left of such an equation, scaled


def dot(x: Floats, y: Floats) -> float:
    total = 0.0
    for i in range(len(x)):
        total += x[i] * y[i]
    return total


def solve_pivoted(A: Matrix, n: int, last: int) -> float:
    """Solve A[:n, :n] Y = A[:n, n:last] by elimination with partial pivoting; Y in place of the right-hand sides.

    Returns the sign of the determinant (0: singular).
    """
    sign = 1.0
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(A[i, k]) > abs(A[pivot, k]):
                pivot = i
        if not abs(A[pivot, k]) > 0.0:
            return 0.0
        if pivot != k:
            sign = -sign
            for j in range(k, last):
                A[k, j], A[pivot, j] = A[pivot, j], A[k, j]
        if A[k, k] < 0.0:
            sign = -sign
        for i in range(k + 1, n):
            factor = A[i, k] / A[k, k]
            for j in range(k + 1, last):
                A[i, j] -= factor * A[k, j]
    for k in range(n - 1, -1, -1):
        for column in range(n, last):
            total = A[k, column]
            for j in range(k + 1, n):
                total -= A[k, j] * A[j, column]
            A[k, column] = total / A[k, k]
    return sign


def add_compensated(z: Floats, dz: Floats, carry: Floats) -> None:
    """z += dz, with what rounding drops kept in `carry` (Neumaier): momenta stay exact over thousands of steps."""
    move(z, carry, dz, z, carry)


def move(z: Floats, carry: Floats, dz: Floats, after: Floats, dropped: Floats) -> None:
    """after = z + dz, with what rounding dropped before in `carry` and what it drops now in `dropped`."""
    for i in range(len(z)):
        term = dz[i] + carry[i]
        total = z[i] + term
        back = total - z[i]
        dropped[i] = (z[i] - (total - back)) + (term - back)
        after[i] = total


def add_increments(z: Floats, increments: Matrix, carry: Floats, states: Matrix) -> None:
    """States after each of the increments from z, which becomes the last of them."""
    for i in range(len(increments)):
        add_compensated(z, increments[i], carry)
        copy_into(states[i], z)
