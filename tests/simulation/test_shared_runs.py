"""Runs that are ended where they fail, and runs that several cells share."""

import math
import time

import numpy as np
import pytest

import tcbench
from tcbench import Integrator
from tcbench.simulation import shared_runs
from tcbench.simulation.python_loop import POINTS

SCENARIO = tcbench.scenarios()["short_term"].replace(t_end=1.0)


def resting(calls, seconds=0.0, fail=math.inf):
    """A solver that stays where it is, with an energy far too large from t = fail on. calls: its tolerances."""

    def adaptive(system, z0, t_eval, rtol, atol):
        states, counts = outputs(system, z0, t_eval, rtol, atol)
        return np.array(list(states)), counts

    def outputs(system, z0, t_eval, rtol, atol):
        calls.append(rtol)
        counts = {}

        def states():
            time.sleep(seconds)
            for i, t in enumerate(t_eval):
                counts["steps"] = i
                yield z0 if t < fail else z0 + 1e3

        return states(), counts

    return Integrator(name="resting", adaptive=adaptive, outputs=outputs)


def same(one, other):
    arrays = all(np.array_equal(a, b) for a, b in ((one.t, other.t), (one.z, other.z), (one.energy, other.energy)))
    return arrays and repr((one.status, one.failure, one.steps, one.summary, one.solver)) == repr(
        (other.status, other.failure, other.steps, other.summary, other.solver)
    )


def test_a_run_ends_at_the_output_at_which_it_has_failed():
    early = tcbench.simulate(resting([], fail=0.5), SCENARIO)
    assert early.status == "blowup" and early.t[-1] == pytest.approx(0.5) and early.steps == POINTS // 2
    method = resting([], fail=0.5)
    whole = tcbench.simulate(Integrator(name="resting", adaptive=method.adaptive), SCENARIO)
    assert whole.steps == POINTS and whole.t[-1] == early.t[-1] and np.array_equal(whole.z, early.z)
    assert whole.failure == early.failure and whole.summary == early.summary


@pytest.mark.parametrize("name", [n for n, i in tcbench.integrators().items() if i.outputs])
def test_the_states_of_a_solver_are_the_same_one_by_one(name):
    method, times = tcbench.integrators()[name], np.linspace(0.0, 2.0, 41)
    states, counts = method.outputs(SCENARIO.model, SCENARIO.z0.copy(), times, 1e-6, 1e-6)
    states = np.array(list(states))
    whole, expected = method.adaptive(SCENARIO.model, SCENARIO.z0.copy(), times, 1e-6, 1e-6)
    assert np.array_equal(states, whole) and counts == expected and counts["rhs_evaluations"] > 100
    if name.startswith("solve_ivp"):  # and those of SciPy's own function
        from scipy.integrate import solve_ivp

        from tcbench.systems.right_hand_side import Field

        field = Field(SCENARIO.model)
        word = {"rk45": "RK45", "dop853": "DOP853", "radau": "Radau", "bdf": "BDF", "lsoda": "LSODA"}[name[10:]]
        jac = {"jac": field.jacobian} if word in ("Radau", "BDF", "LSODA") else {}
        own = solve_ivp(field.rate, (0.0, 2.0), SCENARIO.z0.copy(), word, times, rtol=1e-6, atol=1e-6, **jac)
        assert np.allclose(states, own.y.T, rtol=1e-13, atol=1e-13)
        assert 0 <= own.nfev - counts["rhs_evaluations"] <= 3  # no interpolation at the start


def test_outputs_that_end_early_or_have_another_shape_are_a_failure():
    few = Integrator(name="few", adaptive=print, outputs=lambda s, z, t, r, a: (iter([z, z]), {}))
    assert "outputs ended after 2 states, 201 were asked for" in tcbench.simulate(few, SCENARIO).failure
    wrong = Integrator(name="wrong", adaptive=print, outputs=lambda s, z, t, r, a: (iter([z[1:]]), {}))
    assert "shape (9,), (10,) were asked for" in tcbench.simulate(wrong, SCENARIO).failure


def test_a_run_is_made_once_and_measured_as_if_it_were_ones_own(tmp_path):
    for fail in (math.inf, 0.5):
        calls, folder = [], tmp_path / str(fail)
        folder.mkdir()
        method = resting(calls, 2 * shared_runs.SHORTEST_S, fail)
        alone = tcbench.simulate(method, SCENARIO)
        with shared_runs.shared_in(str(folder)):
            made = tcbench.simulate(method, SCENARIO)
            assert shared_runs.reads() == 0
        with shared_runs.shared_in(str(folder)):
            read = tcbench.simulate(method, SCENARIO)
            assert shared_runs.reads() == 1 and read.wall_time_s == made.wall_time_s
            assert same(made, alone) and same(read, alone) and len(calls) == 2
            with shared_runs.unshared():
                tcbench.simulate(method, SCENARIO)
            tcbench.simulate(method, SCENARIO, tolerance=1e-3)
            tcbench.simulate(method, SCENARIO, t_end=0.9)
            tcbench.simulate(method, SCENARIO.replace(blowup_factor=2.0))
            assert shared_runs.reads() == 1 and len(calls) == 6
        tcbench.simulate(method, SCENARIO)
        assert len(calls) == 7  # nobody to share with


def test_a_failure_of_a_solver_is_shared_too(tmp_path):
    calls = []

    def failing(system, z0, t_eval, rtol, atol):
        calls.append(rtol)
        time.sleep(2 * shared_runs.SHORTEST_S)
        raise ArithmeticError("never")

    with shared_runs.shared_in(str(tmp_path)):
        one, other = (tcbench.simulate(Integrator(name="failing", adaptive=failing), SCENARIO) for _ in range(2))
    assert len(calls) == 1 and one.status == other.status == "nonconverged" and one.failure == other.failure


@pytest.mark.thorough
def test_studies_of_one_run_share_their_slow_runs(tmp_path):
    studies = ["conservation", "equilibrium"]
    results = tcbench.run(["solve_ivp_radau"], ["short_term"], studies, tmp_path / "both", jobs=1)
    both = results.tables
    assert list(both["conservation"]["shared_runs"]) == [0, 0, 0]
    assert list(both["equilibrium_summary"]["shared_runs"]) == [1]
    alone = tcbench.run(["solve_ivp_radau"], ["short_term"], studies[1:], tmp_path / "one", jobs=1).tables
    assert list(alone["equilibrium_summary"]["shared_runs"]) == [0]
    assert alone["equilibrium"].equals(both["equilibrium"])
