"""What terminal and page say of a run: of small tables whose answer is seen at once, and random ones."""

import math
import re

import awkward
import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

import tcbench
from tcbench.cli import main
from tcbench.commands import terminal
from tcbench.report import marks, overview, page_data, words
from tcbench.report.by_method import by_method, claims, lost, remarks
from tcbench.report.pairs import pairs, times_over_best
from tcbench.studies.cost import reach
from tcbench.studies.work_precision import tabulate

pytestmark = pytest.mark.usefixtures("cells_here")

NAN = math.nan


def answers(tables, declared=None):
    found = overview.findings(pairs(tables, declared or {}), tables, declared or {})
    return {one.title: (one.lead, one.text, list(one.more)) for one in found}


def times(**of):
    """Seconds to an error of 1e-6 on scenarios a, b, c ...; nan where it was not reached."""
    return pd.DataFrame([
        {"integrator": m, "scenario": s, "measure": "error", "target": 1e-6, "time_s": t, "best_peer": "radau",
         "ratio_to_best_peer": 4.0}
        for m, seconds in of.items() for s, t in zip("abcde", seconds, strict=False)
    ])  # fmt: skip


PARTIAL = times(half=[1.0, 1.0, NAN, NAN, NAN], whole=[9.0, 9.0, 9.0, 2.0, 2.0], best=[0.1, 0.1, 0.1, 1.0, NAN])


def test_who_is_never_far_behind_is_named_and_the_peers_that_ran_are_said_last():
    peer = pd.DataFrame({"integrator": ["radau", "heyoka"], "scenario": "a", "peer": ["scipy", "other"],
                         "status": "ok", "control": "rtol", "value": 1e-6, "failure": ""})  # fmt: skip
    told = {"absent": {"cvode": "scikit-sundae"}}
    lead, text, more = answers({"time_to_accuracy": PARTIAL, "work_precision": peer}, told)["An accurate trajectory"]
    assert (lead, text) == ("whole", "an error of 1e-6 on 5 of 5 scenarios")
    assert more[0] == "at most 90 times the fastest's time"
    assert more[-1].startswith("beside SciPy and heyoka (cvode not installed), of which the fastest takes 4 times")


def test_what_is_not_reached_is_infinite_in_every_rank():
    """A method gained by not reaching hard scenarios: 105 times the best on 5 of 14 stood before 311 on 8."""
    found = pairs({"time_to_accuracy": PARTIAL}, {})
    assert times_over_best(found)["half"] == pytest.approx([10.0, 10.0, math.inf, math.inf, math.inf])
    rows = by_method({"time_to_accuracy": PARTIAL}, {})
    assert rows[0] == ["method", "to 1e-6", "x best"]
    assert rows[1:] == [["best", "4 of 5", "1"], ["whole", "5 of 5", "90"], ["half", "2 of 5", "not on most"]]
    assert page_data.order(found, "time 1e-06") == ["whole", "best", "half"]


def test_rows_stand_in_the_order_that_the_numbers_say_for_steps_too():
    """The key of this lens was not a number for 15 of 27 methods."""
    limits = {"free": ("none", NAN), "long": ("physical", 0.5), "short": ("physical", 0.1), "never": ("physical", NAN)}
    table = pd.DataFrame([
        {"integrator": m, "scenario": s, "limit": limit, "dt_stable": h, "dt_unstable": h, "dt_cap": 4.0}
        for m, (limit, h) in limits.items() for s in "ab"
    ])  # fmt: skip
    found = pairs({"stability": table}, {})
    assert page_data.order(found, "step") == ["free", "long", "short", "never"]


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
    lead, _, more = answers(tables)["What fails"]
    assert lead == "nothing" and more == ["the entropy fell in 2 of those that reached their end"]
    failed = page_data.failures(tables)["sdirk3"]["stiff_spring"]
    assert failed[0] == 0 and failed[3] == {"S": 2} and "the entropy fell" in failed[2]


