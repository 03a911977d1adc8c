"""A 0/0 in an author's own quotient is named as such, with its line; what is none is not accused."""

import numpy as np
import pytest

import tcbench
from tcbench import Integrator
from tcbench.authoring import integrator_checks as checks
from tcbench.building_blocks import divided_difference
from tcbench.solver.quotients import zero_over_zero

SCENARIO = tcbench.scenarios()["short_term"]


def textbook(z0, z1, h, system):
    """A quotient that is one wherever it exists, as printed: nowhere at z1 = z0."""
    one = (z1.p @ z1.p - z0.p @ z0.p) / ((z1.p - z0.p) @ (z1.p + z0.p))
    return z1 - z0 - h * one * system.vector_field((z0 + z1) / 2)


def tamed(z0, z1, h, system):
    slope = divided_difference(lambda s: np.exp(s / 3), z0.s[0], z1.s[0])
    return z1 - z0 - h * system.vector_field((z0 + z1) / 2) * slope / slope


BAD, GOOD = (Integrator(name=f.__name__, order=2, source="x", flows=f) for f in (textbook, tamed))


def test_a_run_and_the_check_name_the_line():
    line = textbook.__code__.co_firstlineno + 2
    run = tcbench.simulate(BAD, SCENARIO)
    assert not run.ok and f"divides 0 by 0 at z1 = z0 (test_quotients.py, line {line})" in run.failure
    assert "building_blocks" in run.failure
    found = checks.quotients(BAD)
    assert found.verdict == checks.FAIL and f"line {line}" in found.found and "building_blocks" in found.remedy


def test_what_divides_by_nothing_that_vanishes_is_not_accused():
    assert tcbench.simulate(GOOD, SCENARIO).ok and checks.quotients(GOOD).verdict == checks.OK
    for name, method in tcbench.integrators().items():
        if method.kind == "flows" and not method.suits(SCENARIO.model):
            assert not any(zero_over_zero(f, SCENARIO.model, SCENARIO.z0, 0.1) for f in method.flows), name


def test_what_has_overflowed_at_this_step_is_not_accused():
    """Neither in compiled code, which raises no flag, nor where a logarithm has no value."""

    def far(z0, z1, h, system):
        size = system.energy(system.state(z0 * (1 + 1e180 * (10 * h) ** 60)))
        return z1 - z0 - h * system.vector_field((z0 + z1) / 2) * (size / size)

    def negative(z0, z1, h, system):
        return z1 - z0 - h * np.log(-1 - z0.p @ z0.p) * system.vector_field((z0 + z1) / 2)

    for wrong in (far, negative):
        run = tcbench.simulate(Integrator(name=wrong.__name__, order=1, source="x", flows=wrong), SCENARIO, dt=0.1)
        assert not run.ok and "0 by 0" not in run.failure


def test_a_run_that_ends_for_another_reason_says_nothing_of_it():
    run = tcbench.simulate("midpoint_entropy", SCENARIO, dt=2.0, continuation=False, t_end=200.0)
    assert not run.ok and "0 by 0" not in run.failure


@pytest.mark.parametrize("name", ["tc_gauss", "scipy_odeint"])
def test_other_kinds_have_no_formula_to_look_at(name):
    assert checks.quotients(tcbench.integrators()[name]).verdict == checks.NONE
