"""`tcbench check` on systems that keep both laws near the start, and are wrong, or not what the theory asks for."""

import numpy as np
import pytest
from tiers import tiers

from tcbench import Scenario, System, scenarios
from tcbench.authoring import check, geometry
from tests.authoring.test_check_systems import ByMatrices, Right, lines_of

LAWS = ("formulas", "the operators", "far out")


def told(kind, verdict=check.NONE, only=LAWS):
    return {line.check: f"{line.found} {line.remedy}" for line in lines_of(kind, only=only) if line.verdict == verdict}


def velocity(self, z, dE, dS):
    return {"q": z.p, "p": -dE.q}


def heat_of_momenta(self, z, dE, dS):
    return {"p": -self.eta * z.p, "s": self.eta * z.p @ dE.p / dE.s}


def heat_of_momenta_twice(self, z, dE, dS):
    return {"p": -self.eta * z.p, "s": self.eta * z.p @ z.p / dE.s}


def beyond_two(self, z, dE, dS):
    force = self.eta * dE.p
    return {"p": -force, "s": force @ dE.p / dE.s * (1 + abs(z.q[0] - 2) + z.q[0] - 2)}


NEAR_ONLY = [
    ("reversible", velocity, "reversible keeps energy"),
    ("irreversible", beyond_two, "far out"),
    ("irreversible", heat_of_momenta, "irreversible never lowers entropy"),
    ("irreversible", heat_of_momenta_twice, "irreversible keeps energy"),
]


@pytest.mark.parametrize(("name", "wrong", "claim"), tiers(NEAR_ONLY, NEAR_ONLY[:2]))
def test_what_holds_at_true_gradients_near_the_start_only_is_found(name, wrong, claim):
    """dE.p is p there, and discrete gradients that know that p^2 is quadratic keep it so; Gonzalez's does not."""
    failed = told(type("Wrong", (Right,), {name: wrong}), check.FAIL)
    assert [*failed] == [claim] and f"test_geometry.py, line {wrong.__code__.co_firstlineno}, {name}()" in failed[claim]


def test_the_terms_that_do_not_cancel_are_told_and_a_sign_that_is_wrong():
    lost = type("Lost", (Right,), {"irreversible": lambda self, z, dE, dS: {"p": -self.eta * dE.p}})
    assert "At worst dE . rate = (-" in (found := told(lost, check.FAIL))["irreversible keeps energy"]
    assert " of p), at q0 = " in found["irreversible keeps energy"]
    cools = {"irreversible": lambda self, z, dE, dS: {"p": self.eta * dE.p, "s": -self.eta * dE.p @ dE.p / dE.s}}
    found = told(type("Cools", (Right,), cools), check.FAIL)
    assert "falls everywhere: is a sign wrong?" in found["irreversible never lowers entropy"]


def bent(self, z, dE, dS):
    return {"q": (1 + z.p[1] ** 2) * dE.p, "p": -(1 + z.p[1] ** 2) * dE.q}


def bent_matrix(self, z):
    L = np.zeros((5, 5), dtype=object)
    L[0, 2] = L[1, 3] = 1 + z.p[1] ** 2
    return L - L.T


def faster(self, z, dE, dS):
    return {"q": dE.p * (1 + dE.p @ dE.p), "p": -dE.q * (1 + dE.p @ dE.p)}


def gyroscope(self, z, dE, dS):
    force = self.eta * (dE.p + np.array([dE.p[1], -dE.p[0]]))
    return {"p": -force, "s": force @ dE.p / dE.s}


NOT_OF_THE_THEORY = {
    "Jacobi": (Right, {"reversible": bent}, "bracket", "Jacobi's identity is violated by"),
    "Jacobi, matrix": (ByMatrices, {"poisson": bent_matrix}, "bracket", "Jacobi's identity is violated by"),
    "not linear": (Right, {"reversible": faster}, "bracket", "not linear in dE"),
    "not symmetric": (Right, {"irreversible": gyroscope}, "Onsager", "the rate of p0 changes with dE of p1 by -0.1"),
    "falls": (Right, {"energy": lambda self, z: z.p @ z.p / 2 + z.q @ z.q / 2 + 9 * z.s - np.exp(z.s),
        "temperature": lambda self, z, dE, dS: dE.s, "exergy_offset": lambda self: 1e3},
        "temperatures", "falls as s takes up energy"),
    "cools far out": (Right, {"irreversible": lambda self, z, dE, dS:
        {"p": -self.eta * (3 + z.q[0]) * dE.p, "s": self.eta * (3 + z.q[0]) * dE.p @ dE.p / dE.s}},
        "far out", "the entropy falls at q0 = -"),
}  # fmt: skip


