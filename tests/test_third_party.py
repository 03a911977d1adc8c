"""A third-party distribution for real: built into a wheel, installed beside tcbench in a fresh environment, and run."""

import csv
import json
import os
import shutil
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import pytest

import tcbench
from tcbench.authoring import scaffold

pytestmark = pytest.mark.thorough
EXAMPLE = Path(__file__).parent.parent / "examples" / "tcbench-example-plugin"


def quiet(command, **options):
    return subprocess.run(list(map(str, command)), capture_output=True, text=True, **options)


def wheel_of(source, folder):
    """A wheel, built from a copy (which leaves no build folder behind): offline if setuptools can, else by pip."""
    copy = shutil.copytree(
        source, folder / "source", ignore=shutil.ignore_patterns("build", "*.egg-info", "__pycache__")
    )
    code = "import sys; from setuptools import build_meta as b; print(b.build_wheel(sys.argv[1]))"
    alone = quiet([sys.executable, "-c", code, folder], cwd=copy)
    if alone.returncode:  # setuptools before 70.1 needs the package wheel
        done = quiet([sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", folder, copy], timeout=1800)
        if done.returncode:
            pytest.skip(
                f"no wheel can be built here: {alone.stderr.strip().splitlines()[-1]}; pip: {done.stderr[-300:]}"
            )
    (wheel,) = folder.glob("*.whl")
    return wheel


@pytest.fixture(scope="module")
def python(tmp_path_factory):
    """The interpreter of a fresh environment that sees tcbench and what it needs, and has both plugins installed."""
    folder = tmp_path_factory.mktemp("fresh")
    venv.create(folder / "env", with_pip=False)
    interpreter = folder / "env" / ("Scripts" if os.name == "nt" else "bin") / Path(sys.executable).name
    paths = {"base": str(folder / "env"), "platbase": str(folder / "env")}
    site = Path(sysconfig.get_path("purelib", "venv", vars=paths))
    here = {sysconfig.get_path(name) for name in ("purelib", "platlib")}
    lines = [
        f"import site; site.addsitedir({path!r})" for path in sorted(here)
    ]  # its .pth files too: editable installs
    (site / "beside.pth").write_text("\n".join(lines) + "\n")
    root = scaffold.new_package("integrator", "scaffolded", folder)
    for name, source in (("example", EXAMPLE), ("scaffolded", root)):
        (folder / name).mkdir()
        wheel = wheel_of(source, folder / name)
        done = quiet(
            [sys.executable, "-m", "pip", "--python", interpreter, "install", "--no-deps", "--no-index", wheel]
        )
        if "No module named pip" in done.stderr:
            pytest.skip("pip is not installed here")
        assert done.returncode == 0, done.stderr
    yield interpreter


def run(python, *args, cwd=None):
    done = quiet([python, "-m", "tcbench", *args], cwd=cwd)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_an_installed_distribution_is_in_the_list_and_in_a_run(python, tmp_path):
    data = json.loads(run(python, "list", "--json", cwd=tmp_path))
    found = {i["name"]: i for i in data["integrators"]}
    assert {"example_rk4", "scaffolded", "tc_monolithic"} <= set(found) and found["example_rk4"]["order"] == 4
    assert data["broken"] == []
    out = tmp_path / "out"
    run(python, "run", "-i", "example_rk4", "-i", "scaffolded", "-i", "tc_monolithic", "-s", "bound_equilibrium",
        "--study", "conservation", "--dt", "0.1", "-o", out, cwd=tmp_path)  # fmt: skip
    rows = {row["integrator"]: row for row in csv.DictReader((out / "tables" / "conservation.csv").open())}
    assert rows["example_rk4"]["plugin"] == "tcbench-example-plugin 0.1.0" and rows["scaffolded"]["status"] == "ok"
    assert rows["scaffolded"]["plugin"] == "tcbench-scaffolded 0.1.0"
    # the installed metric is a column, also in the rows of the built-ins
    assert all(float(row["hottest"]) >= 330 for row in rows.values())


def test_this_environment_is_untouched():
    assert "example_rk4" not in tcbench.integrators() and not (EXAMPLE / "build").exists()
