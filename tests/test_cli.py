"""The command line as a user meets it: exit codes, sentences, files, pipes."""

import csv
import errno
import json
import os
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from click.shell_completion import BashComplete
from click.testing import CliRunner
from command import tcbench

from tcbench.cli import main

pytestmark = pytest.mark.usefixtures("cells_here")


LEAN = """
import os, sys
from click.testing import CliRunner
from tcbench.cli import main
heavy = {"pandas", "matplotlib", "scipy"}
for words, more in (["--help"], {"numpy", "llvmlite"}), (sys.argv[2:], {sys.argv[1]}):
    print(CliRunner().invoke(main, words).output, os.environ.get("OPENBLAS_NUM_THREADS"))
    assert not (heavy | more) & set(sys.modules), words
"""


LOADED = {
    ("list",): ("llvmlite", "tc_strang"),
    ("simulate", "tc_monolithic", "short_term"): ("tcbench.runner", "\n 1\n"),
}


@pytest.mark.parametrize("words", LOADED, ids=" ".join)
def test_help_and_a_command_load_nothing_that_they_do_not_need(words):
    """And numpy has one thread, where a run takes less time than threads do to start."""
    env = {k: v for k, v in os.environ.items() if k != "OPENBLAS_NUM_THREADS"}
    unused, told = LOADED[words]
    command = [sys.executable, "-c", LEAN, unused, *words]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=env)
    assert "Commands:" in done.stdout and told in done.stdout


def test_the_help_of_each_command_ends_with_examples_that_parse(tmp_path, monkeypatch):
    from click.testing import CliRunner

    from tcbench.cli import main
    from tcbench.commands.examples import EXAMPLES

    assert set(EXAMPLES) == set(main.commands)
    for name, lines in EXAMPLES.items():
        shown = CliRunner().invoke(main, [name, "--help"]).output
        for line in lines:
            program, command, *words = shlex.split(line)
            assert (program, command) == ("tcbench", name) and f"  {line}\n" in shown
            main.commands[name].make_context(name, words)  # raises where an option or a value is unknown


def test_list_shows_integrators_with_claims_and_sources():
    text = tcbench("list").stdout
    assert "tc_strang" in text and "Romero (2009), remark 3.2" in text and max(map(len, text.splitlines())) <= 260
    assert "Curtiss and Hirschfelder (1952); run when named" in text and "measures " in text
    data = json.loads(tcbench("list", "--json").stdout)
    assert {i["name"]: i["order"] for i in data["integrators"]}["tc_staggered"] == 1
    assert {s["name"] for s in data["scenarios"]} >= {"short_term", "cold_spring"}


def test_simulate_prints_a_row_and_writes_a_trajectory(tmp_path):
    path = tmp_path / "run.csv"
    done = tcbench("simulate", "tc_monolithic", "short_term", "--dt", 0.5, "--t-end", 5, "--csv", path)
    assert done.returncode == 0 and "energy_error_max" in done.stdout
    rows = list(csv.DictReader(path.open()))
    assert len(rows) == 11 and float(rows[-1]["t"]) == 5.0
    assert float(rows[0]["energy"]) == pytest.approx(421.64110579977235469, rel=1e-14)
    failed = tcbench("simulate", "midpoint_entropy", "stiff_spring", "--json")
    assert failed.returncode == 0  # a failed run is a result
    assert json.loads(failed.stdout)["status"] == "blowup"


def test_a_trajectory_is_written_whole_or_not_at_all(tmp_path, monkeypatch):
    """A full disk left a CSV without a line, in place of the one before."""
    path, link = tmp_path / "run.csv", tmp_path / "link.csv"
    path.write_text("of before")
    link.symlink_to(path)

    def full(file, *_, **__):
        Path(file).write_text("a part")
        raise OSError(errno.ENOSPC, "No space left on device")

    command = ["simulate", "tc_monolithic", "short_term", "--t-end", "1", "--csv"]
    with monkeypatch.context() as patch:
        patch.setattr(np, "savetxt", full)
        done = CliRunner().invoke(main, [*command, str(path)])
    assert done.exit_code == 2 and "cannot be written: No space left on device" in done.output
    assert path.read_text() == "of before" and sorted(tmp_path.iterdir()) == [link, path]
    assert CliRunner().invoke(main, [*command, str(link)]).exit_code == 0
    assert link.is_symlink() and path.read_text().startswith("t,")
    assert CliRunner().invoke(main, [*command, os.devnull]).exit_code == 0 and not os.path.isfile(os.devnull)


