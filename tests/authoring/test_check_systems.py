"""`tcbench check` on systems with one fault each: what is wrong is said once, with the author's line."""

import math
import re

import numpy as np
import pytest
from mechanics import OfEntropies
from tiers import tiers

from tcbench import Scenario, TcbenchError
from tcbench.authoring import check
from tcbench.systems.right_hand_side import Field

CALLS = [0]


class Potentials(OfEntropies):
    name = "right"
    variables = {"q": (2,), "p": (2,), "s": ()}
    constants = {"eta": (), "theta": ()}
    reference_temperature = "theta"

    def energy(self, z):
        return z.p @ z.p / 2 + z.q @ z.q / 2 + np.exp(z.s)


class Right(Potentials):
    def reversible(self, z, dE, dS):
        return {"q": dE.p, "p": -dE.q}

    def irreversible(self, z, dE, dS):
        force = self.eta * dE.p
        return {"p": -force, "s": force @ dE.p / dE.s}


class ByMatrices(Potentials):
    def poisson(self, z):
        L = np.zeros((5, 5))
        L[0, 2] = L[1, 3] = 1
        return L - L.T

    def friction(self, z):
        v, theta = z.p, np.exp(z.s)
        B = np.array([[0, 0], [0, 0], [1, 0], [0, 1], [-v[0] / theta, -v[1] / theta]])
        return self.eta * theta * B @ B.T


def counted(self, z, dE, dS):
    CALLS[0] += 1
    return {"p": -CALLS[0] * dE.p, "s": CALLS[0] * dE.p @ dE.p / dE.s}


def in_place(self, z, dE, dS):
    force = dE.p
    force *= self.eta
    return {"p": -force, "s": force @ dE.p / dE.s}


def kept(self, z, dE, dS):
    self.force = self.eta * dE.p
    return {"p": -self.force, "s": self.force @ dE.p / dE.s}


def of_floats(self, z, dE, dS):
    rate = np.zeros(2)
    rate[0] = dE.p[0]
    return {"p": -rate}


def misnamed(self, z, dE, dS):
    return {"P": -dE.p}


def by_math(self, z, dE, dS):
    return {"p": -math.sin(z.q[0]) * dE.p}


def number_first(self, z, dE, dS):
    return {"p": -np.hypot(1.0, dE.p[0]) * dE.p}


FAULTS = {  # formula -> (what is wrong with it, lines below its first, words of the sentence)
    "counter": ("irreversible", counted, None, "not the same"),
    "in place": ("irreversible", in_place, 2, "does not write to its arguments"),
    "kept in self": ("irreversible", kept, 1, "sets self.force"),
    "an array of floats": ("irreversible", of_floats, 2, "dtype=object"),
    "a variable that is none": ("irreversible", misnamed, 0, "No variable of 'right' is called 'P'"),
    "math": ("irreversible", by_math, 1, "np.|numpy"),
    "a number before a formula": ("irreversible", number_first, 1, "write the number a as a + 0 * x"),
    "invariants in a list": ("invariants", lambda self, z: [z.p @ z.p], 0, "by name"),
    "an invariant of two numbers": ("invariants", lambda self, z: {"p": z.p}, 0, "one number, not 'p'"),
    "measures by name": ("measures", lambda self, z: {"r": z.q @ z.q}, 0, "not dict"),
    "no temperature": ("temperature", lambda self, z, dE, dS: None, 0, "missing"),
    "a picture of one point": ("points", lambda self, z: [z.q], None, "points"),
}  # fmt: skip


SLOW = ("the paper's methods", "invariants by steps", "exergy", "smooth")  # a second each
BY_FORMULAS = [name for name in check.OF_SCENARIOS if name not in SLOW]


def lines_of(kind, eta=0.1, only=BY_FORMULAS):
    settings = {"initial": {"q": [1, 0], "p": [0, 1], "s": 0}, "t_end": 1, "dt": 0.1, "shows": "x", "source": "x"}
    try:
        scenario = Scenario("wrong", kind, {"eta": eta, "theta": 1}, **settings)
    except TcbenchError as error:  # as when its file is loaded
        return [check.Line("loads", check.FAIL, str(error))]
    return list(check.scenario_lines(scenario, only))


def failed(kind):
    return {line.check: f"{line.found} {line.remedy}" for line in lines_of(kind) if line.verdict == check.FAIL}


