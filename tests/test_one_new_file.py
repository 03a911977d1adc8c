"""A new study or a new chart is one new file in one obvious folder: no list elsewhere has to be touched."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import tcbench

PACKAGE = Path(tcbench.__file__).parent
STUDY = '''"""How many steps a run has."""

from ..study import Study


def plan(integrators, scenarios, options):
    return [(i, s, {}) for s in scenarios for i in integrators]


def measure(integrator, scenario, options):
    from ..simulation.run import simulate

    return {"status": "ok", "counted": simulate(integrator, scenario).steps}


def tabulate(records):
    import pandas as pd

    return {"counted": pd.DataFrame(list(records))}


STUDY = Study(name="counting", description="steps", tables=("counted",), plan=plan, measure=measure, tabulate=tabulate)
'''
CHART = '''"""Bars."""

from matplotlib.figure import Figure

from ...chart import Chart


def bars(table):
    figure = Figure()
    figure.subplots().bar(table["integrator"], table["counted"])
    return figure


CHARTS = (Chart("bars", "Steps.", ("counted",), bars, study="counting"),)
'''


@pytest.mark.thorough
def test_a_study_and_a_chart_are_one_file_each(tmp_path):
    copy = tmp_path / "tcbench"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    (copy / "studies" / "counting.py").write_text(STUDY)
    (copy / "report" / "charts" / "bars.py").write_text(CHART)
    script = (
        "import tcbench, sys\nassert tcbench.__file__.startswith(sys.argv[1]), tcbench.__file__\n"
        "from tcbench.cli import main\nfrom tcbench.report.plot import plot\n"
        "from tcbench.studies.base import default_studies\nassert list(default_studies())[-1] == 'counting'\n"
        "r = tcbench.run(['tc_strang'], ['short_term'], ['counting'], output=sys.argv[1] + '/run')\n"
        "assert r.tables['counted']['counted'].item() == 84, r.tables\n"
        "plot('bars', sys.argv[1] + '/run', sys.argv[1] + '/bars.svg')\n"
        "main(['list'])\n"
    )
    env = {"PYTHONPATH": str(tmp_path)} | {k: v for k, v in __import__("os").environ.items() if k != "PYTHONPATH"}
    done = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path)],
        cwd=tmp_path,
        env=env,
        capture_output=True,
        text=True,
        timeout=1800,
    )
    assert done.returncode == 0, done.stderr
    assert "counting" in done.stdout and (tmp_path / "bars.svg").stat().st_size > 1000