@pytest.mark.parametrize("fault", tiers(NOT_OF_THE_THEORY, ("Jacobi", "not symmetric", "falls")))
def test_what_the_laws_do_not_need_is_told_and_does_not_fail(fault):
    kind, formulas, name, words = NOT_OF_THE_THEORY[fault]
    wrong = type("Wrong", (kind,), formulas)
    lines = {line.check: line for line in lines_of(wrong, only=("the operators", name))}
    assert all(line.verdict != check.FAIL for line in lines.values()) and words in lines[name].found
    assert "test_geometry.py, line" in lines[name].found


class Twisted(System):
    """so(3)* with an entropy of its Casimir, as the rigid body; or with a bracket of no Lie algebra."""

    variables = {"m": (3,)}
    constants = {"twist": ()}

    def energy(self, z):
        return z.m[0] ** 2 / 2 + z.m[1] ** 2 / 4 + z.m[2] ** 2 / 6 + z.m[0] ** 4

    def entropy(self, z):
        return 0.0 * z.m[0]

    def reversible(self, z, dE, dS):
        x, y, w = z.m
        return {"m": np.cross(np.array([x, y + self.twist * x * x * w, w + self.twist * y]), dE.m)}


@pytest.mark.parametrize("twist, verdict", [(0.0, check.OK), (0.3, check.NONE)])
def test_a_lie_poisson_bracket_is_one(twist, verdict):
    """The bracket v(m) x dE satisfies Jacobi's identity where v . curl v = 0."""
    scenario = Scenario("t", Twisted, {"twist": twist}, initial={"m": [1, 0.4, 0.7]}, t_end=1, dt=0.1)
    *_, line = check.scenario_lines(scenario, ["bracket"])
    assert line.verdict == verdict


class Aligned(System):
    """Its gradients are nearly parallel: the terms of the irreversible rate cancel, and leave their round-off."""

    variables = {"x": (3,)}

    def energy(self, z):
        return z.x[0] ** 2 + 1.01 * z.x[1] ** 2 + 1.02 * z.x[2] ** 2

    def entropy(self, z):
        return -((z.x @ z.x) ** 2) / 4

    def reversible(self, z, dE, dS):
        return {"x": np.cross(dS.x / (z.x @ z.x), dE.x)}

    def irreversible(self, z, dE, dS):
        return {"x": (dE.x @ dE.x) * dS.x - dE.x * (dE.x @ dS.x)}


def test_round_off_is_no_fault():
    scenario = Scenario("a", Aligned, {}, initial={"x": [1, 0.2, 0.4]}, t_end=1, dt=0.1, shows="x", source="x")
    assert [line for line in check.scenario_lines(scenario, LAWS) if line.verdict == check.FAIL] == []


def test_what_ships_is_of_the_theory():
    for name, bracket in (("heavy_top", check.OK), ("reaction", check.NONE)):
        lines = {line.check: line for line in check.scenario_lines(scenarios()[name], [n for n, _ in geometry.TESTS])}
        assert lines["far out"].verdict == lines["Onsager"].verdict == check.OK and not lines["temperatures"].remedy
        assert lines["bracket"].verdict == bracket


class ExpandsWhenWarm(Right):
    """A temperature of two terms: with slopes of its own for each it may be negative, and then S falls, rightly."""

    def energy(self, z):
        return super().energy(z) - 0.5 * z.s * np.exp((z.q[0] - 1) / 4)

    def temperature(self, z, dE, dS):
        return dE.s


def test_entropy_is_owed_where_temperatures_are_positive_only():
    assert "irreversible never lowers entropy" not in told(ExpandsWhenWarm, check.FAIL)
