"""Comparing runs: silent about noise and changes of code without effect, loud about everything else."""

import math
from pathlib import Path

import pandas
import pytest
from command import tcbench as command

import tcbench
from tcbench.errors import TcbenchError
from tcbench.runner.compare import compare, in_both, one_sided, other_machine, regressions
from tcbench.runner.rows import Store

pytestmark = pytest.mark.usefixtures("cells_here")

BASE = {
    "integrator": "tc", "scenario": "short", "dt": 1.0, "status": "ok", "energy_error_max": 2e-6,
    "energy_drift": -1.09e-6, "lyapunov_increment_max": -1e-6, "us_per_step": 1.0, "error_q": [1.0, 2.0],
    "failure": "", "cell_time_s": 1.0,
}  # fmt: skip
RUNG = {"integrator": "tc", "scenario": "short", "control": "dt", "value": 0.1, "status": "ok", "error": 1e-6,
        "wall_time_min_s": 1.0}  # fmt: skip
ORDER = {"integrator": "tc", "scenario": "short", "variable": "all", "order": 4.0, "verdict": "as declared"}


def published(folder, cpu="x", **tables):
    """A folder that has tables and no rows."""
    with Store.open(folder) as store:
        store.write_tables({name: pandas.DataFrame(rows) for name, rows in tables.items()})
        store.write_manifest({"machine": {"cpu": cpu, "cores": 2, "architecture": "x", "system": "Linux"}})
    (folder / "cells.jsonl").unlink()
    return folder


def compared(tmp_path, table, before, after, names="ab"):
    return compare(*(published(tmp_path / n, **{table: rows}) for n, rows in zip(names, (before, after), strict=True)))


@pytest.mark.parametrize(
    ("base", "before", "after", "expected"),
    [
        (BASE, {}, {}, {}),
        (BASE, {}, {"energy_error_max": 2e-6 * (1 + 1e-11)}, {}),
        (BASE, {"energy_error_max": 1e-15}, {"energy_error_max": 3e-14}, {}),  # round-off, whatever its ratio
        (BASE, {}, {"cell_time_s": 9.0, "failure": "said otherwise", "us_per_step": 7.0}, {}),
        (BASE, {}, {"energy_error_max": 2.001e-6}, {"energy_error_max": True}),
        (BASE, {}, {"energy_error_max": math.nan}, {"energy_error_max": True}),
        (BASE, {}, {"error_q": [1.0, 2.1]}, {"error_q": False}),
        (BASE, {}, {"status": "blowup", "energy_error_max": 7.0}, {"status": True}),
        (BASE, {"status": "crash"}, {}, {"status": False}),
        (BASE, {}, {"energy_drift": -9.86e-4}, {"energy_drift": True}),  # signed errors by their magnitude
        (BASE, {}, {"energy_drift": 1e-7}, {"energy_drift": False}),
        (BASE, {}, {"lyapunov_increment_max": -1e-3}, {"lyapunov_increment_max": False}),  # of what may only fall
        (ORDER, {}, {"order": 1.0, "verdict": "lower than declared"}, {"order": True, "verdict": True}),
        (ORDER, {"order": 1.0, "verdict": "lower than declared"}, {}, {"order": False, "verdict": False}),
        (RUNG, {}, {"error": 2.4e-5, "wall_time_min_s": 9.0}, {"error": True}),
    ],
)
def test_noise_is_no_change_and_what_is_beyond_is_found_and_judged(tmp_path, base, before, after, expected):
    table = {id(BASE): "conservation", id(ORDER): "convergence", id(RUNG): "work_precision"}[id(base)]
    changes = compared(tmp_path, table, [base | before], [base | after])
    found = in_both(changes)
    assert dict(zip(found["column"], found["worse"], strict=True)) == expected
    assert len(regressions(changes)) == sum(expected.values())
    assert set(found["options"]) <= {'{"dt":1.0}', '{"variable":"all"}', '{"control":"dt","value":0.1}'}


def test_of_timings_the_ratio_is_told_and_no_verdict_and_of_different_machines_a_sentence(tmp_path):
    slow = RUNG | {"wall_time_min_s": 1.5, "error": 2e-6}
    a, b = (published(tmp_path / n, work_precision=[row]) for n, row in (("a", RUNG), ("b", slow)))
    found = compare(a, b)
    assert found[["kind", "after", "worse"]].values.tolist() == [["value", 2e-6, True], ["time", 1.5, False]]
    assert other_machine(a, b) == ""
    c = published(tmp_path / "c", "Apple M4", work_precision=[slow])
    assert compare(a, c)["column"].tolist() == ["error"]
    assert "different machines (x, 2 cores, x Linux and Apple M4, " in other_machine(a, c)


