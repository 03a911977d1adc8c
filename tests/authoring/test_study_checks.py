"""`tcbench check` of studies, their charts, and columns: each planted fault is on its own line."""

from pathlib import Path

import pytest
from click.testing import CliRunner

from tcbench import plugins
from tcbench.authoring import check
from tcbench.cli import main

STUDY = (Path(check.__file__).parent / "templates" / "study.py.txt").read_text("utf-8").replace("$name", "mine")
LINES = "    lines = [Series("


def checked(folder, source, *words):
    plugins.forget()
    (path := folder / "mine.py").write_text(source)
    return CliRunner().invoke(main, ["check", str(path), *words])


@pytest.mark.parametrize(
    ("old", "new", "line", "told"),
    [
        ("return [(m, s, {", "return [(m.name, s, {", "plan", "must return a list of (integrator, scenario, options)"),
        ("len(run.t) - 1", "run.step", "measure", "has no 'step' (did you mean 'steps'?) at mine.py:"),
        ("len(run.t) - 1", "1 / 0", "measure", "If that is a result, return it: {'status': 'no_root'"),
        ("len(run.t) - 1", "run", "measure", "is not a JSON value"),
        ("len(run.t) - 1", "exit(3)", "measure", "SystemExit: 3"),
        ('"status": run.status', '"status": "fine"', "measure", "status 'fine' is none of ok, nonconverged"),
        ("return {COUNTS.name: pd", 'return {"other": pd', "tables", "returns the table 'other'"),
        ("(rows, columns", '([r["counted"] and r for r in rows], columns', "failed cells", "KeyError: 'counted'"),
        (LINES, "    return table\n" + LINES, "charts", "must return a list of Panel"),
        ('rows["counted"]', 'rows["count"]', "charts", "KeyError: 'count' at mine.py:"),
    ],
)
def test_a_fault_of_a_study_is_on_its_own_line(tmp_path, old, new, line, told):
    """Of a study it said that it is there. A tabulate that fails on failed cells fails before a run has one."""
    assert old in STUDY
    done = checked(tmp_path, STUDY.replace(old, new))
    failed = [text.split("  ")[2].strip() for text in done.stdout.splitlines() if text.startswith("  FAIL")]
    assert (done.exit_code, failed) == (1, [line]) and told in done.stdout, done.output


def test_what_is_right_passes_by_its_name_too_and_what_does_not_apply_is_a_dash(tmp_path):
    words = ["check", "mine", "--plugins-dir", str(tmp_path)]
    for old, new, told in (
        ("", "", "  ok    charts           mine: 1 panel"),
        ('options["dt"] or (s.dt, s.dt / 2)', "()", "  -     plan             no cell of tc_monolithic on short_term"),
        ('        "failure",\n', "", "  -     failed cells     no table says why one failed"),
    ):
        done = checked(tmp_path, STUDY.replace(old, new))
        assert done.exit_code == 0 and told in done.stdout, done.output
        plugins.forget()
        assert CliRunner().invoke(main, words).stdout == done.stdout


def test_a_name_that_is_taken_is_a_line(tmp_path):
    done = checked(tmp_path, STUDY.replace('name="mine",  #', 'name="claims",  #'))
    assert done.exit_code == 1 and "mine registers the study 'claims', which tcbench has" in done.stdout


def test_a_column_is_tried_on_one_run(tmp_path):
    text = "from tcbench import Metric, hookimpl\n\n\n@hookimpl\ndef tcbench_metrics():\n    return [Metric({})]\n"
    for told, code, source in (
        ("ok    number", 0, '"mine", lambda run: run.energy[-1]'),
        ("it gives an array of shape (6,), not a number", 1, '"mine", lambda run: run.energy'),
        ("has a column of this name", 1, '"status", lambda run: 1.0'),
    ):
        done = checked(tmp_path, text.format(source))
        assert done.exit_code == code and told in done.stdout, done.output
