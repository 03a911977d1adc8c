"""What a run ends with: a row a method in at most 30 lines, and nothing that the tables do not carry."""

import math
import re

import awkward
import pandas as pd
import pytest
from click.testing import CliRunner

from tcbench.cli import main
from tcbench.commands import terminal
from tcbench.report.by_method import by_method, claims, remarks
from tcbench.report.page_data import names as names_of
from tcbench.report.pairs import pairs, times_over_best


def law(name, claimed, kept, of):
    return {"law": name, "claimed": claimed, "kept": kept, "of": of}


@pytest.mark.parametrize(
    ("laws", "text"),
    [
        ([law("energy", True, 5, 5), law("entropy", True, 4, 5)], "1 of 2"),
        ([law("energy", True, 5, 5), law("angular_momentum", True, 0, 0)], "1 of 1, 1 not measured"),
        ([law("energy", False, 5, 5)], "none"),
        ([law("energy", None, 5, 5)], "-"),
    ],
)
def test_claims_count_where_they_were_measured(laws, text):
    assert claims(laws) == text


def test_times_are_over_the_fastest_of_each_scenario():
    table = pd.DataFrame(
        [("a", "s", 1.0), ("b", "s", 4.0), ("a", "t", 3.0), ("b", "t", 1.5), ("c", "s", math.nan)],
        columns=["integrator", "scenario", "time_s"],
    ).assign(measure="error", target=1e-6)
    assert times_over_best(pairs({"time_to_accuracy": table}, {})) == {
        "a": [1.0, 2.0],
        "b": [4.0, 1.0],
        "c": [math.inf],
    }
    rows = by_method({"time_to_accuracy": table}, {})
    assert rows == [
        ["method", "to 1e-6", "x best"],
        ["a", "2 of 2", "1.5"],
        ["b", "2 of 2", "2.5"],
        ["c", "0 of 1", "-"],
    ]


def test_sixty_methods_fold_and_lines_fit(capsys):
    names = [*awkward.FORTY[:12], *(f"scipy_{i}" for i in range(20))]
    tables = awkward.everything(names, ["short_term", "stiff_spring"])
    tables["work_precision"]["peer"] = [
        "scipy" if n.startswith("scipy_") else "" for n in tables["work_precision"].integrator
    ]
    rows = by_method(tables, {})
    others = [n for n in names_of(tables, "integrator") if not n.startswith("scipy_")]
    assert [row[0] for row in rows[1:-1]] and {row[0] for row in rows[1:-1]} == set(others)
    assert re.match(r"2\d of SciPy's; best: scipy_", rows[-1][0])
    failed = sum(tables[t]["status"].ne("ok").sum() for t in ("conservation", "work_precision"))
    assert f"{failed} of {sum(len(tables[t]) for t in ('conservation', 'work_precision'))} runs" in remarks(tables)[0]
    terminal.print_methods(rows, remarks(tables))
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) < 30 and not any(line != line.rstrip() for line in lines)


def test_a_run_of_many_methods_ends_in_a_row_a_method(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = awkward.FIVE
    words = [w for n in names for w in ("-i", n)]
    done = CliRunner().invoke(main, ["run", *words, "-s", "short_term", "-s", "cold_spring", "--study", "conservation"])
    assert done.exit_code == 0, done.output
    lines = done.stdout.splitlines()
    assert len(lines) <= 30 and sum(line.split()[:1] == [n] for n in names for line in lines) == len(names)
    assert "claims kept" in done.stdout and not any(line != line.rstrip() for line in lines)
    shown = CliRunner().invoke(main, ["show", "-s", "short_term", "-i", names[0]])
    assert shown.exit_code == 0 and shown.stdout.count(names[0]) >= 5


def test_simulate_says_what_numbers_mean_and_whether_claims_were_kept():
    done = CliRunner().invoke(main, ["simulate", "midpoint_entropy", "short_term", "--t-end", "3"])
    told = {line.split()[0]: line for line in done.stdout.splitlines() if line.strip()}
    assert "max |E − E₀| / V₀" in told["energy_error_max"] and "not claimed, not kept" in told["energy_error_max"]
    assert told["angular_momentum_error_max"].endswith("  claimed, kept")
    assert told["second_law_violations"].endswith("  not claimed, kept")


def test_an_ensemble_alone_has_a_row_a_method_over_all_its_steps():
    table = pd.DataFrame(
        [("a", 0.1, 200, 0), ("a", 0.2, 200, 0), ("b", 0.1, 200, 3), ("b", 0.2, 200, 5)],
        columns=["integrator", "dt", "runs", "failed"],
    )
    rows = by_method({"failure_share": table}, {})
    assert rows == [["method", "random failed"], ["a", "none of 400"], ["b", "2 % of 400"]]
