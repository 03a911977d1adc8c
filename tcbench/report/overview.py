"""What the report says first: a few sentences, each computed from the tables, and nothing that they do not carry."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from ..chart import Tables
from .judged import TIMES, is_finite, ladder_runs, laws, power, times_over_best
from .matrix import Unmeasured, unmeasured
from .summary import seconds

if TYPE_CHECKING:
    from pandas import DataFrame

TARGETS = ("time 1e-06", "time 0.001")  # to an accurate trajectory; the second where no method reaches the first
ROUND_OFF = 1e-12  # errors below it rank nobody
LONGEST = 40  # characters of a name in a sentence
TURNING = "\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069"  # bidirectional controls
WRONG = {"coarse": "final temperatures", "produced": "entropy produced"}  # errors at the coarsest step
TIE = 1.05  # timings that are nearer than this are as good as each other
FEW_RUNS = 50  # from random starts, below which "never failed" says nothing: up to 6 % of failures would not show
FEW_A_STEP = 10  # at one step or tolerance
LADDERS = ("conservation", "work_precision", "stability", "convergence", "equilibrium_summary")
NAMED = 3  # methods that a sentence names before it counts the others


@dataclass(frozen=True)
class Finding:
    """One sentence: what it is about, its answer, the rest of it, and the place on the page that shows it."""

    title: str
    lead: str
    text: str
    href: str


def findings(found: DataFrame, tables: Tables) -> list[Finding]:
    """The sentences that the judged table allows, in the order in which a reader asks."""
    said = (accurate(found, tables), coarse(found), lawful(found), cheapest(found), failing(found, tables),
            random_starts(tables))  # fmt: skip
    return [finding for finding in said if finding is not None]


def scenario_answers(
    found: DataFrame, tables: Tables, scenarios: Iterable[str]
) -> dict[str, list[tuple[str, str, str]]]:
    """Scenario -> (question, answer, the rest of it) of the same rules, asked of its rows alone."""
    answers = {}
    for name in scenarios:
        mine = one_scenario(found, name)
        ladders = {key: t[t["scenario"].astype(str) == name] for key, t in tables.items() if key in LADDERS}
        said = (accurate(mine, tables), coarse(mine), cheapest(mine), failing(mine, ladders))
        answers[name] = [(one.title, one.lead, one.text) for one in said if one is not None]
    return answers


def one_scenario(found: DataFrame, name: str) -> DataFrame:
    """The rows of a scenario, and the columns that say something of it."""
    return found[found.index.get_level_values("scenario") == name].dropna(axis=1, how="all")


def accurate(found: DataFrame, tables: Tables) -> Finding | None:
    """The method that reaches an error of 1e-6 on most scenarios (of 1e-3 where none gets to 1e-6) and, of those, is
    never far behind: the one whose largest ratio to the fastest method's time is the least. Methods within 5 % of it
    are named with it."""
    asked = [key for key in TARGETS if key in found]
    if not asked:
        return None
    title = "An accurate trajectory"
    key = next((key for key in asked if reached(found, key).any()), None)
    if key is None:
        least = power(TIMES[TARGETS[-1]][1])
        return Finding(title, "none", f"no method reached an error of {least} on any scenario", "#lens=time 0.001")
    times = found.loc[found[key].notna(), key]
    count = times.index.get_level_values("scenario").nunique()
    done = times[reached(found, key)[times.index]]
    every = times_over_best(found, key)
    ratios = {name: there for name, of in every.items() if (there := [r for r in of if r < math.inf])}
    ran = {name: len(of) for name, of in every.items()}
    names = _surest(ratios)
    special = _where_it_runs(ratios, ran, names[0])
    name = special or names[0]
    worst, number = max(ratios[name]), len(ratios[name])
    slower = f"at most {rounded(worst)} times the fastest's time" if worst > TIE else "no method is faster"
    compared = slower if len(ran) > 1 else "no other method ran"
    where = f"on all {number} of {count} scenarios that it runs on" if special else _on(number, count)
    where = f"in {seconds(float(done[name].iloc[0]))}" if count == 1 else where
    peers = _against_peers(tables["time_to_accuracy"], key, name, done[name].index)
    text = f"an error of {power(TIMES[key][1])} {where}, {compared}{peers}"
    if special:
        text += f"; {called(names[0])} on {len(ratios[names[0]])}, at most {rounded(max(ratios[names[0]]))} times"
        return Finding(title, f"{called(name)}, else {called(names[0])}", text, f"#lens={key}")
    text += f"; as good within 5 %: {_some(names[1:], 1)}" if names[1:] else ""
    return Finding(title, called(name), text, f"#lens={key}")


def reached(found: DataFrame, key: str) -> Any:
    """Where a number is known and finite."""
    return found[key].notna() & found[key].ne(math.inf)


def _surest(found: Mapping[str, Sequence[float]], price: Any = MappingProxyType({})) -> list[str]:
    """Of numbers by method, one a scenario and small ones better: the method that has most of them and, of those, the
    least of the largest, of equals the least price; then those with as many whose largest is within 5 % of it."""
    first = min(found, key=lambda name: (-len(found[name]), max(found[name]), price.get(name, math.inf), name))
    most, limit = len(found[first]), TIE * max(found[first])
    others = [name for name in sorted(found) if len(found[name]) == most and max(found[name]) <= limit]
    return [first, *(name for name in others if name != first)]


def _where_it_runs(found: Mapping[str, Sequence[float]], ran: Mapping[str, int], general: str) -> str:
    """The method that is ahead of the most general one, by its worst scenario, where it runs: on half of the scenarios
    or more, and with a number on each of them; "" where there is none."""
    most = max(ran.values())
    names = [n for n in found if len(found[n]) == ran[n] >= most / 2 and max(found[n]) * TIE < max(found[general])]
    name = min(names, key=lambda n: (max(found[n]), n), default="")
    return name if name and len(found[name]) < len(found[general]) else ""


def _on(some: int, count: int) -> str:
    return f"on {some} of {count} scenario{'s' if count > 1 else ''}"


def called(name: str) -> str:
    """A name as part of a sentence: short, and without characters that turn the direction of what follows."""
    plain = "".join(c for c in name if c not in TURNING)
    return plain if len(plain) <= LONGEST else f"{plain[: LONGEST - 1]}…"


def _against_peers(table: DataFrame, key: str, name: str, scenarios: Iterable[str]) -> str:
    """How a method that is no peer compares with the best peer of each scenario on which both reach the target."""
    measure, target = TIMES[key]
    mine = table[table["integrator"].eq(name) & table["measure"].eq(measure) & table["target"].eq(target)]
    mine = mine[mine["scenario"].isin(list(scenarios))]
    ratios = [float(ratio) for ratio in mine["ratio_to_best_peer"] if is_finite(ratio)]
    if not ratios or name in set(mine["best_peer"]):
        return ""
    typical = f"{rounded(median(ratios))} times as long"
    if len(ratios) == 1:
        return f"; the best peer takes {typical}"
    return f"; the best peer takes {typical} (median of {len(ratios)}; at least {rounded(min(ratios))})"


def percent(value: float) -> str:
    """Two digits; what an error is within needs no more than 0.001 %."""
    return f"{rounded(100 * max(value, 1e-5))} %"


def rounded(value: float) -> str:
    """Two digits, never as a power of ten."""
    return f"{float(f'{value:.2g}'):g}" if value < 1e5 else f"{value:.0f}"


def lawful(found: DataFrame) -> Finding | None:
    """The methods that ended every run with every law kept, and the largest step of these runs."""
    shares = law_shares(found)
    if not shares:
        return None
    title, href = "The laws at any step", "#lens=energy"
    keep = lawful_ones(found)
    if not keep:
        name = max(shares, key=lambda n: shares[n][0] / shares[n][1])
        good, runs = shares[name]
        most = (
            f"kept every law in every run; {called(name)} in {good} of {runs}" if good else "ended a run with every law"
        )
        return Finding(title, "no method", most, href)
    steps = [float(h) for h in found.groupby(level="integrator")["dt_most"].max()[keep] if is_finite(h)]
    largest = f", at every step tried, up to h = {min(steps):.2g}" if steps else ""
    runs = sum(shares[name][1] for name in keep)
    named = [law.replace("_", " ") for law in laws(found)]
    invariants = [name for name in named if name not in ("energy", "entropy")]
    if len(invariants) > 1:  # of several systems, each with its own names
        named = [*(name for name in named if name not in invariants), "every invariant"]
    words = _listed(named)
    return Finding(
        title, f"{len(keep)} of {len(shares)} method{'s' if len(shares) > 1 else ''}",
        f"kept {words} in each of {runs} runs{largest}: {_some(keep)}", href,
    )  # fmt: skip


def law_shares(found: DataFrame) -> dict[str, tuple[int, int]]:
    """Method -> how many runs of the conservation study it ended with every law kept, and of how many."""
    if "ladder_runs" not in found:
        return {}
    sums = found[["lawful", "ladder_runs"]].groupby(level="integrator").sum()
    return {str(n): (int(kept), int(runs)) for n, kept, runs in sums.itertuples() if runs}


def lawful_ones(found: DataFrame) -> list[str]:
    """The methods that ended every run with every law kept."""
    return [name for name, (good, runs) in law_shares(found).items() if good == runs]


def coarse(found: DataFrame) -> Finding | None:
    """Of the methods that kept every law in every run: the one that is least wrong at the coarsest step of each
    scenario, by the worse of its two errors on its worst scenario; and those of the cheapest of them, for what that
    costs."""
    if "coarse" not in found:
        return None
    wrong = [column for column in WRONG if column in found]
    ran = found[wrong].max(axis=1)[found["coarse"].notna()]
    known = ran[ran.ne(math.inf) & ran.index.isin(lawful_ones(found), level="integrator")]
    errors = {name: of.clip(lower=ROUND_OFF).tolist() for name, of in known.groupby(level="integrator")}
    if not errors:
        return None
    worst = found.loc[known.index, wrong].groupby(level="integrator").max()

    def within(name: str) -> str:
        return ", ".join(f"{WRONG[c]} within {percent(v)}" for c, v in worst.loc[name].items() if is_finite(v))

    count = ran.index.get_level_values("scenario").nunique()
    price = typical_cost(found)
    general, *_ = _surest(errors, price)
    name = _where_it_runs(errors, ran.groupby(level="integrator").size().to_dict(), general) or general
    where = f" {_on(len(errors[name]), count)}" if count > 1 else ""
    text = f"{within(name)}{where}, each law kept{_divided(found, name)}"
    costs = {m: price[m] for m in errors if m in price and len(errors[m]) == len(errors[name])}
    cheap = min(costs, key=lambda m: (costs[m], m), default=name)
    if cheap != name:
        text += f"; {called(cheap)}, whose step is the cheapest of these: {within(cheap)}"
    lead = called(name) if name == general else f"{called(name)}, else {called(general)}"
    if general not in (name, cheap):
        text += f"; {called(general)} {_on(len(errors[general]), count)}: {within(general)}"
    steps = found.groupby(level="scenario")["dt_coarsest"].max().dropna()
    title = f"At h = {steps.iloc[0]:.3g}" if len(steps) == 1 else "At the coarsest step"
    return Finding(title, lead, text, "#lens=coarse")


def _divided(found: DataFrame, name: str) -> str:
    """Into how many steps of its own a method divided one of the coarsest, where that is most; "" where it did not."""
    if "inner" not in found or not (most := (inner := found.loc[name, "inner"]).max()) > TIE:
        return ""
    where = f" on {called(str(inner.idxmax()))}" if inner.count() > 1 else ""
    return f" (steps that it cannot solve are divided: into {most:.2g} on average{where})"


def typical_cost(found: DataFrame) -> Any:
    """Method -> microseconds a step, median over its scenarios."""
    return found["cost"].dropna().groupby(level="integrator").median() if "cost" in found else {}


def cheapest(found: DataFrame) -> Finding | None:
    """The fixed-step method of the least time a step (median over its scenarios) of those that never failed; and where
    one that is cheaper fails. Methods that ran on fewer than half of the scenarios are no candidates."""
    if "cost" not in found:
        return None
    times = found["cost"].dropna().groupby(level="integrator").size()
    typical = typical_cost(found)[2 * times >= times.max()].to_dict()
    if not typical:
        return None
    failed = {name: text for name in typical if (text := _where_it_fails(found.loc[name]))}
    first = min(typical, key=lambda n: (typical[n], n))
    name = min((n for n in typical if n not in failed), key=lambda n: (typical[n], n), default=first)
    count = times[name]
    text = f"{typical[name]:.2g} µs a step{f', median of {count} scenarios' if count > 1 else ''}"
    if name in failed:
        return Finding(
            "The cheapest step", called(name), f"{text}; {failed[name]}; no method never failed", "#lens=cost"
        )
    if name != first:
        text += f"; {called(first)}, {typical[first]:.2g} µs, {failed[first]}"
    return Finding("Cheapest, never failed", called(name), text, "#lens=cost")


def _where_it_fails(mine: DataFrame) -> str:
    """On how many scenarios a method has a largest stable step or a run of its ladder failed; "" where neither."""
    tried = mine["fails"].dropna() if "fails" in mine else ()
    count, start = int(sum(tried)), ""
    if not count:
        return ""
    if is_finite(least := mine["fails_from"].min()):
        start = f" from h = {least:.2g}"
    where = f" on {count} of {len(tried)}{',' if start else ''}" if len(tried) > 1 else ""
    return f"fails{where}{start}"


def failing(found: DataFrame, tables: Tables) -> Finding | None:
    """How many runs of the ladders of steps and tolerances failed, and the smallest step at which one did, there or in
    the search for the largest stable step."""
    ladders = ladder_runs(tables)
    bad = ladders[ladders["status"].ne("ok")]
    runs, failed = len(ladders), len(bad)
    known = [(bad["dt"], bad["integrator"], bad["scenario"])]
    if "fails_from" in found:
        known.append((found["fails_from"], *(found.index.get_level_values(of) for of in ("integrator", "scenario"))))
    steps = [(h, str(m), str(s)) for of in known for h, m, s in zip(*of, strict=True) if is_finite(h)]
    without = unmeasured(tables)
    if not runs and without:
        return Finding("What fails", _without(without), without[0].sentence, "#failures")
    if not runs:
        return None
    if not failed:
        text = f"all {runs} runs of the ladders reached their end"
        if without:
            return Finding("What fails", _without(without), f"{without[0].sentence}; {text}", "#failures")
        return Finding("What fails", "nothing", text.replace(" of the ladders", ""), "#failures")
    least = min(steps, default=None)
    text = "no run with a fixed step among them"
    if least is not None:
        where = f" on {called(least[2])}" if ladders["scenario"].nunique() > 1 else ""
        text = f"at the smallest step: {called(least[1])}{where}, from h = {least[0]:.2g}"
    text += f"; {_without(without)} besides" if without else ""
    return Finding("What fails", f"{failed} of {runs} runs", text, "#failures")


def _without(rows: Sequence[Unmeasured]) -> str:
    return f"{len(rows)} measurement{'s' * (len(rows) > 1)} without a result"


def random_starts(tables: Tables) -> Finding | None:
    """Of the first ensemble: the methods that never failed, in how many runs, and the one with the largest share. A
    method that had fewer than 50 runs, and not as many as any, has not shown that it never fails."""
    table = tables.get("failure_share")
    if table is None or not len(table):
        return None
    rows = table[table["ensemble"] == table["ensemble"].iloc[0]]
    runs, failed = (rows.groupby("integrator", sort=True)[c].sum() for c in ("runs", "failed"))
    enough = runs >= min(FEW_RUNS, runs.max())
    never = [str(n) for n in runs.sort_values(ascending=False, kind="stable").index if enough[n] and not failed[n]]
    judged = int((enough | (failed > 0)).sum())
    lead = f"{len(never)} of {judged} method{'s' if judged > 1 else ''}" if never else "no method"
    text = f"never failed in {sum(runs[n] for n in never)} runs: {_some(never, 2)}" if never else "ended every run"
    if judged < len(runs):
        text += f" ({len(runs) - judged} with fewer than {min(FEW_RUNS, runs.max())} runs not counted)"
    if failed.any():
        shares = [
            r for r in rows.to_dict("records") if r["failed"] and r["runs"] >= min(FEW_A_STEP, rows["runs"].max())
        ]
        worst = max(
            shares or rows.to_dict("records"), key=lambda r: (r["share"] if is_finite(r["share"]) else -1.0, r["runs"])
        )
        at = f"h = {worst['dt']:.3g}" if is_finite(worst["dt"]) else f"tolerance {power(worst['tolerance'])}"
        text += f"; most often {called(str(worst['integrator']))}, in {worst['failed']} of {worst['runs']} at {at}"
    return Finding("From random starts", lead, text, "#overview=ensemble")


def _listed(words: Iterable[str]) -> str:
    """ "a, b and c"."""
    *head, tail = list(words)
    return f"{', '.join(head)} and {tail}" if head else tail


def _some(names: Sequence[str], most: int = NAMED) -> str:
    """The first names, and how many others."""
    rest, names = len(names) - most, [called(name) for name in names]
    return _listed(names) if rest <= 0 else f"{', '.join(names[:most])} and {rest} more"
