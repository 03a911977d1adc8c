"""Systems over spaces as readers of docs/add-system.md write them, each with a small scenario."""

import numpy as np
from mechanics import Warm

from tcbench import Scenario, System

N = 5  # nodes of a row: as few as are traced on arrays
ROW = np.stack([np.arange(N - 1), np.arange(1, N)], axis=1)


def heat(system, e, s):
    """A spring's thermal energy at log strain e and entropy s."""
    return 3.0 * (0.2 * e + np.exp(s - 0.2 * e) - 1.0)


class Row(Warm):
    """Springs in a row, tied to a fixed point, that conduct heat to their neighbours."""

    name = "row"
    variables = {"q": ("node", 2), "p": ("node", 2), "s": ("spring",)}
    tables = {"ends": ("spring", 2, "node+anchor"), "pairs": ("link", 2, "spring")}
    constants = {"mass": ("node",), "anchors": ("anchor", 2), "stiffness": ("spring",), "kappa": ()}

    def strain(self, q):
        ends = np.concatenate([q, self.anchors])[self.ends]
        return np.log(((ends[:, 1] - ends[:, 0]) ** 2).sum(axis=1)) / 2

    def energy(self, z):
        e = self.strain(z.q)
        return (z.p**2 / self.mass[:, None]).sum() / 2 + (self.stiffness / 2 * e**2 + heat(self, e, z.s)).sum()

    def conduction(self, theta):
        a, b = theta[self.pairs].T
        return self.pairs.sums(self.kappa * np.stack([(b - a) / a, (a - b) / b], axis=1))

    def irreversible(self, z, dE, dS):
        return {"s": self.conduction(dE.s)}

    def invariants(self, z):
        return {"spin": (z.q[:, 0] * z.p[:, 1] - z.q[:, 1] * z.p[:, 0]).sum()}


class Dashpots(Row):
    """A dashpot and a second spring beside each spring."""

    name = "dashpots"
    variables = {**Row.variables, "alpha": ("spring",)}
    constants = {**Row.constants, "viscosity": ()}

    def energy(self, z):
        return super().energy(z) + (2.5 * (self.strain(z.q) - z.alpha) ** 2).sum()

    def irreversible(self, z, dE, dS):
        flow = -dE.alpha / self.viscosity
        return {"alpha": flow, "s": self.conduction(dE.s) - flow * dE.alpha / dE.s}


class SharedBath(Row):
    """One bath that all springs see, and a mean temperature to which they tend."""

    name = "shared_bath"
    variables = {**Row.variables, "bath": ()}
    constants = {**Row.constants, "exchange": ()}

    def energy(self, z):
        return super().energy(z) + 20.0 * np.exp(z.bath / 20.0)

    def entropy(self, z):
        return super().entropy(z) + z.bath

    def irreversible(self, z, dE, dS):
        flow = self.exchange * (dE.bath - dE.s)
        mean = 1.0 / (1.0 / dE.s).mean()
        to_mean = self.exchange * (mean / dE.s - 1.0)  # theta . to_mean = 0, and its sum is not negative
        to_mean = to_mean - (dE.s * to_mean).mean() / dE.s
        return {"s": self.conduction(dE.s) + flow / dE.s + to_mean, "bath": -flow.sum() / dE.bath}

    def temperature(self, z, dE, dS):
        return [dE.s, dE.bath]


