"""Adaptive collocation in extended precision: Gauss and Radau IIA of any number of stages.

Two methods that share no node and no coefficient, for references of any smooth z' = rhs(z).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .precision import EPS, LONG, long_number

Change = Callable[[NDArray[Any]], NDArray[Any]]

MOST_STEPS, MOST_ITERATIONS = 200_000, 40
SOLVED, SOLVED_IN_DOUBLES = 1e-19, 1e-14  # what an iteration may leave
NOISE, NOISE_IN_DOUBLES = 50.0, 1e-10  # slow progress is round-off below: so many of the rate's; where it only steers


class InDoubles(Protocol):
    """An autonomous right-hand side in doubles: of a state (m,), of states (s, m) at once, and its Jacobian (m, m)."""

    def rate(self, t: float, z: NDArray[np.float64]) -> NDArray[np.float64]: ...
    def rows(self, z: NDArray[np.float64]) -> NDArray[np.float64]: ...
    def jacobian(self, t: float, z: NDArray[np.float64]) -> NDArray[np.float64]: ...


class ReferenceFailed(RuntimeError):
    """No reference could be computed; the message says where it stopped and what to change."""


@dataclass(frozen=True, eq=False)
class Tableau:
    """A collocation method: nodes c (s,), matrix A (s, s), weights b (s,), and stage values -> Legendre."""

    name: str
    c: NDArray[Any]
    A: NDArray[Any]
    b: NDArray[Any]
    legendre: NDArray[np.float64]

    def extrapolation(self, ratio: float) -> NDArray[np.float64]:
        """(s, s) matrix taking stage values of the last step to those of the next, `ratio` times as long."""
        x = 1 + ratio * self.c.astype(float)
        return np.polynomial.legendre.legvander(2 * x - 1, len(x) - 1) @ self.legendre


def _legendre(n: int, x: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """P_n and P_n' at x in the precision of x, by the three-term recurrence."""
    p0, p1 = np.ones_like(x), x
    d0, d1 = np.zeros_like(x), np.ones_like(x)
    for k in range(1, n):
        p0, p1 = p1, ((2 * k + 1) * x * p1 - k * p0) / (k + 1)
        d0, d1 = d1, d0 + (2 * k + 1) * p0
    return p1, d1


