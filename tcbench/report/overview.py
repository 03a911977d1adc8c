"""What the report says first: short answers, each computed from the tables, with what else can be said behind them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from statistics import median
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

from ..chart import Tables
from . import marks
from .page_data import Unmeasured, unmeasured
from .pairs import TIMES, departed, ladder_runs, laws, times_over_best
from .words import called, is_finite, listed, percent, power, rounded, seconds, some

if TYPE_CHECKING:
    from pandas import DataFrame

TARGETS = ("time 1e-06", "time 0.001")  # to an accurate trajectory; the second where no method reaches the first
ROUND_OFF = 1e-12  # errors below it rank nobody
WRONG = {"coarse": "final temperatures", "produced": "entropy produced"}  # errors at the coarsest step
# Timings nearer than this rank nobody: in a full run nine of ten methods take as long a step, up to it, in the two runs
# of most steps that they have on a scenario.
SPREAD = 1.2
FEW_RUNS = 50  # from random starts, below which "never failed" says nothing: up to 6 % of failures would not show
LADDERS = ("conservation", "work_precision", "stability", "convergence", "equilibrium_summary")
PEERS = {"scipy": "SciPy"}  # packages of several solvers


class Finding(NamedTuple):
    """An answer: what it is about, who, one number, the place on the page that shows it, and sentences behind it."""

    title: str
    lead: str
    text: str
    href: str
    more: Sequence[str] = ()


def findings(results: DataFrame, tables: Tables, declared: Tables = MappingProxyType({})) -> list[Finding]:
    """The answers that the table of pairs allows, in the order in which a reader asks."""
    laws = coarse(results), lawful(results), cheapest(results)
    said = accurate(results, tables, declared), *laws, failing(results, tables), random_starts(tables)
    return [finding for finding in said if finding is not None]


def scenario_answers(
    results: DataFrame, tables: Tables, scenarios: Iterable[str]
) -> dict[str, list[tuple[str, str, str]]]:
    """Scenario -> (question, answer, its number) of the same rules, asked of its rows alone."""
    answers = {}
    for name in scenarios:
        mine = results[results.index.get_level_values("scenario") == name].dropna(axis=1, how="all")
        ladders = {key: t[t["scenario"].astype(str) == name] for key, t in tables.items() if key in LADDERS}
        said = (accurate(mine, tables), coarse(mine), cheapest(mine), failing(mine, ladders))
        answers[name] = [one[:3] for one in said if one is not None]
    return answers


def accurate(results: DataFrame, tables: Tables, declared: Tables = MappingProxyType({})) -> Finding | None:
    """The method that reaches an error of 1e-6 on most scenarios (of 1e-3 where none gets to 1e-6) and, of those, is
    never far behind: the one whose largest ratio to the fastest method's time is the least."""
    if not (asked := [key for key in TARGETS if key in results]):
        return None
    title = "An accurate trajectory"
    key = next((key for key in asked if (results[key] < math.inf).any()), None)
    if key is None:
        loosest = power(TIMES[TARGETS[-1]][1])
        return Finding(title, "none", f"no method reached an error of {loosest} on any scenario", "#lens=time 0.001")
    every = times_over_best(results, key)
    ratios = {name: reached for name, of in every.items() if (reached := [r for r in of if r < math.inf])}
    name, *tied = _surest(ratios)
    count, times, worst = results[key].groupby(level="scenario").any().sum(), results.loc[name, key], max(ratios[name])
    where = f"in {seconds(float(times.min()))}" if count == 1 else f"on {len(ratios[name])} of {count} scenarios"
    far = f"at most {rounded(worst)} times the fastest's time"
    behind = far if worst > SPREAD else f"no method is faster by more than the spread of timings, {percent(SPREAD - 1)}"
    beside, named = _equals("fast", tied)
    more = ["no other method ran" if len(every) == 1 else behind, *named, *_peers(tables, key, name, declared)]
    return Finding(title, called(name), f"an error of {power(TIMES[key][1])} {where}{beside}", f"#lens={key}", more)


