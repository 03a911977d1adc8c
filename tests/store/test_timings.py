"""Timings of two runs: equal ones are found equal, and what is slower is found, as often as is said."""

from __future__ import annotations

import math

import numpy as np
import pytest

import tcbench
from tcbench.store.cells import Cell
from tcbench.runner.compare import compare, regressions
from tcbench.store.store import Store
from tcbench.store.timings import Timed, judge
from tcbench.studies.work_precision import plan, processes

RUNGS = range(10)
# Standard deviations of the logarithms of times in yardsticks, measured on a machine with three jobs a core: of a
# process (2 % of most methods, 5 % of some, and one in fifty is much slower), and of a rung in it.
PROCESS, UNSTEADY, RUNG = 0.02, 0.045, 0.02


# And levels of processes as they were found, in thousandths, seven jobs on each core: of a method in Python whose runs
# take a second, and of a compiled one. The former with 11 evaluations more to 50 took 1.19 times as long.
PYTHON = (-28, 6, 41, 20, 104, -56, -9, 30, -6, -12, -35, -11, -28, 63, 6, 84, -55, 13, 23, 16, 13, -21, -72, -1, -33,
          17, 23, -18, 0, -44, 13)  # fmt: skip
COMPILED = (5, -11, 112, -2, -10, -1, 11, 3, -4, 10, 3, -13, -4, 1, -4, 2, -3, -1, -19, 0, 13, -5, 8, 0, 1, 0, 11, 8,
            -2, -19, -2)  # fmt: skip


def process(random, wander, factor=1.0):
    if isinstance(wander, tuple):
        return {0: factor * math.exp(random.choice(wander) / 1000)}
    shift = random.normal(0, wander) + (random.random() < 0.02) * abs(random.normal(0, 0.3))
    noise = random.normal(0, RUNG, len(RUNGS)) + RUNG * random.exponential(size=len(RUNGS))
    return {rung: factor * 1.5**rung * math.exp(shift + x) for rung, x in zip(RUNGS, noise, strict=True)}


def two_runs(random, methods=5, scenarios=2, factor=1.0, wanders=()):
    """Both runs of some methods, each cell timed in as many processes as the study does; the first method is `factor`
    slower after."""
    cells = {}
    for m in range(methods):
        wander = wanders[m] if wanders else UNSTEADY if 0 < m == methods - 1 else PROCESS
        for s in range(scenarios):
            after = factor if m == 0 else 1.0
            before, slower = ([process(random, wander, f) for _ in range(processes(scenarios))] for f in (1.0, after))
            cells[m, s] = Timed(before, slower, True, m)
    return cells


@pytest.mark.parametrize(("methods", "scenarios"), [(1, 1), (2, 1), (5, 2), (8, 7)])
def test_equal_runs_raise_at_most_one_alarm_in_thirty(methods, scenarios):
    random = np.random.default_rng(1)
    count = 100
    alarms = sum(any(v.real for v in judge(two_runs(random, methods, scenarios)).values()) for _ in range(count))
    assert alarms <= count / 30


@pytest.mark.parametrize(("methods", "scenarios"), [(1, 1), (2, 1), (5, 2), (8, 7)])
def test_a_method_that_is_20_per_cent_slower_is_found_nine_times_in_ten(methods, scenarios):
    random = np.random.default_rng(2)
    count = 100
    found = [judge(two_runs(random, methods, scenarios, factor=1.2)) for _ in range(count)]
    assert sum(any(v.real and v.ratio > 1 for (m, _), v in f.items() if m == 0) for f in found) >= 0.9 * count
    assert sum(any(v.real for (m, _), v in f.items() if m > 0) for f in found) <= 0.05 * count


@pytest.mark.parametrize(("wanders", "scenarios"), [((PYTHON,), 1), ((PYTHON, COMPILED), 1), ((PYTHON, COMPILED), 4)])
def test_so_it_is_with_what_was_measured_on_a_busy_machine(wanders, scenarios):
    random = np.random.default_rng(3)
    count = 150
    both = [[judge(two_runs(random, len(wanders), scenarios, f, wanders)) for _ in range(count)] for f in (1.0, 1.19)]
    assert sum(any(v.real for v in found.values()) for found in both[0]) <= count / 30
    assert sum(any(v.real for (m, _), v in found.items() if m == 0) for found in both[1]) >= 0.95 * count


