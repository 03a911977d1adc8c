"""Code that nobody named is not run, and what a plugin does to its process is undone before another's cells."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from command import tcbench

from tcbench import TcbenchError, plugins
from tcbench import run as run_here
from tcbench.store.store import Store

SCRIPT = Path(sys.executable).with_name("tcbench")
PLUGIN = """
import numpy as np
from tcbench import Integrator, hookimpl
{before}
def step(z, h, system):
    {step}
    return z + h * system.vector_field(z)

@hookimpl
def tcbench_integrators():
    {hook}
    return [Integrator(name={name!r}, order=1, step=step)]
"""


def plugin(path, name=None, before="", step="pass", hook="pass"):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(PLUGIN.format(name=name or path.stem, before=before, step=step, hook=hook))
    return path


def process(*words, cwd):
    """As `tcbench`, by a process of its own."""
    return subprocess.run([str(SCRIPT), *map(str, words)], capture_output=True, text=True, cwd=cwd)


def run(*words, cwd, out="out", by=tcbench):
    return by("run", *words, "-s", "short_term", "--study", "conservation", "--dt", "0.3", "-o", out, cwd=cwd)


def rows(folder):
    return {line["cell"]["integrator"]: line["row"] for line in Store.read(folder).lines()}


def helped(folder, name, factor, late=False):
    where = "from helper import factor"
    plugin(folder / f"{name}.py", before="" if late else where, step=f"{where if late else 'pass'}; h = factor * h")
    (folder / "helper.py").write_text(f"factor = {factor}\n")


def test_helpers_of_one_name_in_two_folders_are_each_its_own_or_refused_with_a_sentence(tmp_path):
    """Imported where the file begins each is found at home; in a step nobody knows who asks, if both are loaded."""
    helped(tmp_path / "a", "mine_a", 1.0)
    helped(tmp_path / "b", "mine_b", 0.5)
    helped(tmp_path / "c", "mine_c", 0.25, late=True)
    plugins.use_folders([tmp_path / name for name in "abc"])
    found = {name: plugins.find_integrator(f"mine_{name}").step for name in "abc"}
    assert [found[name].__globals__["factor"] for name in "ab"] == [1.0, 0.5]
    with pytest.raises(TcbenchError, match=r"Two folders have a module 'helper', and Python would give one of their"):
        found["c"](0.0, 0.1, None)
    chosen = [word for name in "abc" for word in ("-i", f"mine_{name}", "--plugins-dir", name)]
    assert run(*chosen, cwd=tmp_path).returncode == 0  # each cell has a process that knows one of them
    found = rows(tmp_path / "out").values()
    assert len(found) == 3 and not [row for row in found if "Two folders" in row["failure"]]


def test_helpers_of_folders_that_are_loaded_one_after_the_other_are_each_its_own(tmp_path):
    found = []
    for name, factor in (("a", 1.0), ("b", 0.5)):
        helped(tmp_path / name, "mine", factor)
        plugins.forget()
        plugins.use_folders([tmp_path / name])
        found.append(plugins.find_integrator("mine").step.__globals__["factor"])
    (tmp_path / "b" / "helper.py").write_text("factor = 0.25\n")
    os.utime(tmp_path / "b" / "helper.py", (1, 1))  # another time than the cached bytecode's
    plugins.use_folders([tmp_path / "b"])
    found.append(plugins.find_integrator("mine").step.__globals__["factor"])
    assert found == [1.0, 0.5, 0.25]


def test_a_plugin_may_be_called_as_a_package_or_a_module_of_python(tmp_path):
    for name in ("rich", "signal", "numpy", "multiprocessing"):
        plugin(tmp_path / f"{name}.py", f"mine_{name}")
    chosen = [word for name in ("rich", "signal", "numpy") for word in ("-i", f"mine_{name}")]
    done = run(*chosen, "--plugins-dir", ".", cwd=tmp_path, by=process)
    assert done.returncode == 0, done.stderr
    assert {row["status"] for row in rows(tmp_path / "out").values()} == {"blowup"}
    command = [sys.executable, "-m", "tcbench", "list", "--json", "--plugins-dir", "."]
    listed = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    assert "mine_rich" in {i["name"] for i in json.loads(listed.stdout)["integrators"]}, listed.stderr


def test_nothing_in_the_current_folder_runs_unless_it_is_named(tmp_path):
    trace = f"open({str(tmp_path / 'ran')!r}, 'a').write(__name__ + ' ')\n"
    for name in ("signal", "multiprocessing", "tcbench", "struct", "matplotlib", "pickle"):
        (tmp_path / f"{name}.py").write_text(trace)
    done = run("-i", "tc_monolithic", "--report", cwd=tmp_path, by=process)
    assert done.returncode == 0, done.stderr
    assert not (tmp_path / "ran").exists(), (tmp_path / "ran").read_text()
    assert rows(tmp_path / "out")["tc_monolithic"]["status"] == "ok"
    assert (tmp_path / "out" / "report.html").is_file()


def test_a_worker_that_ran_a_plugins_code_serves_no_other_plugin(tmp_path):
    plugin(tmp_path / "p" / "aaa.py", step="np.exp = np.log = lambda x: x * np.nan")
    plugin(tmp_path / "p" / "bbb.py", step="assert np.exp(0.0) == 1.0, 'patched'")
    alone = run("-i", "bbb", "--plugins-dir", "p", "-j", "1", cwd=tmp_path, out="alone")
    assert alone.returncode == 0, alone.stderr
    both = run("-i", "aaa", "-i", "bbb", "-i", "tc_monolithic", "--plugins-dir", "p", "-j", "1", cwd=tmp_path)
    assert both.returncode == 0, both.stderr
    found, clean = rows(tmp_path / "out"), rows(tmp_path / "alone")
    assert found["bbb"]["energy_error_max"] == clean["bbb"]["energy_error_max"], found["bbb"]
    assert found["tc_monolithic"]["status"] == "ok"


def test_a_run_imports_no_plugin_and_none_changes_what_is_planned_of_another(tmp_path):
    who = tmp_path / "who"
    note = f"import os\nopen({str(who)!r}, 'a').write(f'{{os.getpid()}} ')\n"
    plugin(tmp_path / "p" / "aaa.py", before=note + "np.exp = None\nimport scipy.integrate as S\nS.RK45.B = None")
    plugin(tmp_path / "p" / "bbb.py", before="assert np.exp(0.0) == 1.0")
    plugins.use_folders([tmp_path / "p"])
    measure = ["short_term"], ["conservation"], tmp_path / "out"
    tables = run_here(["aaa", "bbb", "tc_strang"], *measure, dt=[0.3], jobs=1).tables
    found = tables["conservation"].set_index("integrator")["status"]
    assert found["tc_strang"] == "ok" and found["bbb"] != "exception"
    pids = who.read_text().split()
    assert len(pids) == len(set(pids)) == 2 and str(os.getpid()) not in pids  # where it is looked up, and where it runs
    (tmp_path / "p" / "bbb.py").write_text("import os\nos._exit(7)\n")
    with pytest.raises(TcbenchError, match=r"The process that imports the plugins died \(exit code 7\)"):
        run_here(["tc_strang"], *measure)


@pytest.mark.parametrize("how", ["raise SystemExit(0)", "raise GeneratorExit", "import os; os.environ['x'] = 1"])
def test_what_a_hook_raises_is_that_plugins_failure(tmp_path, how):
    plugin(tmp_path / "leaving.py", hook=how)
    plugin(tmp_path / "good.py")
    done = tcbench("list", "--json", "--plugins-dir", ".", cwd=tmp_path)
    listed = json.loads(done.stdout)
    assert done.returncode == 0 and [b["name"] for b in listed["broken"]] == ["leaving"]
    assert "good" in {i["name"] for i in listed["integrators"]}


def test_what_an_import_or_the_values_of_a_parameter_raise_is_that_plugins_failure(tmp_path):
    plugin(tmp_path / "importing.py", before="raise BaseException('no')")
    (tmp_path / "valued.py").write_text(
        "from tcbench import Integrator, family, hookimpl\n"
        "def make(of='a'):\n    return Integrator(name='valued', order=1, step=lambda z, h, system: z)\n"
        "@hookimpl\ndef tcbench_integrators():\n    return [family(make, of=lambda known: 1 / 0)]\n"
    )
    plugins.use_folders([tmp_path])
    assert {o.name for o in plugins.registry().broken} == {"importing", "valued"}
    assert "tc_monolithic" in plugins.integrators() and "valued" not in plugins.integrators()


def test_a_message_with_half_of_a_surrogate_pair_costs_nobody_a_table(tmp_path):
    plugin(tmp_path / "torn.py", step="raise ValueError('sur ' + chr(0xd800) + ' end')")
    done = run("-i", "torn", "-i", "tc_monolithic", "--plugins-dir", ".", "--report", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "sur \\ud800 end" in (tmp_path / "out" / "tables" / "conservation.csv").read_text()
    again = run("-i", "torn", "-i", "tc_monolithic", "--plugins-dir", ".", cwd=tmp_path)
    assert again.returncode == 0 and "0 cells" in again.stdout
    lines = (tmp_path / "out" / "cells.jsonl").read_text()  # a folder of a version that wrote it as it was
    (tmp_path / "out" / "cells.jsonl").write_text(lines.replace("\\\\ud800", "\\ud800"))
    assert tcbench("show", "out", "--json", cwd=tmp_path).returncode == 0


def test_an_output_folder_that_is_deleted_during_the_run_ends_it_with_a_sentence(tmp_path):
    erase = f"import shutil; shutil.rmtree({str(tmp_path / 'out')!r}, ignore_errors=True)"
    plugin(tmp_path / "p" / "eraser.py", step=erase)
    done = run("-i", "eraser", "--plugins-dir", "p", cwd=tmp_path)
    assert done.returncode == 2 and "was deleted or replaced while the run" in done.stderr, done.stdout
    assert "Traceback" not in done.stderr and not (tmp_path / "out" / "tables").exists()


def test_a_complex_result_is_refused_not_cut(tmp_path):
    plugin(tmp_path / "p" / "complexly.py", step="return z + 1j")
    assert run("-i", "complexly", "--plugins-dir", "p", "--strict", cwd=tmp_path).returncode == 1
    row = rows(tmp_path / "out")["complexly"]
    assert row["status"] == "exception" and "complex numbers were returned" in row["failure"]
    # those that were finished before count, too
    assert run("-i", "complexly", "--plugins-dir", "p", "--strict", cwd=tmp_path).returncode == 1
    assert run("-i", "complexly", "--plugins-dir", "p", cwd=tmp_path).returncode == 0


@pytest.mark.skipif(os.name == "nt", reason="signals are POSIX")
@pytest.mark.parametrize("delay", [0.4, 1.2])
def test_ctrl_c_ends_with_130_and_without_tracebacks(tmp_path, delay):
    command = [str(SCRIPT), "run", "--all", "-o", str(tmp_path / "out")]
    # a session of its own: the signal goes to the whole group, as a terminal sends it
    child = subprocess.Popen(
        command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True,
        # a job in the background starts with the signal ignored
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )  # fmt: skip
    try:
        deadline = time.monotonic() + 1800
        while not (tmp_path / "out").exists() and time.monotonic() < deadline and child.poll() is None:
            time.sleep(0.02)
        time.sleep(delay)
        os.killpg(child.pid, signal.SIGINT)
        _, errors = child.communicate(timeout=1800)
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child.pid, signal.SIGKILL)
    assert child.returncode == 130 and "Traceback" not in errors, errors[-2000:]


def test_what_a_killed_run_leaves_behind_is_removed_by_the_next(tmp_path, monkeypatch):
    import tempfile

    from tcbench.engine.local import LOGS, _log_folder

    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    old, young = tmp_path / f"{LOGS}old", tmp_path / f"{LOGS}young"
    for folder in (old, young):
        folder.mkdir()
        (folder / ".lock").touch()
    os.utime(old, (1, 1))
    with _log_folder() as held:
        os.utime(held, (1, 1))
        with _log_folder():
            assert Path(held).is_dir()  # locked by one that lives
        assert not old.exists() and young.exists()
    assert not Path(held).exists()
    for name in ("provenance/.a.1f{0}.json", "tables/.t.2e{0}.csv", ".manifest.3d{0}.json", ".probe.4c{0}"):
        path = tmp_path / "run" / name.format("0" * 10)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    with Store.open(tmp_path / "run"):
        assert {p.name for p in (tmp_path / "run").rglob("*") if p.is_file()} == {".lock", "cells.jsonl"}


def test_charts_of_a_method_that_is_not_installed_are_drawn_or_the_error_names_the_cause(tmp_path):
    plugin(tmp_path / "p" / "mine.py", step="h = 0.01 * h")
    assert run("-i", "mine", "-i", "tc_monolithic", "--plugins-dir", "p", cwd=tmp_path).returncode == 0
    drawn = tcbench("plot", "four-panel", "out", "-s", "short_term", "-i", "mine", "-o", "a.png", cwd=tmp_path)
    assert drawn.returncode == 0 and (tmp_path / "a.png").stat().st_size > 1000, drawn.stderr
    wrong = tcbench("plot", "four-panel", "out", "-s", "short_term", "-i", "nobody", "-o", "b.png", cwd=tmp_path)
    assert wrong.returncode == 2 and "No integrator of this run is called 'nobody'" in wrong.stderr
