"""The monolithic method (Romero 2009, eq. (A1)) for chains of any length, with a banded Newton: linear cost in n.

Written for whole arrays of springs, with the closed-form divided differences that `System.discrete_gradient` derives
for small n; tests compare the two. Unknowns are the increments (dq_x, dq_y, ds) of each mass and its spring, in that
order along the chain; momenta are eliminated. The Jacobian then has 8 diagonals below the main one and 5 above.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_banded

from tcbench.errors import TcbenchError

from .chain import Chain

Floats = NDArray[np.float64]
BELOW, ABOVE = 8, 5
TOLERANCE = (
    1e-14  # of the last correction, relative to the size of an unknown; a Newton correction is squared by the next
)
ITERATIONS = 20


@dataclass(frozen=True)
class _Springs:
    """Discrete stress and temperature of every spring, and their derivatives to dpi and ds."""

    stress: Floats
    theta: Floats
    stress_pi: Floats
    stress_s: Floats
    theta_pi: Floats
    theta_s: Floats


def increments(z: Any, h: float, system: Any) -> Floats:
    """z1 - z of one step, for an Integrator; NaN where Newton's iteration fails."""
    if not isinstance(system, Chain):
        raise TcbenchError(f"tc_banded is written for chains (tcbench.chain), not for {system.name!r}.")
    return step(system, np.array(z), h)[0]


def step(model: Any, z: Floats, h: float) -> tuple[Floats, int]:
    """(z1 - z0, Newton iterations); NaN where the iteration does not converge."""
    with np.errstate(all="ignore"):  # an iterate that is not finite is found below
        return _newton(model, z, h)


def _newton(model: Any, z: Floats, h: float) -> tuple[Floats, int]:
    n = len(model.masses)
    q, p, s = z[: 2 * n].reshape(n, 2), z[2 * n : 4 * n].reshape(n, 2), z[4 * n :]
    r0 = model.springs(q)
    dq, ds = h * p / model.masses[:, None], np.zeros(n)
    scale = max(1.0, float(np.abs(r0).max()))
    for iteration in range(1, ITERATIONS + 1):
        residual, diagonals = newton_system(model, p, s, h, r0, _stretch(dq), dq, ds)
        try:
            delta = solve_banded((BELOW, ABOVE), diagonals, -residual.ravel(), overwrite_ab=True).reshape(n, 3)
        except (ValueError, np.linalg.LinAlgError):
            break
        dq, ds = dq + delta[:, :2], ds + delta[:, 2]
        size = max(float(np.abs(delta[:, :2]).max()) / scale, float(np.abs(delta[:, 2]).max()) / model.heat_capacity)
        if not np.isfinite(size):
            break
        if size < np.sqrt(TOLERANCE):  # quadratic convergence: the next correction is below round-off
            dr = _stretch(dq)
            # momenta from the forces: from dq/h they would lose digits at small h
            dp = -h * _forces(_springs(model, s, r0, dr, ds), r0, dr)
            return np.concatenate([dq.ravel(), dp.ravel(), ds]), iteration
    return np.full(5 * n, np.nan), ITERATIONS


def _stretch(dq: Floats) -> Floats:
    """Increments of the vectors along the springs from those of the positions, shape (n, 2)."""
    return np.diff(dq, axis=0, prepend=np.zeros((1, 2)))


def newton_system(
    model: Any, p: Floats, s: Floats, h: float, r0: Floats, dr: Floats, dq: Floats, ds: Floats
) -> tuple[Floats, Floats]:
    """Residual, shape (n, 3), and the Jacobian's diagonals, shape (BELOW + ABOVE + 1, 3 n)."""
    e = _springs(model, s, r0, dr, ds)
    m, kappa, n = model.masses[:, None], model.conductivity, len(s)
    residual = np.empty((n, 3))
    residual[:, :2] = dq - h / m * p + h * h / (2 * m) * _forces(e, r0, dr)
    residual[:, 2] = ds - h * model.conduction(e.theta)
    band = _Band(n)
    mid, r1 = r0 + dr / 2, r0 + dr
    # the force of spring i is 2 stress mid: K = its derivative to dr (2 by 2), g = to ds
    K = e.stress[:, None, None] * np.eye(2) + 4 * e.stress_pi[:, None, None] * mid[:, :, None] * r1[:, None, :]
    g = 2 * e.stress_s[:, None] * mid
    w = h * h / (2 * m)
    one = np.ones(n)
    for a in range(2):
        band.add(a, a, 0, one)
        for b in range(2):
            band.add(a, b, 0, w[:, 0] * K[:, a, b])
            band.add(a, b, -1, -w[1:, 0] * K[1:, a, b])
            band.add(a, b, 0, w[:-1, 0] * K[1:, a, b])
            band.add(a, b, 1, -w[:-1, 0] * K[1:, a, b])
        band.add(a, 2, 0, w[:, 0] * g[:, a])
        band.add(a, 2, 1, -w[:-1, 0] * g[1:, a])
    band.add(2, 2, 0, one)
    _conduction(band, e, 2 * r1 * e.theta_pi[:, None], h * kappa)
    return residual, band.diagonals