def test_a_method_on_few_scenarios_is_timed_in_more_processes():
    assert [processes(n) for n in (1, 2, 3, 5, 14)] == [5, 5, 4, 2, 2]
    method, scenario = tcbench.integrators()["tc_monolithic"], tcbench.scenarios()["short_term"]
    assert [cell[2].get("turn") for cell in plan([method], [scenario], {})] == [None, 2, 3, 4, 5]


def test_a_method_that_is_slower_everywhere_is_found_where_no_cell_alone_would_be():
    def cells(*changes):
        return {k: Timed([{0: 1.0}, {0: 1.12}], [{0: x}, {0: 1.12 * x}], True, "m") for k, x in enumerate(changes)}

    assert not judge(cells(1.2))[0].real
    assert [v.real for v in judge(cells(*[1.2] * 9, 1.0)).values()] == [True] * 9 + [False]


def test_processes_that_differ_by_themselves_excuse_a_difference():
    def cell(first, second, after):
        return {"x": Timed([{0: first}, {0: second}], [{0: after}, {0: after}], True)}

    assert judge(cell(1.0, 1.0, 1.2))["x"].real and not judge(cell(0.9, 1.35, 1.25))["x"].real


def test_seconds_on_a_machine_that_is_slower_as_a_whole_are_no_alarm():
    def cells(*after):
        return {k: Timed([{0: 1.0}], [{0: x}], False, k) for k, x in enumerate(after)}

    assert not any(v.real for v in judge(cells(1.38, 1.4, 1.37, 1.41, 1.39)).values())
    assert [v.real for v in judge(cells(1.0, 1.01, 1.02, 1.01, 3.0)).values()] == [False] * 4 + [True]
    assert judge(cells(1.4))[0].real  # of one alone nobody can tell


def test_without_a_common_rung_there_is_no_verdict():
    assert judge({"x": Timed([{0: 1.0}], [{1: 1.0}], True)}) == {} == judge({})
    assert judge({"x": Timed([{0: 0.0, 1: math.nan}], [{0: 1.0, 1: 1.0}], True)}) == {}


def folder(path, factor, turns=2):
    """A run of one method whose rungs take `factor` yardsticks, and seconds that say nothing."""
    with Store.open(path) as store:
        points = [{"value": v, "status": "ok", "error": v, "yardsticks": factor * (1 + v)} for v in RUNGS]
        rows = [{"points": [p | {"wall_time_min_s": factor**9, "wall_time_median_s": 1.0} for p in points]}]
        rows.append(
            {"points": [{"value": p["value"], "yardsticks": p["yardsticks"]} for p in points[: 3 + int(factor)]]}
        )
        for turn, row in list(zip(({}, {"turn": 2}), rows, strict=True))[:turns]:
            cell = Cell("work_precision", "tc", "short", turn, timed=True)
            store.append(cell.key, {"status": "ok"} | row, cell.as_dict())
        from tcbench.studies.work_precision import tabulate

        records = [{k: v for k, v in r.items() if k != "study"} for r in store.records("work_precision")]
        store.write_tables(tabulate(records))
    return path


def test_a_slower_cell_is_one_regression_however_many_rungs_it_has(tmp_path):
    a, b, c = (folder(tmp_path / name, f) for name, f in (("a", 1.0), ("b", 1.25), ("c", 1.05)))
    (row,) = regressions(compare(a, b)).to_dict("records")
    assert (row["integrator"], row["column"], row["options"]) == ("tc", "time", "{}")
    assert row["after"] == pytest.approx(1.25) and row["difference"] == pytest.approx(0.2)
    assert len(compare(b, a)) == 1 and regressions(compare(b, a)).empty
    assert compare(a, c).empty and compare(a, folder(tmp_path / "d", 1.05, turns=1)).empty


def test_published_tables_are_judged_as_their_rows_are(tmp_path):
    a, b, c = (folder(tmp_path / name, f) for name, f in (("a", 1.0), ("b", 1.25), ("c", 1.05)))
    (a / "cells.jsonl").unlink()
    (row,) = regressions(compare(a, b)).to_dict("records")
    assert row["column"] == "time" and row["after"] == pytest.approx(1.25)
    assert compare(a, c).empty
