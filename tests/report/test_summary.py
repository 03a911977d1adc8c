"""summary.csv: integrator by scenario, in words."""

import awkward
import pandas as pd

import tcbench
from tcbench.report.pairs import pairs
from tcbench.report.summary import summary
from tcbench.runner.declared import method_facts


def summed(tables):
    methods = {name: method_facts(method) for name, method in tcbench.integrators().items()}
    return summary(pairs(tables, {}), methods).set_index(["scenario", "integrator"])


def test_summary_says_what_was_measured():
    tables = awkward.everything(awkward.FIVE)
    table = summed(tables)
    good = table.loc[("short_term", "tc_monolithic")]
    assert good["claims kept"] == "3 of 3" and good["order"] == "2.00"
    assert good["max stable step"] == "above 12" and good["failures"] == "0 of 5"
    assert table.loc[("short_term", "midpoint_temperature")]["failures"] == "3 of 5"
    broken = tables["conservation"].assign(energy_error_max=1e-3)
    row = summed({"conservation": broken}).loc[("short_term", "tc_monolithic")]
    assert (row["claims kept"], row["claims broken"]) == ("2 of 3, not energy", 1)
    nothing = broken.assign(steps=0, second_law_violations=0, status="exception")
    row = summed({"conservation": nothing}).loc[("short_term", "tc_monolithic")]
    assert (row["claims kept"], row["claims broken"]) == ("no step done", 0)


def test_of_an_ensemble_alone_it_has_its_headings_and_no_row():
    table = summary(pairs(awkward.ensemble(awkward.FIVE), {}), {})
    assert table.empty and table.to_csv(index=False).startswith("scenario,integrator,claims kept,")


def test_what_no_study_found_is_told_from_what_none_looked_for():
    limits = {"integrator": ["a", "b", "c"], "scenario": "s", "limit": [None, "solver", "none"], "dt_cap": 12.0}
    ends = pd.DataFrame(limits | {"dt_stable": [None, None, 3.0], "dt_unstable": [None, 1.0, None]})
    column = summed({"stability": ends})["max stable step"]
    assert column.tolist() == ["none found", "none found (solver)", "above 12"]
    times = pd.DataFrame({"integrator": ["a", "b"], "scenario": "s", "measure": "error", "target": 1e-6})
    column = summed({"time_to_accuracy": times.assign(time_s=[0.25, None]), "stability": ends})["time to 1e-6"]
    assert column.tolist() == ["250 ms", "not reached", "-"]
