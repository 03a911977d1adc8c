"""Every number of the first answers, and of what stands behind "more", again from the tables by plain pandas."""

import json
from pathlib import Path

import awkward
import numpy as np
import pandas as pd
import pytest

from tcbench.report.by_method import remarks
from tcbench.report.overview import findings
from tcbench.report.page_data import failures, order, unmeasured
from tcbench.report.pairs import pairs

BASELINE = Path(__file__).parents[2] / "results" / "baseline"


def published():
    tables = {path.stem: pd.read_csv(path, low_memory=False) for path in BASELINE.glob("tables/*.csv")}
    return tables, json.loads((BASELINE / "declared.json").read_text())


def made_up():
    scenarios = ["short_term", "stiff_spring"]
    methods = [*awkward.FIVE, *awkward.PEERS]
    tables = awkward.everything(methods, scenarios)
    work = tables["work_precision"]
    loose = work.index[work["control"].ne("dt")][:2]  # asked for so little, a failure is none
    work.loc[loose, "value"], work.loc[loose, "status"] = 0.1, "exception"
    return tables, awkward.declared(methods, scenarios)


RUNS = {"baseline": published, "made up": made_up}


def kept_all(table):
    """Of each row of `conservation`, whether every law that its system has was kept in it."""
    off = table["energy_error_max"].mask(table["energy_error_max"] <= table.get("energy_round_off", 0.0), 0.0)
    errors = [off, *(table[c] for c in table if c.endswith("_error_max") and c != "energy_error_max")]
    return np.all([~(e > 1e-9) for e in errors], axis=0) & ~(table["second_law_violations"] > 0) & (table["steps"] > 0)


def answers(tables, told):
    return {one.title: one for one in findings(pairs(tables, told), tables, told)}


def said(one):
    return " | ".join([one.lead, one.text, *one.more])


@pytest.mark.parametrize("run", RUNS)
def test_the_laws_at_any_step(run):
    tables, told = RUNS[run]()
    table = tables["conservation"]
    good = kept_all(table) & table["status"].eq("ok")
    keep = [m for m, of in good.groupby(table["integrator"]) if of.all()]
    one = answers(tables, told)["The laws at any step"]
    if not keep:
        assert one.lead == "no method"
        return
    mine = table[table["integrator"].isin(keep)]
    assert one.lead == f"{len(keep)} of {table['integrator'].nunique()} methods"
    assert f"in each of {len(mine)} runs" in one.more and all(m in one.more[0] for m in keep[:3])
    assert f"up to h = {mine.groupby('integrator')['dt'].max().min():.2g}" in said(one)


@pytest.mark.parametrize("run", RUNS)
def test_what_a_step_costs_and_who_never_failed(run):
    tables, told = RUNS[run]()
    table, limits, work = tables["conservation"], tables["stability"], tables.get("work_precision")
    by = ["integrator", "scenario"]
    if work is None:
        own = {name: facts["dt"] for name, facts in told["scenarios"].items()}
        rows = table[np.isclose(table["dt"], table["scenario"].map(own)) & table["status"].eq("ok")]
        cost = rows.set_index(by)["us_per_step"]
    else:
        rows = work[work["control"].eq("dt") & work["status"].eq("ok")].sort_values("steps", kind="stable")
        cost = (1e6 * rows["wall_time_min_s"] / rows["steps"]).groupby([rows[c] for c in by]).last()
    counts, typical = cost.groupby("integrator").size(), cost.groupby("integrator").median()
    typical = typical[2 * counts >= counts.max()].sort_values()
    ladder = table[table["status"].ne("ok")]
    ends = limits[limits["limit"].notna() & limits["limit"].ne("none")]
    fails = {*ladder[by].itertuples(index=False, name=None), *ends[by].itertuples(index=False, name=None)}
    never = [m for m in typical.index if not any(m == name for name, _ in fails)]
    one = next(one for title, one in answers(tables, told).items() if "heapest" in title)
    name = never[0] if never else typical.index[0]
    assert one.lead == name and one.text.startswith(f"{typical[name]:.2g} µs a step")
    times = cost.unstack("integrator")
    near = [m for m in never if m != name and (times[m] / times[name]).median() <= 1.2]  # who is as cheap is said
    others = {0: "", 1: f"; {''.join(near)} as cheap"}.get(len(near), f"; {len(near)} others as cheap")
    assert others in one.text and (" as cheap" in one.text) == bool(near) and all(m in said(one) for m in near[:3])
    first = typical.index[0]
    if never and first != name:  # the cheaper one, on how many scenarios it fails, and from which step
        least = min([*ladder[ladder["integrator"] == first]["dt"], *ends[ends["integrator"] == first]["dt_unstable"]])
        where = sum(m == first for m, _ in fails)
        assert f"{first}, {typical[first]:.2g} µs, fails" in said(one) and f"from h = {least:.2g}" in said(one)
        assert f" on {where} of " in said(one)