@pytest.mark.parametrize("fault", FAULTS)
def test_one_sentence_names_the_line(fault):
    name, wrong, below, words = FAULTS[fault]
    found = failed(type("Wrong", (Right,), {name: wrong}))
    assert len(found) == 1
    (sentence,) = found.values()
    assert any(word in sentence for word in words.split("|"))
    if below is not None:
        assert f"test_check_systems.py, line {wrong.__code__.co_firstlineno + below}:" in sentence


class Root(Right):
    """The slope of its last term is infinite at q1 = 0, where the lines below let it start."""

    def energy(self, z):
        return super().energy(z) + np.hypot(1.0 + 0 * z.p[0], z.p[0]) + np.sqrt(z.q[1])


class Power(Right):
    def energy(self, z):
        return super().energy(z) + z.q[1] ** 0.3


class Angle(Right):
    """Of 0/0."""

    def energy(self, z):
        return super().energy(z) + np.arctan2(z.q[1], 2 * z.q[1])


@pytest.mark.parametrize("kind", [Root, Power, Angle])
def test_a_rate_that_is_no_number_at_the_start_is_told(kind):
    assert "the rate of p is not finite" in failed(kind)["formulas"]
    system = kind(eta=0.1, theta=1)
    with pytest.raises(ArithmeticError, match="not finite at the start"):  # SciPy's RK45 would never come back
        Field(system).rate(0.0, np.array([1.0, 0, 0, 1, 0]))


def matrix(name, change):
    right = getattr(ByMatrices, name)

    def wrong(self, z):
        A = np.array(right(self, z), dtype=object)
        A[2, 3] = A[2, 3] + change
        return A

    return name, wrong


MATRICES = {
    "not skew": (*matrix("poisson", 0.1), "L is skew"),
    "not symmetric": (*matrix("friction", 0.1), "M is symmetric"),
    "degenerate for another gradient": (
        "friction", lambda self, z: np.diag([0, 0, self.eta, self.eta, self.eta]), "M grad E = 0",
    ),
    "of another shape": ("friction", lambda self, z: np.eye(4), "formulas"),
}  # fmt: skip


@pytest.mark.parametrize("fault", tiers(MATRICES, ("not symmetric", "of another shape")))
def test_matrices_are_asked_before_they_are_projected(fault):
    """Projected, each of these keeps both laws and is another system."""
    name, wrong, claim = MATRICES[fault]
    found = failed(type("Wrong", (ByMatrices,), {name: wrong}))
    assert f"test_check_systems.py, line {wrong.__code__.co_firstlineno}" in found[claim]


class TwoBodies(Right):
    variables = {"q": (2,), "p": (2,), "s": (2,)}

    def energy(self, z):
        return z.p @ z.p / 2 + z.q @ z.q / 2 + np.exp(z.s).sum()

    def entropy(self, z):
        return z.s.sum()

    def irreversible(self, z, dE, dS):
        return {"p": -self.eta * dE.p, "s": self.eta * (dE.p @ dE.p) / (2 * dE.s)}


@pytest.mark.parametrize(
    ("temperature", "verdict"),
    [
        (lambda self, z, dE, dS: dE.s, check.OK),
        (lambda self, z, dE, dS: dE.s.mean(), check.NONE),  # between the two
        (lambda self, z, dE, dS: dE.s - 0.5, check.FAIL),  # not absolute
        (lambda self, z, dE, dS: 3 * dE.s.sum(), check.FAIL),
    ],
)
def test_a_wrong_temperature_fails_and_a_mean_does_not(temperature, verdict):
    """It was a "-" line, which nobody mends."""
    kind = type("Warm", (TwoBodies,), {"temperature": temperature})
    start = {"q": [1, 0], "p": [0, 1], "s": [0.1, 0.3]}
    scenario = Scenario("warm", kind, {"eta": 0.1, "theta": 1}, initial=start, t_end=1, dt=0.1)
    *_, line = check.scenario_lines(scenario, ["temperatures"])
    assert line.verdict == verdict and (" at q0 = " in line.found) == (verdict == check.FAIL)
    *_, line = check.scenario_lines(scenario, ["metadata"])
    assert (line.verdict, line.found) == (check.NONE, "shows and source empty")  # a note for readers, no failure


