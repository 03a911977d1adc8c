"""Comparing runs: silent about noise and changes of code without effect, loud about everything else."""

from __future__ import annotations

import math

import pandas
import pytest
from command import tcbench as command

from tcbench.errors import TcbenchError
from tcbench.runner.cell import Cell
from tcbench.runner.compare import compare, in_both, one_sided, other_machine, regressions
from tcbench.runner.rows import Store

BASE = {
    "status": "ok",
    "energy_error_max": 2e-6,
    "energy_drift": -1.09e-6,
    "lyapunov_increment_max": -1e-6,
    "us_per_step": 1.0,
    "errors": {"q": [1.0, 2.0]},
    "cell_time_s": 1.0,
}


def run(folder, rows):
    """A run folder with one timed cell for each row."""
    with Store.open(folder) as store:
        for number, row in rows.items():
            cell = Cell("conservation", "tc", "short", {"dt": number}, timed=True)
            store.append(cell.key, BASE | row, cell.as_dict())
    return folder


def changes(tmp_path, before, after):
    a = run(tmp_path / "a", {1: before})
    return compare(a, run(tmp_path / "b", {1: after}))


@pytest.mark.parametrize(
    "after",
    [
        {},
        {"energy_error_max": 2e-6 * (1 + 1e-11)},
        {"errors": {"q": [1.0, 2.0 + 1e-13]}},
        {"cell_time_s": 9.0, "failure": "said otherwise", "output_tail": "x"},
    ],
)
def test_noise_is_no_change(tmp_path, after):
    assert in_both(changes(tmp_path, {}, after)).empty


@pytest.mark.parametrize(
    ("after", "column", "worse"),
    [
        ({"energy_error_max": 2.001e-6}, "energy_error_max", True),
        ({"energy_error_max": math.nan}, "energy_error_max", True),
        ({"errors": {"q": [1.0, 2.1]}}, "errors.q[1]", False),
        ({"errors": {"q": [1.0]}}, "errors.q.length", False),
        ({"status": "blowup", "energy_error_max": 7.0}, "status", True),
        ({"energy_drift": -9.86e-4}, "energy_drift", True),  # signed errors by their magnitude
        ({"energy_drift": 1e-7}, "energy_drift", False),
        ({"lyapunov_increment_max": -1e-3}, "lyapunov_increment_max", False),  # a fall of what may only fall
    ],
)
def test_a_change_beyond_noise_is_found_and_judged(tmp_path, after, column, worse):
    found = changes(tmp_path, {}, after)
    assert column in set(found["column"])
    row = found[found["column"] == column].iloc[0]
    assert (bool(row["worse"]), row["options"]) == (worse, '{"dt":1}')
    assert len(regressions(found)) == int(found["worse"].sum())


def test_a_column_that_another_version_has_is_one_sentence_and_what_some_rows_have_is_a_change(tmp_path):
    """A new column was as many changes as the table has rows: 175 of the baseline of this repository."""
    found = changes(tmp_path / "new", {}, {"anything": 3.0})
    told = ["Only one of the runs has the column anything of conservation."]
    assert in_both(found).empty and found.attrs["problems"] == told
    a = run(tmp_path / "a", {1: {"anything": 3.0}, 2: {}})
    found = in_both(compare(a, run(tmp_path / "b", {1: {}, 2: {"anything": 3.0}})))
    assert found["column"].tolist() == ["anything"] * 2 and not found["worse"].any()


def test_of_timings_the_ratio_is_told_and_no_verdict(tmp_path):
    found = changes(tmp_path, {}, {"us_per_step": 1.5})
    assert found[["kind", "after", "worse"]].values.tolist() == [["time", 1.5, False]]
    assert in_both(found).empty and regressions(found).empty


def test_runs_without_a_row_in_common_are_an_error(tmp_path):
    """It was "Nothing changed beyond noise", exit code 0, of a gate."""
    a, b = run(tmp_path / "a", {1: {}}), run(tmp_path / "b", {2: {}})
    with pytest.raises(TcbenchError, match="have no row in common"):
        compare(a, b)
    assert command("compare", a, b, "--fail-on-regression").returncode == 2


def test_what_was_changed_during_a_run_is_told_in_one_sentence_and_is_no_regression(tmp_path):
    """Its rows were failures of all methods, and regressions of the second run."""
    edited = {"status": "exception", "exception_type": "ChangedError", "failure": "Files were edited."}
    a, b = run(tmp_path / "a", {1: {}, 2: {}, 3: {}}), run(tmp_path / "b", {1: {}, 2: edited, 3: edited})
    found = compare(a, b)
    assert in_both(found).empty and len(regressions(found)) == 0
    assert found.attrs["problems"] == [f"2 rows of {b} were not measured, and are not compared."]


