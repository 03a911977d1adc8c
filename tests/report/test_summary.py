"""The first table of a run: integrator by scenario."""

import math

import awkward
import pandas as pd

import tcbench
from tcbench.report import summary


def test_summary_says_what_was_measured():
    tables = awkward.everything(awkward.FIVE)
    declared = tcbench.integrators()
    table = summary.summary(tables, declared).set_index(["scenario", "integrator"])
    good = table.loc[("short_term", "tc_monolithic")]
    assert good["claims kept"] == "3 of 3" and good["order"] == "2.00"
    assert good["max stable step"] == "above 12" and good["failures"] == "0 of 5"
    assert table.loc[("short_term", "midpoint_temperature")]["failures"] == "3 of 5"
    broken = tables["conservation"].assign(energy_error_max=1e-3)
    mine = broken[broken["integrator"] == "tc_monolithic"]
    assert summary.claims_kept(mine, declared["tc_monolithic"]) == ("2 of 3, not energy", 1)
    nothing = mine.assign(steps=0, second_law_violations=0, status="exception")
    assert summary.claims_kept(nothing, declared["tc_monolithic"]) == ("no step done", 0)
    assert not len(summary.claimed({"conservation": nothing}, declared))
    assert summary.stable_step(pd.DataFrame([{"dt_stable": math.nan, "limit": math.nan}])) == "none found"
    verdicts = summary.claimed({"conservation": broken}, declared).set_index(["integrator", "claim"])["verdict"]
    assert verdicts["tc_monolithic", "energy"] == "broken"
    assert verdicts["midpoint_entropy", "energy"] == "not claimed, not kept"


def test_time_to_target_is_that_of_the_state():
    rows = pd.DataFrame({
        "status": ["ok", "ok", "ok", "blowup"], "error": [1e-5, 1e-6, float("nan"), 1e-9],
        "reference_limited": [False, False, True, False], "wall_time_min_s": [1e-6, 0.25, 0.5, 1e-7],
    })  # fmt: skip
    assert summary.time_to_target(rows) == "250 ms"
    assert summary.time_to_target(rows.iloc[:1]) == "not reached" and summary.time_to_target(None) == "-"