def test_a_violated_condition_is_told_with_its_terms_and_its_state():
    lost = type("Lost", (Right,), {"irreversible": lambda self, z, dE, dS: {"p": -dE.p, "s": 0.9 * dE.p @ dE.p / dE.s}})
    assert re.search(r"dE \. rate = .* of p.* of s\), at q0 = [^,]+, q1 = ", failed(lost)["irreversible keeps energy"])


@pytest.mark.parametrize(
    ("kind", "only"), [pytest.param(Right, (), marks=pytest.mark.thorough), (ByMatrices, BY_FORMULAS)]
)
def test_what_is_right_passes(kind, only):
    lines = lines_of(kind, only=only)
    assert {"formulas", "bracket"} <= {line.check for line in lines} and all(x.verdict != check.FAIL for x in lines)


def test_a_reference_temperature_may_be_the_name_of_a_constant():
    scenario = Scenario(
        "r", Right, {"eta": 0.1, "theta": 2}, initial={"q": [1, 0], "p": [0, 1], "s": 0.5}, t_end=1, dt=0.1
    )
    assert scenario.model.exergy(scenario.z0) == pytest.approx(1 + np.exp(0.5) - 1)
    assert scenario.model.reference_temperature == 2
    with pytest.raises(TcbenchError, match="'warm' names no constant that is a number; those are: eta, theta"):
        type("Wrong", (Right,), {"reference_temperature": "warm"})


def misspelt(self, z, dE, dS):
    return {"q": dE.p, "p": -dE.q}


def swapped(self, z, dS, dE):
    return {"q": dE.p, "p": -dE.q}


@pytest.mark.parametrize(
    "wrong, told",
    [
        ({"reversable": misspelt}, r"writes reversable\(\), which nothing calls, and no reversible"),
        ({"reversible": swapped}, r"writes reversible\(z, dS, dE\); it is given \(z, dE, dS\)"),
        ({"variables": {"eta": (), "p": (2,), "s": ()}}, "called 'eta', the name of a constant"),
    ],
)
def test_another_system_than_the_author_means_is_no_class(wrong, told):
    """Each of these was a system without motion, and every line passed."""
    with pytest.raises(TcbenchError, match=told):
        type("Wrong", (Potentials,), wrong)
    type("Fine", (Potentials,), {"reversable": lambda self, z: z, "entropies": misspelt, "reversible": misspelt})


def test_what_does_not_move_and_what_nothing_reads_is_told():
    assert "nothing moves" in failed(Potentials)["formulas"]
    kind = type("Unread", (Right,), {"irreversible": lambda self, z, dE, dS: {"p": -dE.p, "s": dE.p @ dE.p / dE.s}})
    *_, line = lines_of(kind, only=["formulas"])
    assert line.verdict == check.OK and "none reads eta" in line.found


JUMPS = [
    (lambda x: abs(x), check.NONE, "slope by q1 jumps from"),
    (lambda x: x / abs(x) / 5, check.FAIL, "its value jumps from"),
    (lambda x: np.tanh(100 * x), check.OK, "no jump"),
    (lambda x: np.sqrt((x - 0.2) ** 2), check.NONE, "slope by q1 jumps from"),
    (lambda x: (abs(x) + x) ** 2, check.OK, "no jump"),
]


@pytest.mark.parametrize(("term", "verdict", "told"), tiers(JUMPS, JUMPS[:3]))
def test_jumps_are_told_with_the_line(term, verdict, told):
    kind = type("Jumps", (Right,), {"energy": lambda self, z: Right.energy(self, z) + term(z.q[1] + 0.1)})
    *_, line = lines_of(kind, only=["smooth"])
    assert line.verdict == verdict and told in line.found
    assert ("test_check_systems.py, line" in line.found) == (verdict != check.OK)


def test_a_check_ends_where_no_random_state_is_admissible():
    """It looked for them without end."""
    cold = type("Cold", (Right,), {"temperature": lambda self, z, dE, dS: -dE.s})
    assert [*failed(cold)] == ["positive"] and lines_of(cold)[-1].check == "the rest"


@pytest.mark.thorough
def test_a_check_ends_where_few_random_states_are_admissible():
    narrow = type("Narrow", (Right,), {"measures": lambda self, z: 1e-5 - (self.energy(z) - 2) ** 2})
    assert failed(narrow) == {}
