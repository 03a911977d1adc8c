"""The records of a run are used again by the next call: no run sees another's."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields

import numpy as np
import pytest

import tcbench

SCENARIO = tcbench.scenarios()["short_term"]


def content(found):
    numbers = [getattr(found, f.name) for f in fields(found) if f.name not in ("wall_time_s", "scenario", "integrator")]
    return [(x.shape, x.tobytes()) if isinstance(x, np.ndarray) else repr(x) for x in numbers]


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
