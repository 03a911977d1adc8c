"""A run's folder keeps the plugin files that were measured; a selection may come from a file."""

import json

import pandas
import pytest
from click.testing import CliRunner

from tcbench import plugins
from tcbench.cli import main

PLUGIN = """
from helper import half
from tcbench import Integrator, hookimpl

def mine(z0, z1, h, system):
    return z1 - z0 - h * system.vector_field(z0 + half * (z1 - z0))

@hookimpl
def tcbench_integrators():
    return [Integrator(name="mine", order=2, source="x", flows=mine)]
"""
STUDY = """
integrator = ["mine", "tc_monolithic"]
scenario = "short_term"
study = "conservation"
dt = [0.3]
jobs = 1
output = "out"
plugins-dir = "own"
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "mine.py").write_text(PLUGIN)
    (tmp_path / "own" / "helper.py").write_text("half = 0.5\n")
    (tmp_path / "own" / "_unused.py").write_text("x = 1\n")
    (tmp_path / "study.toml").write_text(STUDY)
    return tmp_path


def run(*words):
    plugins.forget()
    return CliRunner().invoke(main, list(words))


def test_a_study_from_a_file_and_what_its_folder_keeps(folder):
    done = run("run", "--config", "study.toml")
    assert done.exit_code == 0, done.output
    kept = {p.relative_to(folder / "out" / "sources").as_posix() for p in (folder / "out" / "sources").rglob("*.py")}
    assert kept == {"mine.py", "helper.py"}
    assert (folder / "out" / "sources" / "mine.py").read_text() == PLUGIN
    table = (folder / "out" / "tables" / "conservation.csv").read_text()
    assert "mine" in table and "tc_monolithic" in table and len(table.splitlines()) == 3
    # the command line wins over the file; what an earlier run measured stays beside what this one did
    (folder / "own" / "helper.py").write_text("half = 1.0\n")
    done = run("run", "--config", "study.toml", "-i", "mine", "--dt", "0.1")
    assert done.exit_code == 0, done.output
    kept = [p.read_text() for p in sorted((folder / "out" / "sources").glob("helper*.py"))]
    assert sorted(kept) == ["half = 0.5\n", "half = 1.0\n"]
    assert run("run", "--config", "study.toml", "--dry-run", "--study", "stability").exit_code == 0
    assert not (folder / "out" / "tables" / "stability.csv").exists()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("integrators = ['x']", "integrator"),
        ("integrator = ['x'", "cannot be read"),
        ("[integrator]\nname = 'x'", "is made of words and numbers"),
        ("config = 'other.toml'", "config"),
    ],
)
def test_a_file_that_is_wrong_is_one_sentence(folder, text, words):
    (folder / "study.toml").write_text(text)
    done = run("run", "--config", "study.toml")
    assert done.exit_code == 2 and words in done.output and "Traceback" not in done.output


def test_a_value_of_the_wrong_type_and_a_file_that_is_not_there(folder):
    (folder / "study.toml").write_text("integrator = ['mine']\njobs = 'many'\n")
    assert run("run", "--config", "study.toml").exit_code == 2
    done = run("run", "--config", "nowhere.toml")
    assert done.exit_code == 2 and "nowhere.toml" in done.output


@pytest.mark.thorough
def test_a_site_of_two_runs(folder):
    for name in ("first", "second <&>"):
        assert run("run", "--config", "study.toml", "-o", name).exit_code == 0
    path = folder / "second <&>" / "manifest.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"machine": {"cpu": "Chip <9>", "system": "Moon"}}))
    for _ in range(2):  # again: takes its own place
        done = run("publish", "first", "second <&>", "-o", "site")
        assert done.exit_code == 0, done.output
    page = (folder / "site" / "index.html").read_text()
    assert page.count('<a href="first/index.html">') == 1 and "second &lt;&amp;&gt;" in page
    assert page.count("<h2>") == 2 and "Chip &lt;9&gt;, Moon" in page and "Chip <9>" not in page
    assert "http" not in page.replace("http-equiv", "")  # nothing from elsewhere
    for name in ("first", "second <&>"):
        site = folder / "site" / name
        assert (site / "tables" / "conservation.csv").is_file() and (site / "sources" / "mine.py").is_file()
        assert "<html" in (site / "index.html").read_text() and (site / "manifest.json").is_file()


def test_what_cannot_be_published_is_said(folder):
    done = run("publish", "nowhere", "-o", "site")
    assert done.exit_code == 2 and "no run" in done.output
    assert run("run", "--config", "study.toml", "-i", "tc_monolithic").exit_code == 0
    done = run("publish", "out", "-o", "out/site")
    assert done.exit_code == 2 and "would lie in the run" in done.output and not (folder / "out" / "site").exists()
    (folder / "taken").write_text("")
    assert run("publish", "out", "-o", "taken").exit_code == 2


def test_rows_of_an_older_formula_are_left_out_and_a_sentence_says_so(folder):
    def steps():
        table = pandas.read_csv(folder / "out" / "tables" / "conservation.csv")
        return sorted(table[table.integrator == "mine"].dt)

    def edit(old, new):
        (folder / "own" / "mine.py").write_text(PLUGIN.replace(old, new))

    command = ("run", "--config", "study.toml", "--dt")
    assert run(*command, "0.05").exit_code == 0 and steps() == [0.05]
    edit("half * (z1 - z0)", "0.5 * half * (z1 - z0)")
    done = run(*command, "0.1", "--dt", "0.3")
    sentence = "1 row of mine that was measured with another mine.py is not in the tables"
    assert done.exit_code == 0 and sentence in done.output and steps() == [0.1, 0.3]
    table = pandas.read_csv(folder / "out" / "tables" / "conservation.csv")  # a narrower run truncates no other method
    assert sorted(table[table.integrator == "tc_monolithic"].dt) == [0.05, 0.1, 0.3]
    shown = run("show", "out")
    assert sentence in shown.output and len((folder / "out" / "cells.jsonl").read_text().splitlines()) == 6
    # cells that fail are told by their formula, too
    edit("return z1", "raise ValueError(z0)  #")
    assert run(*command, "0.2").exit_code == 0 and steps() == [0.2]
    assert steps() == [0.2]
    # undone: the older rows are used again, and are what the method is
    edit("", "")
    done = run(*command, "0.05")
    assert done.exit_code == 0 and steps() == [0.05]
    assert "3 rows of mine" in done.output and "1 row of" not in done.output
    sources = {p.name: p.read_text() for p in (folder / "out" / "sources").glob("mine*.py")}
    assert sources.pop("mine.py") == PLUGIN and len(sources) == 2 and all("-" in name for name in sources)
    assert any("raise" in text for text in sources.values()) and PLUGIN not in sources.values()
