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

from tcbench import plugins
from tcbench.runner.rows import Store

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
    return {line["cell"]["integrator"]: line["row"] for line in Store.read(folder).raw()}


def helped(folder, name, factor):
    plugin(folder / f"{name}.py", before="from helper import factor", step="h = factor * h")
    (folder / "helper.py").write_text(f"factor = {factor}\n")


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


@pytest.mark.thorough
def test_nothing_in_the_current_folder_runs_unless_it_is_named_whatever_plugins_are_called(tmp_path):
    trace = f"open({str(tmp_path / 'ran')!r}, 'a').write(__name__ + ' ')\n"
    for name in ("signal", "multiprocessing", "tcbench", "struct", "matplotlib", "pickle"):
        (tmp_path / f"{name}.py").write_text(trace)
    for name in ("rich", "signal", "numpy"):
        plugin(tmp_path / "p" / f"{name}.py", f"mine_{name}")
    done = run("-i", "mine_signal", "--report", "--plugins-dir", "p", cwd=tmp_path, by=process)
    assert done.returncode == 0, done.stderr
    assert not (tmp_path / "ran").exists(), (tmp_path / "ran").read_text()
    assert {name: row["status"] for name, row in rows(tmp_path / "out").items()} == {"mine_signal": "blowup"}
    assert (tmp_path / "out" / "report.html").is_file()


def test_a_worker_that_ran_a_plugins_code_serves_no_other_plugin(tmp_path):
    plugin(tmp_path / "p" / "aaa.py", step="np.exp = np.log = lambda x: x * np.nan")
    plugin(tmp_path / "p" / "bbb.py", step="assert np.exp(0.0) == 1.0, 'patched'")
    both = run("-i", "aaa", "-i", "bbb", "--plugins-dir", "p", "-j", "1", cwd=tmp_path)
    assert both.returncode == 0, both.stderr
    assert rows(tmp_path / "out")["bbb"]["status"] == "blowup", rows(tmp_path / "out")["bbb"]


@pytest.mark.parametrize("how", ["raise SystemExit(0)", "raise GeneratorExit", "import os; os.environ['x'] = 1"])
def test_what_a_hook_raises_is_that_plugins_failure(tmp_path, how):
    plugin(tmp_path / "leaving.py", hook=how)
    plugin(tmp_path / "good.py")
    done = tcbench("list", "--json", "--plugins-dir", ".", cwd=tmp_path)
    listed = json.loads(done.stdout)
    assert done.returncode == 0 and [b["name"] for b in listed["broken"]] == ["leaving"]
    assert "good" in {i["name"] for i in listed["integrators"]}


def test_an_output_folder_that_is_deleted_during_the_run_ends_it_with_a_sentence(tmp_path):
    erase = f"import shutil; shutil.rmtree({str(tmp_path / 'out')!r}, ignore_errors=True)"
    plugin(tmp_path / "p" / "eraser.py", step=erase)
    done = run("-i", "eraser", "--plugins-dir", "p", cwd=tmp_path)
    assert done.returncode == 2 and "was deleted or replaced while the run" in done.stderr, done.stdout
    assert "Traceback" not in done.stderr and not (tmp_path / "out" / "tables").exists()


@pytest.mark.skipif(os.name == "nt", reason="signals are POSIX")
def test_ctrl_c_ends_with_130_and_without_tracebacks(tmp_path):
    plugin(tmp_path / "p" / "slow.py", before="import time", step="time.sleep(60)")
    words = ["run", "-i", "slow", "-s", "short_term", "--study", "conservation", "--plugins-dir", str(tmp_path / "p")]
    command = [str(SCRIPT), *words, "-o", str(tmp_path / "out")]
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
        time.sleep(0.8)
        os.killpg(child.pid, signal.SIGINT)
        _, errors = child.communicate(timeout=1800)
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child.pid, signal.SIGKILL)
    assert child.returncode == 130 and "Traceback" not in errors, errors[-2000:]