def _equals(what: str, names: Sequence[str]) -> tuple[str, list[str]]:
    """Who is as fast or cheap within the spread of timings: what follows the one number, and their names behind it."""
    if not names:
        return "", []
    others = called(names[0]) if len(names) == 1 else f"{len(names)} others"
    beside = f"; {others} as {what} within the spread of timings"
    return beside, [f"as {what}: {some(map(called, names))}"] if len(names) > 1 else []


def _surest(numbers: Mapping[str, Sequence[float]], price: Any = MappingProxyType({})) -> list[str]:
    """Of numbers by method, one a scenario and small ones better: the method that has most of them and, of those, the
    least of the largest, of equals the least price; then those with as many whose largest is within SPREAD of it."""
    first = min(numbers, key=lambda name: (-len(numbers[name]), max(numbers[name]), price.get(name, math.inf), name))
    most, limit = len(numbers[first]), SPREAD * max(numbers[first])
    others = [name for name in sorted(numbers) if len(numbers[name]) == most and max(numbers[name]) <= limit]
    return [first, *(name for name in others if name != first)]


def _peers(tables: Tables, key: str, name: str, declared: Tables) -> list[str]:
    """Which packages the method is compared with, which are not installed, and the best peer's time over its own."""
    (measure, target), table, work = TIMES[key], tables["time_to_accuracy"], tables.get("work_precision")
    mine = table[table["integrator"].eq(name) & table["measure"].eq(measure) & table["target"].eq(target)]
    ratios = [float(ratio) for ratio in mine["ratio_to_best_peer"] if is_finite(ratio)]
    if not ratios or name in set(mine["best_peer"]):
        return []
    peers = () if work is None or "peer" not in work else zip(work["peer"].fillna(""), work["integrator"], strict=True)
    packages = sorted({PEERS.get(peer, called(method)) for peer, method in peers if peer})
    absent = ", ".join(map(str, declared.get("absent", {})))
    beside = f"beside {listed(packages)}" if packages else "beside the peers of this run"
    gap = f" ({absent} not installed)" if absent else ""
    middle, of = rounded(median(ratios)), ""
    if len(ratios) > 1:
        of = f", median of {len(ratios)} scenarios, on none less than {rounded(min(ratios))} times"
    return [f"{beside}{gap}, of which the fastest takes {middle} times as long{of}"]


def lawful(results: DataFrame) -> Finding | None:
    """The methods that ended every run with every law kept, and the largest step of these runs."""
    if not (shares := law_shares(results)):
        return None
    title, href, keep = "The laws at any step", "#lens=energy", lawful_ones(results)
    if not keep:
        name = max(shares, key=lambda n: shares[n][0] / shares[n][1])
        good, runs = shares[name]
        most = f"kept every law in every run; {called(name)} in {good} of {runs}"
        return Finding(title, "no method", most if good else "ended a run with every law", href)
    named = [law.replace("_", " ") for law in laws(results)]
    if len(named) > 3:  # of several systems, each with its own names
        named = [*(name for name in named if name in ("energy", "entropy")), "every invariant"]
    more = [some(map(called, keep)), f"in each of {sum(shares[name][1] for name in keep)} runs"]
    steps = results.groupby(level="integrator")["dt_most"].max()[keep].dropna()
    more += [f"at every step tried, up to h = {steps.min():.2g}"] if len(steps) else []
    return Finding(title, _of_methods(keep, shares), f"kept {listed(named)} in every run", href, more)


def _of_methods(some: Sequence[Any], of: Any) -> str:
    return f"{len(some)} of {len(of)} method{'s' if len(of) > 1 else ''}"


def law_shares(results: DataFrame) -> dict[str, tuple[int, int]]:
    """Method -> how many runs of the conservation study it ended with every law kept, and of how many."""
    if "ladder_runs" not in results:
        return {}
    sums = results[["lawful", "ladder_runs"]].groupby(level="integrator").sum()
    return {str(n): (int(kept), int(runs)) for n, kept, runs in sums.itertuples() if runs}


