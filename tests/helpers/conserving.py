"""Nine systems whose invariants are not quadratic, or whose energy is not written in invariants; and one whose are."""

import numpy as np
from mechanics import Mechanical, OfEntropies

from tcbench import Scenario


class Canonical(Mechanical):
    """q, p, with a heat that friction makes; friction keeps what the subclass declares."""

    variables = {"q": (2,), "p": (2,), "s": ()}


class Kepler(Canonical):
    name = "kepler"

    def energy(self, z):
        return z.p @ z.p / 2 - 1 / np.sqrt(z.q @ z.q) + np.exp(z.s)

    def invariants(self, z):
        (x, y), (u, v) = z.q, z.p
        spin = x * v - y * u
        r = np.sqrt(x * x + y * y)
        return {"spin": spin, "lenz_x": v * spin - x / r, "lenz_y": -u * spin - y / r}


class Relativistic(Canonical):
    name = "relativistic"

    def energy(self, z):
        return np.sqrt(1 + z.p @ z.p) + (z.q @ z.q - 1) ** 2 / 4 + np.exp(z.s)

    def irreversible(self, z, dE, dS):
        along = z.q @ dE.p
        return {"p": -0.1 * along * z.q, "s": 0.1 * along**2 / dE.s}

    def invariants(self, z):
        return {"spin": z.q[0] * z.p[1] - z.q[1] * z.p[0]}


class Hypot(Relativistic):
    """Written in the distance, whose parts are x and y."""

    name = "hypot"

    def energy(self, z):
        return z.p @ z.p / 2 + (np.hypot(z.q[0], z.q[1]) - 1) ** 2 + np.exp(z.s)


class Charge(OfEntropies):
    """In a field B = 1 + r^2: what turns is kept with the flux, of degree 4."""

    name = "charge"
    variables = {"q": (2,), "v": (2,), "s": ()}

    def energy(self, z):
        return z.v @ z.v / 2 + (z.q @ z.q) / 2 + np.exp(z.s)

    def reversible(self, z, dE, dS):
        B = 1 + z.q @ z.q
        return {"q": dE.v, "v": -dE.q + B * np.array([dE.v[1], -dE.v[0]])}

    def irreversible(self, z, dE, dS):
        along = z.q @ dE.v
        return {"v": -0.1 * along * z.q, "s": 0.1 * along**2 / dE.s}

    def invariants(self, z):
        r2 = z.q @ z.q
        return {"spin": z.q[0] * z.v[1] - z.q[1] * z.v[0] + r2 / 2 + r2**2 / 4}


class Bead(OfEntropies):
    """The same on a bowl, z = r^2/2: a constraint beside an invariant of degree 4."""

    name = "bead"
    variables = {"q": (3,), "v": (3,), "s": ()}
    multipliers = {"bowl": ()}

    def energy(self, z):
        return z.v @ z.v / 2 + 2 * z.q[2] + np.exp(z.s)

    def constraints(self, z):
        return {"bowl": z.q[2] - (z.q[0] ** 2 + z.q[1] ** 2) / 2}

    def reversible(self, z, dE, dS):
        B = 1 + z.q[0] ** 2 + z.q[1] ** 2
        return {"q": dE.v, "v": -dE.q + B * np.array([dE.v[1], -dE.v[0], 0 * dE.v[0]])}

    def irreversible(self, z, dE, dS):
        return {"v": -0.1 * np.array([0, 0, 1]) * dE.v[2], "s": 0.1 * dE.v[2] ** 2 / dE.s}

    def invariants(self, z):
        r2 = z.q[0] ** 2 + z.q[1] ** 2
        return {"spin": z.q[0] * z.v[1] - z.q[1] * z.v[0] + r2 / 2 + r2**2 / 4}


class Attitude(OfEntropies):
    """A free body by its quaternion and momentum in the body: the momentum in space is of degree 3."""

    name = "attitude"
    variables = {"e": (4,), "m": (3,), "s": ()}
    constants = {"inertia": (3,)}

    def energy(self, z):
        return (z.m**2 / self.inertia).sum() / 2 + np.exp(z.s)

    def reversible(self, z, dE, dS):
        a, b, c, d = z.e
        xi = np.array([[-b, -c, -d], [a, -d, c], [d, a, -b], [-c, b, a]]) / 2
        return {"e": xi @ dE.m, "m": np.cross(z.m, dE.m) - xi.T @ dE.e}

    def invariants(self, z):
        a, v = z.e[0], z.e[1:]
        there = np.cross(v, z.m)
        space = z.m * (a * a - v @ v) + 2 * v * (v @ z.m) + 2 * a * there
        return {"length": z.e @ z.e, "x": space[0], "y": space[1], "z": space[2]}


class Volterra(OfEntropies):
    """L_ij = A_ij x_i x_j, with a logarithmic Casimir."""

    name = "lotka_volterra"
    variables = {"x": (3,), "s": ()}
    constants = {"A": (3,), "gamma": ()}

    def energy(self, z):
        return (z.x - np.log(z.x)).sum() + np.exp(z.s)

    def reversible(self, z, dE, dS):
        return {"x": z.x * np.cross(self.A, z.x * dE.x)}

    def irreversible(self, z, dE, dS):
        w = z.x * np.array([self.A[1], -self.A[0], 0 * self.A[0]])
        a = w @ dE.x
        return {"x": -self.gamma * w * a, "s": self.gamma * a**2 / dE.s}

    def measures(self, z):
        return z.x

    def invariants(self, z):
        return {"casimir": self.A @ np.log(z.x)}


