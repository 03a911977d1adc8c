"""Holonomic constraints: laws, the constraints, order, the ODE under them, and what is refused."""

import numpy as np
import pytest

import tcbench
from tcbench import Scenario, System, TcbenchError


class Rods(System):
    name = "rigid_rods"
    variables = {"q": ("node", 3), "p": ("node", 3), "s": ("node",)}
    multipliers = {"lam": "rod"}
    tables = {"ends": ("rod", 2, "node+anchor"), "pairs": ("pair", 2, "node")}
    constants = {
        "mass": ("node",),
        "anchors": ("anchor", 3),
        "length": ("rod",),
        "gravity": (3,),
        "kappa": (),
        "eta": (),
    }

    def energy(self, z):
        return (
            (z.p**2 / (2 * self.mass[:, None])).sum()
            - (self.mass * (z.q @ self.gravity)).sum()
            + (2 * (np.exp(z.s / 2) - 1)).sum()
        )

    def constraints(self, z):
        x = np.concatenate([z.q, self.anchors])[self.ends]
        return {"lam": (((x[:, 1] - x[:, 0]) ** 2).sum(axis=1) - self.length**2) / 2}

    def entropy(self, z):
        return z.s.sum()

    def reversible(self, z, dE, dS):
        return {"q": dE.p, "p": -dE.q}

    def irreversible(self, z, dE, dS):
        (a, b), v, x = dE.s[self.pairs].T, dE.p[self.pairs], z.q[self.pairs]
        e = x[:, 1] - x[:, 0]
        rate = ((v[:, 1] - v[:, 0]) * e).sum(axis=1)
        push, made = (self.eta * rate)[:, None] * e, self.eta * rate**2 / 2
        heat = self.kappa * np.stack([(b - a) / a, (a - b) / b], axis=1) + np.stack([made / a, made / b], axis=1)
        return {"p": self.pairs.sums(np.stack([push, -push], axis=1)), "s": self.pairs.sums(heat)}

    def temperature(self, z, dE, dS):
        return dE.s

    def invariants(self, z):
        return {"spin_z": np.cross(z.q, z.p).sum(axis=0)[2]}


def chain(n, kick=1.0, **more):
    k = np.arange(n)
    nodes = np.r_[n, k]
    q = np.cumsum(np.where((k % 2 == 0)[:, None], [1.0, 0, 0], [0, 1.0, 0]), axis=0)
    p = np.stack([0 * k, 0 * k, kick * np.cos(k)], axis=1)
    constants = {
        "ends": np.stack([nodes[:-1], nodes[1:]], axis=1), "pairs": np.stack([k[:-2], k[2:]], axis=1),
        "mass": np.ones(n), "anchors": np.zeros((1, 3)), "length": np.ones(n), "gravity": [0, 0, -9.81],
        "kappa": 0.3, "eta": 0.1,
    }  # fmt: skip
    initial = {"q": q, "p": p, "s": 0.2 * np.cos(k)} | more
    return Scenario(f"chain_of_{n}", Rods, constants, initial=initial, t_end=0.4, dt=0.02, shows="", source="")


def missed(run):
    return max(np.abs(run.scenario.model.constraint_values(z)).max() for z in run.z)


@pytest.mark.parametrize("n", [3, 4, 100])  # det J of E + lam . g has the sign (-1)^n: see systems/constrained.py
@pytest.mark.parametrize("method", ["tc_monolithic", "tc_strang", "tc_gonzalez", "midpoint_entropy"])
def test_laws_and_constraints(method, n):
    run = tcbench.simulate(method, chain(n))
    assert run.ok and run.summary.entropy_increment_min > 0 and missed(run) < 1e-13
    assert np.ptp(run.invariants["spin_z"]) < 1e-12
    assert method == "midpoint_entropy" or run.summary.energy_error_max < 1e-13


@pytest.mark.parametrize("h", [0.1, 0.2, 0.4])
def test_large_steps(h):
    run = tcbench.simulate("tc_monolithic", chain(3), dt=h)
    assert run.ok and missed(run) < 1e-14 and run.summary.energy_error_max < 1e-13


def test_order_against_the_ode_under_the_constraints():
    scenario = chain(3)
    exact = tcbench.simulate("scipy_dop853", scenario, tolerance=1e-11, times=[0.4])
    assert np.abs(scenario.model.constraint_speeds(exact.z[-1])).max() < 1e-10
    errors = [
        np.abs(tcbench.simulate("tc_monolithic", scenario, dt=h).z[-1] - exact.z[-1]).max() for h in (0.01, 0.005)
    ]
    assert 1.9 < np.log2(errors[0] / errors[1]) < 2.1


def test_starts_off_the_constraints_are_refused():
    with pytest.raises(TcbenchError, match="at the start constraints"):
        tcbench.simulate("tc_monolithic", chain(3, q=1.01 * np.array(chain(3).initial["q"])))
    with pytest.raises(TcbenchError, match="the rate of constraints"):
        tcbench.simulate("tc_monolithic", chain(3, p=[[1.0, 0, 0], [0, 0, 0], [0, 0, 0]]))


def test_methods_that_cannot_are_refused():
    for name in ("tc_gauss", "bdf2", "projected[method=midpoint_entropy]", "tc_auto"):
        with pytest.raises(TcbenchError, match="constraints"):
            tcbench.simulate(name, chain(3))
    with pytest.raises(TcbenchError, match="traced up to"):
        tcbench.simulate("scipy_dop853", chain(100))


def test_multipliers_and_constraints_go_together():
    with pytest.raises(TcbenchError, match="go together"):
        type("Half", (Rods,), {"multipliers": {}})
