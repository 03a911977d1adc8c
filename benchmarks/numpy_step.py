"""The TC monolithic step as a researcher would first write it: plain numpy, Newton with a difference Jacobian."""

import numpy as np


def phi(x):
    return np.where(np.abs(x) < 1e-9, 1 + x / 2, np.expm1(x) / np.where(x == 0, 1, x))


def lam(x):
    return np.where(np.abs(x) < 1e-9, 1 - x / 2, np.log1p(x) / np.where(x == 0, 1, x))


def residual(z0, z1, h, c):
    """Eq. (A1), shape (10,); c is the pendulum (its constants are read, none of its functions is called)."""
    mid, beta, ref, c0 = (z0 + z1) / 2, c.coupling, c.reference_temperature, c.heat_capacity
    springs0 = np.array([z0[:2], z0[2:4] - z0[:2]])
    springs = np.array([mid[:2], mid[2:4] - mid[:2]])
    d = z1 - z0
    dpi = 2 * np.sum(springs * np.array([d[:2], d[2:4] - d[:2]]), axis=1)
    pi0 = np.sum(springs0**2, axis=1)
    L0 = 0.5 * np.log(pi0) - np.log(c.natural_lengths)
    slope = lam(dpi / pi0) / (2 * pi0)
    dL = slope * dpi
    s0, s1 = z0[8:], z1[8:]
    e0, e1 = np.exp((s0 - beta * L0) / c0), np.exp((s1 - beta * L0) / c0)
    stress = slope * (c.stiffness / 2 * (2 * L0 + dL) + beta * ref - beta * ref / 2 * (e0 + e1) * phi(-beta * dL / c0))
    theta = ref / 2 * (np.exp((s0 - beta * (L0 + dL)) / c0) + e0) * phi((s1 - s0) / c0)
    force = 2 * stress[:, None] * springs
    m = np.repeat(c.masses, 2)
    rate = c.conductivity * np.array([(theta[1] - theta[0]) / theta[0], (theta[0] - theta[1]) / theta[1]])
    dq = h * mid[4:8] / m
    dp = -h * np.concatenate([force[0] - force[1], force[1]])
    return d - np.concatenate([dq, dp, h * rate])


def step(z0, h, c, tolerance=1e-10):
    """One step; differences of size 1e-7 for the Jacobian."""
    z1 = z0.copy()
    z1[:4] += h * z0[4:8] / np.repeat(c.masses, 2)
    for _ in range(20):
        r = residual(z0, z1, h, c)
        J = np.empty((10, 10))
        for i in range(10):
            shifted = z1.copy()
            shifted[i] += 1e-7
            J[:, i] = (residual(z0, shifted, h, c) - r) / 1e-7
        correction = np.linalg.solve(J, r)
        z1 = z1 - correction
        if np.abs(correction).max() < tolerance * (1 + np.abs(z1).max()):
            return z1
    raise RuntimeError("Newton did not converge")
