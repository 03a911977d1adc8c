"""The five methods of Romero (2009) on nets of springs in plain numpy, written from the paper's formulas alone.

Nothing of tcbench is used: no trace, no derived function. A step is solved by Newton with differences for a Jacobian.
"""

import numpy as np


def phi(x):
    small = np.where(x == 0, 1.0, x)
    return np.where(np.abs(x) < 1e-5, 1 + x / 2 + x * x / 6, np.expm1(small) / small)


def log1p_over(x):
    small = np.where(x == 0, 1.0, x)
    return np.where(np.abs(x) < 1e-5, 1 - x / 2 + x * x / 3, np.log1p(small) / small)


class PlainNet:
    """nx by ny masses, springs between neighbours, the corners (0, 0) and (nx - 1, 0) tied to fixed points."""

    def __init__(self, nx, ny, constants, anchors):
        self.n = nx * ny
        self.ends = [(i * ny + j, (i + 1) * ny + j) for i in range(nx - 1) for j in range(ny)]
        self.ends += [(i * ny + j, i * ny + j + 1) for i in range(nx) for j in range(ny - 1)]
        self.ends += [(0, self.n), ((nx - 1) * ny, self.n + 1)]
        self.m = len(self.ends)
        self.neighbours = [
            (a, b) for mass in range(self.n)
            for a in range(self.m) for b in range(a + 1, self.m) if mass in self.ends[a] and mass in self.ends[b]
        ]  # fmt: skip
        self.anchors = np.reshape(anchors, (2, 2))
        for name in ("masses", "stiffness", "natural_lengths", "conductivity", "reference_temperature", "coupling",
                     "heat_capacity"):  # fmt: skip
            setattr(self, name, np.asarray(constants[name], dtype=float))

    def split(self, z):
        n = self.n
        return z[: 2 * n].reshape(n, 2), z[2 * n : 4 * n].reshape(n, 2), z[4 * n :]

    def vectors(self, q):
        points = np.concatenate([q, self.anchors])
        return np.array([points[b] - points[a] for a, b in self.ends])

    def strain(self, pi):
        return np.log(np.sqrt(pi) / self.natural_lengths)

    def theta(self, pi, s):
        return self.reference_temperature * np.exp((s - self.coupling * self.strain(pi)) / self.heat_capacity)

    def pull(self, vectors, stress):
        """dE/dq of springs whose energies change by `stress` with their squared lengths."""
        force = np.zeros((self.n + 2, 2))
        for (a, b), r, x in zip(self.ends, vectors, stress, strict=True):
            force[b] += 2 * x * r
            force[a] -= 2 * x * r
        return force[: self.n]

    def conduct(self, theta):
        rate = np.zeros(self.m)
        for a, b in self.neighbours:
            rate[a] += self.conductivity * (theta[b] - theta[a]) / theta[a]
            rate[b] += self.conductivity * (theta[a] - theta[b]) / theta[b]
        return rate

    def entropy(self, pi, theta):
        return self.coupling * self.strain(pi) + self.heat_capacity * np.log(theta / self.reference_temperature)

    def discrete(self, z0, z1):
        """(dE/dq, mean p, theta*) by eqs. (27)-(33), closed forms of docs/physics.md."""
        (q0, p0, s0), (q1, p1, s1) = self.split(z0), self.split(z1)
        r0, r1 = self.vectors(q0), self.vectors(q1)
        mid, pi0 = (r0 + r1) / 2, (r0**2).sum(1)
        x = (2 * mid * (r1 - r0)).sum(1) / pi0
        beta, c0, ref = self.coupling, self.heat_capacity, self.reference_temperature
        L0, dL = self.strain(pi0), 0.5 * np.log1p(x)
        hot, cold = np.exp((s1 - beta * L0) / c0), np.exp((s0 - beta * L0) / c0)
        inner = self.stiffness / 2 * (2 * L0 + dL) + beta * ref - beta * ref / 2 * (hot + cold) * phi(-beta * dL / c0)
        stress = log1p_over(x) / (2 * pi0) * inner
        theta = ref / 2 * (np.exp((s0 - beta * (L0 + dL)) / c0) + cold) * phi((s1 - s0) / c0)
        return self.pull(mid, stress), (p0 + p1) / 2, theta

    def rates(self, q, p, s):
        """dz/dt."""
        r = self.vectors(q)
        pi = (r**2).sum(1)
        theta = self.theta(pi, s)
        force = (self.stiffness * self.strain(pi) - self.coupling * (theta - self.reference_temperature)) / (2 * pi)
        return p / self.masses[:, None], -self.pull(r, force), self.conduct(theta)

    # residuals of a step, of the five methods

    def reversible(self, z0, z1, h):
        by_q, p, _ = self.discrete(z0, z1)
        (q0, p0, s0), (q1, p1, s1) = self.split(z0), self.split(z1)
        return np.concatenate([
            (q1 - q0 - h * p / self.masses[:, None]).ravel(), (p1 - p0 + h * by_q).ravel(), s1 - s0,
        ])  # fmt: skip

    def irreversible(self, z0, z1, h):
        still = 4 * self.n
        theta = self.discrete(z0, np.concatenate([z0[:still], z1[still:]]))[2]
        return np.concatenate([z1[:still] - z0[:still], z1[still:] - z0[still:] - h * self.conduct(theta)])

    def tc_monolithic(self, z0, z1, h):
        theta, s = self.discrete(z0, z1)[2], 4 * self.n
        found = self.reversible(z0, z1, h)
        found[s:] -= h * self.conduct(theta)
        return found

    def midpoint_entropy(self, z0, z1, h):
        q, p, s = self.split((z0 + z1) / 2)
        return z1 - z0 - h * np.concatenate([x.ravel() for x in self.rates(q, p, s)])

    def midpoint_temperature(self, z0, z1, h):
        """Unknowns in z1: temperatures behind positions and momenta."""
        (q0, p0, s0), (q1, p1, theta1) = self.split(z0), self.split(z1)
        pi0 = (self.vectors(q0) ** 2).sum(1)
        q, p, theta = (q0 + q1) / 2, (p0 + p1) / 2, (self.theta(pi0, s0) + theta1) / 2
        s = self.entropy((self.vectors(q) ** 2).sum(1), theta)
        dq, dp, _ = self.rates(q, p, s)
        s1 = self.entropy((self.vectors(q1) ** 2).sum(1), theta1)
        parts = [(q1 - q0 - h * dq).ravel(), (p1 - p0 - h * dp).ravel(), s1 - s0 - h * self.conduct(theta)]
        return np.concatenate(parts)

    def step(self, method, z0, h):
        if method in ("tc_staggered", "tc_strang"):
            halves = [("reversible", h), ("irreversible", h)]
            if method == "tc_strang":
                halves = [("reversible", h / 2), ("irreversible", h), ("reversible", h / 2)]
            for name, part in halves:
                z0 = solved(getattr(self, name), z0, z0, part)
            return z0
        if method != "midpoint_temperature":
            return solved(getattr(self, method), z0, z0, h)
        q, _, s = self.split(z0)
        start = np.concatenate([z0[: 4 * self.n], self.theta((self.vectors(q) ** 2).sum(1), s)])
        z1 = solved(self.midpoint_temperature, z0, start, h)
        q, _, theta = self.split(z1)
        return np.concatenate([z1[: 4 * self.n], self.entropy((self.vectors(q) ** 2).sum(1), theta)])


def solved(residual, z0, start, h):
    """Newton with differences; the last corrections use one matrix until they no longer shrink."""
    z1, previous = start.copy(), np.inf
    for iteration in range(40):
        r = residual(z0, z1, h)
        if iteration < 4:
            columns = []
            for i in range(len(z1)):
                moved = z1.copy()
                moved[i] += 1e-7 * max(1.0, abs(z1[i]))
                columns.append((residual(z0, moved, h) - r) / (moved[i] - z1[i]))
            matrix = np.linalg.inv(np.array(columns).T)
        correction = matrix @ r
        size = np.abs(correction / np.maximum(1.0, np.abs(z1))).max()
        z1 = z1 - correction
        if iteration > 4 and size >= previous and size < 1e-13:
            break
        previous = size
    return z1
