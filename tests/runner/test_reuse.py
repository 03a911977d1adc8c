"""The one rule of reuse: tcbench, its packages and the plugin's folder as they were; everything else is used again."""

import os
import shutil
import sys
from dataclasses import replace

import numpy as np
import pytest

import tcbench
from tcbench import Integrator, plugins
from tcbench.runner.cell import Cell
from tcbench.runner.ledger import plan
from tcbench.runner.plan import plan_job
from tcbench.runner.rows import Rows, Store
from tcbench.runner.run import execute
from tcbench.runner.scheduler import run_cells
from tcbench.runner.tables import latest_rows
from tcbench.runner.worker import MEASURE
from tests.simulation.test_changed_formulas import springs

PLUGIN = """
from helper import weight
from tcbench import Integrator, Metric, hookimpl

def step(z, h, system):
    return z + weight * h * system.vector_field(z)

@hookimpl
def tcbench_integrators():
    return [Integrator(name="mine", order=1, step=step, uses=["../far/data.csv"], requires=("rich",))]

@hookimpl
def tcbench_metrics():
    return [Metric("doubled", lambda run: 2 * run.energy[0])]
"""
FILES = {"p/mine.py": PLUGIN, "p/helper.py": "weight = 0.5\n", "p/data.txt": "1", "p/sub/deep.bin": "1",
         "far/data.csv": "1", "q/other.py": "", "far/unnamed.csv": "1", "t/__init__.py": "", "t/newton.py": "",
         "t/report/page.py": ""}  # fmt: skip


@pytest.fixture
def desk(tmp_path):
    """A plugin with a helper and data, another one, what `uses` names, and a package in tcbench's place."""
    for name, text in FILES.items():
        write(tmp_path / name, text)
    return tmp_path