def test_a_recovered_cell_is_no_regression(tmp_path):
    found = changes(tmp_path, {"status": "crash"}, {})
    assert in_both(found)["kind"].tolist() == ["status"] and regressions(found).empty


def test_round_off_is_no_change_however_large_its_ratio(tmp_path):
    assert in_both(changes(tmp_path, {"energy_error_max": 1e-15}, {"energy_error_max": 3e-14})).empty


@pytest.mark.parametrize(
    ("before", "after", "worse"),
    [
        ({"order": 4.0, "verdict": "as declared"}, {"order": 1.0, "verdict": "lower than declared"}, 2),
        ({"order": 1.0, "verdict": "lower than declared"}, {"order": 4.0, "verdict": "as declared"}, 0),
        ({"error": 1.1e-8}, {"error": 2.4e-5}, 1),
        ({"status": "ok", "wall_time_min_s": 1.0}, {"status": "blowup", "wall_time_min_s": 1.0}, 1),
    ],
)
def test_what_stands_in_a_list_of_a_row_is_judged_as_well(tmp_path, before, after, worse):
    found = changes(tmp_path, {"points": [{"dt": 0.1} | before]}, {"points": [{"dt": 0.1} | after]})
    assert len(in_both(found)) > 0 and len(regressions(found)) == worse


def test_a_rung_is_named_by_its_step_and_variable(tmp_path):
    points = [{"variable": v, "dt": h, "error": 1e-3} for v in "qp" for h in (0.1, 0.05)]

    def column(name, last):
        return in_both(changes(tmp_path / name, {"points": points}, {"points": [*points[:3], last]}))["column"].tolist()

    assert column("1", points[3] | {"error": 2e-3}) == ["points[variable=p, dt=0.05].error"]
    assert column("2", points[3] | {"dt": 0.04}) == ["points[3].dt"]
    assert column("3", 5)  # a damaged line


def test_timings_of_cells_that_shared_the_machine_are_not_compared(tmp_path):
    folders = []
    for name, seconds in (("a", 1.0), ("b", 2.0)):
        with Store.open(tmp_path / name) as store:
            cell = Cell("conservation", "tc", "short")
            store.append(cell.key, {"status": "ok", "wall_time_s": seconds, "timed": False}, cell.as_dict())
        folders.append(tmp_path / name)
    assert compare(*folders).empty


def test_what_one_run_alone_has_is_counted_and_is_no_regression(tmp_path):
    found = compare(run(tmp_path / "a", {1: {}, 2: {}, 4: {}}), run(tmp_path / "b", {2: {}, 3: {}}))
    counts = found[found["kind"] != "time"][["kind", "before", "after"]]
    assert counts.fillna(0).values.tolist() == [["missing", 2, 0], ["new", 0, 1]]
    assert regressions(found).empty and in_both(found).empty
    assert one_sided(found, "a", "b") == [
        "Only a has rows of tc on short (2 of conservation).",
        "Only b has rows of tc on short (1 of conservation).",
    ]


def published(folder, tables):
    """A folder that has tables and no rows."""
    with Store.open(folder) as store:
        store.write_tables({name: pandas.DataFrame(rows) for name, rows in tables.items()})
    for path in folder.iterdir():
        if path.is_file():
            path.unlink()
    return folder


def test_ensembles_are_told_apart_by_name_and_seed(tmp_path):
    def share(ensemble, failed, first_seed=0):
        return {
            "ensemble": ensemble,
            "integrator": "m",
            "dt": 0.1,
            "first_seed": first_seed,
            "runs": 100,
            "failed": failed,
        }

    both = [share("random", 0), share("random[stiffness=10:300]", 40)]
    a = published(tmp_path / "a", {"failure_share": both})
    found = compare(a, published(tmp_path / "b", {"failure_share": both[1:] + [share("random", 7, first_seed=300)]}))
    assert sorted(found["kind"]) == ["missing", "new"] and regressions(found).empty
    found = compare(a, published(tmp_path / "c", {"failure_share": [share("random", 40), both[1]]}))
    assert regressions(found)[["scenario", "column", "after"]].values.tolist() == [["random", "failed", 40]]


def test_points_of_an_ensemble_are_told_apart_by_seed_and_value(tmp_path):
    def points(folder, seeds):
        rows = [{"integrator": "m", "seed": k, "control": "dt", "value": 0.1, "error": 10.0**-k} for k in seeds]
        return published(tmp_path / folder, {"ensemble_points": rows})

    found = compare(points("a", [1, 2, 3]), points("b", [2, 3]))
    assert found["kind"].tolist() == ["missing"]


def test_rows_that_nothing_tells_apart_are_not_compared_and_a_sentence_says_so(tmp_path):
    def table(folder, values):
        rows = [{"integrator": "m", "scenario": "s", "status": "ok", "dt": 0.1, "what": v} for v in (*values, 0)]
        return published(tmp_path / folder, {"conservation": [*rows[:-1], rows[-1] | {"dt": 0.2}]})

    found = compare(table("a", [1, 2]), table("b", [2, 1]))
    assert found.empty and "2 rows of the table conservation" in found.attrs["problems"][0]


