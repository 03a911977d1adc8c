"""Adaptive solvers report when they are asked to; what cannot be a list of times is refused in a sentence."""

import numpy as np
import pytest

import tcbench
from tcbench import TcbenchError

TIMES = [0.1, 0.15, 1.0, 4.0]


@pytest.mark.parametrize("name", ["tc_auto", "tc_taylor", "tc_gauss_adaptive", "scipy_odeint"])
def test_a_run_has_the_states_at_the_times_that_were_asked_for(name):
    run = tcbench.simulate(name, "short_term", tolerance=1e-10, times=TIMES)
    assert run.ok and np.array_equal(run.t, [0, *TIMES]) and run.z.shape == (5, 10) and len(run.energy) == 5
    again = tcbench.simulate(name, "short_term", tolerance=1e-10, times=[0, *np.linspace(0.5, 4, 8)])
    assert np.allclose(again.z[[2, 8]], run.z[[3, 4]], rtol=1e-8, atol=1e-8)  # at t = 1 and 4


def test_the_runs_at_the_default_times_are_not_mistaken_for_them():
    before = tcbench.simulate("tc_auto", "short_term", t_end=4.0)
    chosen = tcbench.simulate("tc_auto", "short_term", times=TIMES)
    after = tcbench.simulate("tc_auto", "short_term", t_end=4.0)
    assert len(before.t) == len(after.t) == 201 and len(chosen.t) == 5 and np.array_equal(before.z, after.z)


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("tc_auto", {"times": [1.0, 1.0]}, "numbers that grow"),
        ("tc_auto", {"times": []}, "numbers that grow"),
        ("tc_auto", {"times": [0.0]}, "the last after 0"),
        ("tc_auto", {"times": "soon"}, "must be numbers, not 'soon'"),
        ("tc_auto", {"times": [1.0], "t_end": 2.0}, "leave out t_end = 2"),
        ("tc_monolithic", {"times": [1.0]}, "states at the ends of its steps: give dt="),
    ],
)
def test_what_is_no_list_of_times_is_refused(name, options, message):
    with pytest.raises(TcbenchError, match=message):
        tcbench.simulate(name, "short_term", **options)


@pytest.mark.parametrize("method", ["scipy_odeint", "solve_ivp_rk45"])
def test_slope_and_first_fall_of_uneven_times_are_those_of_the_records(method):
    """A loop that took the first time for the step of all gave a drift six times too large."""
    t = np.concatenate([[0.01], 0.01 + np.cumsum(np.random.default_rng(1).uniform(0.01, 0.8, 40))])
    run = tcbench.simulate(method, "short_term", times=t, tolerance=1e-3)
    error = (run.energy - run.energy[0])[1:] / run.scenario.initial_exergy
    assert run.summary.energy_drift == pytest.approx(np.polyfit(run.t[1:], error, 1)[0], rel=1e-9)
    falls = run.t[1:][np.diff(run.entropy) < -1e-10]
    assert run.summary.first_entropy_fall == falls[0] if len(falls) else np.isnan(run.summary.first_entropy_fall)


@pytest.mark.parametrize("tolerance", [1e-300, 1e-17])
def test_a_tolerance_below_round_off_is_refused(tolerance):
    """It ran for ever."""
    with pytest.raises(TcbenchError, match="below the round-off of a number"):
        tcbench.simulate("scipy_odeint", "short_term", tolerance=tolerance)


@pytest.mark.parametrize("change", [lambda z: np.ma.masked_array(z, mask=z > 0), lambda z: z > 0])
def test_states_that_are_no_plain_numbers_are_told(change):
    method = tcbench.Integrator(name="odd", order=1, step=lambda z, h, system: change(np.asarray(z)))
    run = tcbench.simulate(method, "short_term")
    assert run.status == "exception" and "states are plain numbers" in run.failure


def test_states_before_a_solver_gives_up_are_kept():
    """The row said t = 0 where SciPy had come to 0.5."""

    def outputs(system, z0, t_eval, rtol, atol):
        def states():
            for t in t_eval:
                if t > 1.0:
                    raise ArithmeticError("the step became too small")
                yield z0 * (1 + 1e-6 * t)

        return states(), {}

    def adaptive(system, z0, t_eval, rtol, atol):
        return np.array(list(outputs(system, z0, t_eval, rtol, atol)[0]))

    method = tcbench.Integrator(name="gives_up", source="here", adaptive=adaptive, outputs=outputs)
    run = tcbench.simulate(method, "damped_oscillator", times=[0.5, 1.0, 1.5, 2.0])
    assert run.status == "nonconverged" and run.t.tolist() == [0.0, 0.5, 1.0] and len(run.z) == 3
    assert "(t = 1)" in run.failure and "too small" in run.failure