def gauss_nodes(s: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Gauss-Legendre nodes and weights on [0, 1] in extended precision, polished by Newton."""
    x = np.polynomial.legendre.leggauss(s)[0].astype(LONG)
    for _ in range(3):
        p, d = _legendre(s, x)
        x = x - p / d
    d = _legendre(s, x)[1]
    return (1 + x) / 2, 1 / ((1 - x * x) * d * d)


def lagrange(nodes: NDArray[Any], x: NDArray[Any]) -> NDArray[Any]:
    """The Lagrange polynomials of s nodes at x (m,), shape (m, s), in extended precision."""
    factors = np.ones((len(x), len(nodes)), LONG)
    for j in range(len(nodes)):
        for k in range(len(nodes)):
            if k != j:
                factors[:, j] *= (x - nodes[k]) / (nodes[j] - nodes[k])
    return factors


@lru_cache(maxsize=8)
def tableau(kind: str, s: int) -> Tableau:
    """Gauss (order 2s) or Radau IIA (order 2s - 1) with s stages, in extended precision.

    Hairer, Norsett & Wanner, Solving ODEs I, II.7 and IV.5: nodes are the zeros of P_s (Gauss) or P_s -
    P_{s-1} (Radau IIA, right end included); a_ij is the integral of the j-th Lagrange polynomial over [0,
    c_i].
    """
    g, w = gauss_nodes(s)
    if kind == "gauss":
        c = g
    elif kind == "radau":
        series = np.zeros(s + 1)
        series[s], series[s - 1] = 1, -1
        x = np.sort(np.polynomial.legendre.legroots(series).real).astype(LONG)
        for _ in range(3):
            (p, d), (p_, d_) = _legendre(s, x), _legendre(s - 1, x)
            x = x - (p - p_) / (d - d_)
        x[-1] = long_number(1)
        c = (1 + x) / 2
    else:
        raise ValueError(f"Unknown collocation '{kind}'. Known: gauss, radau.")
    A = np.array([ci * (w @ lagrange(c, ci * g)) for ci in c])
    vandermonde = np.polynomial.legendre.legvander(2 * c.astype(float) - 1, s - 1)
    return Tableau(f"{kind} {s}-stage", c, A, w @ lagrange(c, g), np.linalg.inv(vandermonde))


def integrate(
    method: Tableau,
    rhs: Change,
    in_doubles: InDoubles,
    z0: ArrayLike,
    times: Sequence[float],
    tolerance: float = 1e-12,
    max_seconds: float = 300.0,
    least: Any = 1.0,
) -> NDArray[Any]:
    """States of z' = rhs(z) at `times` (increasing, from t = 0) by adaptive collocation, shape (len(times), m).

    rhs is called with extended arrays of shape (m, s), all stages at once. in_doubles: the same in doubles; Newton's
    iterations begin with it, and it decides nothing. `tolerance` bounds
    h |last Legendre coefficient of dz/dt| / max(least, |z|) on each step. The end point is far more accurate than that
    (superconvergence), except in a stiff component, where it is about that.
    """
    z = np.asarray(z0, LONG)
    solve = _Stages(method, lambda Z: rhs(Z.T).T, in_doubles, least)
    t, h, s = long_number(0), long_number(1e-3), len(method.c)
    last: tuple[NDArray[Any], Any] | None = None  # stage derivatives of the last step and its length
    states, steps, deadline = [], 0, time.monotonic() + max_seconds
    for end in times:
        while t < end:
            steps += 1
            if steps > MOST_STEPS or time.monotonic() > deadline or h < 1e-14 * end:
                raise ReferenceFailed(
                    f"{method.name} collocation stopped at t = {float(t):.6g} of {end:g} after "
                    f"{steps - 1} tries with h = {float(h):.2g}. Give the scenario a smaller t_converge: "
                    "references are for systems of some hundreds of numbers, and short times."
                )
            remaining = long_number(end) - t
            # Halving what is left avoids a tiny last step, whose extrapolated guess would be poor.
            step = remaining if remaining <= h * long_number(1.01) else min(h, remaining / 2)
            guess = None if last is None else method.extrapolation(float(step / last[1])) @ last[0]
            K = solve(z, step, guess)
            if K is None:
                h, last = step / 4, None
                continue
            tail = np.abs(method.legendre[-1] @ K.astype(float))
            error = float(step) * float(np.max(tail / np.maximum(least, np.abs(z.astype(float)))))
            factor = min(3.0, 0.85 * (tolerance / max(error, 1e-300)) ** (1 / s))
            h = (
                step * long_number(max(0.2, factor))
                if step == remaining or factor < 1
                else max(h, step * long_number(factor))
            )
            if error > 5 * tolerance:
                last = None
                continue
            t = long_number(end) if step == remaining else t + step
            z, last = z + step * (method.b @ K), (K, step)
        states.append(z)
    return np.array(states)


class _Stages:
    """Stage derivatives K = f(z + h A K) by simplified Newton, shape (s, m).

    The linear algebra is done in doubles, and so are the first iterations: they only steer, the residual in extended
    precision decides.
    """

    def __init__(self, method: Tableau, f: Change, in_doubles: InDoubles, least: Any) -> None:
        self.method, self.f, self.in_doubles, self.A = method, f, in_doubles, method.A.astype(float)
        self.least = least

    def __call__(self, z: NDArray[Any], h: Any, guess: NDArray[Any] | None) -> NDArray[Any] | None:
        """From a guess, by default the rate at z; None when it does not converge."""
        size, rates, start, step = np.maximum(self.least, np.abs(z)), self.in_doubles.rows, z.astype(float), float(h)
        K = np.repeat(self.f(z[None, :]), len(self.A), axis=0) if guess is None else guess
        with np.errstate(all="ignore"):
            correct = self._correction(z + step * (self.A[len(self.A) // 2] @ K), step)
            if correct is None:
                return None
            rough = lambda K: rates(start + step * (self.A @ K)) - K  # noqa: E731
            scale, stop = step / size.astype(float), (SOLVED_IN_DOUBLES, NOISE_IN_DOUBLES)
            found, gain = _newton(rough, correct, K.astype(float), scale, *stop, 1.0)
            K, gain = (K, 1.0) if found is None else (found, gain)
            exact = lambda K: self.f(z + h * (self.method.A @ K)) - K  # noqa: E731
            return _newton(exact, correct, K.astype(LONG), h / size, SOLVED, NOISE * EPS, gain)[0]

    def _correction(self, z: NDArray[Any], h: float) -> Change | None:
        """Of K for a residual, with the Jacobian at z; None where that is not finite."""
        from scipy.linalg.lapack import dgetrf, dgetrs

        J = self.in_doubles.jacobian(0.0, z.astype(float))
        if not np.all(np.isfinite(J)):
            return None
        size = len(self.A) * len(z)
        matrix = (-h * self.A[:, None, :, None] * J[:, None, :]).reshape(size, size)
        matrix.flat[:: size + 1] += 1.0
        lu, pivots, _ = dgetrf(matrix)
        return lambda residual: dgetrs(lu, pivots, residual.astype(float).ravel())[0].reshape(residual.shape)


def _newton(
    residual: Change, correction: Change, K: NDArray[Any], weights: Any, enough: float, noise: float, gain: float
) -> tuple[NDArray[Any] | None, float]:
    """K without a residual, None where the iteration does not converge; and its last correction over the one before.

    It ends where the next correction would be less than `enough`, or less than `noise` while none is half the last.
    gain : that ratio in the iterations before, 1 if there were none.
    """
    previous = np.inf
    for _ in range(MOST_ITERATIONS):
        left = residual(K)
        if not np.all(np.isfinite(left)):
            return None, gain
        dK = correction(left)
        K = K + dK
        delta = float(np.max(np.abs(dK) * weights))
        gain = gain if previous == np.inf else delta / max(previous, 1e-300)
        if delta * min(gain, 1.0) < enough or (delta < noise and gain > 0.5):
            return K, gain
        if gain > 2.0:
            return None, gain
        previous = delta
    return None, gain
