"""The largest step of methods that are given by a step function."""

import math

import numpy as np

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
