"""`tcbench check` names the author's line: of a plugin's formula, and of any system's."""

from dataclasses import replace

import conserving
import numpy as np
import pytest
from command import tcbench as command
from mechanics import Warm
from tiers import tiers

import tcbench
from tcbench import plugins
from tcbench.authoring import check, scenario_checks
from tcbench.authoring import integrator_checks as contract

FORMULAS = """
import numpy as np
from tcbench import Integrator, hookimpl

def branching(z0, z1, h, system):
    return z1 if z0[0] > 0 else z0

def silent(z0, z1, h, system):
    z1 - z0 - h * system.vector_field((z0 + z1) / 2)

def misspelt(z0, z1, h, system):
    return z1 - z0 - h * system.vectorfield(z0)

def fewer(z0, z1, h):
    return z1 - z0

def nothing(z, h, system):
    z + h

def scipys(z, h, system):
    from scipy.optimize import brentq
    return brentq(lambda x: 1.0, 0.0, 1.0)

@hookimpl
def tcbench_integrators():
    traced = (branching, silent, misspelt, fewer)
    formulas = [Integrator(name=f.__name__, order=2, source="x", flows=f) for f in traced]
    return formulas + [Integrator(name=f.__name__, order=2, source="x", step=f) for f in (nothing, scipys)]
"""


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("branching", "mine.py, line 6: a branch on the value of a symbol"),
        ("silent", "returned nothing (is `return` missing?)"),
        ("nothing", "is `return` missing?"),
        ("misspelt", "'Pendulum' has no 'vectorfield' (did you mean 'vector_field'?).\n"),
        ("fewer", "takes (z0, z1, h, system); yours takes (z0, z1, h)."),
        ("scipys", "at mine.py:22"),
    ],
)
def test_the_sentence_names_the_line_of_the_plugin_and_none_of_ours(tmp_path, name, words):
    (tmp_path / "mine.py").write_text(FORMULAS)
    done = command("check", name, "--only", "runs,input unchanged", "--plugins-dir", str(tmp_path))
    assert done.returncode == 1 and words in done.stdout, done.stdout
    assert not any(
        ours in done.stdout for ours in ("python_loop.py", "symbols.py", "segmentation fault", "must not die")
    )
    method = plugins.find_integrator(name)
    assert ".py:" not in check._guarded("order", dict(contract.TESTS)["order"], method).found.replace("mine.py:", "")


class Friction(Warm):
    """A mass whose friction heats a bath, right; below it is planted wrong."""

    name = "friction_bath"

    def energy(self, z):
        return z.p**2 / 2 + z.q**2 / 2 + np.exp(z.s)

    def irreversible(self, z, dE, dS):
        return {"p": -dE.p, "s": dE.p**2 / dE.s}


GENERAL = {  # what is wrong -> the check that finds it
    "reversible": (lambda self, z, dE, dS: {"q": dE.p, "p": -dE.q * (1 + z.q)}, "reversible keeps energy"),
    "irreversible": (lambda self, z, dE, dS: {"p": -dE.p, "s": dE.p**2 / np.exp(z.s)}, "irreversible keeps energy"),
    "invariants": (lambda self, z: {"momentum": z.p}, "momentum is invariant"),
}


@pytest.mark.parametrize("name", tiers(GENERAL, ("irreversible",)))
def test_of_any_system_the_line_of_the_formula_is_named(name):
    """irreversible: right at the true gradients, where dE.s is exp(s), and wrong at those that a method puts in."""
    wrong, claim = GENERAL[name]
    kind = type("Wrong", (Friction,), {name: wrong})
    scenario = tcbench.Scenario("wrong", kind, {}, initial={"q": 1, "p": 0.5, "s": 0}, t_end=1, dt=0.1)
    failed = {line.check: line.remedy for line in scenario_checks.laws(scenario) if line.verdict == check.FAIL}
    assert f"test_check_places.py, line {wrong.__code__.co_firstlineno}, " in failed[claim]
    right = replace(scenario, system=Friction)
    assert all(line.verdict == check.OK for line in [*scenario_checks.laws(right), scenario_checks.entropies(right)])


def test_an_exergy_that_is_mostly_offset_is_told():
    """The least of p^2/2 + q^2/2 + exp(s) - s is 1."""
    set_to_zero = type("SetToZero", (Friction,), {"reference_temperature": 1.0})
    right = type("Right", (set_to_zero,), {"exergy_offset": lambda self: -1.0})
    for kind, remedy in ((set_to_zero, "let exergy_offset() give -1 more"), (right, "")):
        scenario = tcbench.Scenario("offset", kind, {}, initial={"q": 0.5, "p": 0.5, "s": 0.1}, t_end=1, dt=0.1)
        found = scenario_checks.exergy(scenario)
        assert found.verdict == check.OK and remedy in found.remedy and bool(remedy) == bool(found.remedy)


def test_what_is_named_as_a_scenario_is_one():
    """A pattern and a member of a family as well, and nothing that is an integrator."""
    names = [subject.name for subject in check.named([], ["*_term", "chain[n=2]"])]
    assert names == ["long_term", "short_term", "chain[n=2]"]
    assert [subject.kind for subject in check.subjects("chain[n=2]")] == ["scenario"]
    for wrong in (([], ["tc_strang"]), (["short_term"], [])):
        with pytest.raises(tcbench.TcbenchError, match="is called"):
            check.named(*wrong)


LOST = [("kepler", "lenz x by steps"), ("volterra", "casimir by steps")]


@pytest.mark.parametrize(("name", "steps"), tiers(LOST, LOST[:1]))
def test_an_invariant_that_steps_lose_is_no_fault_of_the_system(name, steps):
    """The equations keep Runge-Lenz, no rate alone does at other gradients: check says which methods lose it, why."""
    scenario = next(one for one in conserving.LOST if one.name == name)
    lines = {
        line.check: line for line in [*scenario_checks.laws(scenario), *scenario_checks.invariants_by_steps(scenario)]
    }
    assert all(line.verdict != check.FAIL for line in lines.values())
    assert "tc_monolithic" in lines[steps].found and "tc_invariant keeps it" in lines[steps].remedy