def test_of_a_solver_that_chooses_its_steps_the_tightest_tolerance_that_failed_is_told():
    """The page told of 1e-3 where the same solver failed at 1e-11, too."""
    row = {"integrator": "a", "scenario": "s", "control": "tolerance", "status": "exception", "failure": "why"}
    table = pd.DataFrame([row | {"value": value} for value in (1e-3, 1e-11, 1e-7)])
    assert page_data.failures({"work_precision": table})["a"]["s"] == [3, 3, "tolerance 1e-11: why", {"x": 3}]


def test_a_name_cannot_turn_or_flood_a_sentence():
    table = awkward.conservation([awkward.HOSTILE, "x" * 10_000], ["s"], failing=lambda name, h: True)
    _, _, more = answers({"conservation": table})["What fails"]
    assert "\u202e" not in more[0] and len(more[0]) < 150


def test_no_study_no_sentence_and_no_number():
    whole = awkward.everything(awkward.FIVE)
    for absent, title in (("time_to_accuracy", "An accurate trajectory"), ("conservation", "The laws at any step")):
        assert title not in answers({name: table for name, table in whole.items() if name != absent})
    tables = {"other": pd.DataFrame({"integrator": ["a"], "scenario": ["s"]})}
    assert by_method(tables, {}) == [["method"], ["a"]] and answers(tables) == {}
    assert pairs(awkward.ensemble(awkward.FIVE), {}).empty


def test_laws_count_the_runs_that_could_keep_them():
    table = awkward.conservation(["tc_monolithic", "midpoint_entropy"], ["short_term"], lambda name, h: False)
    table.loc[0, "steps"] = 0
    table.loc[1, "energy_error_max"] = 1e-3
    table["angular_momentum_error_max"] = math.nan
    table["linear_momentum_error_max"] = 1e-15
    told = {"integrators": {"tc_monolithic": {"claims": ["energy"], "family": "Romero (2009)"}}}
    tables = {"conservation": table}
    rows = {m["name"]: m for m in page_data.methods(pairs(tables, told), tables, told)}
    found = {law["law"]: law for law in rows["tc_monolithic"]["laws"]}
    worst = {"worst": 1e-3, "where": "short_term, h = 0.15"}  # of the run that lost most
    assert found["energy"] == {"law": "energy", "claimed": True, "kept": 3, "of": 4} | worst
    assert found["linear_momentum"]["of"] == 4 and "angular_momentum" not in found
    assert found["entropy"]["claimed"] is False and rows["tc_monolithic"]["family"] == 0
    assert rows["midpoint_entropy"]["laws"][0]["claimed"] is None and rows["midpoint_entropy"]["family"] == 4


def test_cells_are_numbers_dashes_or_nothing():
    tables, told = awkward.everything(awkward.FIVE), {"scenarios": {"short_term": {"dt": 0.3}}}
    lenses = {lens["key"]: lens["cells"] for lens in page_data.lenses(pairs(tables, told))}
    assert lenses["step"]["tc_monolithic"]["short_term"] == ["none", 12.0]
    assert lenses["energy"]["midpoint_entropy"]["short_term"] is None  # it failed at that step
    assert "scipy_radau" not in lenses["energy"]
    failed = page_data.failures(tables)
    assert failed["midpoint_entropy"]["short_term"] == [3, 12, "h = 0.3: blew up", {"B": 3, "S": 2}]
    assert "tc_strang" not in failed


def test_of_methods_that_are_equally_right_the_cheapest_is_named_and_no_error_below_a_thousandth_of_a_per_cent_is():
    """Of a reaction at rest the page named the one within 1.1e-13 %, and told both numbers."""
    assert overview._surest({"dear": [1e-12], "cheap": [1e-12]}, {"dear": 2.0, "cheap": 1.0})[0] == "cheap"
    assert (words.percent(1.1e-15), words.percent(0.026)) == ("0.001 %", "2.6 %")


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


def point(error, seconds, **more):
    errors = {f"error_{name}": error for name in ("q", "p", "s", "theta")}
    return {"status": "ok", "error": error, "wall_time_min_s": seconds, "reference_limited": False} | errors | more


