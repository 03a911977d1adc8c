"""A study and a chart from one plugin file, the one of docs/add-study.md: run, shown, plotted, and on the page."""

import base64
import gzip
import json
import math
import re
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest
from click.testing import CliRunner

from tcbench import Chart, Panel, Row, Series, Study, TcbenchError, plugins
from tcbench.cli import main
from tcbench.report import page_charts
from tcbench.report.chart_kinds import draw_kind
from tcbench.runner.cell import Cell
from tcbench.runner.rows import Store
from tcbench.runner.tables import make_tables

pytestmark = pytest.mark.usefixtures("cells_here")

PAGE = (Path(__file__).parents[1] / "docs" / "add-study.md").read_text("utf-8")
SOURCE = PAGE.split('title="halving.py"\n')[1].split("```")[0]
NAME = 'Study(\n            name="halving"'
HALVING = ["run", "--study", "halving"]
assert "def tcbench_studies" in SOURCE and "def tcbench_charts" in SOURCE


def test_the_file_of_the_page_is_the_one_that_the_command_writes(tmp_path):
    command("new", "study", "halving", "--folder", tmp_path)
    assert (tmp_path / "halving.py").read_text("utf-8") == SOURCE


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


def packed(page, name):
    return json.loads(gzip.decompress(base64.b64decode(re.search(f'id="{name}">(.*?)<', page)[1])))


def test_the_study_is_measured_and_its_chart_is_on_the_page_and_a_picture(folder):
    table = pd.read_csv(folder / "run" / "tables" / "halving.csv")
    assert table["counted"].tolist() == [167, 84] and table["status"].eq("ok").all()
    page = (folder / "run" / "report.html").read_text("utf-8")
    assert 'data-view="charts"' in page
    (panel,) = packed(page, "charts")["halving"]["of"]["short_term"]
    (line,) = panel["series"]
    assert line["name"] == "tc_strang" and panel["y"]["label"] == "steps of a run"
    assert (line["at"], line["x"], line["y"]) == ([0, 1], "dt", "counted")  # rows of the table, and its columns
    picture = folder / "halving.svg"
    done = command("plot", "halving", folder / "run", "--plugins-dir", folder, "-o", picture)
    assert done.exit_code == 0, done.output
    assert "steps of a run" in picture.read_text()


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
    def panels(table):
        raise ZeroDivisionError("nothing to divide by")

    problems = []
    chart = Chart("mine", "Mine.", ("t",), panels)
    assert page_charts.panels_of([chart], {"t": pd.DataFrame({"integrator": ["a"]})}, {}, problems) == {}
    (told,) = problems
    assert told.startswith(
        "The chart 'mine' is not on the page: ZeroDivisionError: nothing to divide by at test_plugin"
    )


@pytest.mark.parametrize(
    ("tabulate", "told"),
    [
        (lambda rows: rows, "must return a dict of DataFrames by the name of the table"),
        (lambda rows: pd.DataFrame(rows), "must return a dict of DataFrames"),
        (lambda rows: {"t": rows}, "must return a dict of DataFrames"),
        (lambda rows: {"other": pd.DataFrame(rows)}, "returns the table 'other'; write tables=('other',)"),
        (lambda rows: {"t": pd.DataFrame(rows)[["absent"]]}, "cannot be tabulated: KeyError"),
    ],
)
def test_tables_that_are_none_cost_their_study_alone(tmp_path, tabulate, told):
    with Store.open(tmp_path) as store:
        for study in ("bad", "good"):
            cell = Cell(study, "i", "s")
            store.append(cell.key, {"status": "ok"}, cell.as_dict())
        bad = Study("bad", "", ("t",), plan=lambda *_: [], measure=lambda *_: {}, tabulate=tabulate)
        good = replace(bad, name="good", tables=("u",), tabulate=lambda rows: {"u": pd.DataFrame(rows)})
        tables, failed = make_tables([bad, good], store, set(store.rows()))
    assert list(tables) == ["u"] and failed == [bad]
    assert len(store.problems) == 1 and told in store.problems[0]


