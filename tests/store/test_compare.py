"""Comparing runs: silent about noise and changes of code without effect, loud about everything else."""

from __future__ import annotations

import math

import pandas
import pytest

from tcbench.errors import TcbenchError
from tcbench.store.cells import Cell
from tcbench.store.compare import compare, regressions
from tcbench.store.store import Store

BASE = {
    "status": "ok",
    "energy_error_max": 2e-6,
    "us_per_step": 1.0,
    "errors": {"q": [1.0, 2.0]},
    "cell_time_s": 1.0,
}


def run(folder, rows, fingerprint="old"):
    """A run folder with one timed cell for each row."""
    with Store.open(folder) as store:
        for number, row in rows.items():
            cell = Cell("study", "tc", "short", {"dt": number}, timed=True, fingerprint=fingerprint)
            store.append(cell.key, BASE | row, cell.as_dict())
    return folder


def changes(tmp_path, before, after, **options):
    a = run(tmp_path / "a", {1: before})
    return compare(a, run(tmp_path / "b", {1: after}, fingerprint="new"), **options)


@pytest.mark.parametrize(
    "after",
    [
        {},
        {"us_per_step": 1.12},  # timings wander by 5 to 13 %
        {"energy_error_max": 2e-6 * (1 + 1e-11)},
        {"errors": {"q": [1.0, 2.0 + 1e-13]}},
        {"cell_time_s": 9.0, "failure": "said otherwise", "output_tail": "x"},
    ],
)
def test_noise_is_no_change(tmp_path, after):
    assert changes(tmp_path, {}, after).empty


@pytest.mark.parametrize(
    ("after", "column", "worse"),
    [
        ({"us_per_step": 1.5}, "us_per_step", True),
        ({"us_per_step": 0.5}, "us_per_step", False),
        ({"energy_error_max": 2.001e-6}, "energy_error_max", True),
        ({"energy_error_max": math.nan}, "energy_error_max", True),
        ({"errors": {"q": [1.0, 2.1]}}, "errors.q[1]", True),
        ({"errors": {"q": [1.0]}}, "errors.q.length", False),
        ({"status": "blowup", "energy_error_max": 7.0}, "status", True),
        ({"anything": 3.0}, "anything", False),
    ],
)
def test_a_change_beyond_noise_is_found_and_judged(tmp_path, after, column, worse):
    found = changes(tmp_path, {}, after)
    assert column in set(found["column"])
    row = found[found["column"] == column].iloc[0]
    assert (bool(row["worse"]), row["options"]) == (worse, '{"dt":1}')
    assert len(regressions(found)) == int(found["worse"].sum())


def test_a_recovered_cell_is_no_regression(tmp_path):
    found = changes(tmp_path, {"status": "crash"}, {})
    assert found["kind"].tolist() == ["status"] and regressions(found).empty


def test_round_off_is_no_change_however_large_its_ratio(tmp_path):
    assert changes(tmp_path, {"energy_error_max": 1e-15}, {"energy_error_max": 3e-14}).empty


@pytest.mark.parametrize(
    ("before", "after", "worse"),
    [
        ({"order": 4.0, "verdict": "as declared"}, {"order": 1.0, "verdict": "lower than declared"}, 2),
        ({"order": 1.0, "verdict": "lower than declared"}, {"order": 4.0, "verdict": "as declared"}, 0),
        ({"error": 1.1e-8}, {"error": 2.4e-5}, 1),
        ({"status": "ok", "wall_time_min_s": 1.0}, {"status": "blowup", "wall_time_min_s": 1.0}, 1),
        ({"wall_time_min_s": 1.0}, {"wall_time_min_s": 1.1}, None),  # within the noise of timings
        ({"wall_time_min_s": 1.0}, {"wall_time_min_s": 1.5}, 1),
    ],
)
def test_what_stands_in_a_list_of_a_row_is_judged_as_well(tmp_path, before, after, worse):
    found = changes(tmp_path, {"points": [{"dt": 0.1} | before]}, {"points": [{"dt": 0.1} | after]})
    assert found.empty if worse is None else len(found) > 0 and len(regressions(found)) == worse


def test_noise_is_the_users_to_set(tmp_path):
    after = {"us_per_step": 1.5, "energy_error_max": 2.1e-6}
    assert changes(tmp_path / "1", {}, after, noise=0.5)["column"].tolist() == ["energy_error_max"]
    noise = {"energy_error_max": 0.1, "us_per_step": 0.1}
    assert changes(tmp_path / "2", {}, after, noise=noise)["column"].tolist() == ["us_per_step"]


def test_timings_of_cells_that_shared_the_machine_are_not_compared(tmp_path):
    folders = []
    for name, seconds in (("a", 1.0), ("b", 2.0)):
        with Store.open(tmp_path / name) as store:
            cell = Cell("study", "tc", "short")
            store.append(cell.key, {"status": "ok", "wall_time_s": seconds, "timed": False}, cell.as_dict())
        folders.append(tmp_path / name)
    assert compare(*folders).empty


def test_missing_and_new_cells_are_changes(tmp_path):
    found = compare(run(tmp_path / "a", {1: {}, 2: {}}), run(tmp_path / "b", {2: {}, 3: {}}))
    assert dict(zip(found["kind"], found["options"], strict=True)) == {
        "missing": '{"dt":1}',
        "new": '{"dt":3}',
    }
    assert regressions(found)["kind"].tolist() == ["missing"]


def test_published_tables_without_rows_can_be_compared(tmp_path):
    folders = []
    for name, error in (("a", 1e-6), ("b", 2e-6)):
        frame = pandas.DataFrame({"integrator": ["x", "y"], "scenario": "s", "dt": [0.1, 0.1], "status": "ok"})
        frame["error"] = [1e-6, error]
        with Store.open(tmp_path / name) as store:
            store.write_tables({"convergence_points": frame})
        for path in (tmp_path / name).iterdir():
            if path.is_file():
                path.unlink()
        folders.append(tmp_path / name)
    found = regressions(compare(*folders))
    assert found[["study", "integrator", "column"]].values.tolist() == [["convergence_points", "y", "error"]]


def test_a_folder_without_a_run_is_refused(tmp_path):
    with pytest.raises(TcbenchError, match="There is no run"):
        compare(run(tmp_path / "a", {1: {}}), tmp_path / "b")
    Store.open(tmp_path / "empty").close()
    with pytest.raises(TcbenchError, match="no rows"):
        compare(run(tmp_path / "c", {1: {}}), tmp_path / "empty")
