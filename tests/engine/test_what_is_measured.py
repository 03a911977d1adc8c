"""A row is used again only where it would come out the same: objects, Systems, modules, plugin files, packages."""

import importlib
import os
import subprocess
import sys
import textwrap
from dataclasses import replace

import numpy as np
import pandas
import pytest
from command import tcbench as command

import tcbench
from tcbench import Integrator, plugins
from tcbench.engine import fingerprint
from tcbench.engine.local import run_cells
from tcbench.engine.measure import MEASURE
from tcbench.runner.plan import plan_job
from tcbench.store.rows import Rows
from tcbench.store.store import Store
from tests.simulation.test_changed_formulas import springs

WEIGHT = 0.5


def weighted(theta):
    def formula(z0, z1, h, system):
        return z1 - z0 - h * system.vector_field((1 - theta) * z0 + theta * z1)

    return Integrator(name="mine", order=1, flows=formula)


def run(folder, methods, scenarios=("short_term",)):
    return tcbench.run(methods, scenarios, ["conservation"], folder, dt=[0.3])


def error(results):
    return results.tables["conservation"]["energy_error_max"].item()


def test_a_sweep_with_closures_of_one_name_measures_each(tmp_path):
    found = [run(tmp_path, [weighted(theta)]) for theta in (0.5, 1.0, 0.5)]
    assert error(found[0]) == error(found[2]) != error(found[1])
    V0 = tcbench.scenarios()["short_term"].initial_exergy
    for results, theta in zip(found, (0.5, 1.0, 0.5), strict=True):
        direct = tcbench.simulate(weighted(theta), "short_term", dt=0.3, residuals=True)
        assert error(results) == pytest.approx(np.abs(direct.energy - direct.energy[0]).max() / V0, rel=1e-9)
    counts = [(r.summary.planned, r.summary.run, r.summary.already_finished, r.summary.left) for r in found]
    assert counts == [(1, 1, 0, 0)] * 3  # what a session's object computes with is not known
    hashes = [r.tables["conservation"]["source_hash"].item() for r in found]
    assert hashes[0] == hashes[2] != hashes[1] and all(len(mark) == 12 for mark in hashes)
    # the folder's own tables say what the last run says
    assert pandas.read_csv(tmp_path / "tables" / "conservation.csv")["energy_error_max"].item() == error(found[2])


def test_a_global_that_a_step_in_python_reads_is_in_the_key(tmp_path, monkeypatch):
    def step(z, h, system):
        return z + WEIGHT * h * system.vector_field(z)

    method = Integrator(name="mine", order=1, step=step)
    first = error(run(tmp_path, [method]))
    monkeypatch.setitem(globals(), "WEIGHT", 0.25)
    second = run(tmp_path, [method])
    assert error(second) != first and second.summary.run == 1


def test_what_has_no_hash_is_measured_each_time_and_says_so(tmp_path):
    states = (n for n in range(10**6))

    def step(z, h, system):
        next(states)
        return z + h * system.vector_field(z)

    method = Integrator(name="mine", order=1, step=step)
    found = [run(tmp_path, [method]) for _ in range(2)]
    assert [r.summary.run for r in found] == [1, 1]
    assert found[1].tables["conservation"]["source_hash"].item() == fingerprint.UNHASHABLE
    assert len(Store.read(tmp_path).lines()) == 1


def test_what_a_session_has_changed_of_an_imported_system_is_not_measured_by_workers_which_have_its_file(
    tmp_path, monkeypatch
):
    scenario, methods = springs(), ["tc_monolithic", "midpoint_entropy"]
    first = run(tmp_path, methods, [scenario])
    assert set(first.tables["conservation"]["status"]) == {"ok"} and first.summary.run == 2
    assert run(tmp_path, methods, [scenario]).summary.already_finished == 2
    monkeypatch.setattr("tests.simulation.test_changed_formulas.HARDNESS", 2.0)
    again = run(tmp_path, methods, [scenario])
    assert again.summary.run == 2 and again.statuses == {"exception": 2}
    rows = [row for row in Store.read(tmp_path).rows().values() if row["status"] == "exception"]
    assert [row["exception_type"] for row in rows] == ["ChangedError"] * 2
    assert all("Springs" in row["failure"] and "changed in the session" in row["failure"] for row in rows)
    monkeypatch.undo()  # as the file says: the rows of before are those of what there is
    assert run(tmp_path, methods, [scenario]).summary.already_finished == 2


