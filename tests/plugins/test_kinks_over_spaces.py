"""Adaptive methods on arrays whose rates or energies have kinks."""

import numpy as np
import pytest
from mechanics import Mechanical, OfEntropies
from scipy.integrate import solve_ivp

import tcbench
from tcbench import Scenario
from tcbench.systems.right_hand_side import Field


class Row(Mechanical):
    """Masses between springs that yield beyond a limit, `a` being what stays of it: rates have kinks."""

    name = "yielding_row"
    variables = {"q": ("mass",), "p": ("mass",), "a": ("spring",), "s": ()}
    tables = {"ends": ("spring", 2, "mass")}
    constants = {"m": ("mass",), "k": (), "limit": (), "eta": ()}

    def stretch(self, z):
        left, right = z.q[self.ends].T
        return right - left

    def energy(self, z):
        held = self.k / 2 * (self.stretch(z) - z.a) ** 2 + z.a**2 / 4
        return (z.p**2 / self.m).sum() / 2 + held.sum() + (z.q**2).sum() / 8 + 2 * np.exp(z.s / 2)

    def irreversible(self, z, dE, dS):
        push, pull = -dE.a - self.limit, dE.a - self.limit
        flow = (abs(push) + push - abs(pull) - pull) / (2 * self.eta)
        return {"a": flow, "s": -(flow * dE.a).sum() / dE.s}


class Closing(Row):
    """Springs that push harder where they are closed: energies have kinks."""

    def energy(self, z):
        x, a = self.limit - self.stretch(z), z.a
        held = self.k / 2 * self.stretch(z) ** 2 + 15 * ((abs(x) + x) / 2) ** 2 + a**2
        return (z.p**2 / self.m).sum() / 2 + held.sum() + 2 * np.exp(z.s / 2)

    def irreversible(self, z, dE, dS):
        return {}


@pytest.mark.parametrize(
    ("kind", "n", "k", "limit", "eta"),
    [(Row, 30, 9.0, 0.3, 1.0), (Row, 5, 4.0, 0.4, 0.1), (Closing, 14, 1.0, -0.1, 1.0)],
)
@pytest.mark.parametrize("method", ["tc_gauss_adaptive", "controlled"])
def test_kinks_over_spaces_are_seen(method, kind, n, k, limit, eta):
    """Systems traced over their spaces had no kinks for collocation, which holds the defect between nodes only."""
    i = np.arange(n)
    constants = {"ends": np.stack([i[:-1], i[1:]], 1), "m": np.ones(n), "k": k, "limit": limit, "eta": eta}
    initial = {"q": 0.5 * np.sin(1.3 * i + 0.2), "p": 0.5 * np.cos(2.1 * i), "a": np.zeros(n - 1), "s": 0.0}
    scenario = Scenario("row", kind, constants, initial=initial, t_end=1.0, dt=0.05)
    exact = solve_ivp(Field(scenario.model).rate, (0.0, 1.0), scenario.z0, "DOP853", max_step=2e-3, rtol=1e-10,
                      atol=1e-10).y[:, -1]  # fmt: skip
    run = tcbench.simulate(method, scenario, tolerance=1e-5)
    assert run.ok, run.failure
    assert np.abs(run.z[-1] - exact).max() < 1e-5


class ShockTube(OfEntropies):
    """Cells of gas between nodes and walls, with von Neumann and Richtmyer's viscosity, against a squeeze alone."""

    name = "shock_tube"
    variables = {"x": ("node",), "p": ("node",), "s": ("cell",)}
    tables = {"ends": ("cell", 2, "node+wall")}
    constants = {"mass": ("node",), "wall": ("wall",), "m": ("cell",), "gamma": (), "c1": (), "c2": ()}

    def width(self, x):
        left, right = np.concatenate([x, self.wall])[self.ends].T
        return right - left

    def energy(self, z):
        power = (self.gamma - 1) * (z.s / self.m - np.log(self.width(z.x) / self.m))
        return (z.p**2 / (2 * self.mass)).sum() + (self.m * np.exp(power) / (self.gamma - 1)).sum()

    def reversible(self, z, dE, dS):
        return {"x": dE.p, "p": -dE.x}

    def irreversible(self, z, dE, dS):
        left, right = np.concatenate([dE.p, 0.0 * self.wall])[self.ends].T
        squeeze = np.maximum(left - right, 0.0)
        push = -self.m / self.width(z.x) * squeeze * (self.c1 + self.c2 * squeeze)
        return {"p": self.ends.sums(np.stack([push, -push], axis=1)), "s": push * (right - left) / dE.s}

    def temperature(self, z, dE, dS):
        return dE.s


@pytest.mark.parametrize(
    ("method", "tolerance", "middle"),
    [("tc_gauss_adaptive", 1e-6, 7), ("tc_gauss_adaptive", 1e-6, 17), ("controlled", 1e-5, 12)],
)
def test_cells_that_rest_in_their_kink_until_a_shock_comes_do_not_end_a_run(method, tolerance, middle):
    n, gamma = 24, 1.4
    k = np.arange(n)
    density, pressure = np.where(k < middle, 1.0, 0.2), np.where(k < middle, 2.0, 0.1)
    m, nodes = density / n, np.r_[n - 1, k[:-1], n]
    constants = {"ends": np.stack([nodes[:-1], nodes[1:]], 1), "mass": (m[:-1] + m[1:]) / 2, "wall": [0.0, 1.0], "m": m,
                 "gamma": gamma, "c1": 0.3, "c2": 1.0}  # fmt: skip
    entropies = m * np.log(pressure / density**gamma) / (gamma - 1)
    initial = {"x": (k[:-1] + 1) / n, "p": np.zeros(n - 1), "s": entropies}
    scenario = Scenario("tube", ShockTube, constants, initial=initial, t_end=0.15, dt=0.01)
    exact = solve_ivp(Field(scenario.model).rate, (0.0, 0.15), scenario.z0, "DOP853", max_step=1e-3, rtol=1e-10,
                      atol=1e-12).y[:, -1]  # fmt: skip
    run = tcbench.simulate(method, scenario, tolerance=tolerance)
    assert run.ok and np.abs(run.z[-1] - exact).max() < 10 * tolerance, run.failure
