"""What the page says first, of small tables whose answer is seen at once; and ranks, families and marks."""

import math

import awkward
import pandas as pd
import pytest
from random_tables import random_tables

from tcbench.report import marks, overview, page_data
from tcbench.report.by_method import by_method
from tcbench.report.pairs import pairs


def sentences(tables, declared=None):
    found = overview.findings(pairs(tables, declared or {}), tables, declared or {})
    return {one.title: (one.lead, one.text, one.more) for one in found}


def times(**of):
    """Seconds to an error of 1e-6 on scenarios a, b, c ...; nan where it was not reached."""
    return pd.DataFrame([
        {"integrator": m, "scenario": s, "measure": "error", "target": 1e-6, "time_s": t, "best_peer": "radau",
         "ratio_to_best_peer": 4.0}
        for m, seconds in of.items() for s, t in zip("abcde", seconds, strict=False)
    ])  # fmt: skip


NAN = math.nan
PARTIAL = times(half=[1.0, 1.0, NAN, NAN, NAN], whole=[9.0, 9.0, 9.0, 2.0, 2.0], best=[0.1, 0.1, 0.1, 1.0, NAN])


def test_who_is_never_far_behind_is_named_and_the_peers_that_ran_are_said_last():
    peer = pd.DataFrame({"integrator": ["radau", "heyoka"], "scenario": "a", "peer": ["scipy", "other"],
                         "status": "ok", "control": "rtol", "value": 1e-6, "failure": ""})  # fmt: skip
    lead, text, more = sentences(
        {"time_to_accuracy": PARTIAL, "work_precision": peer}, {"absent": {"cvode": "scikit-sundae"}}
    )["An accurate trajectory"]
    assert (lead, text) == ("whole", "an error of 1e-6 on 5 of 5 scenarios")
    assert more[0] == "at most 90 times the fastest's time"
    assert more[-1].startswith("beside SciPy and heyoka (cvode not installed), of which the fastest takes 4 times")


def test_what_is_not_reached_is_infinite_in_every_rank():
    """A method gained by not reaching hard scenarios: 105 times the best on 5 of 14 stood before 311 on 8."""
    rows = by_method({"time_to_accuracy": PARTIAL}, {})
    place = rows[0].index("x best")
    assert [(row[0], row[place]) for row in rows[1:]] == [("best", "1"), ("whole", "90"), ("half", "not on most")]
    assert page_data.order(pairs({"time_to_accuracy": PARTIAL}, {}), "time 1e-06") == ["whole", "best", "half"]


def test_rows_stand_in_the_order_that_the_numbers_say_for_steps_too():
    """The key of this lens was not a number for 15 of 27 methods."""
    limits = {"free": ("none", NAN), "long": ("physical", 0.5), "short": ("physical", 0.1), "never": ("physical", NAN)}
    table = pd.DataFrame([
        {"integrator": m, "scenario": s, "limit": limit, "dt_stable": h, "dt_unstable": h, "dt_cap": 4.0}
        for m, (limit, h) in limits.items() for s in "ab"
    ])  # fmt: skip
    assert page_data.order(pairs({"stability": table}, {}), "step") == ["free", "long", "short", "never"]


def test_a_method_that_lost_a_law_is_not_among_the_consistent():
    rows = awkward.conservation(["honest", "refuted"], ["s"], failing=lambda name, h: False)
    rows["second_law_violations"] = (rows["integrator"].eq("refuted") & rows["dt"].eq(1.2)).astype(int)
    rows["energy_error_max"] = 1e-14
    told = {m: {"family": page_data.FAMILIES[1]} for m in ("honest", "refuted")}
    found = page_data.families({"conservation": rows}, {"integrators": told})
    assert found == {"honest": page_data.FAMILIES[1], "refuted": page_data.FAMILIES[2]}