def write(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def made(desk, name="p"):
    plugins.forget()
    plugins.use_folders([desk / name, desk / "q"])
    job = plan_job(["mine"], ["short_term"], ["conservation"], dt=[0.3])
    return job.context["made_by"][job.cells[0].key]


def version_of(package):
    return lambda desk, patch: [
        patch.setattr(f"tcbench.{where}.installed_version", lambda name: "99" if name == package else "1")
        for where in ("integrator", "runner.provenance")
    ]


def edit(name, text="weight = 1.0\n"):
    return lambda desk, patch: write(desk / name, text)


CHANGES = {  # after which the row is measured again
    "the plugin": edit("p/mine.py", PLUGIN.replace("order=1", "order=2")),
    "a metric": edit("p/mine.py", PLUGIN.replace("2 *", "3 *")),
    "a helper": edit("p/helper.py"),
    "data beside it": edit("p/data.txt"),
    "data of any kind, deep": edit("p/sub/deep.bin"),
    "a file more": edit("p/more.cfg"),
    "what `uses` names": edit("far/data.csv"),
    "and that it goes": lambda desk, patch: (desk / "far" / "data.csv").unlink(),
    "a package that it requires": version_of("rich"),
    "a package under tcbench": version_of("numpy"),
    "tcbench": edit("t/newton.py"),
    "compiled or plain": lambda desk, patch: patch.setenv("TCBENCH_PLAIN", "1"),
}
NO_CHANGES = [  # after which it is used again: a touch, line ends of Windows, results and pictures, an environment
    lambda desk: os.utime(desk / "p" / "mine.py", (1, 1)),
    lambda desk: (desk / "p/helper.py").write_bytes(b"weight = 0.5\r\n"),
    lambda desk: [write(desk / "p" / n, "x") for n in
                  ("out/cells.jsonl", "cells.jsonl", "tables/conservation.csv", "manifest.json", "a.png", "b.log")],
    lambda desk: [write(desk / "p/env" / n, "x") for n in ("pyvenv.cfg", "lib.py")],
    lambda desk: [write(desk / n, "weight = 1.0") for n in ("q/other.py", "far/unnamed.csv", "t/report/page.py")],
]  # fmt: skip


@pytest.fixture
def beside(desk, monkeypatch):
    plugins.registry()
    monkeypatch.setattr(sys.modules["tcbench_plugins"], "__file__", str(desk / "t" / "__init__.py"))
    return desk


@pytest.mark.parametrize("what", CHANGES)
def test_a_row_is_measured_again_if_what_it_was_made_by_has_changed(beside, monkeypatch, what):
    before = made(beside)
    CHANGES[what](beside, monkeypatch)
    assert made(beside) != before


def test_a_row_is_used_again_whatever_else_has_changed(beside):
    """A touch, line ends of Windows, results, pictures and an environment in the plugin's folder, other plugins, files
    that nobody names, and what only shows."""
    before = made(beside)
    for k, change in enumerate(NO_CHANGES):
        change(beside)
        assert made(beside) == before, k


def test_a_folder_that_moves_is_the_same(desk):
    before = made(desk)
    shutil.move(desk / "p", desk / "moved")
    assert made(desk, "moved") == before


@pytest.mark.usefixtures("here")
def test_the_rows_of_a_plugin_are_used_again_until_it_is_edited(desk):
    def run():
        plugins.use_folders([desk / "p"])
        return tcbench.run(["mine"], ["short_term"], ["conservation"], desk / "out", dt=[0.3])

    first, second = run(), run()
    assert (first.summary.run, second.summary.run) == (1, 0)
    write(desk / "p" / "helper.py", "weight = 1.0\n")
    os.utime(desk / "p" / "helper.py", (1e9, 1e9))  # Python may take its byte code for current
    third = run()
    assert third.summary.run == 1
    errors = [r.tables["conservation"]["energy_error_max"].item() for r in (first, third)]
    assert errors[0] != errors[1]


def test_a_file_that_is_edited_after_the_plan_gives_no_row_of_the_plan(desk):
    plugins.use_folders([desk / "p"])
    job = plan_job(["mine"], ["short_term"], ["conservation"], dt=[0.3])
    write(desk / "p" / "helper.py", "weight = 1.0\n")
    rows = Rows()
    run_cells(job.cells, MEASURE, job.context, rows, jobs=1)
    (row,) = rows.rows().values()
    assert row["exception_type"] == "ChangedError" and "not what the run was planned with" in row["failure"]


@pytest.mark.parametrize("name", ["short_term", "rigid_body"])  # springs; any other system, which has `initial`
def test_every_number_of_a_scenario_counts_and_no_word_does(name):
    def of(scenario):
        job = plan_job(["midpoint_entropy"], [scenario], ["conservation"], dt=[0.3])
        return job.cells[0].key, job.context["made_by"][job.cells[0].key]

    base = tcbench.scenarios()[name].replace(name="x")
    constant = "coupling" if name == "short_term" else "damping"
    for change in ({"t_end": 1.01 * base.t_end}, {"constants": base.constants | {constant: 0.3}}):
        assert of(replace(base, **change)) != of(base)
    for word in ("shows", "source"):
        assert of(replace(base, **{word: "another word"})) == of(base)


def test_a_timing_is_of_the_machine_that_took_it():
    cell, rows = Cell("work_precision", "m", "s", timed=True), Rows()
    rows.append(cell.key, {"status": "ok", "machine": "a slow one"}, cell.as_dict())
    assert not plan([cell], rows, machine="a slow one")[0] and plan([cell], rows, machine="a fast one")[0]


def test_a_table_is_of_one_tcbench_one_method_and_one_scenario_and_says_what_it_leaves_out():
    for older, told in (("b-m-s", "another tcbench"), ("a-n-s", "an older m"), ("a-m-t", "another scenario s")):
        rows = Rows()
        for n, mark in enumerate((older, "a-m-s")):
            cell = Cell("conservation", "m", "s", {"dt": n})
            rows.append(cell.key, {"status": "ok"}, cell.as_dict(), made_by=mark)
        keys, sentences = latest_rows(rows)
        assert len(keys) == 1 and told in sentences[0]


@pytest.mark.usefixtures("here")
def test_objects_of_a_session_are_measured_each_time_and_each_of_one_name_is_its_own(tmp_path):
    def weighted(theta):
        def formula(z0, z1, h, system):
            return z1 - z0 - h * system.vector_field((1 - theta) * z0 + theta * z1)

        return Integrator(name="mine", order=1, flows=formula)

    found = [
        tcbench.run([weighted(theta)], ["short_term"], ["conservation"], tmp_path, dt=[0.3]) for theta in (0.5, 1, 0.5)
    ]
    errors = [results.tables["conservation"]["energy_error_max"].item() for results in found]
    assert errors[0] == errors[2] != errors[1] and [results.summary.run for results in found] == [1, 1, 1]


def test_what_a_session_has_changed_of_an_imported_system_is_not_measured_by_workers(tmp_path, monkeypatch):
    def run():
        return tcbench.run(["midpoint_entropy"], [springs()], ["conservation"], tmp_path, dt=[0.3])

    assert run().statuses == {"ok": 1} and run().summary.run == 0
    monkeypatch.setattr("tests.simulation.test_changed_formulas.HARDNESS", 2.0)
    again = run()
    assert again.summary.run == 1 and again.statuses == {"exception": 1}
    (row,) = Store.read(tmp_path).rows().values()
    assert row["exception_type"] == "ChangedError" and "changed in the session" in row["failure"]
    monkeypatch.undo()


@pytest.mark.usefixtures("here")
def test_files_of_the_user_in_the_folder_stay_as_they_are(tmp_path):
    """Each .csv and .parquet in tables/ was deleted that no study makes."""
    kept = {"tables/mine.csv": "a,b\n1,2\n", "notes.txt": "mine", "tables/notes.parquet": "mine"}
    for name, text in kept.items():
        write(tmp_path / name, text)
    for dt in (0.3, 0.6):
        tcbench.run(["tc_strang"], ["short_term"], ["conservation"], tmp_path, dt=[dt])
    assert {name: (tmp_path / name).read_text() for name in kept} == kept
    assert {p.name for p in (tmp_path / "tables").iterdir() if p.stem in ("mine", "notes")} == {
        "mine.csv",
        "notes.parquet",
    }


@pytest.mark.usefixtures("here")
def test_a_folder_has_one_truth_whatever_was_run_last(tmp_path):
    import pandas

    names = ["tc_monolithic", "tc_strang"]
    for methods in (names, names[:1]):
        results = tcbench.run(methods, ["short_term"], ["conservation"], tmp_path, dt=[0.3])
    assert len(results.tables["conservation"]) == 1
    for path, read in (("conservation.csv", pandas.read_csv), ("conservation.parquet", pandas.read_parquet)):
        assert sorted(read(tmp_path / "tables" / path)["integrator"]) == names
    fresh = tcbench.run(names[:1], ["short_term"], ["equilibrium"], tmp_path, fresh=True)
    assert {p.stem for p in (tmp_path / "tables").iterdir()} == set(fresh.tables)


@pytest.mark.usefixtures("here")
def test_a_damaged_line_is_told_and_its_cell_measured_again(tmp_path):
    """One changed digit was believed."""
    job = plan_job(["tc_strang"], ["short_term"], ["conservation"], dt=[0.3, 0.6])
    limits = {"jobs": 1, "timeout": 60.0, "memory_limit": None, "retry_failed": False}
    execute(job, tmp_path, limits)
    lines = (tmp_path / "cells.jsonl").read_bytes().splitlines(keepends=True)
    assert b'"dt":0.3' in lines[0]
    (tmp_path / "cells.jsonl").write_bytes(lines[0].replace(b'"dt":0.3', b'"dt":0.6') + lines[1])
    again = execute(job, tmp_path, limits)
    assert (
        again.summary.run == 1 and "line 1: is damaged" in again.problems[0] and len(again.tables["conservation"]) == 2
    )
    assert np.isfinite(again.tables["conservation"]["energy_error_max"]).all()