@pytest.mark.parametrize(
    "panels",
    [lambda table: None, lambda table: Panel((), "x", "y"), lambda table: [1], lambda table: Panel((), "", "", "ln")],
)
def test_a_chart_that_cannot_be_drawn_is_a_sentence(panels):
    with pytest.raises(TcbenchError, match=r"(?s)list of Panel|x_scale is one of log, linear, share, zero, not 'ln'"):
        draw_kind(Chart("mine", "", ("t",), panels), {"t": pd.DataFrame({"a": [1]})})


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('return {"status"', 'return 3.0 or {"status"', "measure of the study 'halving' must return a dict, not 3.0."),
        ('return {"status"', 'return {"dt": 7.0, "status"', "measure of the study 'halving' returns dt=7.0"),
        ('return {"status"', 'return {"integrator": "x", "status"', "returns integrator='x', and 'integrator' is what"),
    ],
)
def test_a_row_that_is_none_or_renames_its_cell_is_an_exception_of_that_cell(tmp_path, old, new, told):
    """The first was a message of Python about |; the others were rows of a method that nobody has run."""
    assert old in SOURCE
    (tmp_path / "halving.py").write_text(SOURCE.replace(old, new))
    words = ["run", "-i", "tc_strang", "-s", "short_term", "--study", "halving", "--plugins-dir", tmp_path, "-j", "1"]
    done = command(*words, "-o", tmp_path / "run")
    table = pd.read_csv(tmp_path / "run" / "tables" / "halving.csv")
    assert done.exit_code == 0 and table["status"].eq("exception").all() and table["integrator"].eq("tc_strang").all()
    assert told in done.stderr and "Traceback" not in done.output


def test_a_study_whose_tables_cannot_be_made_ends_with_code_2_and_its_rows_are_kept(folder, tmp_path):
    """It was 0, as if all were well."""
    (tmp_path / "halving.py").write_text(SOURCE.replace("{COUNTS.name: pd", '{"halves": pd'))
    words = ["run", "-i", "tc_strang", "-s", "short_term", "--study", "halving", "--plugins-dir", tmp_path, "-j", "1"]
    done = command(*words, "-o", tmp_path / "run")
    assert done.exit_code == 2 and "write tables=('halves',)" in done.stderr
    assert len((tmp_path / "run" / "cells.jsonl").read_text().splitlines()) == 2


@pytest.mark.parametrize(
    ("old", "new", "words", "told"),
    [
        ("fixed = [method ", "fixed = [method.nope ", HALVING, "plan of the study 'halving' failed: AttributeError"),
        ("    return [(m, s, {", "    [(m, s, {", HALVING, "not None."),
        ("(m, s, {", "(m.name, s, {", HALVING, "must return a list of (integrator, scenario, options)"),
        ("tables=(COUNTS,)", 'tables="halving"', HALVING, "The study 'halving': tables is a tuple of words"),
        (NAME, 'Study(name="claims"', ["run", "--study", "claims"], "registers the study 'claims', which tcbench"),
        (NAME, 'Study(name="claims"', ["list"], "halving registers the study 'claims', which tcbench has"),
        ("tables=(COUNTS,)", 'tables=("convergence",)', HALVING,
         "The table 'convergence' of the study 'halving' (halving) is one of the study 'convergence', too"),
        ("tables=(COUNTS,)", 'tables=("../away",)', HALVING, "'../away' cannot be a name"),
        ('Chart(name="halving"', 'Chart(name="laws"', ["plot"], "halving registers the chart 'laws', which tcbench"),
        ('Chart(name="halving"', 'Chart(name="my laws"', ["plot", "my laws"], "'my laws' cannot be a name"),
    ],
)  # fmt: skip
def test_what_cannot_be_planned_and_names_that_are_taken_or_none_are_a_sentence(tmp_path, old, new, words, told):
    """They were tracebacks; of two studies or charts with one name one was lost without a word."""
    assert old in SOURCE
    (tmp_path / "halving.py").write_text(SOURCE.replace(old, new))
    chosen = ["-i", "tc_strang", "-s", "short_term", "--dry-run", "-o", tmp_path / "run"] if "run" in words else []
    done = command(*words, *chosen, "--plugins-dir", tmp_path)
    assert done.exit_code == 2 and told in done.output and "Traceback" not in done.output