def lawful_ones(results: DataFrame) -> list[str]:
    """The methods that ended every run with every law kept."""
    return [name for name, (good, runs) in law_shares(results).items() if good == runs]


def coarse(results: DataFrame) -> Finding | None:
    """Of the methods that kept every law in every run: the one that is least wrong at the coarsest step of each
    scenario, by the worse of its two errors on its worst scenario; and the cheapest of them, for what that costs."""
    if "coarse" not in results:
        return None
    wrong = [column for column in WRONG if column in results]
    ran = results[wrong].max(axis=1)[results["coarse"].notna()]
    judged = ran[ran.ne(math.inf) & ran.index.isin(lawful_ones(results), level="integrator")]
    errors = {name: of.clip(lower=ROUND_OFF).tolist() for name, of in judged.groupby(level="integrator")}
    if not errors:
        return None
    worst, price = results.loc[judged.index, wrong].groupby(level="integrator").max(), typical_cost(results)

    def within(name: str) -> list[str]:
        return [f"{WRONG[c]} within {percent(v)}" for c, v in worst.loc[name].items() if is_finite(v)]

    name, count = _surest(errors, price)[0], ran.index.get_level_values("scenario").nunique()
    text, *more = within(name)
    more += [f"on {len(errors[name])} of {count} scenarios"] if count > 1 else []
    if "inner" in results and (most := results.loc[name, "inner"].max()) > 1.05:
        more.append(f"steps that it cannot solve are divided, into {most:.2g} on average where that is most")
    others = sorted((m for m in errors if m in price and len(errors[m]) == len(errors[name])), key=lambda m: price[m])
    equal = [m for m in others if m in as_cheap(results, others[0])]
    cheap = min(equal, key=lambda m: max(errors[m]), default=name)
    rank = f"the cheapest of these{' within the spread of timings' * (len(equal) > 1)}"
    more += [f"{called(cheap)}, whose step is {rank}: {', '.join(within(cheap))}"] * (cheap != name)
    steps = results.groupby(level="scenario")["dt_coarsest"].max().dropna()
    title = f"At h = {steps.iloc[0]:.3g}" if len(steps) == 1 else "At the coarsest step"
    return Finding(title, called(name), text, "#lens=coarse", ["each law kept", *more])


def typical_cost(results: DataFrame) -> Any:
    """Method -> microseconds a step, median over its scenarios."""
    return results["cost"].dropna().groupby(level="integrator").median() if "cost" in results else {}


def as_cheap(results: DataFrame, name: str) -> list[str]:
    """The methods whose step takes at most SPREAD times that of one, in the median of the scenarios of both."""
    costs = results["cost"].unstack("integrator")
    ratios = costs.div(costs[name], axis=0).median()
    return [str(m) for m in ratios.index[ratios <= SPREAD]]


def cheapest(results: DataFrame) -> Finding | None:
    """The fixed-step method of the least time a step (median over its scenarios) of those that never failed; who is as
    cheap within the spread of timings; and where one that is cheaper fails. Methods that ran on fewer than half of the
    scenarios are no candidates."""
    if "cost" not in results:
        return None
    times = results["cost"].dropna().groupby(level="integrator").size()
    typical = typical_cost(results)[2 * times >= times.max()].sort_values(kind="stable")
    if not len(typical):
        return None
    failed = {name: text for name in typical.index if (text := _where_it_fails(results.loc[name]))}
    first, href = typical.index[0], "#lens=cost"
    name = next((name for name in typical.index if name not in failed), first)
    text, of = f"{rounded(typical[name])} µs a step", times[name]
    more = [f"median of {of} scenarios"] if of > 1 else []
    if name in failed:
        more.append("no method never failed")
        return Finding("The cheapest step", called(name), f"{text}; {failed[name]}", href, more)
    near = as_cheap(results, name)
    beside, named = _equals("cheap", [m for m in typical.index if m in near and m not in failed and m != name])
    text, more = text + beside, [*more, *named]
    more += [f"{called(first)}, {rounded(typical[first])} µs, {failed[first]}"] if name != first else []
    return Finding("Cheapest, never failed", called(name), text, href, more)


