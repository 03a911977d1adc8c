"""Random scenarios: the same digits everywhere and for ever, within their ranges, and refusals that say what to do."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import tcbench
from tcbench import Range, Scenario, ScenarioFamily, TcbenchError, plugins
from tcbench.systems.sampling import rounded

DIGITS = {  # measured results carry these names: numbers that differ here make them other scenarios
    0: {
        "conductivity": 0.188883, "coupling": 0.894138, "heat_capacity": 7.82526, "masses": [0.345125, 0.891622],
        "natural_lengths": [1.25848, 1.57568], "stiffness": [24.7253, 210.585],
        "positions": [-0.360428, -0.668744, -0.0300933, 0.979397],
        "momenta": [-2.30559, -1.99379, -0.15221, 0.423613], "temperatures": [260.285, 400.701],
    },
    1: {
        "conductivity": 0.339145, "coupling": 0.786696, "heat_capacity": 4.63902, "masses": [2.5517, 0.599484],
        "natural_lengths": [0.762909, 0.523795], "stiffness": [0.993664, 31.0873],
        "positions": [-0.524518, 1.48976, 0.157489, 1.45339],
        "momenta": [1.83299, -1.2369, -2.1664, 1.13795], "temperatures": [324.738, 366.774],
    },
    7: {
        "conductivity": 66.3479, "coupling": 0.946552, "heat_capacity": 17.2111, "masses": [0.851333, 0.314849],
        "natural_lengths": [1.53032, 2.08859], "stiffness": [0.147757, 5.61541],
        "positions": [2.68092, 2.05998, 1.9453, 2.68681],
        "momenta": [2.18233, -4.40939, -1.12805, 2.39712], "temperatures": [404.928, 262.973],
    },
}  # fmt: skip


def random(seed, **ranges):
    values = ",".join(f"{k}={v}" for k, v in {"seed": seed, **ranges}.items())
    return plugins.find_scenario(f"random[{values}]")


@pytest.mark.parametrize("seed", DIGITS)
def test_a_seed_has_the_same_digits_for_ever(seed):
    scenario = random(seed)
    numbers = scenario.constants | {n: list(getattr(scenario, n)) for n in ("positions", "momenta", "temperatures")}
    assert {name: numbers[name] for name in DIGITS[seed]} == DIGITS[seed]
    assert (numbers["reference_temperature"], scenario.t_end) == (300.0, 25.0)


@settings(max_examples=60)
@given(st.integers(0, 2**63 - 1))
def test_every_seed_lies_within_the_documented_ranges(seed):
    scenario, ranges = random(seed), plugins.registry().scenario_families["random"].ranges
    for name in ("stiffness", "masses", "natural_lengths", "conductivity", "heat_capacity", "coupling"):
        low, high = ranges[name].low, ranges[name].high
        assert np.all((low <= np.array(scenario.constants[name])) & (np.array(scenario.constants[name]) <= high))
    ratios = np.array(scenario.temperatures) / 300
    assert np.all((ratios >= 0.7 * (1 - 1e-5)) & (ratios <= 1.4 * (1 + 1e-5)))  # rounded to six digits
    q = np.array(scenario.positions)
    lengths = np.array([np.hypot(*q[:2]), np.hypot(*(q[2:] - q[:2]))]) / scenario.constants["natural_lengths"]
    assert np.all((lengths >= 0.4 * (1 - 1e-4)) & (lengths <= 2.5 * (1 + 1e-4)))


def test_a_restricted_range_changes_that_number_only():
    free, stiff = random(3), random(3, stiffness="100:300")
    assert stiff.name == "random[seed=3,stiffness=100:300]"
    assert min(stiff.constants["stiffness"]) >= 100 > min(free.constants["stiffness"])
    same = [name for name in free.constants if name != "stiffness"]
    assert {n: free.constants[n] for n in same} == {n: stiff.constants[n] for n in same}
    assert free.positions == stiff.positions and free.momenta == stiff.momenta
    assert random(3, conductivity="40").constants["conductivity"] == 40.0
    assert random(3, t_end="50").t_end == 50.0


def test_names_are_canonical_so_that_one_scenario_has_one_name():
    assert random("007").name == random(7, stiffness="0.03:300").name == "random[seed=7]"
    assert plugins.find_scenario("random").name == "random[seed=0]"
    assert random(7).replace(t_end=1.0).hash == random(7).hash


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"seed": "-1"}, "whole number"), ({"seed": "x"}, "whole number"), ({"seed": 2**63}, "whole number"),
        ({"seed": 1, "stiff": "3"}, "stiffness"), ({"seed": 1, "stiffness": "a:b"}, "low:high"),
        ({"seed": 1, "stiffness": "3:1"}, "low <= high"), ({"seed": 1, "stiffness": "0:1"}, "must be positive"),
        ({"seed": 1, "masses": "nan"}, "finite"), ({"seed": 1, "temperatures": "-1"}, "must be positive"),
    ],
)  # fmt: skip
def test_bad_members_are_refused_with_a_remedy(values, sentence):
    with pytest.raises(TcbenchError, match=sentence):
        random(**values)


def test_a_plugin_offers_a_family_of_its_own_system():
    base = tcbench.scenarios()["gas_containers"]

    def sample(draw):
        return base.replace(momenta=tuple(rounded(draw("momenta") * draw.normals(len(base.momenta)))))

    family = ScenarioFamily("random_gas", sample=sample, ranges={"momenta": Range(0.1, 1.0, log=True)})
    assert family.defaults == {"seed": "0", "momenta": "0.1:1"}
    member = family.member(seed="5")
    assert isinstance(member, Scenario) and member.name == "random_gas[seed=5]" and member.system is base.system
    assert member.momenta == family.member(seed="5").momenta != family.member(seed="6").momenta


def test_a_family_says_how_it_makes_its_members():
    with pytest.raises(TcbenchError, match="one of make= and sample="):
        ScenarioFamily("neither")
    with pytest.raises(TcbenchError, match="range of this family"):
        ScenarioFamily("wrong", sample=lambda draw: draw("mass")).member()
