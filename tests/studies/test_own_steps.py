"""The largest step of methods that are given by a step function, and the loosest tolerance of adaptive ones."""

import math

import numpy as np
import pytest

import tcbench
from tcbench import Integrator
from tcbench.analysis import stable_step as S

SCENARIO = tcbench.scenarios()["bound_equilibrium"].replace(t_end=10.0)


def euler(z, h, system):
    return z + h * system.vector_field(z)


def test_a_step_function_has_the_limit_that_its_runs_show():
    method = Integrator(
        name="midpoint", order=2, step=lambda z, h, s: z + h * s.vector_field(z + h / 2 * s.vector_field(z))
    )
    row, points = S.maximum_own_step(method, SCENARIO)
    assert row["limit"] == "physical" and row["dt_stable"] < row["dt_unstable"] <= row["dt_half"]
    assert tcbench.simulate(method, SCENARIO, dt=row["dt_stable"]).ok
    assert not tcbench.simulate(method, SCENARIO, dt=row["dt_unstable"]).ok
    assert {p["solver"] for p in points} == {"own"} and row["cause"]


def test_a_formula_and_the_same_method_as_a_function_have_one_limit():
    def formula(z0, z1, h, system):
        return z1 - z0 - h * system.vector_field(z0)

    function = S.maximum_own_step(Integrator(name="function", order=1, step=euler), SCENARIO)[0]
    flows = S.maximum_step(Integrator(name="formula", order=1, flows=formula), SCENARIO)[0]
    assert function["dt_stable"] == flows["dt_stable"] and function["limit"] == flows["limit"] == "physical"


def test_a_function_that_gives_up_is_a_limit_of_its_solver_and_one_that_never_does_has_none():
    def fragile(z, h, system):
        if h > 0.3:
            raise ArithmeticError("no root")
        return np.array(z)

    row, _ = S.maximum_own_step(Integrator(name="fragile", order=1, step=fragile), SCENARIO)
    assert row["limit"] == "solver" and row["dt_stable"] <= 0.3 < row["dt_unstable"] and "no root" in row["cause"]
    still, _ = S.maximum_own_step(Integrator(name="still", order=1, step=lambda z, h, s: np.array(z)), SCENARIO)
    assert still["limit"] == "none" and still["dt_stable"] == still["dt_cap"] and math.isnan(still["dt_unstable"])


def test_the_loosest_tolerance_holds_and_the_next_does_not():
    row = S.loosest_tolerance(tcbench.integrators()["scipy_odeint"], SCENARIO)
    good, bad = row["tolerance_stable"], row["tolerance_unstable"]
    assert good == pytest.approx(bad / 10**0.5) or math.isnan(bad)
    assert S.outcome_of(tcbench.simulate("scipy_odeint", SCENARIO, tolerance=good)).ok
    if not math.isnan(bad):
        assert not S.outcome_of(tcbench.simulate("scipy_odeint", SCENARIO, tolerance=bad)).ok and row["cause"]


def test_a_solver_that_never_holds_has_none():
    def broken(system, z0, times, rtol, atol):
        raise ArithmeticError("never")

    row = S.loosest_tolerance(Integrator(name="broken", adaptive=broken), SCENARIO)
    assert math.isnan(row["tolerance_stable"]) and row["limit"] == "solver" and "never" in row["cause"]
    assert row["tolerance_unstable"] == S.TOLERANCES[-1]