def _where_it_fails(mine: DataFrame) -> str:
    """On how many scenarios a method has a largest stable step or a run of its ladder failed; "" where neither."""
    tried = mine["fails"].dropna() if "fails" in mine else ()
    if not (count := int(sum(tried))):
        return ""
    start = f" from h = {smallest:.2g}" if is_finite(smallest := mine["fails_from"].min()) else ""
    where = f" on {count} of {len(tried)}{',' if start else ''}" if len(tried) > 1 else ""
    return f"fails{where}{start}"


def failing(results: DataFrame, tables: Tables) -> Finding | None:
    """How many runs of the ladders of steps and tolerances failed and how, on how many more the entropy fell, and the
    smallest step at which one failed, there or in the search for the largest stable step."""
    import pandas as pd

    ladders, without = ladder_runs(tables), unmeasured(tables)
    bad, counts = ladders[ladders["status"].ne("ok")], ladders["mark"].value_counts().to_dict()
    title, href, ended = "What fails", "#failures", f"all {len(ladders)} runs reached their end"
    fell = [f"the entropy fell in {n} of those that reached their end"] if (n := counts.pop("S", 0)) else []
    fell += [text.partition(";")[0] for text in departed(tables)]
    if without and not len(bad):
        return Finding(title, _without(without), without[0].sentence, href, [ended, *fell] if len(ladders) else [])
    if not len(bad):
        return Finding(title, "nothing", ended, href, fell) if len(ladders) else None
    steps = bad.set_index(["integrator", "scenario"])["dt"].dropna()
    if "fails_from" in results:
        steps = pd.concat([steps, results["fails_from"].dropna()])
    smallest = "no run with a fixed step among them"
    if len(steps):
        method, scenario = min(steps[steps.eq(steps.min())].index)
        where = f" on {called(scenario)}" if ladders["scenario"].nunique() > 1 else ""
        smallest = f"at the smallest step: {called(method)}{where}, from h = {steps.min():.2g}"
    more = [smallest, *fell, *([f"{_without(without)} besides"] if without else [])]
    return Finding(title, f"{len(bad)} of {len(ladders)} runs", marks.as_text(counts), href, more)


def _without(rows: Sequence[Unmeasured]) -> str:
    return f"{len(rows)} measurement{'s' * (len(rows) > 1)} without a result"


def random_starts(tables: Tables) -> Finding | None:
    """Of the first ensemble: the methods that never failed, in how many runs, and the one with the largest share. A
    method that had fewer than 50 runs, and not as many as any, has not shown that it never fails."""
    table = tables.get("failure_share")
    if table is None or not len(table):
        return None
    sums = table[table["ensemble"] == table["ensemble"].iloc[0]].groupby("integrator")[["runs", "failed"]].sum()
    most = min(FEW_RUNS, sums["runs"].max())
    enough = sums[(sums["runs"] >= most) | (sums["failed"] > 0)].sort_values("runs", ascending=False, kind="stable")
    never, share = enough.index[enough["failed"].eq(0)], sums["failed"] / sums["runs"]
    text = f"never failed in {sums.loc[never, 'runs'].sum()} runs" if len(never) else "ended every run"
    more = [some(map(called, never), 2)] if len(never) else []
    more += [f"{few} with fewer than {most} runs not counted"] if (few := len(sums) - len(enough)) else []
    more += [f"most often {called(share.idxmax())}, in {100 * share.max():.2g} % of its runs"] if share.any() else []
    lead = _of_methods(never, enough) if len(never) else "no method"
    return Finding("From random starts", lead, text, "#overview=ensemble", more)
