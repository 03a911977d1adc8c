"""What a method is for: systems, what it asks of them, packages; one place decides, and everyone asks it."""

import re

import numpy as np
import pytest

import tcbench
from tcbench import Flow, Integrator, TcbenchError
from tcbench.plugins import find_scenario
from tcbench.runner.plan import plan_job

PENDULUM, GAS, BODY = (find_scenario(name).model for name in ("short_term", "gas_containers", "rigid_body"))


def method(**declared):
    return Integrator(name="mine", order=1, step=lambda z, h, system: z + h * system.vector_field(z), **declared)


@pytest.mark.parametrize(
    "declared, system, reason",
    [
        ({}, PENDULUM, ""),
        ({}, find_scenario("chain[n=3]").model, ""),
        ({"systems": {"chain"}}, find_scenario("chain[n=1000]").model, ""),
        ({"systems": ["chain"]}, PENDULUM, "written for chain only, not for pendulum"),
        ({"needs": ["conduction_flow"]}, PENDULUM, ""),
        ({"needs": ["conduction_flow"]}, GAS, r"gas_containers does not define: write conduction_flow\(\) in"),
        (
            {"variables": "energy"},
            BODY,
            "no elements with both: write its class as an ElementSystem .* or take a method",
        ),
        ({"elements": True}, BODY, "and rigid_body has none: write its class as an ElementSystem .* or take a method"),
        ({"needs": ["heat_pump"]}, PENDULUM, "needs heat_pump, which the system pendulum does not define"),
    ],
)
def test_a_method_says_which_systems_it_is_for_and_why_not(declared, system, reason):
    found = method(**declared).suits(system)
    assert re.search(reason, found) if reason else found == ""


def test_what_does_not_suit_is_refused_and_left_out_for_the_same_reason():
    mine = method(needs=["conduction_flow"])
    with pytest.raises(TcbenchError) as refused:
        tcbench.simulate(mine, "gas_containers")
    with pytest.raises(TcbenchError) as left_out:
        plan_job([mine], ["gas_containers"], ["conservation"])
    for error in (refused, left_out):
        assert mine.suits(GAS) in str(error.value)
    assert {c.scenario for c in plan_job([mine], ["gas_containers", "short_term"], ["conservation"]).cells} == {
        "short_term"
    }


def test_an_absent_package_is_named_with_its_cure():
    mine = method(requires=["numpy", "no-such-package"])
    assert mine.versions()["no-such-package"] is None and mine.versions()["numpy"][0].isdigit()
    assert mine.lacks == "it needs packages that are not installed: pip install no-such-package"
    with pytest.raises(TcbenchError, match=r"'mine' cannot run on 'short_term': .*pip install no-such-package"):
        tcbench.simulate(mine, "short_term")
    assert method(requires=["numpy"]).lacks == ""


def test_one_word_in_the_place_of_several_is_refused():
    with pytest.raises(TcbenchError, match="needs must be a set of words"):
        method(needs="conduction_flow")


def test_a_blow_up_is_one_whatever_the_user_has_told_numpy_and_counts_that_are_none_are_named():
    explosive = Integrator(name="explosive", order=1, step=lambda z, h, system: np.asarray(z) * 1e200 * 1e200)
    plain = tcbench.simulate(explosive, "damped_oscillator")
    with np.errstate(all="raise"):
        told = tcbench.simulate(explosive, "damped_oscillator")
        assert np.geterr()["over"] == "raise"
    assert plain.status == told.status == "nonfinite"

    def adaptive(system, z0, t_eval, rtol, atol):
        return np.repeat(np.asarray(z0)[None], len(t_eval), axis=0), {"steps": "many"}

    run = tcbench.simulate(Integrator(name="counts", adaptive=adaptive), "damped_oscillator")
    assert run.status == "exception" and "counts are whole numbers, and 'steps' is 'many'" in run.failure


def test_numbers_of_other_kinds_are_those_of_python():
    """float32's 1 times a step of 0.1 had the digits of float32, int8's 3 stages of 100 numbers no room."""

    def midpoint(z0, z1, h, system):
        return z1 - z0 - h * system.vector_field(0.5 * (z0 + z1))

    flow = Flow(midpoint, np.float32(1.0), stages=np.int8(0), most=np.int16(1))
    assert [type(x) for x in (flow.fraction, flow.stages, flow.memory, flow.most)] == [float, int, int, int]
    one, other = (tcbench.simulate(Integrator(name="a", order=2, flows=[f]), "short_term") for f in (flow, midpoint))
    assert np.array_equal(one.z, other.z)
    with pytest.raises(TcbenchError, match="stages from 0"):
        Flow(midpoint, memory=-1)
