"""The records of a run are used again by the next call: no run sees another's."""

import gc
import weakref
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields

import numpy as np
import pytest

import tcbench
from tcbench.simulation import prepared
from tcbench.solver import foresight

SCENARIO = tcbench.scenarios()["short_term"]
METHODS = ["tc_strang", "projected", "verlet_heat", "tc_gauss"]
WAYS = (  # of one scenario, one after the other
    {"dt": 0.3, "t_end": 3.0},
    {"dt": 0.1, "t_end": 1.0, "record_every": None},
    {"dt": 0.3, "t_end": 3.0, "continuation": False, "residuals": True},
    {"dt": 3.0, "t_end": 3.0},
    {"dt": 0.05, "t_end": 2.0, "record_every": 7},
)


def content(found):
    numbers = [getattr(found, f.name) for f in fields(found) if f.name not in ("wall_time_s", "scenario", "integrator")]
    return [(x.shape, x.tobytes()) if isinstance(x, np.ndarray) else repr(x) for x in numbers]


def new(method, **way):
    """Nothing is kept of a new scenario's system."""
    way = dict(way)
    return tcbench.simulate(method, SCENARIO.replace(t_end=way.pop("t_end")), **way)


@pytest.mark.parametrize("method", METHODS)
def test_runs_one_after_the_other_are_those_of_new_records(method):
    scenarios = {way["t_end"]: SCENARIO.replace(t_end=way["t_end"]) for way in WAYS}
    kept, expected = [], [content(new(method, **way)) for way in WAYS]
    for _ in range(2):
        for way in WAYS:
            rest = {name: value for name, value in way.items() if name != "t_end"}
            kept.append(tcbench.simulate(method, scenarios[way["t_end"]], **rest))
    assert [content(found) for found in kept] == expected * 2  # also those that later runs came after


def test_a_failed_run_leaves_nothing_to_the_next():
    scenario = tcbench.scenarios()["stiff_spring"]
    before = content(tcbench.simulate("midpoint_entropy", scenario, dt=0.01))
    failed = tcbench.simulate("midpoint_entropy", scenario, dt=scenario.t_end)
    assert not failed.ok and failed.solver.tracked
    assert content(tcbench.simulate("midpoint_entropy", scenario, dt=0.01)) == before


@pytest.mark.parametrize(
    ("method", "ways"),
    [
        ("tc_strang", [{"dt": 1e-3}, {"dt": 2e-3}]),
        ("tc_gauss", [{"dt": 0.05}, {"dt": 0.1}]),
        ("tc_auto", [{"tolerance": 1e-8}, {"tolerance": 2e-8}]),
    ],
)
def test_threads_have_records_of_their_own(method, ways):
    def run(i):
        return content(tcbench.simulate(method, SCENARIO, **ways[i % 2]))

    alone = [run(0), run(1)]
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(run, range(24))) == alone * 12


def test_what_a_long_run_recorded_does_not_stay():
    scenario = SCENARIO.replace(coupling=0.124)
    found = tcbench.simulate("tc_strang", scenario, dt=scenario.t_end / 1000)
    (kept,) = [free for _, free in prepared._KEPT[scenario.model].values()]
    assert found.z.shape[0] == 1001 and [ready.run.n_rows for ready in kept] == [2]


def test_one_set_of_records_serves_every_call_and_goes_with_its_system(monkeypatch):
    made = []
    monkeypatch.setattr(prepared, "Prepared", lambda *given: made.append(Prepared(*given)) or made[-1])
    scenario = SCENARIO.replace(coupling=0.123)
    for method in ("tc_strang", "tc_gauss"):
        for steps in (1, 5, 700):
            tcbench.simulate(method, scenario, dt=scenario.t_end / steps)
    assert len(made) == 2
    system = weakref.ref(scenario.model)
    made.clear()
    del scenario
    gc.collect()
    assert system() is None


Prepared = prepared.Prepared


def test_what_is_done_before_anyone_is_told_is_the_same_run(monkeypatch):
    whole = content(tcbench.simulate("tc_monolithic", SCENARIO, dt=0.01))
    for untold in (0, 1, 7, 10**6):
        monkeypatch.setattr(foresight, "UNTOLD", untold)
        assert content(tcbench.simulate("tc_monolithic", SCENARIO, dt=0.01)) == whole
