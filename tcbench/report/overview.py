"""What the report says first: a few sentences, each computed from the tables, and nothing that they do not carry."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import TYPE_CHECKING, Any

from .matrix import Unmeasured, finite, is_fixed, law_columns, laws_kept, own_steps, unmeasured

if TYPE_CHECKING:
    from pandas import DataFrame

Tables = Mapping[str, Any]
TARGETS = (1e-6, 1e-3)  # errors of an accurate trajectory; the second where no method reaches the first
LONGEST = 40  # characters of a name in a sentence
TURNING = "\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069"  # bidirectional controls
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
    found = (accurate(tables), lawful(tables), cheapest(tables, declared), failing(tables), random_starts(tables))
    return [finding for finding in found if finding is not None]


def accurate(tables: Tables) -> Finding | None:
    """The method that is first to an error of 1e-6 on most scenarios (of 1e-3 where none gets to 1e-6)."""
    table = tables.get("time_to_accuracy")
    if table is None or not len(table):
        return None
    title = "An accurate trajectory"
    table = table[table["measure"].eq("error")]
    scenarios = table["scenario"].nunique()
    for target in TARGETS:
        rows = [r for r in table[table["target"].eq(target)].to_dict("records") if finite(r["time_s"])]
        if not rows:
            continue
        fastest: dict[str, Any] = {}
        for row in sorted(rows, key=lambda r: (r["time_s"], r["integrator"])):
            fastest.setdefault(row["scenario"], row)
        wins = Counter(row["integrator"] for row in fastest.values())
        name = min(wins, key=lambda n: (-wins[n], n))
        reached = [row for row in rows if row["integrator"] == name]
        first = "first to" if table["integrator"].nunique() > 1 else "reached"  # alone, it has overtaken nobody
        where = f"on {wins[name]} of {scenarios} scenario{'s' if scenarios > 1 else ''}"
        text = f"{first} an error of {power(target)} {where}{_against_peers(reached)}"
        return Finding(title, called(name), text, f"#lens=time {target:g}")
    text = f"no method reached an error of {power(TARGETS[-1])} on any scenario"
    return Finding(title, "none", text, "#lens=time 0.001")


def called(name: str) -> str:
    """A name as part of a sentence: short, and without characters that turn the direction of what follows."""
    plain = "".join(c for c in name if c not in TURNING)
    return plain if len(plain) <= LONGEST else f"{plain[: LONGEST - 1]}…"


def power(value: float) -> str:
    """1e-6 without the zero that Python writes."""
    return f"1e{round(math.log10(value))}"


def _against_peers(rows: Sequence[Mapping[str, Any]]) -> str:
    """How a method that is no peer compares with the peers, over the scenarios on which both reach the target."""
    peers = {r["best_peer"] for r in rows if finite(r["ratio_to_best_peer"])}
    scipy = {r["best_scipy"] for r in rows if finite(r["ratio_to_best_scipy"])}
    if not peers or rows[0]["integrator"] in peers:
        return ""
    parts = []
    for column, whom, there in (
        ("ratio_to_best_scipy", "SciPy's best", bool(scipy)),
        ("ratio_to_best_peer", "the best peer", peers != scipy),
    ):
        ratios = [float(r[column]) for r in rows if finite(r[column])]
        if there and ratios:
            factor = median(ratios)
            order = f"{rounded(factor)} times before" if factor >= 1 else f"{rounded(1 / factor)} times behind"
            parts.append(f"{order} {whom} (median of {len(ratios)})")
    return f"; {', '.join(parts)}" if parts else ""


def rounded(value: float) -> str:
    """Two digits, never as a power of ten."""
    return f"{float(f'{value:.2g}'):g}" if value < 1e5 else f"{value:.0f}"


def lawful(tables: Tables) -> Finding | None:
    """The methods that ended every run with every law kept, and the largest step of these runs."""
    table = tables.get("conservation")
    if table is None or not len(table):
        return None
    title, href = "The laws at any step", "#lens=energy"
    columns = law_columns(table)
    shares, steps_of = {}, {}
    for name, rows in table.groupby("integrator", sort=True):
        good = rows["status"].eq("ok") & _all_kept(rows, columns)
        shares[str(name)] = (int(good.sum()), len(rows))
        steps_of[str(name)] = max((float(h) for h in rows["dt"] if finite(h)), default=math.nan)
    keep = [name for name, (good, runs) in shares.items() if good == runs]
    if not keep:
        name = max(shares, key=lambda n: shares[n][0] / shares[n][1])
        good, runs = shares[name]
        most = (
            f"kept every law in every run; {called(name)} in {good} of {runs}" if good else "ended a run with every law"
        )
        return Finding(title, "no method", most, href)
    steps = [steps_of[name] for name in keep if finite(steps_of[name])]
    largest = f", at every step tried, up to h = {min(steps):.3g}" if steps else ""
    runs = sum(shares[name][1] for name in keep)
    words = _listed([law.replace("angular_", "").replace("_", " ") for law in columns], "and")
    return Finding(
        title, f"{len(keep)} of {len(shares)} method{'s' if len(shares) > 1 else ''}",
        f"kept {words} in each of {runs} runs{largest}: {_some(keep)}", href,
    )  # fmt: skip


def _all_kept(rows: DataFrame, columns: Mapping[str, str]) -> Any:
    """Whether a run kept every law that its system has; a run without a completed step kept none."""
    import pandas as pd

    judged = pd.DataFrame({law: laws_kept(rows, law, column) for law, column in columns.items()})
    return judged.ne(False).all(axis=1) & judged.notna().any(axis=1)


def cheapest(tables: Tables, declared: Tables) -> Finding | None:
    """The fixed-step method of the least time a step (median over its scenarios), and where it fails."""
    times = own_steps(tables, declared)
    typical = {name: median(found.values()) for name, found in times.items() if found}
    if not typical:
        return None
    name = min(typical, key=lambda n: (typical[n], n))
    count = len(times[name])
    text = f"{typical[name]:.2g} µs a step, {f'median of {count} scenarios' if count > 1 else 'on one scenario'}"
    return Finding("The cheapest step", called(name), text + _where_it_fails(tables, name), "#lens=cost")


def _where_it_fails(tables: Tables, name: str) -> str:
    """On how many scenarios a method has a largest stable step, or how many of its runs failed."""
    table = tables.get("stability")
    if table is not None and (table["integrator"] == name).any():
        rows = table[(table["integrator"] == name) & table["limit"].notna()]
        ends = rows[rows["limit"].ne("none")]
        first = [float(h) for h in ends["dt_unstable"] if finite(h)]
        if not len(ends):
            return "; no limit of its step found" if len(rows) else ""
        start = f", from h = {min(first):.2g}" if first else ""
        return f"; fails on {len(ends)} of {len(rows)}{start}"
    table = tables.get("conservation")
    if table is None:
        return ""
    rows = table[table["integrator"] == name]
    return f"; {int(rows['status'].ne('ok').sum())} of its {len(rows)} runs failed" if len(rows) else ""


def failing(tables: Tables) -> Finding | None:
    """How many runs of the ladders of steps and tolerances failed, and the smallest step at which one did."""
    runs, failed, steps = 0, 0, []
    for study in ("conservation", "work_precision"):
        table = tables.get(study)
        if table is None or not len(table):
            continue
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
    """Of the first ensemble: the methods that never failed, in how many runs, and the one with the largest share."""
    table = tables.get("failure_share")
    if table is None or not len(table):
        return None
    rows = table[table["ensemble"] == table["ensemble"].iloc[0]]
    runs, failed = (rows.groupby("integrator", sort=True)[c].sum() for c in ("runs", "failed"))
    never = [str(name) for name in runs.sort_values(ascending=False, kind="stable").index if not failed[name]]
    lead = f"{len(never)} of {len(failed)} method{'s' if len(failed) > 1 else ''}" if never else "no method"
    text = f"never failed in {sum(runs[n] for n in never)} runs: {_some(never, 2)}" if never else "ended every run"
    if len(never) < len(failed):
        worst = max(rows.to_dict("records"), key=lambda r: (r["share"] if finite(r["share"]) else -1.0, r["runs"]))
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
