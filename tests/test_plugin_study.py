"""A study and a chart from one plugin file, the one of docs/add-study.md: run, shown, plotted, and on the page."""

import base64
import gzip
import json
import re
from pathlib import Path

import pandas as pd
import pytest
from click.testing import CliRunner

from tcbench import plugins
from tcbench.cli import main
from tcbench.report import page_charts

PAGE = (Path(__file__).parents[1] / "docs" / "add-study.md").read_text("utf-8")
SOURCE = PAGE.split('title="halving.py"\n')[1].split("```")[0]
assert "def tcbench_studies" in SOURCE and "def tcbench_charts" in SOURCE


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A run of the page's study, with its plugin file beside it."""
    place = tmp_path_factory.mktemp("study")
    (place / "halving.py").write_text(SOURCE)
    words = ["run", "-i", "tc_strang", "-s", "short_term", "--study", "halving", "--report"]
    done = CliRunner().invoke(main, [*words, "--plugins-dir", str(place), "-o", str(place / "run"), "-j", "1"])
    assert done.exit_code == 0, done.output
    yield place
    plugins.forget()


def command(*words):
    plugins.forget()
    return CliRunner().invoke(main, list(map(str, words)))


def charts_of(page):
    text = re.search(r'id="charts">(.*?)<', page)[1]
    return json.loads(gzip.decompress(base64.b64decode(text)))


def test_the_study_is_measured_and_its_chart_is_on_the_page_and_a_picture(folder):
    table = pd.read_csv(folder / "run" / "tables" / "halving.csv")
    assert table["counted"].tolist() == [167, 84] and table["status"].eq("ok").all()
    page = (folder / "run" / "report.html").read_text("utf-8")
    assert 'data-view="charts"' in page
    (panel,) = charts_of(page)["halving"]["of"]["short_term"]
    (line,) = panel["series"]
    assert line["name"] == "tc_strang" and panel["y"]["label"] == "steps of a run"
    assert (line["at"], line["x"], line["y"]) == ([0, 1], "dt", "counted")  # rows of the table, and its columns
    picture = folder / "halving.svg"
    done = command("plot", "halving", folder / "run", "--plugins-dir", folder, "-o", picture)
    assert done.exit_code == 0, done.output
    assert "steps of a run" in picture.read_text()


def test_charts_of_plugins_that_this_process_has_not_imported_come_from_another(folder):
    """Its answer was no JSON: the page said that the process had died, and had none of them."""
    plugins.forget()
    plugins.use_folders([folder])
    problems = []
    assert list(page_charts.page_charts(folder / "run", {}, {}, problems)) == ["halving"] and problems == []


def test_a_cell_is_measured_again_when_the_plugin_changes_and_only_then(folder):
    words = ["run", "-i", "tc_strang", "-s", "short_term", "--study", "halving", "--plugins-dir", folder]
    same = command(*words, "-o", folder / "run", "--dry-run").output
    (folder / "halving.py").write_text(SOURCE.replace("len(run.t) - 1", "len(run.t)"))
    edited = command(*words, "-o", folder / "run", "--dry-run").output
    (folder / "halving.py").write_text(SOURCE)
    assert "2 cells: 2 finished, 0 to run" in same and "0 finished, 2 to run" in edited


def test_without_the_plugin_its_tables_are_there_and_a_name_is_answered(folder):
    shown = command("show", folder / "run", "--table", "halving")
    assert shown.exit_code == 0 and "167" in shown.output and "No study is called 'halving' here" in shown.output
    absent = command("plot", "halving", folder / "run", "-o", folder / "a.svg")
    assert absent.exit_code == 2 and "No chart is called 'halving'" in absent.output
    assert "halving" in command("list", "--plugins-dir", folder).output


def test_a_chart_that_raises_leaves_the_page_and_says_so():
    from tcbench import Chart

    def panels(table):
        raise ZeroDivisionError("nothing to divide by")

    problems = []
    chart = Chart("mine", "Mine.", ("t",), panels)
    assert page_charts.panels_of([chart], {"t": pd.DataFrame({"integrator": ["a"]})}, {}, problems) == {}
    assert problems == ["The chart 'mine' is not on the page: ZeroDivisionError: nothing to divide by"]