@pytest.mark.parametrize(
    "last", [point(1e-7, 4e-3), point(1e-7, 4e-3, error_theta=2e-6), point(NAN, 4e-3, reference_limited=True)]
)
def test_the_time_to_an_accuracy_is_one_number_everywhere(last):
    points = [point(1e-3, 1e-3), point(1e-5, 2e-3), last]
    tables = tabulate([{"integrator": "a", "scenario": "s", "peer": "", "points": points}])
    line = tables["time_to_accuracy"].set_index(["measure", "target"]).loc[("error", 1e-6), "time_s"]
    assert reach(tables["work_precision"].to_dict("records"), "error", 1e-6) == pytest.approx(line, rel=1e-12)
    assert pairs(tables, {})["time 1e-06"].tolist() == [line]


def test_sixty_methods_fold_and_lines_fit(capsys):
    names = [*awkward.FORTY[:3], *(f"scipy_{i}" for i in range(20))]
    tables = awkward.everything(names, ["short_term"])
    peer = ["scipy" if n.startswith("scipy_") else "" for n in tables["work_precision"]["integrator"]]
    tables["work_precision"]["peer"] = peer
    rows = by_method(tables, {})
    others = [n for n in page_data.names(tables, "integrator") if not n.startswith("scipy_")]
    assert {row[0] for row in rows[1:-1]} == set(others) and re.match(r"2\d of SciPy's; best: scipy_", rows[-1][0])
    terminal.print_methods(rows, remarks(tables))
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) < 30 and not any(line != line.rstrip() for line in lines)


