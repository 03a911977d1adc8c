"""The table of pairs, row by row against plain loops; and what reads it says one thing."""

import math

import pandas as pd
import pytest
from random_tables import is_number, random_tables, records

from tcbench.report.by_method import by_method, remarks
from tcbench.report.overview import failing, findings
from tcbench.report.page_data import failures, methods, unmeasured
from tcbench.report.pairs import laws, pairs
from tcbench.report.summary import summary

LAWS = {"energy": ("energy_error_max", 1e-9), "entropy": ("second_law_violations", 0),
        "angular_momentum": ("angular_momentum_error_max", 1e-9)}  # fmt: skip


@pytest.mark.parametrize("seed", [3, 4])
def test_each_row_is_what_its_runs_came_to(seed):
    tables = random_tables(seed)
    found = pairs(tables, {})
    assert set(laws(found)) <= set(LAWS) and found.index.is_unique
    for (method, scenario), row in found.iterrows():
        runs = [r for r in records(tables, "conservation") if (r["integrator"], r["scenario"]) == (method, scenario)]
        ends = [r for r in records(tables, "stability") if (r["integrator"], r["scenario"]) == (method, scenario)]
        lawful = [r["status"] == "ok" for r in runs]
        for law in laws(found):
            column, most = LAWS[law]
            kept = [r[column] <= most for r in runs if r["steps"] and is_number(r[column])]
            assert (row[f"kept_{law}"], row[f"of_{law}"]) == (sum(kept), len(kept))
            lawful = [w and r["steps"] > 0 and not r[column] > most for w, r in zip(lawful, runs, strict=True)]
        assert row["lawful"] == sum(lawful) and row["ladder_runs"] == len(runs) == 3
        steps = [r["dt"] for r in runs if r["status"] != "ok"]
        steps += [r["dt_unstable"] for r in ends if r["limit"] != "none"]
        assert bool(row["fails"]) == bool(steps)
        assert row["fails_from"] == pytest.approx(min(filter(is_number, steps), default=math.nan), nan_ok=True)


def test_a_law_that_is_broken_beyond_all_bounds_is_broken_in_every_place():
    """summary.csv left infinite losses out, and called the claim kept."""
    tables = random_tables(3)
    bad = tables["conservation"]["integrator"].eq("m00") & tables["conservation"]["scenario"].eq("s0")
    tables["conservation"].loc[bad, ["energy_error_max", "status", "steps"]] = [math.inf, "ok", 80]
    told = {name: {"claims": ["energy"]} for name in ("m00", "m01")}
    found = pairs(tables, {})
    rows = summary(found, told).set_index(["scenario", "integrator"])
    assert rows.loc[("s0", "m00"), "claims kept"] == "0 of 1, not energy"
    (row,) = [m for m in methods(found, tables, {"integrators": told}) if m["name"] == "m00"]
    assert row["laws"][0]["kept"] <= row["laws"][0]["of"] - 3
    assert [r[1] for r in by_method(tables, {"integrators": told}) if r[0] == "m00"] == ["0 of 1"]


@pytest.mark.parametrize("seed", [3, 4])
def test_failures_are_counted_by_one_rule(seed):
    """The page's sentence left tolerances above 1e-3 out; its cells and the terminal counted them."""
    tables = random_tables(seed)
    runs = [r for r in records(tables, "conservation") if not r.get("tolerance", 0) > 1e-3]
    runs += [r for r in records(tables, "work_precision") if r["control"] == "dt" or not r["value"] > 1e-3]
    failed = sum(r["status"] != "ok" for r in runs)
    assert failed and len(runs) < sum(len(tables[name]) for name in ("conservation", "work_precision"))
    found, cells = pairs(tables, {}), failures(tables)
    assert (found["failed"].sum(), found["runs"].sum()) == (failed, len(runs))
    assert sum(cell[0] for of in cells.values() for cell in of.values()) == failed + len(unmeasured(tables))
    assert failing(found, tables).lead == f"{failed} of {len(runs)} runs"
    assert remarks(tables)[0].startswith(f"{failed} of {len(runs)} runs of the ladders failed")


def test_of_a_solver_that_chooses_its_steps_the_tightest_tolerance_that_failed_is_told():
    """The page told of 1e-3 where the same solver failed at 1e-11, too."""
    row = {"integrator": "a", "scenario": "s", "control": "tolerance", "status": "exception", "failure": "why"}
    table = pd.DataFrame([row | {"value": value} for value in (1e-3, 1e-11, 1e-7)])
    assert failures({"work_precision": table})["a"]["s"] == [3, 3, "tolerance 1e-11: why", {"x": 3}]


def test_a_run_of_other_studies_alone_has_rows_that_say_nothing():
    """As of a study of equilibria, or of a plugin: summary.csv ended in an exception of pandas."""
    tables = {"other": pd.DataFrame({"integrator": ["a"], "scenario": ["s"]})}
    (row,) = summary(pairs(tables, {}), {}).to_dict("records")
    assert row["claims kept"] == row["order"] == row["failures"] == "-" and by_method(tables, {}) == [["method"], ["a"]]
    assert findings(pairs(tables, {}), tables) == []
