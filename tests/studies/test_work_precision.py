"""work_precision: what a cell measures, and how rungs become times to an accuracy."""

import math

import numpy as np
import pytest

import tcbench
from tcbench import Integrator
from tcbench.analysis import timing
from tcbench.studies import work_precision as study
from tcbench.studies.cost import exponent, reach, time_to_accuracy

SCENARIO = tcbench.scenarios()["short_term"].replace(t_end=1.0)


class Clock:
    """Processor time that passes only where a test says so."""

    def __init__(self):
        self.now = 0.0

    def process_time(self):
        return self.now

    perf_counter = process_time


def point(error, seconds, **more):
    return {"status": "ok", "error": error, "wall_time_min_s": seconds, **more}


@pytest.fixture(scope="module")
def records():
    chosen = [tcbench.integrators()[n] for n in ("tc_monolithic", "scipy_odeint", "tc_gauss_adaptive")]
    cells = study.plan(chosen, [SCENARIO], {"dt": [0.1, 0.01]})
    with pytest.MonkeyPatch.context() as patched:  # however busy the machine is
        patched.setattr(study, "enough", lambda points, took: "")
        return [study.measure(i, s, o) | {"integrator": i.name, "scenario": s.name, **o} for i, s, o in cells]


def test_a_cell_has_a_rung_for_each_setting_with_its_time_and_errors(records):
    table = study.tabulate(records)["work_precision"]
    assert set(table["status"]) == {"ok"} and list(table.columns[: len(study.WORK.names)]) == study.WORK.names
    fixed = table[table["integrator"] == "tc_monolithic"]
    assert list(fixed["value"]) == pytest.approx([0.1, 0.01]) and list(fixed["control"]) == ["dt", "dt"]
    assert list(fixed["steps"]) == [10, 100] and (fixed["newton_iterations"] >= fixed["steps"]).all()
    assert (fixed["repeats"] >= 1).all() and (fixed["wall_time_min_s"] <= fixed["wall_time_median_s"]).all()
    direct = tcbench.simulate("tc_monolithic", SCENARIO, dt=0.01)
    exact = study.horizon(SCENARIO) and [1.5895928678481363, 4.0028041675297446]  # short_term at t = 1
    assert fixed["error_q"].iloc[1] >= np.abs(direct.z[-1, :2] - exact).max() / 4.1 > 0
    peer = table[table["integrator"] == "scipy_odeint"]
    assert len(peer) == len(study.TOLERANCES) and (peer["rhs_evaluations"] > peer["steps"]).all()
    assert peer["error"].iloc[-1] < 1e-7 < peer["error"].iloc[0]


def test_errors_within_the_references_own_are_hidden_and_marked():
    exact = np.arange(1.0, 11.0)
    hidden = study.errors_of(SCENARIO, exact + 1e-14, exact, floor=1e-12)
    shown = study.errors_of(SCENARIO, exact + 1e-9, exact, floor=1e-12)
    assert math.isnan(hidden["error"]) and hidden["reference_limited"] and not shown["reference_limited"]
    assert shown["error_p"] == pytest.approx(2e-10, rel=0.01)


def test_a_solver_that_fails_is_a_point_and_costs_no_repeats(monkeypatch):
    monkeypatch.setattr(study, "SLOW_S", math.inf)  # no run is slow, however busy the machine is

    def broken(system, z0, t_eval, rtol, atol):
        if rtol < 1e-2:
            raise RuntimeError("gave up")
        return np.tile(z0, (len(t_eval), 1))

    row = study.measure(Integrator(name="broken", adaptive=broken), SCENARIO, {})
    table = study.tabulate([row | {"integrator": "broken", "scenario": "s"}])["work_precision"]
    failed = table[table["status"] == "exception"]
    assert row["status"] == "ok" and len(failed) == 10 and failed["failure"].str.contains("gave up").all()
    assert failed["wall_time_min_s"].isna().all() and (table["status"] == "ok").sum() == 2


def test_a_slow_method_is_spared_its_finer_rungs_and_the_table_says_so(monkeypatch):
    calls, clock = [], Clock()
    for module in (study, timing):
        monkeypatch.setattr(module, "time", clock)

    def slow(system, z0, t_eval, rtol, atol):
        calls.append(rtol)
        clock.now += 0.25
        return np.tile(z0, (len(t_eval), 1))

    row = study.measure(Integrator(name="slow", adaptive=slow), SCENARIO, {})
    assert len(row["points"]) == 1 and set(calls) == {study.TOLERANCES[0]}
    (left_out,) = study.tabulate([row | {"integrator": "slow", "scenario": "s"}])["work_precision"]["left_out"]
    assert left_out == "11 finer ones, to 1e-12: a run took 0.25 s, more than 0.2 s"


def test_what_costs_little_or_is_not_yet_right_goes_on():
    right = point(1e-10, 0.1, energy_error_max=1e-13)
    wrong = point(1e-8, 0.1, energy_error_max=1e-13)
    falling = [point(1e-10, 0.1, energy_error_max=10.0**-k) for k in range(5, 10)]
    assert "every accuracy" in study.enough([right], [0.1])
    assert study.enough([], []) == study.enough([right], [0.001]) == study.enough([wrong], [0.1]) == ""
    assert study.enough(falling, [0.1] * 5) == ""
    stuck = [point(1e-10, 0.1, energy_error_max=e) for e in (3e-12, 2e-12, 2.1e-12, 1.9e-12)]
    assert "every accuracy" in study.enough(stuck, [0.1] * 4)  # round-off: finer steps do not help
    hidden = point(None, 0.1, reference_limited=True, energy_error_max=0.0)
    assert "every accuracy" in study.enough([hidden], [0.1])
    failed = {"status": "blowup", "error": math.nan}
    assert study.enough([failed], [1.0]) == "" and "2 runs that failed" in study.enough([failed, failed], [1.0, 1.0])


def test_time_to_an_accuracy_is_interpolated_in_logarithms():
    points = [point(1e-2, 1.0), point(1e-4, 100.0), point(None, 1000.0, reference_limited=True)]
    assert reach(points, "error", 1e-3) == pytest.approx(10.0)
    assert reach(points, "error", 1e-2) == 1.0 and reach(points, "error", 1e-9) == 1000.0
    assert math.isnan(reach(points[:2], "error", 1e-9)) and math.isnan(reach([], "error", 1e-3))
    assert math.isnan(reach([{"status": "blowup", "error": 0.0, "wall_time_min_s": 1.0}], "error", 1.0))


def test_ratios_are_to_the_best_peer_and_to_the_best_of_scipy():
    base = {"scenario": "s"}
    rows = time_to_accuracy([
        base | {"integrator": "mine", "peer": "", "points": [point(1e-4, 1.0)]},
        base | {"integrator": "a", "peer": "scipy", "points": [point(1e-4, 8.0)]},
        base | {"integrator": "b", "peer": "other", "points": [point(1e-4, 4.0)]},
    ])  # fmt: skip
    mine = next(r for r in rows if r["integrator"] == "mine" and r["measure"] == "error" and r["target"] == 1e-3)
    assert (mine["best_peer"], mine["ratio_to_best_peer"]) == ("b", 4.0)
    assert (mine["best_scipy"], mine["ratio_to_best_scipy"]) == ("a", 8.0)


def test_exponents_are_those_of_the_power_law():
    assert exponent([(n, 1e-3 * n**1.5) for n in (1, 10, 100)]) == pytest.approx(1.5)
    assert math.isnan(exponent([(1, 1e-3), (2, 1e-3)]))