def test_a_system_made_inside_a_function_runs(tmp_path):
    base = springs().system

    class Local(base):
        name = "local"

    scenario = replace(springs(), system=Local, name="local")
    assert run(tmp_path, ["tc_monolithic"], [scenario]).tables["conservation"]["status"].item() == "ok"


SYSTEM = """
import numpy as np
import tcbench
from tcbench import Pendulum
from factor_of_mine import factor
class Softer(Pendulum):
    name = "softer"
    def conduction(self, theta):
        return factor * super().conduction(theta)
"""


def test_a_system_of_a_module_runs_in_workers_and_an_edit_of_what_it_imports_is_seen(tmp_path, monkeypatch):
    (tmp_path / "system_of_mine.py").write_text(SYSTEM)
    (tmp_path / "factor_of_mine.py").write_text("factor = 1.0\n")
    monkeypatch.syspath_prepend(tmp_path)
    module = importlib.import_module("system_of_mine")
    short = tcbench.scenarios()["short_term"]

    def measured():
        scenario = replace(short.replace(name="soft"), system=module.Softer)
        results = run(tmp_path / "out", ["midpoint_entropy"], [scenario])
        return results.tables["conservation"].iloc[0], results.summary.run

    first, count = measured()
    assert first["status"] == "ok" and count == 1 and measured()[1] == 0
    (tmp_path / "factor_of_mine.py").write_text("factor = 9.0  # longer\n")  # .pyc: size and seconds
    stale, count = measured()  # the session still has the old module: the worker, which has the new one, refuses
    assert count == 1 and "was changed in the session" in stale["failure"]
    importlib.reload(sys.modules["factor_of_mine"])
    module = importlib.reload(module)
    second, count = measured()
    assert count == 1 and second["status"] == "ok"
    assert second["energy_error_max"] != first["energy_error_max"]


PLUGIN = """
from tcbench import Integrator, Metric, hookimpl

def formula(z0, z1, h, system):
    return z1 - z0 - h * system.vector_field(({a}) * z0 + {b} * z1)

@hookimpl
def tcbench_integrators():
    return [Integrator(name="from_a_file", order=1, flows=formula)]

@hookimpl
def tcbench_metrics():
    return [Metric("doubled", lambda run: {c} * run.energy[0])]
"""


def test_a_plugin_file_that_is_edited_during_the_session_is_read_again(tmp_path):
    file, out = tmp_path / "from_a_file.py", tmp_path / "out"
    file.write_text(PLUGIN.format(a=0.5, b=0.5, c=2))
    plugins.use_folders([file])
    first = run(out, ["from_a_file"])
    assert run(out, ["from_a_file"]).summary.run == 0
    file.write_text(PLUGIN.format(a=0.0, b=1.0, c=2))
    plugins.use_folders([file])
    second = run(out, ["from_a_file"])
    assert second.summary.run == 1 and error(second) != error(first)


HELPED = "import pack.share\n" + PLUGIN.replace("({a})", "pack.share.old").replace("{b}", "pack.share.new")


@pytest.mark.parametrize("python", ["this", pytest.param("another", marks=pytest.mark.thorough)])
def test_an_edit_of_one_size_and_second_is_measured(tmp_path, monkeypatch, python):
    """Python would take its byte code of the file before for current: own files, helpers and packages beside them."""
    monkeypatch.delenv("PYTHONDONTWRITEBYTECODE", raising=False)
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    (tmp_path / "pack").mkdir()
    (tmp_path / "pack" / "__init__.py").write_text("")
    share, out = tmp_path / "pack" / "share.py", tmp_path / "out"
    (tmp_path / "from_a_file.py").write_text(HELPED.format(c=2))
    errors = []
    for values in ("old, new = 0.5, 0.5\n", "old, new = 0.0, 1.0\n"):
        share.write_text(values)
        os.utime(share, (1e9, 1e9))
        if python == "this":
            plugins.use_folders([tmp_path])
            errors.append(error(run(out, ["from_a_file"])))
        else:
            command = [sys.executable, "-m", "tcbench", "run", "-i", "from_a_file", "-s", "short_term", "--study",
                       "conservation", "--dt", "0.3", "--plugins-dir", str(tmp_path), "--output", str(out)]  # fmt: skip
            subprocess.run(command, check=True, capture_output=True)
            errors.append(pandas.read_csv(out / "tables" / "conservation.csv")["energy_error_max"].item())
    assert errors[0] != errors[1]


