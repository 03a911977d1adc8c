"""`tcbench new` writes plugins that run as they are, and never over anything."""

import ast
import subprocess
import sys
import tomllib

import pytest
from click.testing import CliRunner
from tiers import tiers

import tcbench
from tcbench import plugins
from tcbench.authoring import check, integrator_checks
from tcbench.cli import main


def new(*args):
    return CliRunner().invoke(main, ["new", *map(str, args)])


KINDS = main.commands["new"].params[0].type.choices


@pytest.mark.parametrize("kind", tiers(KINDS, ("integrator",)))  # what the others' lines ask is asked of built-in ones
def test_a_new_file_is_commented_and_passes_the_check_as_it_is(kind, tmp_path):
    done = new(kind, "my_own", "--folder", tmp_path)
    path = tmp_path / "my_own.py"
    assert done.exit_code == 0 and f"tcbench check {path}" in done.output
    text = path.read_text()
    assert ast.get_docstring(ast.parse(text)) and text.count("#") >= 4 and "$" not in text
    lint = subprocess.run([sys.executable, "-m", "ruff", "check", "--isolated", "--line-length=120", str(path)])
    assert lint.returncode == 0
    if kind == "integrator":
        plugins.use_folders([path])
        lines = [test(tcbench.integrators()["my_own"]) for _, test in integrator_checks.TESTS]
        assert not [line for line in lines if line.verdict == check.FAIL]
        assert tcbench.simulate("my_own", "short_term", t_end=3.0).ok
    else:
        assert all(report.ok for report in check.check(str(path)))


def test_what_exists_is_never_overwritten(tmp_path):
    (tmp_path / "mine.py").write_text("precious")
    done = new("integrator", "mine", "--folder", tmp_path)
    assert done.exit_code == 2 and "exists already" in done.output
    assert (tmp_path / "mine.py").read_text() == "precious"
    assert new("system", "thing", "--package", "--folder", tmp_path).exit_code == 0
    before = sorted(tmp_path.rglob("*"))
    assert new("system", "thing", "--package", "--folder", tmp_path).exit_code == 2
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    ("kind", "name", "words"),
    [
        ("integrator", "Mine", "lower-case"),
        ("integrator", "class", "lower-case"),
        ("integrator", "../mine", "lower-case"),
        ("integrator", "tc_strang", "is taken"),
        ("scenario", "short_term", "is taken"),
        ("study", "conservation", "is taken"),
    ],
)
def test_bad_names_are_refused_with_a_sentence(kind, name, words, tmp_path):
    done = new(kind, name, "--folder", tmp_path)
    assert done.exit_code == 2 and words in done.output and not list(tmp_path.iterdir())


def test_a_new_package_is_complete(tmp_path):
    assert new("integrator", "my_own", "--package", "--folder", tmp_path).exit_code == 0
    root = tmp_path / "tcbench-my-own"
    data = tomllib.loads((root / "pyproject.toml").read_text())
    assert data["project"]["entry-points"]["tcbench"] == {"my_own": "tcbench_my_own.plugin"}
    assert data["project"]["name"] == root.name
    for path in ("README.md", "src/tcbench_my_own/__init__.py", "src/tcbench_my_own/plugin.py", "tests/test_my_own.py"):
        assert (root / path).read_text()