def test_a_column_that_another_version_has_is_one_sentence_and_what_some_rows_have_is_a_change(tmp_path):
    """A new column was as many changes as the table has rows: 175 of the baseline of this repository."""
    found = compared(tmp_path, "conservation", [BASE], [BASE | {"anything": 3.0}])
    assert found.empty and found.attrs["problems"] == ["Only one of the runs has the column anything of conservation."]
    first, second = [BASE | {"anything": 3.0}, BASE | {"dt": 2.0}], [BASE, BASE | {"dt": 2.0, "anything": 3.0}]
    found = in_both(compared(tmp_path, "conservation", first, second, "cd"))
    assert found["column"].tolist() == ["anything"] * 2 and not found["worse"].any()


def test_runs_without_a_row_in_common_or_without_rows_are_an_error(tmp_path):
    """It was "Nothing changed beyond noise", exit code 0, of a gate."""
    a, b = (published(tmp_path / n, conservation=[BASE | {"dt": dt}]) for n, dt in (("a", 1.0), ("b", 2.0)))
    with pytest.raises(TcbenchError, match="have no row in common"):
        compare(a, b)
    assert command("compare", a, b, "--fail-on-regression").returncode == 2
    with pytest.raises(TcbenchError, match="There is no run"):
        compare(a, tmp_path / "none")
    Store.open(tmp_path / "empty").close()
    with pytest.raises(TcbenchError, match="no rows"):
        compare(a, tmp_path / "empty")


def test_what_was_changed_during_a_run_is_told_in_one_sentence_and_is_no_regression(tmp_path):
    """Its rows were failures of all methods, and regressions of the second run."""
    edited = {"status": "exception", "exception_type": "ChangedError", "failure": "Files were edited."}
    rows = [BASE | {"dt": dt} for dt in (1.0, 2.0, 3.0)]
    found = compared(tmp_path, "conservation", rows, [rows[0], *(row | edited for row in rows[1:])])
    assert in_both(found).empty and len(regressions(found)) == 0
    assert found.attrs["problems"][0] == f"2 rows of {tmp_path / 'b'} were not measured, and are not compared."


def test_what_one_run_alone_has_is_counted_and_is_no_regression_nor_is_how_far_a_timed_ladder_went(tmp_path):
    a, b = ([BASE | {"dt": dt} for dt in steps] for steps in ((1.0, 2.0, 4.0), (2.0, 3.0)))
    found = compared(tmp_path, "conservation", a, b)
    assert found[["kind", "before", "after"]].fillna(0).values.tolist() == [["missing", 2, 0], ["new", 0, 1]]
    assert regressions(found).empty and in_both(found).empty
    told = [["missing", "tc", "conservation", 1, 2.0], ["new", "tc", "conservation", 1, 1.0]]
    assert one_sided(found).values.tolist() == told
    assert compared(tmp_path, "work_precision", [RUNG], [RUNG, RUNG | {"value": 0.05}], "cd")["kind"].tolist() == [
        "time"
    ]


def test_ensembles_are_told_apart_by_name_and_seed_and_what_nothing_tells_apart_is_not_compared(tmp_path):
    def share(ensemble, failed, first_seed=0):
        told = {"ensemble": ensemble, "integrator": "m", "dt": 0.1, "first_seed": first_seed}
        return told | {"runs": 100, "failed": failed}

    both = [share("random", 0), share("random[stiffness=10:300]", 40)]
    found = compared(tmp_path, "failure_share", both, [both[1], share("random", 7, first_seed=300)])
    assert sorted(found["kind"]) == ["missing", "new"] and regressions(found).empty
    found = compared(tmp_path, "failure_share", both, [share("random", 40), both[1]], "cd")
    assert regressions(found)[["scenario", "column", "after"]].values.tolist() == [["random", "failed", 40]]
    twice = [[BASE | {"energy_drift": v} for v in values] + [BASE | {"dt": 2.0}] for values in ((1, 2), (2, 1))]
    found = compared(tmp_path, "conservation", *twice, "ef")
    assert found.empty and "2 rows of the table conservation" in found.attrs["problems"][0]


def test_a_published_baseline_finds_its_partners_in_a_new_run(tmp_path):
    """Tables on one side, rows on the other, of another version: matched by what they are."""
    baseline = Path(__file__).resolve().parents[2] / "results" / "baseline"
    tcbench.run(["tc_monolithic"], ["short_term"], ["conservation"], new := tmp_path / "new")
    found = compare(baseline, new)
    lost = found[found["kind"].eq("missing") & (found["study"] == "conservation") & (found["scenario"] == "short_term")]
    assert not found["kind"].eq("new").any() and lost["integrator"].nunique() == 4 and compare(new, new).empty
    table = pandas.read_csv(new / "tables" / "conservation.csv")
    last, dt = table.index[-1], table["dt"].iloc[-1]
    table.loc[last, "energy_error_final"] = 0.5
    (change,) = in_both(compare(new, published(tmp_path / "b", conservation=table))).to_dict("records")
    assert (change["integrator"], change["column"]) == ("tc_monolithic", "energy_error_final") and f"{dt:g}" in str(
        change["options"]
    )