def test_four_marks_say_how_runs_and_steps_end():
    """0 of 10 runs of sdirk3 failed, and its stable step was 0.028: its entropy fell, which only one of them said."""
    ends = {"blowup": "B", "nonfinite": "B", "no_root": "R", "nonconverged": "R", "unphysical": "P", "crash": "x"}
    assert {status: marks.mark_of(status) for status in ends} == ends
    assert marks.mark_of("ok", True) == "S" and marks.mark_of("ok") == ""
    causes = ["the entropy fell by more than 1e-10", "a temperature is not positive", "|E - E0| exceeds V0"]
    assert [marks.mark_of_limit("physical", cause) for cause in causes] == ["S", "P", "B"]
    assert marks.mark_of_limit("none", "") == ">" and marks.mark_of_limit(NAN, "") == ""
    rows = awkward.conservation(["sdirk3"], ["stiff_spring"], failing=lambda name, h: False)
    rows["second_law_violations"] = [0, 0, 0, 2, 2]
    steps = pd.DataFrame([{"integrator": "sdirk3", "scenario": "stiff_spring", "limit": "physical", "dt_cap": 4.0,
                           "dt_stable": 0.028, "dt_unstable": 0.029, "cause": causes[0]}])  # fmt: skip
    tables = {"conservation": rows, "stability": steps}
    (row,) = pairs(tables, {}).to_dict("records")
    assert (row["failed"], row["mark_S"], row["limit_mark"]) == (0, 2, "S")
    lead, _, more = sentences(tables)["What fails"]
    assert lead == "nothing" and more == ("the entropy fell in 2 of those that reached their end",)
    failed = page_data.failures(tables)["sdirk3"]["stiff_spring"]
    assert failed[0] == 0 and failed[3] == {"S": 2} and "the entropy fell" in failed[2]


@pytest.mark.parametrize("seed", range(4))
def test_every_scenario_is_answered_from_its_rows(seed):
    tables = random_tables(seed)
    found = pairs(tables, {})
    scenarios = sorted(found.index.get_level_values("scenario").unique())
    answers = overview.scenario_answers(found, tables, scenarios)
    assert list(answers) == scenarios and min(map(len, answers.values())) >= 3
    assert page_data.telling(found) in scenarios


def test_a_name_cannot_turn_or_flood_a_sentence():
    table = awkward.conservation([awkward.HOSTILE, "x" * 10_000], ["s"], failing=lambda name, h: True)
    _, _, more = sentences({"conservation": table})["What fails"]
    assert "\u202e" not in more[0] and len(more[0]) < 150


def test_no_study_no_sentence():
    whole = random_tables(3)
    for absent, title in (("time_to_accuracy", "An accurate trajectory"), ("conservation", "The laws at any step")):
        assert title not in sentences({name: table for name, table in whole.items() if name != absent})


def test_laws_count_the_runs_that_could_keep_them():
    table = awkward.conservation(["tc_monolithic", "midpoint_entropy"], ["short_term"], lambda name, h: False)
    table.loc[0, "steps"] = 0
    table.loc[1, "energy_error_max"] = 1e-3
    table["angular_momentum_error_max"] = math.nan
    table["linear_momentum_error_max"] = 1e-15
    told = {"integrators": {"tc_monolithic": {"claims": ["energy"], "family": "Romero (2009)"}}}
    tables = {"conservation": table}
    rows = {m["name"]: m for m in page_data.methods(pairs(tables, told), tables, told)}
    laws = {law["law"]: law for law in rows["tc_monolithic"]["laws"]}
    worst = {"worst": 1e-3, "where": "short_term, h = 0.15"}  # of the run that lost most
    assert laws["energy"] == {"law": "energy", "claimed": True, "kept": 3, "of": 4} | worst
    assert laws["linear_momentum"]["of"] == 4 and "angular_momentum" not in laws
    assert laws["entropy"]["claimed"] is False and rows["tc_monolithic"]["family"] == 0
    assert rows["midpoint_entropy"]["laws"][0]["claimed"] is None and rows["midpoint_entropy"]["family"] == 4


def test_cells_are_numbers_dashes_or_nothing():
    tables = awkward.everything(awkward.FIVE)
    lenses = {
        lens["key"]: lens["cells"]
        for lens in page_data.lenses(pairs(tables, {"scenarios": {"short_term": {"dt": 0.3}}}))
    }
    assert lenses["step"]["tc_monolithic"]["short_term"] == ["none", 12.0]
    assert lenses["energy"]["midpoint_entropy"]["short_term"] is None  # it failed at that step
    assert "scipy_radau" not in lenses["energy"]
    failed = page_data.failures(tables)
    assert failed["midpoint_entropy"]["short_term"] == [3, 12, "h = 0.3: blew up", {"B": 3, "S": 2}]
    assert "tc_strang" not in failed


def test_of_methods_that_are_equally_right_the_cheapest_is_named_and_no_error_below_a_thousandth_of_a_per_cent_is():
    """Of a reaction at rest the page named the one within 1.1e-13 %, and told both numbers."""
    assert overview._surest({"dear": [1e-12], "cheap": [1e-12]}, {"dear": 2.0, "cheap": 1.0})[0] == "cheap"
    assert (overview.percent(1.1e-15), overview.percent(0.026)) == ("0.001 %", "2.6 %")