def test_run_writes_tables_and_a_manifest_and_resumes(tmp_path):
    out = tmp_path / "my runs"
    chosen = ("-i", "tc_monolithic", "-i", "midpoint_entropy", "-s", "stiff_spring", "--study", "conservation")
    args = ("run", *chosen, "--dt", 0.1, "--dt", 0.3, "-o", out)
    first = tcbench(*args)
    assert first.returncode == 0, first.stderr
    assert "stiff_spring" in first.stdout and "blowup" in first.stdout and "4 cells" in first.stdout
    assert shlex.split(first.stdout.partition("To see them: ")[2].splitlines()[0]) == ["tcbench", "show", str(out)]
    rows = list(csv.DictReader((out / "tables" / "conservation.csv").open()))
    assert [(r["integrator"], r["dt"]) for r in rows] == [
        ("midpoint_entropy", "0.1"), ("midpoint_entropy", "0.3"), ("tc_monolithic", "0.1"), ("tc_monolithic", "0.3"),
    ]  # fmt: skip
    assert {r["status"] for r in rows if r["integrator"] == "tc_monolithic"} == {"ok"}
    import pandas as pd

    assert len(pd.read_parquet(out / "tables" / "conservation.parquet")) == 4
    manifest = json.loads((out / "manifest.json").read_text())
    assert manifest["packages"]["llvmlite"] and manifest["command"] and manifest["machine"]
    again = tcbench(*args)
    assert again.returncode == 0 and "4 were finished before" in again.stdout
    dry = tcbench(*args, "--dt", 0.2, "--dry-run")
    assert "6 cells: 4 finished, 2 to run. Time: about " in dry.stdout
    shown = tcbench("show", out)
    assert shown.returncode == 0 and "tc_monolithic" in shown.stdout
    same = tcbench("compare", out, out, "--fail-on-regression")
    assert same.returncode == 0 and "Nothing changed" in same.stdout


def test_show_gives_a_summary_of_a_large_run_and_any_table_by_name():
    folder = Path(__file__).parent.parent / "results" / "baseline"
    shown = tcbench("show", folder).stdout
    assert "claims kept" in shown and "--table NAME" in shown and len(shown.splitlines()) < 80
    one = tcbench("show", folder, "--table", "stability", "-s", "stiff_spring", "-i", "tc_strang").stdout.split()
    assert one.count("tc_strang") == 1 and "tc_staggered" not in one and "stiff_spring" in one
    points = tcbench("show", folder, "--table", "convergence", "-i", "tc_strang", "--json").stdout
    rows = json.loads(points)["convergence"]
    assert len(rows) > 5 and {row["integrator"] for row in rows} == {"tc_strang"}
    part = tcbench("show", folder, "-s", "long_term", "-i", "tc_strang").stdout
    assert "conservation: long_term" in part and "short_term" not in part
    for options, sentence in (
        (("--table", "stabilty"), "Did you mean 'stability'?"), (("-s", "nowhere"), "No scenario of this run"),
        (("-i", "tc_strong"), "Did you mean 'tc_strang'?"),
    ):  # fmt: skip
        done = tcbench("show", folder, *options)
        assert done.returncode == 2 and sentence in done.stderr


def test_what_a_run_leaves_out_or_cannot_read_is_said(tmp_path):
    args = ("run", "-i", "scipy_odeint", "-i", "tc_strang", "-s", "short_term", "--study", "conservation")
    done = tcbench(*args, "--study", "convergence", "--dt", 0.3, "-o", tmp_path)
    assert done.returncode == 0 and "scipy_odeint is not in the study convergence" in done.stderr
    rows = tmp_path / "cells.jsonl"
    lines = rows.read_text().splitlines()
    rows.write_text("\n".join([lines[0], '{"garbage', *lines[2:]]) + "\n")
    assert "line 2: is damaged" in tcbench("show", tmp_path).stderr
    again = tcbench(*args, "--dt", 0.3, "-o", tmp_path)
    assert "line 2: is damaged" in again.stderr