def test_a_file_that_is_edited_after_the_plan_gives_no_row_of_the_plan(tmp_path):
    file = tmp_path / "from_a_file.py"
    file.write_text(PLUGIN.format(a=0.5, b=0.5, c=2))
    plugins.use_folders([file])
    job = plan_job(["from_a_file"], ["short_term"], ["conservation"], dt=[0.3])
    file.write_text(PLUGIN.format(a=0.0, b=1.0, c=2))
    rows = Rows()
    run_cells(job.cells, MEASURE, job.context, rows, jobs=1)
    (row,) = rows.rows().values()
    assert row["exception_type"] == "ChangedError" and "not those that the run was planned with" in row["failure"]


def test_a_metric_that_is_edited_is_measured_again(tmp_path):
    file, out = tmp_path / "from_a_file.py", tmp_path / "out"
    values = []
    for c in (2, 3):
        file.write_text(PLUGIN.format(a=0.5, b=0.5, c=c))
        plugins.use_folders([file])
        values.append(run(out, ["from_a_file"]).tables["conservation"]["doubled"].item())
    assert values[1] == pytest.approx(1.5 * values[0])


def test_versions_of_what_computes_are_in_the_key(monkeypatch):
    def key():
        return plan_job(["tc_monolithic"], ["short_term"], ["conservation"], dt=[0.3]).cells[0].key

    before = key()
    for package in ("numpy", "scipy", "llvmlite"):
        with monkeypatch.context() as patch:
            patch.setattr(fingerprint, "versions", lambda package=package: {package: "other"})
            assert key() != before
    assert key() == before


def test_a_new_version_of_a_required_package_measures_again_and_stands_in_the_manifest(tmp_path, monkeypatch):
    method = replace(tcbench.integrators()["tc_strang"], requires=("rich",))
    monkeypatch.setitem(plugins.registry().integrators, "tc_strang", method)
    assert run(tmp_path, ["tc_strang"]).summary.run == 1
    packages = Store.read(tmp_path).manifest()["packages"]
    assert "rich" in packages and "llvmlite" in packages and "casadi" not in packages
    before = plan_job(["tc_strang"], ["short_term"], ["conservation"]).cells[0].key
    for found in ("99.0", None):  # another, or none
        monkeypatch.setattr("tcbench.integrator.installed_version", lambda name, found=found: found)
        assert plan_job(["tc_strang"], ["short_term"], ["conservation"]).cells[0].key != before


def test_a_folder_has_one_truth_whatever_was_run_last(tmp_path):
    run(tmp_path, [weighted(0.5), replace(weighted(1.0), name="other")])
    narrow = run(tmp_path, [weighted(0.5)])
    assert len(narrow.tables["conservation"]) == 1
    for table in (
        pandas.read_csv(tmp_path / "tables" / "conservation.csv"),
        pandas.read_parquet(tmp_path / "tables" / "conservation.parquet"),
    ):
        assert sorted(table["integrator"]) == ["mine", "other"]
    fresh = tcbench.run([weighted(0.5)], ["short_term"], ["convergence"], tmp_path, fresh=True)
    assert {p.stem for p in (tmp_path / "tables").iterdir()} == set(fresh.tables)


def test_the_summary_of_the_command_line_has_all_rows_too(tmp_path):
    words = ["run", "-s", "short_term", "--study", "conservation", "--dt", "0.3", "-o", tmp_path]
    for methods in (["-i", "tc_monolithic", "-i", "midpoint_entropy"], ["-i", "tc_monolithic"]):
        done = command(*words, *methods)
        assert done.returncode == 0, done.stderr
    summary = pandas.read_csv(tmp_path / "summary.csv")
    assert sorted(summary["integrator"]) == ["midpoint_entropy", "tc_monolithic"]


def test_a_script_that_is_edited_gives_the_new_number(tmp_path):
    script = tmp_path / "script.py"
    text = textwrap.dedent("""
        import tcbench
        from tcbench import Integrator
        def formula(z0, z1, h, system):
            return z1 - z0 - h * system.vector_field(THETA * z1 + (1 - THETA) * z0)
        method = Integrator(name="mine", order=1, flows=formula)
        results = tcbench.run([method], ["short_term"], ["conservation"], "out", dt=[0.3])
        print(results.summary.run, results.tables["conservation"]["energy_error_max"].item())
    """)
    found = []
    for theta in ("0.5", "1.0", "1.0"):
        script.write_text(f"THETA = {theta}\n" + text)
        done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        found.append(done.stdout.split())
    assert [count for count, _ in found] == ["1", "1", "1"]
    assert found[0][1] != found[1][1] == found[2][1]