def _conduction(band: _Band, e: _Springs, theta_r: Floats, hk: float) -> None:
    """Rows of the entropies: -h kappa times the derivative of theta_j/theta_i - 1, for neighbours j of i."""
    theta = e.theta
    for j in (-1, 1):
        here, there = (slice(1, None), slice(None, -1)) if j == -1 else (slice(None, -1), slice(1, None))
        by_there, by_here = -hk / theta[here], hk * theta[there] / theta[here] ** 2
        band.add(2, 2, j, by_there * e.theta_s[there])
        band.add(2, 2, 0, by_here * e.theta_s[here], skip=1 if j == -1 else 0)
        for b in range(2):  # theta_i depends on dr_i = dq_i - dq_(i-1)
            band.add(2, b, j, by_there * theta_r[there, b])
            band.add(2, b, 0, by_here * theta_r[here, b], skip=1 if j == -1 else 0)
            at_there, at_here = by_there * theta_r[there, b], by_here * theta_r[here, b]
            if j == -1:
                band.add(2, b, -2, -at_there[1:])
                band.add(2, b, -1, -at_here)
            else:
                band.add(2, b, 0, -at_there)
                band.add(2, b, -1, -at_here[1:])


class _Band:
    """The Jacobian by diagonals, as SciPy stores them: entry (row, column) is at [ABOVE + row - column, column]."""

    def __init__(self, n: int) -> None:
        self.n, self.diagonals = n, np.zeros((BELOW + ABOVE + 1, 3 * n))

    def add(self, row: int, column: int, shift: int, values: Floats, skip: int = 0) -> None:
        """Add d(row of mass i)/d(column of mass i + shift), for the masses i that the values cover, from `skip` on."""
        first = max(skip, -shift, 0)
        start = 3 * (first + shift) + column
        self.diagonals[ABOVE + row - column - 3 * shift, start : start + 3 * len(values) : 3] += values


def _forces(e: _Springs, r0: Floats, dr: Floats) -> Floats:
    """grad of the internal energy to the positions, discrete, shape (n, 2)."""
    f = 2 * e.stress[:, None] * (r0 + dr / 2)
    return f - np.concatenate([f[1:], np.zeros((1, 2))])


def _springs(model: Any, s: Floats, r0: Floats, dr: Floats, ds: Floats) -> _Springs:
    """PHYSICS: D_pi e and D_s e in closed form, no difference of nearly equal numbers."""
    beta, c0, ref, C = model.coupling, model.heat_capacity, model.reference_temperature, model.stiffness
    pi0 = (r0 * r0).sum(1)
    x = (2 * (r0 + dr / 2) * dr).sum(1) / pi0
    L0, dL = model.log_strain(pi0), 0.5 * np.log1p(x)
    y, w = -beta * dL / c0, ds / c0
    slope, slope_pi = _lam(x) / (2 * pi0), _lam_slope(x) / (2 * pi0**2)
    L_pi = 1 / (2 * pi0 * (1 + x))
    cold, hot = np.exp((s - beta * L0) / c0), np.exp((s + ds - beta * L0) / c0)
    inner = C / 2 * (2 * L0 + dL) + beta * ref - beta * ref / 2 * (hot + cold) * _phi(y)
    inner_pi = (C / 2 + beta**2 * ref / (2 * c0) * (hot + cold) * _phi_slope(y)) * L_pi
    moved = cold * np.exp(y)
    return _Springs(
        stress=slope * inner,
        theta=ref / 2 * (moved + cold) * _phi(w),
        stress_pi=slope_pi * inner + slope * inner_pi,
        stress_s=-slope * beta * ref / (2 * c0) * hot * _phi(y),
        theta_pi=-ref * beta / (2 * c0) * moved * L_pi * _phi(w),
        theta_s=ref / (2 * c0) * (moved + cold) * _phi_slope(w),
    )


def _quotient(x: Floats, above: Floats, near: Floats, limit: float) -> Floats:
    """`near` (a series) where |x| < limit, `above` elsewhere."""
    return np.where(np.abs(x) < limit, near, above)


def _phi(x: Floats) -> Floats:
    """expm1(x)/x."""
    safe = np.where(x == 0, 1.0, x)
    return np.where(x == 0, 1.0, np.expm1(safe) / safe)


def _phi_slope(x: Floats) -> Floats:
    safe = np.where(x == 0, 1.0, x)
    near = 1 / 2 + x * (1 / 3 + x * (1 / 8 + x * (1 / 30 + x / 144)))
    return _quotient(x, (np.exp(safe) * (safe - 1) + 1) / safe**2, near, 1e-2)


def _lam(x: Floats) -> Floats:
    """log1p(x)/x."""
    safe = np.where(x == 0, 1.0, x)
    return np.where(x == 0, 1.0, np.log1p(safe) / safe)


def _lam_slope(x: Floats) -> Floats:
    safe = np.where(x == 0, 1.0, x)
    near = -1 / 2 + x * (2 / 3 + x * (-3 / 4 + x * (4 / 5 + x * (-5 / 6 + x * 6 / 7))))
    return _quotient(x, (safe / (1 + safe) - np.log1p(safe)) / safe**2, near, 1e-2)
