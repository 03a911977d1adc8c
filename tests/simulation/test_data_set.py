"""Certified data sets: their error bars hold, and they say who made somebody else's."""

import json

import numpy as np
import pytest
import scipy.io
from click.testing import CliRunner
from scipy.integrate import solve_ivp

import tcbench
from tcbench.cli import main
from tcbench.simulation.data_set import data_set, judge, read_published, starts_around

SCENARIO = "short_term"


@pytest.fixture(scope="module")
def pendulum():
    return data_set(tcbench.scenarios()[SCENARIO], starts=5, every=0.5, t_end=10)


def test_stated_errors_hold_against_another_method(pendulum):
    scenario = tcbench.scenarios()[SCENARIO]
    for start, states, error in zip(
        starts_around(scenario, 5, 0.3, 0)[:2], pendulum.states, pendulum.error, strict=False
    ):
        model, times = start.model, pendulum.times
        other = solve_ivp(
            lambda t, z, model: model.vector_field(z),
            (0, 10),
            start.z0,
            "DOP853",
            times,
            args=(model,),
            rtol=1e-13,
            atol=1e-14,
        ).y.T
        size = np.maximum(scenario.model.state_magnitudes, np.abs(states))
        # 1e-9: one of the starts magnifies what rounding takes from that solver a million times
        assert np.all(np.max(np.abs(other - states) / size, axis=1) <= error + 1e-9)
    assert pendulum.error.max() < 1e-12


def test_laws_and_rates_are_of_the_states(pendulum):
    assert np.ptp(pendulum.laws["energy"], axis=1).max() < 1e-12 * pendulum.laws["energy"].max()
    assert np.ptp(pendulum.laws["angular_momentum"], axis=1).max() < 1e-12
    assert np.diff(pendulum.laws["entropy"], axis=1).min() > -1e-13
    model = tcbench.scenarios()[SCENARIO].model
    assert np.array_equal(pendulum.rates[2, 3], model.vector_field(pendulum.states[2, 3]))


def test_starts_differ_and_are_the_same_again(pendulum):
    again = data_set(tcbench.scenarios()[SCENARIO], starts=5, every=5.0, t_end=10)
    assert np.array_equal(again.states[:, 0], pendulum.states[:, 0])
    assert len(np.unique(pendulum.states[:, 0], axis=0)) == 5
    assert sorted(pendulum.split) == ["test"] + ["train"] * 4


def test_a_data_set_of_a_method_names_it(tmp_path):
    run = tcbench.simulate("tc_strang", SCENARIO, dt=0.1, t_end=4)
    scipy.io.savemat(tmp_path / "strang.mat", {"Z": run.z[None, ::2].transpose(0, 2, 1), "t_vec": run.t[None, ::2]})
    methods = [tcbench.integrators()[name] for name in ("midpoint_entropy", "tc_monolithic", "tc_strang")]
    found = judge(tmp_path / "strang.mat", tcbench.scenarios()[SCENARIO], methods)
    (nearest, missed), (_, second) = [*found.methods.items()][:2]
    assert nearest == ("tc_strang", 2) and missed < 1e-14 < 1e-10 < second
    truth = tcbench.simulate("tc_gauss_adaptive", SCENARIO, times=[0, 4.0], tolerance=1e-12).z[-1]
    size = np.maximum(tcbench.scenarios()[SCENARIO].model.state_magnitudes, np.abs(truth))
    assert found.errors[0, -1] == pytest.approx(np.max(np.abs(run.z[-1] - truth) / size), rel=1e-4)


def test_exact_data_name_no_method(pendulum, tmp_path):
    """Of the solution itself gauss3 in ten steps from a state to the next was said to have made it."""
    pendulum.write(tmp_path / "exact.npz")
    found = judge(tmp_path / "exact.npz", tcbench.scenarios()[SCENARIO], [tcbench.integrators()["gauss3"]])
    assert found.exact and not found.methods
    told = CliRunner().invoke(main, ["data", SCENARIO, "--judge", str(tmp_path / "exact.npz")])
    assert told.exit_code == 0 and "made the data" not in told.output and "solution to round-off" in told.output


def test_both_files_are_read_back(pendulum, tmp_path):
    for name in ("data.npz", "data.mat"):
        pendulum.write(tmp_path / name)
        times, states = read_published(tmp_path / name)
        assert np.array_equal(times, pendulum.times) and np.array_equal(states, pendulum.states)
    content = scipy.io.loadmat(tmp_path / "data.mat")
    assert content["Z"].shape == (5, 10, 21) and content["L"].shape == (10, 10) and content["dt"] == 0.5
    about = json.loads(str(np.load(tmp_path / "data.npz")["about"]))
    assert about["scenario"] == SCENARIO and len(about["made_by"]) == 5 and about["variables"]["q"] == [0, 4, [4]]


def test_a_stiff_scenario_has_error_bars_too():
    data = data_set(tcbench.scenarios()["reaction"].replace(initial={}), starts=2, spread=0.05)
    assert np.isfinite(data.error).all() and data.error.max() < 1e-6


@pytest.mark.parametrize(
    ("options", "says"),
    [({"starts": 0}, "starts >= 1"), ({"every": -1.0}, "0 < every"), ({"every": 1e9}, "<= t_end"),
     ({"spread": 1.5}, "spread")],
)  # fmt: skip
def test_what_cannot_be_is_said(options, says):
    with pytest.raises(tcbench.TcbenchError, match=says):
        data_set(tcbench.scenarios()[SCENARIO], **options)


def test_other_files_are_refused_in_one_sentence(tmp_path):
    (tmp_path / "text.mat").write_text("hello")
    np.savez(tmp_path / "pickled.npz", times=np.array([object()], dtype=object), states=np.zeros((1, 1, 1)))
    for name in ("text.mat", "pickled.npz", "missing.mat"):
        with pytest.raises(tcbench.TcbenchError, match="is no data set"):
            read_published(tmp_path / name)
    np.savez(tmp_path / "small.npz", times=np.arange(3.0), states=np.zeros((1, 3, 2)))
    with pytest.raises(tcbench.TcbenchError, match="states of 2 numbers"):
        judge(tmp_path / "small.npz", tcbench.scenarios()[SCENARIO])
