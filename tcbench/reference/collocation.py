"""Adaptive collocation, Radau IIA of any number of stages, in doubles: for stiff and other equations that the series of
`pairs` cannot follow."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Protocol

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike, NDArray

from . import quadrature

Floats = NDArray[np.float64]
MOST_STEPS, MOST_ITERATIONS = 200_000, 40
CROWDED, LEAST_ADVANCE = 500, 1e-6  # steps in which less than this part of the time passes: it would never arrive
SOLVED, NOISE = 1e-15, 1e-10  # the correction that ends an iteration; one below which slow progress is round-off


class Field(Protocol):
    """An autonomous right-hand side of states (s, m), and its Jacobian (m, m) at one."""

    def rows(self, z: Floats) -> Floats: ...
    def jacobian(self, t: float, z: Floats) -> Floats: ...


class ReferenceFailed(RuntimeError):
    """No reference could be computed; the message says where it stopped and what to change."""


@dataclass(frozen=True, eq=False)
class Tableau:
    """A collocation method: nodes c (s,), matrix A (s, s), weights b (s,), and stage values -> Legendre (s, s)."""

    c: Floats
    A: Floats
    b: Floats
    legendre: Floats

    def extrapolation(self, ratio: float) -> Floats:
        """(s, s) matrix taking stage values of the last step to those of the next, `ratio` times as long."""
        return legendre.legvander(1 + 2 * ratio * self.c, len(self.c) - 1) @ self.legendre


@lru_cache(maxsize=8)
def radau(s: int) -> Tableau:
    """Radau IIA with s stages, order 2s - 1.

    Hairer, Norsett & Wanner, Solving ODEs I, II.7 and IV.5: nodes are the zeros of P_s - P_(s-1), right end included;
    a_ij is the integral of the j-th Lagrange polynomial over [0, c_i].
    """
    series = np.zeros(s + 1)
    series[s - 1 :] = -1, 1
    x = np.sort(legendre.legroots(series).real).astype(np.longdouble)
    for _ in range(3):
        (p, d), (p_, d_) = quadrature.legendre(s, x), quadrature.legendre(s - 1, x)
        x = x - (p - p_) / (d - d_)
    x[-1] = 1.0
    c = (1 + x) / 2
    A = quadrature.integrals(c, c).astype(float)
    return Tableau(c.astype(float), A, A[-1], np.linalg.inv(legendre.legvander(x.astype(float), s - 1)))


def integrate(
    stages: int, field: Field, z0: ArrayLike, times: Sequence[float], tolerance: float = 1e-12,
    max_seconds: float = 300.0, magnitudes: Any = 1.0,
) -> Floats:  # fmt: skip
    """States of z' = f(z) at `times` (increasing, from t = 0), shape (len(times), m).

    `tolerance` bounds h |last Legendre coefficient of dz/dt| / max(magnitudes, |z|) on each step. The end point is far
    more accurate than that (superconvergence), except in a stiff component, where it is about that. Raises
    ReferenceFailed where it takes too long.
    """
    method, z = radau(stages), np.array(z0, float)
    t, h, lost = 0.0, 1e-3, np.zeros_like(z)
    last: tuple[Floats, float] | None = None  # stage derivatives of the last step and its length
    states, steps, deadline, mark = [], 0, time.monotonic() + max_seconds, t
    for end in times:
        while t < end:
            steps += 1
            stuck = h < 1e-14 * end or (steps % CROWDED == 0 and t - mark < LEAST_ADVANCE * end)
            if stuck:
                raise ReferenceFailed(
                    f"{stages}-stage collocation comes no further than t = {t:.6g} of {end:g}: the rates jump or "
                    "have a pole there, or there are motions far faster than the horizon is long, and no reference "
                    "can be had beyond. Give the scenario a t_converge before that time."
                )
            mark = mark if steps % CROWDED else t
            if steps > MOST_STEPS or time.monotonic() > deadline:
                raise ReferenceFailed(
                    f"{stages}-stage collocation stopped at t = {t:.6g} of {end:g} after {steps - 1} tries with "
                    f"h = {h:.2g}. Give the scenario a smaller t_converge: references are for systems of some "
                    "hundreds of numbers, and short times."
                )
            # halving the rest avoids a tiny last step, whose extrapolated guess would be poor
            step = end - t if end - t <= 1.01 * h else min(h, (end - t) / 2)
            K = _stages(method, field, z, step, last, magnitudes)
            if K is None:
                h, last = step / 4, None
                continue
            error = step * float(np.max(np.abs(method.legendre[-1] @ K) / np.maximum(magnitudes, np.abs(z))))
            factor = min(3.0, 0.85 * (tolerance / max(error, 1e-300)) ** (1 / stages))
            h = step * max(0.2, factor) if step == end - t or factor < 1 else max(h, step * factor)
            if error > 5 * tolerance:
                last = None
                continue
            t = end if step == end - t else t + step
            change = step * (method.b @ K) + lost
            z, last, before = z + change, (K, step), z
            lost = change - (z - before)  # compensated: the next step adds it
        states.append(z)
    return np.array(states)


def _stages(
    method: Tableau, field: Field, z: Floats, h: float, last: tuple[Floats, float] | None, magnitudes: Any
) -> Floats | None:
    """Stage derivatives K = f(z + h A K), shape (s, m), by simplified Newton; None where it does not converge."""
    K = np.repeat(field.rows(z[None]), len(method.c), axis=0)
    if last is not None:
        K = method.extrapolation(h / last[1]) @ last[0]
    weights, gain, previous = h / np.maximum(magnitudes, np.abs(z)), 1.0, np.inf
    with np.errstate(all="ignore"):
        correct = _correction(method, field, z + h * (method.A[len(method.A) // 2] @ K), h)
        if correct is None:
            return None
        for _ in range(MOST_ITERATIONS):
            left = field.rows(z + h * (method.A @ K)) - K
            if not np.all(np.isfinite(left)):
                return None
            K = K + (dK := correct(left))
            delta = float(np.max(np.abs(dK) * weights))
            gain = gain if previous == np.inf else delta / max(previous, 1e-300)
            if delta * min(gain, 1.0) < SOLVED or (delta < NOISE and gain > 0.5):
                return K
            if gain > 2.0:
                return None
            previous = delta
    return None


def _correction(method: Tableau, field: Field, z: Floats, h: float) -> Callable[[Floats], Floats] | None:
    """residual -> correction of K, (s, m) each, with the Jacobian at z (m,); None where that is not finite."""
    from scipy.linalg import lu_factor, lu_solve

    J = field.jacobian(0.0, z)
    if not np.all(np.isfinite(J)):
        return None
    size = len(method.A) * len(z)
    matrix = np.eye(size) - (h * method.A[:, None, :, None] * J[:, None, :]).reshape(size, size)
    factors = lu_factor(matrix, check_finite=False)
    return lambda residual: lu_solve(factors, residual.ravel(), check_finite=False).reshape(residual.shape)