class Arms(OfEntropies):
    """Two bodies with a spring that sees the difference of their angles through sin alone, written with angles."""

    name = "two_arms"
    variables = {"q": (2,), "phi": (), "p": (2,), "l": (), "s": ()}
    constants = {"k": ()}

    def energy(self, z):
        along = z.q[0] * np.cos(z.phi) + z.q[1] * np.sin(z.phi)
        return (z.p @ z.p + z.l**2) / 2 + self.k * (along - 1) ** 2 / 2 + np.exp(z.s)

    def reversible(self, z, dE, dS):
        return {"q": dE.p, "p": -dE.q, "phi": dE.l, "l": -dE.phi}

    def invariants(self, z):
        return {"spin": z.q[0] * z.p[1] - z.q[1] * z.p[0] + z.l}


class AngleBeam(OfEntropies):
    """A beam in the plane, whose strains are written with the angles of its sections; they rub, and conduct."""

    name = "angle_beam"
    variables = {"q": ("node", 2), "phi": ("node",), "p": ("node", 2), "l": ("node",), "s": ("element",)}
    tables = {"ends": ("element", 2, "node")}
    constants = {"mass": ("node",), "length": ("element",), "k": ()}

    def energy(self, z):
        x, phi = z.q[self.ends], z.phi[self.ends]
        along, turned = (x[:, 1] - x[:, 0]) / self.length[:, None], (phi[:, 0] + phi[:, 1]) / 2
        (u, v), c, s = along.T, np.cos(turned), np.sin(turned)
        strain = 50 * (c * u + s * v - 1) ** 2 + 30 * (c * v - s * u) ** 2
        bend = self.k * ((phi[:, 1] - phi[:, 0]) / self.length) ** 2
        heat = self.length * (np.exp(z.s / self.length) - 1)
        kinetic = (z.p**2 / self.mass[:, None]).sum() + (z.l**2 / (0.02 * self.mass)).sum()
        return kinetic / 2 + (self.length * (strain + bend) / 2).sum() + heat.sum()

    def reversible(self, z, dE, dS):
        return {"q": dE.p, "phi": dE.l, "p": -dE.q, "l": -dE.phi}

    def irreversible(self, z, dE, dS):
        w = dE.l[self.ends]
        rate = w[:, 1] - w[:, 0]
        push = 0.01 * rate
        return {"l": self.ends.sums(np.stack([push, -push], axis=1)), "s": push * rate / dE.s}

    def invariants(self, z):
        (x, y), (u, v) = z.q.T, z.p.T
        return {"spin": (x * v - y * u).sum() + z.l.sum(), "push_x": u.sum(), "push_y": v.sum()}


def one(name, system, constants, initial, t_end=10.0, dt=0.1):
    return Scenario(name, system, constants, initial=initial, t_end=t_end, dt=dt, shows="", source="")


def beam(n=10):
    k = np.arange(n + 1)
    length = np.full(n, 1.0 / n)
    mass = np.convolve(length, [0.5, 0.5])
    u = k / n - 0.5
    return one(
        "angle_beam", AngleBeam, {"ends": np.stack([k[:-1], k[1:]], axis=1), "mass": mass, "length": length, "k": 1.0},
        {"q": np.stack([u, 0 * u], axis=1), "phi": 0 * u, "p": mass[:, None] * np.stack([0 * u, 2 * u + u * u], axis=1),
         "l": 0.02 * mass * (2 + 2 * u), "s": 0.1 * length * (k[:-1] < n / 2)}, t_end=1.0, dt=0.02,
    )  # fmt: skip


LOST = [  # by tc_monolithic
    one("charge", Charge, {}, {"q": [1.0, 0.2], "v": [0.3, 0.8], "s": 0.0}),
    one("bead", Bead, {}, {"q": [1.0, 0.0, 0.5], "v": [0.4, 0.8, 0.4], "s": 0.0}, dt=0.05),
    one("attitude", Attitude, {"inertia": (1.0, 2.0, 3.0)}, {"e": [1.0, 0, 0, 0], "m": [0.3, 1.5, 0.4], "s": 0.0}),
    one("volterra", Volterra, {"A": (1.0, 0.7, 1.3), "gamma": 0.05}, {"x": [0.5, 1.3, 2.0], "s": 0.0}),
    one("arms", Arms, {"k": 5.0}, {"q": [1.2, 0.1], "phi": 0.3, "p": [0.1, 0.7], "l": -0.2, "s": 0.0}),
    one("kepler", Kepler, {}, {"q": [1.0, 0.0], "p": [0.0, 1.2], "s": 0.0}),
    one("hypot", Hypot, {}, {"q": [1.2, 0.3], "p": [0.1, 0.9], "s": 0.0}),
    beam(),
]
KEPT = one("relativistic", Relativistic, {}, {"q": [1.2, 0.3], "p": [0.1, 0.9], "s": 0.0})