class Drag(Row):
    """Friction between nodes, which heats a medium at each node; two kinds of springs."""

    name = "drag"
    variables = {**Row.variables, "heat": ("node",), "warm": ("tie",)}
    tables = {**Row.tables, "joined": ("tie", 2, "node")}
    constants = {**Row.constants, "drag": ("tie",)}

    def energy(self, z):
        first, second = self.joined.T
        d2 = ((z.q[second] - z.q[first]) ** 2).sum(axis=1)
        return super().energy(z) + 2.0 * np.exp(z.heat).sum() + (0.1 * (d2 - 4.0) ** 2 + 2.0 * np.exp(z.warm)).sum()

    def entropy(self, z):
        return super().entropy(z) + z.heat.sum() + z.warm.sum()

    def irreversible(self, z, dE, dS):
        v = dE.p[self.joined]
        force = self.drag[:, None] * (v[:, 1] - v[:, 0])
        work = ((v[:, 1] - v[:, 0]) * force).sum(axis=1) / 2
        warmed = self.joined.sums(np.stack([work, work], axis=1)) / dE.heat
        flow = dE.heat[self.joined[:, 0]] - dE.warm
        cooled = self.joined[:, 0].sums(flow) / dE.heat
        return {
            "p": self.joined.sums(np.stack([force, -force], axis=1)),
            "heat": warmed - cooled, "s": self.conduction(dE.s), "warm": flow / dE.warm,
        }  # fmt: skip

    def invariants(self, z):
        return {}


class Reactions(System):
    """Cells with two substances each, which react, diffuse to neighbours and warm a common medium."""

    name = "reactions"
    variables = {"n": ("cell", 2), "u": ("cell",)}
    tables = {"next": ("face", 2, "cell")}
    constants = {"rate": ("cell",), "diffusion": ()}

    def energy(self, z):
        return z.u.sum()

    def entropy(self, z):
        return (-z.n * (np.log(z.n) - 1.0)).sum() + (3.0 * np.log(z.u - z.n[:, 1])).sum()

    def reversible(self, z, dE, dS):
        return {}

    def irreversible(self, z, dE, dS):
        force = dS.n[:, 1] - dS.n[:, 0]
        gain = self.rate * z.n[:, 0] * force
        moved = self.diffusion * (dS.n[self.next[:, 1]] - dS.n[self.next[:, 0]])
        spread = self.next.sums(np.stack([-moved, moved], axis=1))
        warm = self.diffusion * (dS.u[self.next[:, 1]] - dS.u[self.next[:, 0]])
        return {"n": np.stack([-gain, gain], axis=1) + spread, "u": self.next.sums(np.stack([-warm, warm], axis=1))}

    def measures(self, z):
        return [z.n, z.u - z.n[:, 1]]

    def invariants(self, z):
        return {"matter": z.n.sum()}


def row(kind, **more):
    """A row of N masses, the first tied to the origin."""
    k = np.arange(N)
    constants = {"ends": np.concatenate([ROW, [[N, 0]]]), "pairs": [*ROW[:-1], [N - 1, 0]], "mass": 1.0 + 0.1 * (k % 7),
                 "anchors": [[0.0, 0.0]], "stiffness": 10.0 + k % 5, "kappa": 2.0}  # fmt: skip
    initial = {"q": np.stack([1.1 * (k + 1), 0.1 * np.sin(k)], 1), "p": np.stack([0 * k, 0.5 * np.cos(k)], 1),
               "s": 0.1 * np.cos(k)}  # fmt: skip
    given = {n: more.pop(n) for n in list(more) if n in kind.constants or n in kind.tables}
    return Scenario(kind.name, kind, constants | given, initial=initial | more, t_end=0.5, dt=0.1)


def cells(count=9):
    k = np.arange(count)
    faces = np.stack([k[:-1], k[1:]], axis=1)
    start = {"n": np.stack([1.0 + 0.5 * np.cos(k), 0.3 + 0.1 * np.sin(k)], 1), "u": 3.0 + 0.2 * np.sin(2 * k)}
    constants = {"next": faces, "rate": 0.2 + 0.1 * k / count, "diffusion": 0.3}
    return Scenario("cells", Reactions, constants, initial=start, t_end=0.5, dt=0.1)


NETWORKS = {
    "row": row(Row), "dashpots": row(Dashpots, viscosity=4.0, alpha=np.zeros(N)),
    "shared_bath": row(SharedBath, exchange=0.5, bath=0.5),
    "drag": row(Drag, joined=np.stack([np.arange(N - 2), np.arange(2, N)], 1), drag=0.3 + 0.1 * np.arange(N - 2),
                heat=0.1 * np.sin(np.arange(N)), warm=0.05 * np.arange(N - 2.0)),
    "reactions": cells(),
}  # fmt: skip