BAD = [
    (("run",), "Say what to run"),
    (("run", "-i", "tc_monolitic"), "Did you mean 'tc_monolithic'?"),
    (("run", "-s", "shortterm"), "Did you mean 'short_term'?"),
    (("run", "-s", "short_term[mass=2]"), "takes no values in brackets"),
    (("run", "--study", "conservatoin"), "Did you mean 'conservation'?"),
    (("run", "--all", "--dt", "0"), "dt must be positive"),
    (("run", "--all", "--dt", "nan"), "dt must be positive and finite"),
    (("run", "-s", "short_term", "--dt", "26"), "longer than the horizon"),
    (("run", "-i", "tc_strang", "-s", "short_term", "-o", "/proc/nowhere"), "/proc/nowhere"),
    (("run", "--all", "--plugins-dir", "no_such_folder"), "does not exist"),
    (("list", "--plugins-dir", str(Path(__file__).parent / "../pyproject.toml")), "takes a folder, or a file NAME.py"),
    (("check", str(Path(__file__).parent / "../pyproject.toml")), "is no Python file"),
    (("run", "-i", "tc_gauss[k=2"), "parameters are written tc_gauss[param=value]"),
    (("simulate", "tc_monolithic", "short_term", "--dt", "-1"), "dt must be positive"),
    (("simulate", "tc_monolithic", "short_term", "--csv", "no/such/folder/run.csv"), "does not exist"),
    (("simulate", "scipy_odeint", "short_term", "--dt", "0.1"), "give --tolerance instead of --dt"),
    (("run", "-i", "scipy_odeint", "--study", "convergence"), "has no step size to vary"),
    (
        ("run", "-i", "verlet_heat", "-s", "chain[n=4]"),
        "conduction_flow, which the system chain does not",
    ),
    (("run", "--all", "-o", ""), "name of the output folder is empty"),
    (("run", "--all", "--plugins-dir", ""), "name of a plugin folder is empty"),
    (("simulate", "tc_monolithic", "short_term", "--plugins-dir", ""), "name of a plugin folder is empty"),
    (("run", "-i", "tc_strang[a=all]"), "No parameter of 'tc_strang' is called 'a'"),
    (("run", "-i", "tc_gauss[k=1,k=2]"), "gives 'k' twice"),
    (("run", "-s", "chain[n=100000000000]"), "from 2 to 100000, not '100000000000'"),
    (("run", "-s", "short_term", "--dt", "1e-12"), "GiB of states"),
    (("map", "tc_monolithic", "short_term", "--x", "dt=0.1:1:999999999999", "--y", "stiffness=1:2:3"), "at most 2000"),
    (("map", "tc_monolithic", "short_term", "--y", "dt=0.1:1:3", "--x", "stiffness=1:2:99999999999"), "at most 2000"),
    (("run", "-s", "short_term", "--dask", "nonsense"), "is no address of a Dask scheduler"),
    (("run", "-s", "short_term", "--dask", ""), "is no address of a Dask scheduler"),
    (("run", "-s", "short_term", "--dask", "foo://bar"), "is no address of a Dask scheduler"),
    (("run", "-s", "short_term", "--dask", "tcp://127.0.0.1:9"), "No Dask scheduler answers"),
    (("new", "integrator", "numpy"), "name of an installed module"),
    (("show", "no_such_run"), "There is no run in"),
    (("compare", "no_such_run", "no_such_run"), "There is no run in"),
    (("compare",), "Missing argument 'RUN_A'. See tcbench compare --help."),
    (("run", "tc_strang", "short_term"), "(tc_strang short_term). Integrators are named with -i, scenarios with -s."),
    (("run", "-i", "tc_strang", "-s", "short_term", "-o", __file__), "a file is in the way. Choose another folder."),
    (("plot", str(Path(__file__).parent)), "the kind of chart comes first: tcbench plot KIND"),
    (("animate", "tc_strang", "short_term", "-o", "x.avi"), "an animation is written as .gif, .mp4, .html"),
    (("new", "integratr", "mine"), "Invalid value for 'KIND': 'integratr' is not one of"),
    (("simulat", "tc_monolithic", "short_term"), "Did you mean 'simulate'?"),
    (("simulate", "tc_monolithic"), "tc_monolithic is an integrator: the scenario is missing"),
    (("simulate", "short_term", "tc_monolithic"), "short_term is a scenario and comes last"),
    (("run", "--dt", "abc"), "'abc' is not a valid float. See tcbench run --help."),
    (("run", "--study", "map", "-i", "tc_strang", "-s", "short_term"), "A map needs its two axes: tcbench map"),
    (("cache", "claer"), "'claer' is not 'clear'. See tcbench cache --help."),
]


@pytest.mark.parametrize(("args", "sentence"), BAD)
def test_bad_input_is_one_sentence_and_exit_code_2(args, sentence, tmp_path):
    done = tcbench(*args, cwd=tmp_path)
    assert done.returncode == 2
    assert sentence in done.stderr and "Traceback" not in done.stderr
    said = [line for line in done.stderr.strip().splitlines() if not line.endswith(" so far")]  # a slow machine's waits
    assert len(said) == 1
    assert done.stdout == "" and list(tmp_path.iterdir()) == []  # nothing half-written


