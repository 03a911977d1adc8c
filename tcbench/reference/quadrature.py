"""Gauss's rule and Lagrange polynomials on [0, 1], in np.longdouble so that coefficients of methods are rounded once.

Hairer, Norsett & Wanner, Solving ODEs I, II.7.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Longs = NDArray[Any]


def legendre(n: int, x: Longs) -> tuple[Longs, Longs]:
    """P_n and P_n' at x (m,), shape (m,) each, by the three-term recurrence."""
    p0, p1 = np.ones_like(x), x
    d0, d1 = np.zeros_like(x), np.ones_like(x)
    for k in range(1, n):
        p0, p1 = p1, ((2 * k + 1) * x * p1 - k * p0) / (k + 1)
        d0, d1 = d1, d0 + (2 * k + 1) * p0
    return p1, d1


def gauss(s: int) -> tuple[Longs, Longs]:
    """Nodes and weights of the rule with s points, shape (s,) each; exact for polynomials of degree 2s - 1."""
    x = np.polynomial.legendre.leggauss(s)[0].astype(np.longdouble)
    for _ in range(3):
        p, d = legendre(s, x)
        x = x - p / d
    d = legendre(s, x)[1]
    return (1 + x) / 2, 1 / ((1 - x * x) * d * d)


def lagrange(nodes: Longs, x: ArrayLike) -> Longs:
    """The polynomials that are 1 at one of s nodes and 0 at the others, at x (m,): shape (m, s)."""
    x = np.asarray(x, np.longdouble)
    factors = np.ones((len(x), len(nodes)), np.longdouble)
    for j in range(len(nodes)):
        for k in range(len(nodes)):
            if k != j:
                factors[:, j] *= (x - nodes[k]) / (nodes[j] - nodes[k])
    return factors


def integrals(nodes: Longs, x: Longs) -> Longs:
    """The integrals of these polynomials from 0 to x (m,), shape (m, s): at the nodes a collocation's matrix."""
    inner, weights = gauss(len(nodes))
    return np.array([end * (weights @ lagrange(nodes, end * inner)) for end in x])
