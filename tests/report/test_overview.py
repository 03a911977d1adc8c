"""Every sentence of the Overview is computed again here, another way, from the tables of small and large runs."""

import math
import re
import statistics
from pathlib import Path

import awkward
import pandas as pd
import pytest
from random_tables import is_number, random_tables, records

import tcbench
from tcbench.report import matrix, overview
from tcbench.report.judged import judged
from tcbench.report.summary import seconds
from tcbench.runner.tables import read_tables


def sentences(tables, declared=None):
    return {
        found.title: (found.lead, found.text) for found in overview.findings(judged(tables, declared or {}), tables)
    }


def expected_accuracy(tables):
    """(names that may lead, scenarios reached, worst ratio, rows of the first): by pandas, pivoted."""
    table = tables["time_to_accuracy"]
    table = table[table["measure"] == "error"]
    for target in (1e-6, 1e-3):
        times = table[table["target"] == target].pivot(index="integrator", columns="scenario", values="time_s")
        if not times.notna().any(axis=None):
            continue
        ratios = times / times.min()
        rank = pd.DataFrame({"reached": ratios.count(axis=1), "worst": ratios.max(axis=1)}).reset_index()
        rank = rank.sort_values(["reached", "worst", "integrator"], ascending=[False, True, True])
        first = rank.iloc[0]
        tied = rank[(rank["reached"] == first["reached"]) & (rank["worst"] <= 1.05 * first["worst"])]
        mine = table[(table["target"] == target) & (table["integrator"] == first["integrator"])]
        return [first["integrator"], *sorted(tied["integrator"][1:])], first, target, mine[mine["time_s"].notna()]
    return [], None, 1e-3, table.iloc[:0]


def expected_lawful(tables):
    rows = records(tables, "conservation")
    laws = [("energy_error_max", 1e-9), ("second_law_violations", 0), ("angular_momentum_error_max", 1e-9)]
    bad = set()
    for r in rows:
        values = [(r[c], most) for c, most in laws if is_number(r[c])]
        if r["status"] != "ok" or r["steps"] == 0 or not values or any(v > most for v, most in values):
            bad.add(r["integrator"])
    methods = {r["integrator"] for r in rows}
    return sorted(methods - bad), len(methods), rows