def test_published_tables_without_rows_can_be_compared(tmp_path):
    folders = [
        published(
            tmp_path / name,
            {"convergence_points": [
                {"integrator": i, "scenario": "s", "dt": 0.1, "status": "ok", "error": e}
                for i, e in (("x", 1e-6), ("y", error))
            ]},
        )
        for name, error in (("a", 1e-6), ("b", 2e-6))
    ]  # fmt: skip
    found = regressions(compare(*folders))
    assert found[["study", "integrator", "column"]].values.tolist() == [["convergence_points", "y", "error"]]


def test_a_folder_without_a_run_is_refused(tmp_path):
    with pytest.raises(TcbenchError, match="There is no run"):
        compare(run(tmp_path / "a", {1: {}}), tmp_path / "b")
    Store.open(tmp_path / "empty").close()
    with pytest.raises(TcbenchError, match="no rows"):
        compare(run(tmp_path / "c", {1: {}}), tmp_path / "empty")


# -- machines, samples, published tables


def with_machine(folder, cpu):
    """The folder's runs, measured on this kind of machine."""
    with Store.open(folder) as store:
        store.write_manifest({"machine": {"cpu": cpu, "cores": 2, "architecture": "x", "system": "Linux"}})
    return folder


def test_timings_of_different_machines_are_left_out_and_a_sentence_says_so(tmp_path):
    a, b = (
        run(tmp_path / n, {1: {"us_per_step": t, "energy_error_max": e}})
        for n, t, e in (("a", 1, 1e-6), ("b", 9, 2e-6))
    )
    assert other_machine(a, b) == "" and set(compare(a, b)["column"]) == {"time", "energy_error_max"}
    with_machine(a, "Intel Xeon"), with_machine(b, "Apple M4")
    assert compare(a, b)["column"].tolist() == ["energy_error_max"]
    assert "different machines (Intel Xeon, 2 cores, x Linux and Apple M4, " in other_machine(a, b)


def test_how_far_a_timed_ladder_went_is_no_change(tmp_path):
    two, three = ({"points": [{"value": v, "error": 1e-3} for v in range(n)]} for n in (2, 3))
    assert in_both(changes(tmp_path / "1", two, three)).empty and in_both(changes(tmp_path / "2", three, two)).empty
    worse = {"points": [{"value": 0, "error": 1e-3}, {"value": 1, "error": 1e-2}]}
    found = in_both(changes(tmp_path / "3", worse, three))
    assert found["column"].tolist() == ["points[value=1].error"]


def test_a_published_baseline_finds_its_partners_in_a_new_run(tmp_path):
    """Tables on one side, rows on the other, of another version and machine: matched by what they are."""
    import shutil

    import tcbench

    options = {"integrators": ["tc_strang"], "scenarios": ["short_term"], "dt": [0.3, 0.6]}
    new = tmp_path / "new"
    tcbench.run(**options, studies=["conservation", "convergence", "stability", "work_precision"], output=new)
    published = tmp_path / "published"
    shutil.copytree(new / "tables", published / "tables")
    shutil.copy(new / "manifest.json", published)
    for path in (published / "tables").iterdir():
        if path.suffix == ".parquet":
            path.unlink()  # the baseline keeps CSV
            continue
        frame = pandas.read_csv(path)
        for column in ("source_hash", "scenario_hash", "plugin", "tcbench_version", "why"):
            frame[column] = "of then" if column != "scenario_hash" else frame.get(column)
        frame.to_csv(path, index=False)
    both = [compare(published, new), compare(new, published), compare(new, new)]
    assert all(set(found["kind"]) <= {"time"} for found in both), both[0].to_string()
    table = pandas.read_csv(published / "tables" / "conservation.csv")
    table.loc[table["dt"] == 0.6, "energy_error_final"] = 0.5
    table.to_csv(published / "tables" / "conservation.csv", index=False)
    (change,) = in_both(compare(published, new)).to_dict("records")
    assert (change["integrator"], change["column"], change["options"]) == (
        "tc_strang",
        "energy_error_final",
        '{"dt":0.6}',
    )


def test_the_baseline_of_this_repository_finds_partners_for_all_that_was_run(tmp_path):
    from pathlib import Path

    import tcbench

    baseline = Path(__file__).resolve().parents[2] / "results" / "baseline"
    tcbench.run(["tc_monolithic"], ["short_term"], ["conservation"], tmp_path)
    found = compare(baseline, tmp_path)
    assert not found["kind"].eq("new").any()
    lost = found[found["kind"].eq("missing")]
    assert lost[(lost["study"] == "conservation") & (lost["scenario"] == "short_term")]["integrator"].nunique() == 4
