"""What the report says first: a few sentences, each computed from the tables, and nothing that they do not carry."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import TYPE_CHECKING, Any

from .matrix import (
    Unmeasured,
    coarse_errors,
    finite,
    is_fixed,
    law_columns,
    laws_kept,
    own_steps,
    to_numbers,
    unmeasured,
)
from .summary import seconds

if TYPE_CHECKING:
    from pandas import DataFrame

Tables = Mapping[str, Any]
TARGETS = (1e-6, 1e-3)  # errors of an accurate trajectory; the second where no method reaches the first
LONGEST = 40  # characters of a name in a sentence
TURNING = "\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069"  # bidirectional controls
TIE = 1.05  # timings that are nearer than this are as good as each other
LOOSE = 1e-3  # tolerances above it ask for so little that a failure says nothing
FEW_RUNS = 50  # from random starts, below which "never failed" says nothing: up to 6 % of failures would not show
FEW_A_STEP = 10  # at one step or tolerance
RESTS_ON = ("conservation", "work_precision", "time_to_accuracy", "cost", "stability", "convergence",
            "equilibrium_summary")  # fmt: skip
NAMED = 3  # methods that a sentence names before it counts the others


@dataclass(frozen=True)
class Finding:
    """One sentence: what it is about, its answer, the rest of it, and the place on the page that shows it."""

    title: str
    lead: str
    text: str
    href: str


def findings(tables: Tables, declared: Tables) -> list[Finding]:
    """The sentences that these tables allow, in the order in which a reader asks."""
    found = (
        accurate(tables), coarse(tables, declared), lawful(tables), cheapest(tables, declared), failing(tables),
        random_starts(tables),
    )  # fmt: skip
    return [finding for finding in found if finding is not None]


def scenario_answers(
    tables: Tables, declared: Tables, scenarios: Iterable[str]
) -> dict[str, list[tuple[str, str, str]]]:
    """Scenario -> (question, answer, the rest of it) of the same rules, asked of its rows alone."""
    found = {}
    for name in scenarios:
        mine = one_scenario(tables, name)
        answers = (accurate(mine), coarse(mine, declared), cheapest(mine, declared), failing(mine))
        found[name] = [(one.title, one.lead, one.text) for one in answers if one is not None]
    return found


def one_scenario(tables: Tables, name: str) -> dict[str, Any]:
    """What is said of a run rests on these tables: their rows of this scenario."""
    return {key: t[t["scenario"].astype(str) == name] for key, t in tables.items() if key in RESTS_ON}


def accurate(tables: Tables) -> Finding | None:
    """The method that reaches an error of 1e-6 on most scenarios (of 1e-3 where none gets to 1e-6) and, of those, is
    never far behind: the one whose largest ratio to the fastest method's time is the least. Methods within 5 % of it
    are named with it."""
    table = tables.get("time_to_accuracy")
    if table is None or not len(table):
        return None
    title = "An accurate trajectory"
    table = table[table["measure"].eq("error")]
    count = table["scenario"].nunique()
    for target in TARGETS:
        rows = [r for r in table[table["target"].eq(target)].to_dict("records") if finite(r["time_s"])]
        if not rows:
            continue
        best: dict[str, float] = {}
        for row in rows:
            best[row["scenario"]] = min(row["time_s"], best.get(row["scenario"], math.inf))
        ratios: dict[str, list[float]] = {}
        for row in rows:
            ratios.setdefault(str(row["integrator"]), []).append(row["time_s"] / best[row["scenario"]])
        names = _surest(ratios)
        ran = dict(table[table["target"].eq(target)].groupby("integrator")["scenario"].nunique())
        special = _where_it_runs(ratios, ran, names[0])
        name = special or names[0]
        worst, reached = max(ratios[name]), len(ratios[name])
        slower = f"at most {rounded(worst)} times the fastest's time" if worst > TIE else "no method is faster"
        compared = slower if table["integrator"].nunique() > 1 else "no other method ran"
        mine = [row for row in rows if row["integrator"] == name]
        where = f"on all {reached} of {count} scenarios that it runs on" if special else _on(reached, count)
        where = f"in {seconds(float(mine[0]['time_s']))}" if count == 1 else where
        text = f"an error of {power(target)} {where}, {compared}{_against_peers(mine)}"
        if special:
            text += f"; {called(names[0])} on {len(ratios[names[0]])}, at most {rounded(max(ratios[names[0]]))} times"
            return Finding(title, f"{called(name)}, else {called(names[0])}", text, f"#lens=time {target:g}")
        text += f"; as good within 5 %: {_some(names[1:], 1)}" if names[1:] else ""
        return Finding(title, called(name), text, f"#lens=time {target:g}")
    text = f"no method reached an error of {power(TARGETS[-1])} on any scenario"
    return Finding(title, "none", text, "#lens=time 0.001")


def _surest(found: Mapping[str, Sequence[float]]) -> list[str]:
    """Of numbers by method, one a scenario and small ones better: the method that has most of them and, of those, the
    least of the largest; then the methods with as many whose largest is within 5 % of it."""
    first = min(found, key=lambda name: (-len(found[name]), max(found[name]), name))
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


def power(value: float) -> str:
    """1e-6 without the zero that Python writes."""
    return f"1e{round(math.log10(value))}"


def _against_peers(rows: Sequence[Mapping[str, Any]]) -> str:
    """How a method that is no peer compares with the best peer of each scenario on which both reach the target."""
    ratios = [float(r["ratio_to_best_peer"]) for r in rows if finite(r["ratio_to_best_peer"])]
    if not ratios or rows[0]["integrator"] in {r["best_peer"] for r in rows}:
        return ""
    typical = f"{rounded(median(ratios))} times as long"
    if len(ratios) == 1:
        return f"; the best peer takes {typical}"
    return f"; the best peer takes {typical} (median of {len(ratios)}; at least {rounded(min(ratios))})"


def percent(value: float) -> str:
    return f"{rounded(100 * value)} %"


def rounded(value: float) -> str:
    """Two digits, never as a power of ten."""
    return f"{float(f'{value:.2g}'):g}" if value < 1e5 else f"{value:.0f}"


def lawful(tables: Tables) -> Finding | None:
    """The methods that ended every run with every law kept, and the largest step of these runs."""
    shares = law_shares(tables)
    if not shares:
        return None
    title, href, table = "The laws at any step", "#lens=energy", tables["conservation"]
    keep = [name for name, (good, runs) in shares.items() if good == runs]
    if not keep:
        name = max(shares, key=lambda n: shares[n][0] / shares[n][1])
        good, runs = shares[name]
        most = (
            f"kept every law in every run; {called(name)} in {good} of {runs}" if good else "ended a run with every law"
        )
        return Finding(title, "no method", most, href)
    steps = [float(h) for h in table.groupby("integrator")["dt"].max()[keep] if finite(h)]
    largest = f", at every step tried, up to h = {min(steps):.3g}" if steps else ""
    runs = sum(shares[name][1] for name in keep)
    words = _listed([law.replace("_", " ") for law in law_columns(table)], "and")
    return Finding(
        title, f"{len(keep)} of {len(shares)} method{'s' if len(shares) > 1 else ''}",
        f"kept {words} in each of {runs} runs{largest}: {_some(keep)}", href,
    )  # fmt: skip


def law_shares(tables: Tables) -> dict[str, tuple[int, int]]:
    """Method -> how many runs of the conservation study it ended with every law kept, and of how many."""
    table = tables.get("conservation")
    if table is None or not len(table):
        return {}
    good = table["status"].eq("ok") & _all_kept(table, law_columns(table))
    return {str(name): (int(kept.sum()), len(kept)) for name, kept in good.groupby(table["integrator"], sort=True)}


def _all_kept(rows: DataFrame, columns: Mapping[str, str]) -> Any:
    """Whether a run kept every law that its system has; a run without a completed step kept none."""
    import pandas as pd

    judged = pd.DataFrame({law: laws_kept(rows, law, column) for law, column in columns.items()})
    return judged.ne(False).all(axis=1) & judged.notna().any(axis=1)


def coarse(tables: Tables, declared: Tables) -> Finding | None:
    """Of the methods that kept every law in every run: the one whose temperatures at the end are least wrong at the
    coarsest step of each scenario, by its worst scenario; and those of the cheapest of them, for what that costs."""
    lawful_ones = {name for name, (good, runs) in law_shares(tables).items() if good == runs}
    cells = coarse_errors(tables)
    found = {m: [x for x in of.values() if x is not None] for m, of in cells.items() if m in lawful_ones}
    found = {name: errors for name, errors in found.items() if errors}
    if not found:
        return None
    count = len({scenario for of in cells.values() for scenario in of})
    general, *_ = _surest(found)
    name = _where_it_runs(found, {m: len(of) for m, of in cells.items()}, general) or general
    where = f" {_on(len(found[name]), count)}" if count > 1 else ""
    text = f"final temperatures within {percent(max(found[name]))}{where}, each law kept"
    price = own_steps(tables, declared)
    costs = {m: median(price[m].values()) for m in found if price.get(m) and len(found[m]) == len(found[name])}
    cheap = min(costs, key=lambda m: (costs[m], m), default=name)
    if cheap != name:
        text += f"; {called(cheap)}, whose step is the cheapest of these, within {percent(max(found[cheap]))}"
    lead = called(name) if name == general else f"{called(name)}, else {called(general)}"
    if general not in (name, cheap):
        text += f"; {called(general)} within {percent(max(found[general]))} on {len(found[general])}"
    return Finding(_coarsest(tables["work_precision"]), lead, text, "#lens=coarse")


def _coarsest(table: DataFrame) -> str:
    """The question with the step, where there is one."""
    rows = table[table["control"].eq("dt")]
    steps = to_numbers(rows, "value").groupby(rows["scenario"].astype(str)).max().dropna()
    return f"At h = {steps.iloc[0]:.3g}" if len(steps) == 1 else "At the coarsest step"


def cheapest(tables: Tables, declared: Tables) -> Finding | None:
    """The fixed-step method of the least time a step (median over its scenarios) of those that never failed; and where
    one that is cheaper fails. Methods that ran on fewer than half of the scenarios are no candidates."""
    times = own_steps(tables, declared)
    most = max(map(len, times.values()), default=0)
    typical = {name: median(found.values()) for name, found in times.items() if found and 2 * len(found) >= most}
    if not typical:
        return None
    failed = {name: text for name in typical if (text := _where_it_fails(tables, name))}
    first = min(typical, key=lambda n: (typical[n], n))
    name = min((n for n in typical if n not in failed), key=lambda n: (typical[n], n), default=first)
    count = len(times[name])
    text = f"{typical[name]:.2g} µs a step{f', median of {count} scenarios' if count > 1 else ''}"
    if name in failed:
        return Finding(
            "The cheapest step", called(name), f"{text}; {failed[name]}; no method never failed", "#lens=cost"
        )
    if name != first:
        text += f"; {called(first)}, {typical[first]:.2g} µs, {failed[first]}"
    return Finding("Cheapest, never failed", called(name), text, "#lens=cost")


def _where_it_fails(tables: Tables, name: str) -> str:
    """On how many scenarios a method has a largest stable step or a run of its ladder failed; "" where neither."""
    limits: dict[str, float] = {}
    judged: set[str] = set()
    for study, failed, step in (("stability", "limit", "dt_unstable"), ("conservation", "status", "dt")):
        table = tables.get(study)
        rows = None if table is None else table[(table["integrator"] == name) & table[failed].notna()]
        rows = None if rows is None else rows[["scenario", failed, step]]
        for row in rows.to_dict("records") if rows is not None else ():
            judged.add(row["scenario"])
            if row[failed] not in ("none", "ok"):
                at = float(row[step]) if finite(row[step]) else math.inf
                limits[row["scenario"]] = min(at, limits.get(row["scenario"], math.inf))
    start = f" from h = {min(limits.values()):.2g}" if limits and finite(min(limits.values())) else ""
    where = f" on {len(limits)} of {len(judged)}{',' if start else ''}" if len(judged) > 1 else ""
    return f"fails{where}{start}" if limits else ""


def failing(tables: Tables) -> Finding | None:
    """How many runs of the ladders of steps and tolerances failed, and the smallest step at which one did. Tolerances
    above 1e-3 ask for so little that what a solver does with them is no failure, and do not count."""
    runs, failed, steps = 0, 0, []
    for study, control in (("conservation", "tolerance"), ("work_precision", "value")):
        table = tables.get(study)
        if table is None or not len(table):
            continue
        asked = to_numbers(table, control)
        if study == "work_precision":
            asked = asked.where(~table["control"].eq("dt"))
        table = table[~(asked > LOOSE)]
        bad = table[table["status"].ne("ok")]
        runs, failed = runs + len(table), failed + len(bad)
        for row in bad.to_dict("records"):
            step = row.get("dt") if study == "conservation" else row.get("value") if is_fixed(row) else None
            if finite(step):
                steps.append((float(step), str(row["integrator"]), str(row["scenario"])))  # type: ignore[arg-type]
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
        text = f"at the smallest step: {called(least[1])} on {called(least[2])}, h = {least[0]:.2g}"
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
            shares or rows.to_dict("records"), key=lambda r: (r["share"] if finite(r["share"]) else -1.0, r["runs"])
        )
        at = f"h = {worst['dt']:.3g}" if finite(worst["dt"]) else f"tolerance {worst['tolerance']:.0e}"
        text += f"; most often {called(str(worst['integrator']))}, in {worst['failed']} of {worst['runs']} at {at}"
    return Finding("From random starts", lead, text, "#overview=ensemble")


def _listed(words: Iterable[str], last: str) -> str:
    """ "a, b and c"."""
    *head, tail = list(words)
    return f"{', '.join(head)} {last} {tail}" if head else tail


def _some(names: Sequence[str], most: int = NAMED) -> str:
    """The first names, and how many others."""
    rest, names = len(names) - most, [called(name) for name in names]
    return _listed(names, "and") if rest <= 0 else f"{', '.join(names[:most])} and {rest} more"