def test_an_accurate_trajectory_and_the_rows_of_its_lens():
    tables, told = made_up()
    table = tables["time_to_accuracy"]
    times = table[table["measure"].eq("error") & table["target"].eq(1e-6)].pivot(
        index="integrator", columns="scenario", values="time_s"
    )
    ratios = times / times.min()
    reached, worst = ratios.notna().sum(axis=1), ratios.max(axis=1)
    best = pd.DataFrame({"missed": -reached, "worst": worst}).sort_values(["missed", "worst"], kind="stable").index[0]
    one = answers(tables, told)["An accurate trajectory"]
    assert one.lead == best and f"on {reached[best]} of {times.notna().any().sum()} scenarios" in one.text
    behind = (
        f"at most {float(f'{worst[best]:.2g}'):g} times" if worst[best] > 1.2 else "no method is faster by more than"
    )
    near = [m for m in worst.index if m != best and reached[m] == reached[best] and worst[m] <= 1.2 * worst[best]]
    assert all(m in said(one) for m in near[:3]) and ("as fast within the spread" in one.text) == bool(near)
    assert behind in said(one)
    mean = np.log(ratios).mean(axis=1).where(reached > 0, np.inf)
    ranked = pd.DataFrame({"missed": -reached, "mean": mean, "name": mean.index}).sort_values(
        [*("missed", "mean", "name")]
    )
    assert [m for m in order(pairs(tables, told), "time 1e-06") if m in mean.index] == [*ranked.index]


def test_the_coarsest_step():
    tables, told = made_up()
    work, table = tables["work_precision"], tables["conservation"]
    good = kept_all(table) & table["status"].eq("ok")
    keep = {m for m, of in good.groupby(table["integrator"]) if of.all()}
    rows = work[work["control"].eq("dt")]
    rows = rows[np.isclose(rows["value"], rows.groupby("scenario")["value"].transform("max"))]
    wrong = rows[[c for c in ("error_theta", "error_entropy_produced") if c in rows]].max(axis=1)
    wrong = wrong[rows["status"].eq("ok") & rows["integrator"].isin(keep)].dropna()
    one = answers(tables, told).get("At the coarsest step") or answers(tables, told).get(
        f"At h = {rows['value'].max():.3g}"
    )
    worst = wrong.groupby(rows["integrator"]).agg(["size", "max"]).sort_values(["size", "max"], ascending=[False, True])
    shown = worst.loc[one.lead]
    assert (
        shown["size"] == worst["size"].max()
        and shown["max"] <= 1.05 * worst[worst["size"] == shown["size"]]["max"].min()
    )
    share = float(f"{100 * shown['max']:.2g}")
    assert f"{share:g} %" in said(one)


@pytest.mark.parametrize("run", RUNS)
def test_what_fails(run):
    tables, told = RUNS[run]()
    parts, work = [tables["conservation"]], tables.get("work_precision")
    if work is not None:
        fixed = work["control"].eq("dt")
        parts.append(work.assign(dt=work["value"].where(fixed), tolerance=work["value"].mask(fixed)))
    runs = pd.concat(parts)
    runs = runs[~(runs["tolerance"] > 1e-3)] if "tolerance" in runs else runs
    bad = runs[runs["status"].ne("ok")]
    one = answers(tables, told)["What fails"]
    assert one.lead == (f"{len(bad)} of {len(runs)} runs" if len(bad) else "nothing")
    ends = tables["stability"]
    ends = ends[ends["limit"].notna() & ends["limit"].ne("none")]["dt_unstable"]
    if bad["dt"].notna().any():
        assert f"from h = {min(bad['dt'].min(), ends.min()):.2g}" in said(one)
    assert not len(bad) or remarks(tables)[0].startswith(f"{len(bad)} of {len(runs)} runs of the ladders failed")
    cells = [cell for of in failures(tables).values() for cell in of.values()]
    assert sum(cell[0] for cell in cells) == len(bad) + len(unmeasured(tables))
    fell = (runs["status"].eq("ok") & (runs["second_law_violations"] > 0)).sum()
    assert (f"the entropy fell in {fell} of those" in said(one)) == bool(fell)