def test_patterns_and_options_select_in_every_command(tmp_path):
    out = tmp_path / "results" / "latest"
    chosen = ("-i", "tc_st*", "-i", "midpoint_entropy", "-s", "short*", "--study", "conserv*", "--dt", 0.3)
    done = tcbench("run", *chosen, "--json", cwd=tmp_path)
    data = json.loads(done.stdout)
    names = {"tc_staggered", "tc_strang", "tc_strang_exact", "midpoint_entropy"}
    assert data["ran"] == 4 and {row["integrator"] for row in data["tables"]["conservation"]} == names
    assert out.is_dir()  # where the commands below look without being told
    shown = json.loads(tcbench("show", "-i", "tc_str*", "--json", cwd=tmp_path).stdout)["conservation"]
    assert {row["integrator"] for row in shown} == {"tc_strang", "tc_strang_exact"}
    drawn = tcbench("plot", "conservation", "-i", "tc_str*", "--json", cwd=tmp_path)
    assert json.loads(drawn.stdout) == {"files": ["conservation.png"]} and (tmp_path / "conservation.png").is_file()
    assert "Nothing changed" in tcbench("compare", out, "-i", "tc_strang", cwd=tmp_path).stdout
    listed = json.loads(tcbench("list", "-i", "midpoint_*", "--json").stdout)
    assert [i["name"] for i in listed["integrators"]] == ["midpoint_entropy", "midpoint_temperature"]
    assert listed["scenarios"] == [] and listed["studies"] == []
    words, options = (
        json.loads(tcbench("simulate", *args, "--json").stdout)
        for args in (("tc_strang", "short_term"), ("-s", "short_term", "-i", "tc_strang"))
    )
    same = ("integrator", "scenario", "dt", "status", "energy_error_max")
    assert [words[name] for name in same] == [options[name] for name in same]
    axes = ("--x", "dt=0.1:0.4:2", "--y", "stiffness=0.5:1:2", "-o", tmp_path / "map", "--json")
    mapped = json.loads(tcbench("map", "-i", "tc_strang", "-s", "short_term", *axes).stdout)
    assert len(mapped["tables"]["map"]) == 4 and Path(mapped["picture"]).is_file()


@pytest.mark.parametrize(
    ("args", "sentence"),
    [
        (("run", "-i", "nothing*"), "No integrator fits the pattern 'nothing*'"),
        (("run", "-i", "tc_strang", "-s", "*_nothing"), "No scenario fits the pattern '*_nothing'"),
        (("run", "--study", "z*"), "No study fits the pattern 'z*'"),
        (("simulate", "-i", "tc_*", "short_term"), "One integrator is needed here, not"),
        (("check", "tc_strang", "--only", "ordr"), "Did you mean 'order'?"),
        (("plot", "lawz"), "Did you mean 'laws'?"),
        (("list", "--plugins-dir", ""), "plugin folder is empty"),
    ],
)
def test_names_that_select_nothing_are_refused(args, sentence):
    done = tcbench(*args)
    assert done.returncode == 2 and sentence in done.stderr and done.stdout == ""


def test_what_was_not_run_is_named_at_the_end(monkeypatch):
    from tcbench import plugins
    from tcbench.integrator import Integrator
    from tcbench.runner.plan import plan_job

    absent = Integrator(name="far_away", order=1, step=lambda z, h, system: z, requires=("no-such-package",))
    monkeypatch.setitem(plugins.registry().integrators, "far_away", absent)
    (sentence,) = [text for text in plan_job(None, ["short_term"], ["conservation"]).notes if "far_away" in text]
    assert "not run" in sentence and "pip install no-such-package" in sentence
    assert "far_away" not in plugins.present()
    assert plan_job(["tc_strang"], ["short_term"], ["conservation"]).notes == []
    named = plan_job(["scipy_odeint", "tc_strang"], ["short_term"], ["conservation"], dt=[0.1])
    assert "scipy_odeint" in named.notes[0]


def test_strict_ends_with_1_where_a_cell_crashed(tmp_path):
    (tmp_path / "bad.py").write_text(
        "from tcbench import Integrator, hookimpl\n"
        "def bad(z, h, system):\n    raise RuntimeError('as planned')\n"
        "@hookimpl\n"
        "def tcbench_integrators():\n    return [Integrator(name='bad', order=2, step=bad)]\n"
    )
    args = ("run", "-i", "bad", "-s", "short_term", "--study", "conservation", "--dt", 0.3, "--plugins-dir", tmp_path)
    (tmp_path / "broken.py").write_text("import no_such_module_here\n")
    plain = tcbench(*args, "-o", tmp_path / "a")
    assert plain.returncode == 0 and "broken.py was not loaded: ModuleNotFoundError" in plain.stderr
    assert tcbench(*args, "-o", tmp_path / "b", "--strict").returncode == 1


def test_names_are_completed_in_the_shell():
    found = BashComplete(main, {}, "tcbench", "_TCBENCH_COMPLETE").get_completions(["run", "-i"], "tc_st")
    assert {"tc_staggered", "tc_strang"} <= {one.value for one in found}
