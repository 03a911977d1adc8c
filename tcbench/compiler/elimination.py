"""Symbolic LU of a small Jacobian on the expression graph, without pivoting: no loops, no operations on its zeros."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ..errors import TraceError
from . import derivatives as trace
from .derivatives import Symbol

ZERO_PIVOT = "The residual's Jacobian has a structural zero on its diagonal; reorder the rows."


@dataclass
class Factors:
    """L D U of the Jacobian without pivoting, on the graph; constants stay constants.

    U has ones on its diagonal. Each unknown goes into all equations above it at once: the longest chain of dependent
    operations has n products and sums; row by row it would have n^2/2.
    """

    lower: dict[tuple[int, int], Symbol]
    upper: dict[tuple[int, int], Symbol]
    inverse: list[Symbol]  # of the pivots, D
    marked: bool = False  # factors and unknowns are intermediates

    def solve(self, right: Sequence[Symbol]) -> list[Symbol]:
        """x of L D U x = right, (n,) symbols."""
        b, n = list(right), len(self.inverse)
        for (i, k), factor in self.lower.items():  # ordered by k, then i
            b[i] = trace.sub(b[i], trace.mul(factor, b[k]))
        b = [trace.mul(x, inverse) for x, inverse in zip(b, self.inverse, strict=True)]
        for j in reversed(range(n)):
            b[j] = trace.mark(b[j]) if self.marked else b[j]
            for k in range(j):
                b[k] = trace.sub(b[k], trace.mul(self.upper[k, j], b[j]))
        return b

    def stored(self) -> tuple[Factors, dict[Symbol, Symbol]]:
        """These factors as new input symbols, and the value of each."""
        names: dict[Symbol, Symbol] = {}
        twin: dict[Symbol, Symbol] = {}

        def name(value: Symbol) -> Symbol:
            if value.op == "const":
                return value
            if value not in twin:
                twin[value] = trace.variable("factor")
                names[twin[value]] = value
            return twin[value]

        lower = {key: name(v) for key, v in self.lower.items()}
        upper = {key: name(v) for key, v in self.upper.items()}
        return Factors(lower, upper, [name(v) for v in self.inverse]), names


def factorise(jacobian: Any, symmetric: bool = False, marked: bool = False) -> tuple[Factors, list[Symbol]]:
    """(LU factors without pivoting, pivots) of a Jacobian (n, n); the pivots' signs give that of the determinant.

    symmetric : L is the transpose of U. marked : factors and unknowns are intermediates. TraceError for a pivot 0."""
    n, A = len(jacobian), [list(row) for row in jacobian]
    factors = Factors({}, {}, [], marked)
    for k in range(n):
        if trace.is_const(A[k][k], 0.0):
            raise TraceError(ZERO_PIVOT)
        factors.inverse.append(trace.reciprocal(A[k][k]))
        for j in range(k + 1, n):
            factors.upper[k, j] = trace.mul(A[k][j], factors.inverse[k])
            if marked:
                factors.upper[k, j] = trace.mark(factors.upper[k, j])
        for i in range(k + 1, n):
            if trace.is_const(A[i][k], 0.0):
                continue
            factor = factors.upper[k, i] if symmetric else trace.mul(A[i][k], factors.inverse[k])
            factors.lower[i, k] = factor
            for j in range(i if symmetric else k + 1, n):
                A[i][j] = trace.sub(A[i][j], trace.mul(factor, A[k][j]))
                A[j][i] = A[i][j] if symmetric else A[j][i]
    return factors, [A[k][k] for k in range(n)]