@pytest.mark.parametrize(
    ("made", "told"),
    [
        (lambda: Series("a", [1, 2, 3], [1, 2]), "Series 'a': x has 3 numbers, and y has 2"),
        (lambda: Series("a", 1.0, [2.0]), "Series 'a': x must be numbers, as of a column, not 1.0"),
        (lambda: Series("a", [1.0], "b"), "Series 'a': y must be numbers, as of a column, not 'b'"),
        (lambda: Panel([("a", [1], [2])], "x", "y"), "series are a list of Series, not ('a', [1], [2])"),
        (lambda: Panel(Series("a", [1], [2]), "x", "y"), "series are a list of Series, not Series(name='a'"),
        (lambda: Panel((), "x", "y", rows=[{"a": 1}]), "rows are a list of Row, not {'a': 1}"),
        (lambda: Row("a", {"circle": [1.0]}), "Row 'a': marks are numbers by their mark"),
        (lambda: Row("a", {"o": 1.0}), "Row 'a': marks are numbers by their mark"),
    ],
)
def test_what_is_no_part_of_a_chart_is_named_where_it_is_made(made, told):
    with pytest.raises(TcbenchError) as found:
        made()
    assert told in str(found.value)


def test_a_chart_without_a_number_says_so_on_the_page_and_in_a_picture():
    """It was a pair of blank axes."""
    table = pd.DataFrame({"integrator": ["a", "a"], "dt": [0.1, 0.2], "v": [math.nan, -1.0]})
    for panels in (lambda t: [Panel([Series("a", t["dt"], t["v"])], "h", "v")], lambda t: []):
        chart = Chart("mine", "Mine.", ("t",), panels)
        (ax,) = draw_kind(chart, {"t": table}).axes
        assert [text.get_text() for text in ax.texts] == ["no number to draw"]
    found = page_charts.panels_of([replace(chart, panels=lambda t: [Panel([Series("a", t["dt"], t["v"])], "h", "v")])],
                                  {"t": table}, {}, [])  # fmt: skip
    assert found["mine"]["of"][""][0]["note"] == "no number to draw"


def test_the_report_says_on_the_terminal_which_chart_it_lacks(folder, tmp_path):
    """It was on the page alone, where nobody looks who misses the chart."""
    (tmp_path / "halving.py").write_text(SOURCE.replace("lines = [", "lines = 1 / 0 and ["))
    done = command("report", folder / "run", "--plugins-dir", tmp_path)
    assert done.exit_code == 0 and "The chart 'halving' is not on the page: ZeroDivisionError" in done.stderr


def test_steps_that_a_study_does_not_take_are_told(tmp_path):
    """They were ignored without a word."""
    words = [
        "run",
        "-i",
        "tc_strang",
        "-s",
        "short_term",
        "--study",
        "halving",
        "--plugins-dir",
        tmp_path,
        "--dt",
        "0.5",
    ]
    for source, own in ((SOURCE, False), (SOURCE.replace('options["dt"] or ', ""), True)):
        (tmp_path / "halving.py").write_text(source)
        done = command(*words, "-o", tmp_path / "run", "-j", "1")
        assert done.exit_code == 0
        assert ("--dt does not apply to studies that have steps of their own: halving." in done.stderr) == own
        steps = pd.read_csv(tmp_path / "run" / "tables" / "halving.csv")["dt"].tolist()
        assert steps == ([0.15, 0.3] if own else [0.5])