def test_a_run_ends_with_a_row_a_method_and_simulate_says_whether_claims_were_kept(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    chosen = [w for n in awkward.FIVE for w in ("-i", n)] + ["-s", "short_term", "-s", "cold_spring"]
    done = CliRunner().invoke(main, ["run", *chosen, "--study", "conservation"])
    lines = done.stdout.splitlines()
    assert done.exit_code == 0 and len(lines) <= 30 and "claims kept" in done.stdout
    assert sum(line.split()[:1] == [n] for n in awkward.FIVE for line in lines) == len(awkward.FIVE)
    shown = CliRunner().invoke(main, ["show", "-s", "short_term", "-i", awkward.FIVE[0]])
    assert shown.exit_code == 0 and shown.stdout.count(awkward.FIVE[0]) >= 5
    done = CliRunner().invoke(main, ["simulate", "midpoint_entropy", "short_term", "--t-end", "3"])
    told = {line.split()[0]: line for line in done.stdout.splitlines() if line.strip()}
    assert "max |E − E₀| / V₀" in told["energy_error_max"] and "not claimed, not kept" in told["energy_error_max"]
    assert told["angular_momentum_error_max"].endswith("  claimed, kept")
    assert told["second_law_violations"].endswith("  not claimed, kept")
    done = CliRunner().invoke(main, ["simulate", "midpoint_entropy", "short_term", "--dt", "0.7", "--t-end", "3"])
    assert re.search(r"t_final +3\.5 .* the last of 5 steps ends past t_end = 3\n", done.stdout)


def test_an_ensemble_alone_has_a_row_a_method_over_all_its_steps():
    runs = [("a", 0.1, 200, 0), ("a", 0.2, 200, 0), ("b", 0.1, 200, 3), ("b", 0.2, 200, 5)]
    table = pd.DataFrame(runs, columns=["integrator", "dt", "runs", "failed"])
    assert by_method({"failure_share": table}, {}) == [
        ["method", "random failed"], ["a", "none of 400"], ["b", "2 % of 400"]
    ]  # fmt: skip


WHY = "ReferenceFailed: stopped at t = 0.2 of 1"


def test_what_gave_no_result_is_told_with_its_reason():
    """Nobody is told that nothing fails, and no undetermined order is mute; each reason is told once."""
    row = {"scenario": "large", "variable": "all", "verdict": "undetermined"}
    failed = [row | {"integrator": n, "status": "exception", "note": WHY} for n in ("a", "b", "c")]
    few = row | {"integrator": "d", "status": "ok", "note": "Only 2 points stand above every floor."}
    still = few | {"integrator": "e", "variable": "u"}  # a variable that stands still; the order is that of the state
    fits = pd.DataFrame([*failed, few, still, still | {"variable": "all", "verdict": "as declared", "note": "fine"}])
    ladder = {"integrator": "a", "scenario": "large", "dt": 0.1, "status": "ok", "failure": ""}
    tables = {"conservation": pd.DataFrame([ladder]), "convergence": fits}
    lead, text, _ = answers(tables)["What fails"]
    assert (lead, WHY in text) == ("3 measurements without a result", True)
    assert answers({"convergence": fits})["What fails"][0] == lead
    assert answers({"conservation": tables["conservation"]})["What fails"][0] == "nothing"
    found = page_data.failures(tables)
    assert set(found) == {"a", "b", "c"} and found["a"]["large"][0] == 1 and WHY in found["a"]["large"][2]
    assert remarks(tables)[1:] == [
        f"No result of convergence of a on large, convergence of b on large and 1 more: {WHY}",
        "Order undetermined of d on large: Only 2 points stand above every floor.",
    ]


def test_two_steps_for_an_order_and_a_scenario_that_does_not_suit_are_told(tmp_path):
    chosen = ["run", "-i", "verlet_heat", "-s", "short_term", "-s", "gas_containers", "--study", "convergence", "--dt"]
    done = CliRunner().invoke(main, [*chosen, "0.1", "--dt", "0.2", "-o", str(tmp_path / "out")])
    assert done.exit_code == 0 and "2 steps, and an order takes at least 3: leave --dt out" in done.stderr
    assert "verlet_heat is not run on gas_containers: it needs conduction_flow" in done.stderr
    shown = CliRunner().invoke(main, ["show", str(tmp_path / "out")])
    for said in (done, shown):
        assert "Order undetermined of verlet_heat on short_term: Only 2 points" in said.stdout


def test_one_name_has_one_unit():
    """`summary.energy_error_max` in Python is the column of that name: over the initial exergy."""
    from tcbench.simulation import metrics

    run = tcbench.simulate("midpoint_entropy", "short_term", dt=0.3)
    row, V0 = metrics.conservation(run), run.scenario.initial_exergy
    for name in ("energy_error_max", "energy_drift", "lyapunov_increment_max"):
        assert row[name] == getattr(run.summary, name)
    assert row["energy_error_max"] == np.abs(run.energy - run.energy[0]).max() / V0 and abs(V0 - 1) > 0.1


def test_a_declared_invariant_that_a_run_departs_from_is_told_on_terminal_and_page():
    """A charge's canonical momentum drifted by 3e-3 with all lines passing; round-off of other runs says nothing."""
    why_a = "canonical changes by 1e-03 of its terms: why; x. T; spin changes by 1"
    rows = pd.DataFrame([
        {"integrator": m, "scenario": "charge", "dt": 0.1, "status": status, "energy_error_max": 1e-15,
         "canonical_error_max": off, "spin_error_max": 1e-14, "invariants_lost": why}
        for m, status, off, why in (("a", "ok", 3e-3, why_a),
                                     ("b", "ok", 1e-14, None), ("c", "blowup", 1.0, None), ("d", "ok", 2e-9, None))
    ])  # fmt: skip
    (sentence,) = lost({"conservation": rows})
    told = "Canonical departs by more than 1e-10 in 2 of 3 runs that ended well, most by 0.003 (a on charge)"
    assert sentence == f"{told}; of a canonical changes by 1e-03 of its terms: why; x. T."
    assert sentence in remarks({"conservation": rows})
    assert any("canonical departs" in text for text in answers({"conservation": rows})["What fails"][2])
    assert lost({"conservation": rows[rows["integrator"].eq("b")]}) == []