def expected_prices(tables):
    """Method -> microseconds a step of its scenarios."""
    fixed = {r["integrator"] for r in records(tables, "work_precision") if r["control"] == "dt"}
    rows = [r for r in records(tables, "cost") if r["integrator"] in fixed]
    if not rows:  # not timed alone: the completed runs of the ladder at the step in its middle
        ladders = {}
        for r in records(tables, "conservation"):
            ladders.setdefault(r["scenario"], set()).add(r["dt"])
        own = {s: sorted(h for h in steps if is_number(h)) for s, steps in ladders.items()}
        rows = [r for r in records(tables, "conservation") if r["status"] == "ok"]
        rows = [r for r in rows if r["dt"] == own[r["scenario"]][len(own[r["scenario"]]) // 2]]
    times = {}
    for r in rows:
        if is_number(r["us_per_step"]):
            times.setdefault(r["integrator"], []).append(r["us_per_step"])
    return times


def expected_failures(tables):
    """Method -> {scenario: smallest step that failed}, of its conservation runs and its stability limits."""
    found = {}
    for name, failed, step in (("conservation", "status", "dt"), ("stability", "limit", "dt_unstable")):
        for r in records(tables, name):
            if r[failed] not in ("ok", "none"):
                steps = found.setdefault(r["integrator"], {}).setdefault(r["scenario"], [])
                steps += [r[step]] if is_number(r[step]) else []
    return {m: {s: min(steps, default=math.inf) for s, steps in of.items()} for m, of in found.items()}


@pytest.mark.parametrize("seed", range(25))
def test_the_sentences_follow_from_the_tables(seed):
    tables = random_tables(seed)
    assert len(check_sentences(tables)) in (5, 6)  # at the coarsest step lawful methods may have failed


@pytest.mark.parametrize("seed", [3, 8, 11])
def test_what_a_scenario_answers_follows_from_its_rows(seed):
    tables = random_tables(seed)
    found = overview.scenario_answers(judged(tables, {}), tables, sorted(set(tables["conservation"]["scenario"])))
    for scenario, answers in found.items():
        mine = {name: table[table["scenario"] == scenario] for name, table in tables.items() if "scenario" in table}
        steps = mine["work_precision"].loc[mine["work_precision"]["control"] == "dt", "value"]
        for title, lead, text in answers:
            assert not title.startswith("At h") or title == f"At h = {steps.max():.3g}"
            CHECKS.get(title, check_coarse)(mine, lead, text)
    assert min(map(len, found.values())) >= 3


def test_the_sentences_of_a_large_real_run_follow_from_its_tables():
    """The published run: five methods, seven scenarios, every study but those of time."""
    tables = read_tables(Path(__file__).parents[2] / "results" / "baseline")
    assert len(tables["conservation"]) > 150 and len(check_sentences(tables)) == 3


def check_sentences(tables):
    """Each sentence that these tables allow agrees with what is computed here; their titles."""
    said = sentences(tables)
    for title, (lead, text) in said.items():
        CHECKS.get(title, check_coarse)(tables, lead, text)
    return list(said)


def expected_special(worst, ran, general):
    """The method with the least `worst` of those with a number wherever they ran, on half of the scenarios or more;
    worst, and ran beside it: by method; None unless it is ahead of the general one and runs on fewer."""
    table = pd.DataFrame({"count": worst.count(axis=1), "worst": worst.max(axis=1), "ran": pd.Series(ran)}).dropna()
    table = table[(table["count"] == table["ran"]) & (table["ran"] >= table["ran"].max() / 2)]
    ahead = table[table["worst"] * 1.05 < worst.max(axis=1)[general]].reset_index(names="name")
    ahead = ahead.sort_values(["worst", "name"])
    return None if not len(ahead) or ahead["count"].iloc[0] >= worst.count(axis=1)[general] else ahead["name"].iloc[0]


def check_accuracy(tables, lead, text):
    names, first, target, mine = expected_accuracy(tables)
    if first is not None:
        rows = tables["time_to_accuracy"]
        rows = rows[(rows["measure"] == "error") & (rows["target"] == target)]
        times = rows.pivot(index="integrator", columns="scenario", values="time_s")
        special = expected_special(times / times.min(), rows.groupby("integrator")["scenario"].nunique(), names[0])
        if special:
            worst = (times / times.min()).loc[special].max()
            assert lead == f"{special}, else {names[0]}" and "that it runs on" in text
            assert worst <= 1.05 or float(re.search(r"at most (\S+) times the", text)[1]) == pytest.approx(
                worst, rel=0.051
            )
            return
    if first is None:
        assert (lead, text) == ("none", "no method reached an error of 1e-3 on any scenario")
        return
    level = re.search(r"; as good within 5 %: (\S+)(?: and (\d+) more)?$", text)
    assert lead == names[0] and (level is not None) == (len(names) > 1)
    assert level is None or (level[1] == names[1] and int(level[2] or 0) == len(names) - 2)
    count = tables["time_to_accuracy"]["scenario"].nunique()
    where = f"on {first['reached']} of {count} scenario" if count > 1 else f"in {seconds(mine['time_s'].iloc[0])}"
    assert f"an error of {'1e-6' if target == 1e-6 else '1e-3'} {where}" in text
    if first["worst"] > 1.05:
        behind = float(re.search(r"at most ([\d.e+]+) times the fastest's time", text)[1])
        assert behind == pytest.approx(first["worst"], rel=0.051)
    ratios = mine["ratio_to_best_peer"].dropna()
    if mine["integrator"].iloc[0] in set(mine["best_peer"]) or not len(ratios):
        assert "best peer" not in text
    elif len(ratios) > 1:
        told = re.search(r"takes (\S+) times as long \(median of (\d+); at least (\S+)\)", text)
        middle, of, least = told.groups()
        assert float(least) == pytest.approx(ratios.min(), rel=0.051) and int(of) == len(ratios)
        assert float(middle) == pytest.approx(ratios.median(), rel=0.051)


def both_of(text):
    """The two errors, per cent, that a sentence tells first."""
    return [float(v) for v in re.search(r"temperatures within (\S+) %, entropy produced within (\S+) %", text).groups()]


def check_coarse(tables, lead, text):
    keep, _, _ = expected_lawful(tables)
    work = tables["work_precision"]
    work = work[work["control"] == "dt"]
    work = work[work["value"] == work.groupby("scenario")["value"].transform("max")]
    work = work[work["scenario"].map(work.groupby("scenario")["error_theta"].count() > 0)]
    scenarios = work["scenario"].nunique()
    work = work[work["integrator"].isin(keep) & (work["status"] == "ok")]
    both = work[["error_theta", "error_entropy_produced"]].fillna(1e-11)
    work = work.assign(theta=both["error_theta"], made=both["error_entropy_produced"], e=both.max(axis=1))
    worst = work.groupby("integrator")[["theta", "made"]].max().clip(lower=1e-5)  # told within 0.001 %
    errors = work.groupby("integrator")["e"].agg(["count", "max"])
    prices = expected_prices(tables)
    errors = errors.reset_index()
    errors["price"] = [statistics.median(prices.get(name, [math.inf])) for name in errors["integrator"]]
    errors["max"] = errors["max"].clip(lower=1e-12)
    errors = errors.sort_values(["count", "max", "price", "integrator"], ascending=[False, True, True, True])
    first = errors.iloc[0]
    cells = work.pivot(index="integrator", columns="scenario", values="e")
    ran = tables["work_precision"]
    ran = ran[(ran["control"] == "dt") & (ran["value"] == ran.groupby("scenario")["value"].transform("max"))]
    ran = ran[ran["scenario"].map(ran.groupby("scenario")["error_theta"].count() > 0)]
    ran = ran.groupby("integrator")["scenario"].nunique()
    special = expected_special(cells, ran[ran.index.isin(cells.index)], first["integrator"])
    if special:
        assert lead == f"{special}, else {first['integrator']}"
        assert both_of(text) == pytest.approx(100 * worst.loc[special], rel=0.051)
        return
    assert lead == first["integrator"]
    assert f"on {first['count']} of {scenarios} scenario" in text if scenarios > 1 else " scenario" not in text
    assert both_of(text) == pytest.approx(100 * worst.loc[first["integrator"]], rel=0.051)
    inner = work.get("inner_steps_mean", pd.Series(index=work.index)).where(work["integrator"] == lead).max()
    divided = re.search(r"are divided: into (\S+) on average", text)
    assert (divided is not None) == (inner > 1.05) and (
        not divided or float(divided[1]) == pytest.approx(inner, rel=0.051)
    )
    beside = re.search(r"; (\S+), whose step is the cheapest of these: (.*)$", text)
    level = [m for m in errors.loc[errors["count"] == first["count"], "integrator"] if m in prices]
    cheap = min(sorted(level), key=lambda m: statistics.median(prices[m]), default=lead)
    assert (beside is None) == (cheap == lead)
    if beside:
        assert beside[1] == cheap
        assert both_of(beside[2]) == pytest.approx(100 * worst.loc[cheap], rel=0.051)


def check_lawful(tables, lead, text):
    keep, methods, rows = expected_lawful(tables)
    if keep:
        runs = [r for r in rows if r["integrator"] in keep]
        assert (
            lead == f"{len(keep)} of {methods} method{'s' * (methods > 1)}" and f"in each of {len(runs)} runs" in text
        )
        assert text.split(": ")[-1].startswith(keep[0])
        named = re.search(r"up to h = ([\d.]+)", text)
        largest = [
            max((r["dt"] for r in runs if r["integrator"] == k and is_number(r["dt"])), default=None) for k in keep
        ]
        largest = [h for h in largest if h is not None]
        assert (named is None and not largest) or float(named[1]) == pytest.approx(min(largest), rel=6e-3)
    else:
        assert lead == "no method"


def check_cheapest(tables, lead, text):
    prices, failures = expected_prices(tables), expected_failures(tables)
    most = max(map(len, prices.values()))
    prices = {name: of for name, of in prices.items() if 2 * len(of) >= most}
    typical = {name: statistics.median(of) for name, of in sorted(prices.items())}
    free = {name: price for name, price in typical.items() if name not in failures}
    name = min(free or typical, key=(free or typical).get)
    assert lead == name and float(text.split(" µs")[0]) == pytest.approx(typical[name], rel=0.051)
    assert f"median of {len(prices[name])} scenarios" in text or (len(prices[name]) == 1 and "median" not in text)
    first = min(typical, key=typical.get)
    if first in failures:  # the cheapest of all, with what it costs
        assert first in lead + text
        assert f"fails on {len(failures[first])} of " in text or (tables["conservation"]["scenario"].nunique() == 1)
        at = min(failures[first].values())
        assert not math.isfinite(at) or f"from h = {at:.2g}" in text
    assert ("no method never failed" in text) == (not free)


def check_failing(tables, lead, text):
    runs = [(r, r["dt"]) for r in records(tables, "conservation") if not r.get("tolerance", 0) > 1e-3]
    work = [r for r in records(tables, "work_precision") if r["control"] == "dt" or r["value"] <= 1e-3]
    runs += [(r, r["value"] if r["control"] == "dt" else math.nan) for r in work]
    failed = [(r, h) for r, h in runs if r["status"] != "ok"]
    assert lead == (f"{len(failed)} of {len(runs)} runs" if failed else "nothing")
    fixed = [(h, r["integrator"], r["scenario"]) for r, h in failed if is_number(h)]
    searched = [
        (r["dt_unstable"], r["integrator"], r["scenario"]) for r in records(tables, "stability") if r["limit"] != "none"
    ]
    fixed += [one for one in searched if failed and is_number(one[0])]
    if fixed:
        where = " on {2}" if len({r["scenario"] for r, _ in runs}) > 1 else ""
        assert text == f"at the smallest step: {{1}}{where}, from h = {{0:.2g}}".format(*min(fixed))


def check_random_starts(tables, lead, text):
    table = tables["failure_share"]
    table = table[table["ensemble"] == table["ensemble"][0]]
    sums = table.groupby("integrator")[["runs", "failed"]].sum()
    few = min(50, sums["runs"].max())
    judged = sums[(sums["runs"] >= few) | (sums["failed"] > 0)]
    never = judged[judged["failed"] == 0].sort_values(["runs"], ascending=False, kind="stable")
    assert lead == (f"{len(never)} of {len(judged)} method{'s' * (len(judged) > 1)}" if len(never) else "no method")
    start = f"never failed in {never['runs'].sum()} runs: {never.index[0]}" if len(never) else "ended every run"
    assert text.startswith(start)
    assert (f"({len(sums) - len(judged)} with fewer than {few} runs not counted)" in text) == (len(judged) < len(sums))
    told = re.search(
        r"most often (\S+), in (\d+) of (\d+) at (h|tolerance) = ?([\d.e-]+)$",
        text.replace("tolerance ", "tolerance = "),
    )
    assert (told is None) == (not sums["failed"].any())
    if told:
        name, failed, runs, control, at = told.groups()
        column = "dt" if control == "h" else "tolerance"
        rows = table[table["runs"] >= min(10, table["runs"].max())]
        (row,) = [
            r
            for r in rows.to_dict("records")
            if r["integrator"] == name and r[column] == pytest.approx(float(at), rel=0.06)
        ]
        assert (row["failed"], row["runs"]) == (int(failed), int(runs))
        assert row["failed"] / row["runs"] == (rows["failed"] / rows["runs"]).max()


CHECKS = {
    "An accurate trajectory": check_accuracy, "The laws at any step": check_lawful,
    "The cheapest step": check_cheapest, "Cheapest, never failed": check_cheapest,
    "At the coarsest step": check_coarse, "What fails": check_failing, "From random starts": check_random_starts,
}  # fmt: skip


def test_a_small_real_run_says_only_what_it_has(tmp_path):
    tcbench.run(["tc_monolithic", "midpoint_entropy"], ["stiff_spring"], ["conservation"], tmp_path, jobs=1)
    tables = read_tables(tmp_path)
    said = sentences(tables)
    rows = tables["conservation"].to_dict("records")
    failed = sorted(r["dt"] for r in rows if r["status"] != "ok")
    assert list(said) == ["The laws at any step", "Cheapest, never failed", "What fails"]
    assert said["The laws at any step"] == (
        "1 of 2 methods",
        "kept energy, entropy and angular momentum in each of 5 runs, at every step tried, up to h = 1.2: "
        "tc_monolithic",
    )
    assert said["What fails"][0] == f"{len(failed)} of 10 runs" and f"h = {failed[0]:.2g}" in said["What fails"][1]
    own = {r["integrator"]: r["us_per_step"] for r in rows if r["dt"] == 0.3 and r["status"] == "ok"}
    lead, text = said["Cheapest, never failed"]
    assert lead == "tc_monolithic" and text.startswith(f"{own[lead]:.2g} µs a step")


def test_when_every_run_failed_nothing_is_praised():
    table = awkward.conservation(awkward.FIVE, failing=lambda name, h: True).assign(steps=0)
    said = sentences({"conservation": table})
    assert said["The laws at any step"] == ("no method", "ended a run with every law")
    assert (
        not [title for title in said if title.startswith(("The cheapest", "Cheapest"))]
        and said["What fails"][0] == "75 of 75 runs"
    )
    assert overview.findings(judged({}, {}), {}) == []


def test_a_name_cannot_turn_or_flood_a_sentence():
    table = awkward.conservation([awkward.HOSTILE, "x" * 10_000], ["s"], failing=lambda name, h: True)
    _, text = sentences({"conservation": table})["What fails"]
    assert "\u202e" not in text and len(text) < 150


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
    rows = {m["name"]: m for m in matrix.methods(judged(tables, told), tables, told)}
    laws = {law["law"]: law for law in rows["tc_monolithic"]["laws"]}
    worst = {"worst": 1e-3, "where": "short_term, h = 0.15"}  # of the run that lost most
    assert laws["energy"] == {"law": "energy", "claimed": True, "kept": 3, "of": 4} | worst
    assert laws["linear_momentum"]["of"] == 4 and "angular_momentum" not in laws
    assert laws["entropy"]["claimed"] is False and rows["tc_monolithic"]["family"] == 0
    assert rows["midpoint_entropy"]["laws"][0]["claimed"] is None and rows["midpoint_entropy"]["family"] == 4


def test_cells_are_numbers_dashes_or_nothing():
    tables = awkward.everything(awkward.FIVE)
    lenses = {
        lens["key"]: lens["cells"] for lens in matrix.lenses(judged(tables, {"scenarios": {"short_term": {"dt": 0.3}}}))
    }
    assert lenses["step"]["tc_monolithic"]["short_term"] == ["none", 12.0]
    assert lenses["energy"]["midpoint_entropy"]["short_term"] is None  # it failed at that step
    assert "scipy_radau" not in lenses["energy"]
    failed = matrix.failures(tables)
    assert failed["midpoint_entropy"]["short_term"] == [3, 12, "h = 0.3: blew up"] and "tc_strang" not in failed


def test_of_methods_that_are_equally_right_the_cheapest_is_named_and_no_error_below_a_thousandth_of_a_per_cent_is():
    """Of a reaction at rest the page named the one within 1.1e-13 %, and told both numbers."""
    assert overview._surest({"dear": [1e-12], "cheap": [1e-12]}, {"dear": 2.0, "cheap": 1.0})[0] == "cheap"
    assert (overview.percent(1.1e-15), overview.percent(0.026)) == ("0.001 %", "2.6 %")
