"""Copies and pickles of scenarios, systems, steppers, methods and runs have memory of their own."""

import copy
import pickle

import pytest

import tcbench
from tcbench.plugins import find_integrator, find_scenario

from ..helpers.every_kind import CASES, KINDS, ids, method_of, settings, simulate, told

COPIES = {"copy": copy.copy, "deepcopy": copy.deepcopy, "pickle": lambda item: pickle.loads(pickle.dumps(item))}


@pytest.mark.parametrize("case", [*CASES[: len(KINDS)], ("tc_monolithic", "net[nx=3,ny=3]")], ids=ids)
def test_copies_of_a_scenario_that_has_run_run_as_it_did(case):
    name, system = case
    scenario = find_scenario(system).replace(t_end=0.2)
    alone = simulate(name, scenario)
    if method_of(name).kind != "adaptive" and not method_of(name).memory:
        tcbench.stepper(method_of(name), scenario)(scenario.z0, 0.02)
    for copied in COPIES.values():
        again = copied(scenario)
        assert again == scenario and simulate(name, again) == alone
        with pytest.raises(ValueError, match="read-only"):
            again.z0[0] = 1.0
    assert simulate(name, scenario) == alone


def test_a_stepper_that_is_copied_has_memory_of_its_own():
    scenario = find_scenario("bound_equilibrium")
    for name in ("tc_monolithic", "tc_gauss"):
        step = tcbench.stepper(name, scenario)
        expected = step(scenario.z0, 0.1).tobytes()
        for copied in COPIES.values():
            again = copied(step)
            assert again.iterations == 0 and again(scenario.z0, 0.1).tobytes() == expected


@pytest.mark.parametrize(
    "name",  # not dop853: SciPy's counts one evaluation more or less in two equal runs
    ["tc_monolithic", "tc_gauss", "tc_auto", "tc_taylor[order=8]", "scipy_dopri5", "controlled[method=tc_monolithic]"],
)
def test_integrators_and_runs_can_be_pickled_and_copied(name):
    scenario = find_scenario("bound_equilibrium").replace(t_end=0.2)
    method, alone = find_integrator(name), simulate(name, scenario)
    run = tcbench.simulate(method, scenario, **settings(method))
    for copied in COPIES.values():
        assert told(tcbench.simulate(copied(method), scenario, **settings(method))) == alone
        assert told(copied(run)) == alone
