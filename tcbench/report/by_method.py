"""What a run ends with on a terminal: one row a method, then what failed and the paper's statements."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from statistics import median
from typing import TYPE_CHECKING, Any

from ..chart import Tables
from ..errors import LOUD
from ..systems.energy_scale import HIDDEN
from .marks import as_text
from .page_data import methods, unmeasured
from .pairs import departed, ladder_runs, of_whole_state, pairs, times_over_best
from .words import ABSENT, is_finite, share_of, some

if TYPE_CHECKING:
    from pandas import DataFrame

HEADINGS = (
    "method", "claims kept", "order (declared)", "stable step", "to 1e-6", "x best", "failed runs",
    "random failed",
)  # fmt: skip
FAR_OUT = 0.1  # of the exact range of a temperature, beyond which a run is told
REASONS = 4  # sentences on what has no result: the tables have the rest
FOLD_ABOVE = 20  # methods, so that 30 lines hold everything


def by_method(tables: Tables, declared: Tables) -> list[list[str]]:
    """HEADINGS, then one row a method: best first within families; SciPy's solvers are one row where many run.

    claims kept: of those that some system of the run can show. stable step: the least over the scenarios, and how many
    have no limit. to 1e-6: scenarios on which the error of the state reached it; x best: its time over that of the
    fastest method, median over all scenarios, infinite where it did not get there. random failed: runs of an
    ensemble, over all steps or tolerances.
    """
    table = pairs(tables, declared)
    ratios, shares = times_over_best(table), tables.get("failure_share")
    random = {} if shares is None else shares.groupby("integrator")[["failed", "runs"]].sum().T.to_dict("list")

    def rank(r: Mapping[str, Any]) -> tuple[Any, ...]:
        of = ratios.get(r["name"], [])
        return median(of) if of else math.inf, -sum(map(is_finite, of)), r["name"]

    rows = sorted(methods(table, tables, declared), key=lambda r: (r["family"], *rank(r)))
    work = tables.get("work_precision")
    group = [r for r in rows if work is not None and "peer" in work and len(rows) > FOLD_ABOVE
             and r["name"] in {*work.loc[work["peer"].eq("scipy"), "integrator"]}]  # fmt: skip
    shown = [_row(r, ratios.get(r["name"]), random) for r in rows if r not in group]
    if group:
        best = min(group, key=rank)
        failed = share_of(sum(r["failed"] for r in group), sum(r["runs"] for r in group))
        row = _row(best, ratios.get(best["name"]), random)
        shown.append([f"{len(group)} of SciPy's; best: {best['name']}", *row[1:6], failed, row[7]])
    used = [i for i in range(len(HEADINGS)) if i == 0 or any(row[i] != ABSENT for row in shown)]
    return [[HEADINGS[i] for i in used], *([row[i] for i in used] for row in shown)]


def _row(r: Mapping[str, Any], ratios: Sequence[float] | None, random: Mapping[str, Sequence[int]]) -> list[str]:
    reached, middle = sum(map(is_finite, ratios or ())), median(ratios) if ratios else math.inf
    failed, runs = random.get(r["name"], (0, 0))
    share = f"{100 * failed / runs:.3g} % of {runs}" if failed else f"none of {runs}"
    return [
        str(r["name"]),
        claims(r["laws"]),
        _order(r["order"]),
        _step(r["step"]),
        share_of(reached, len(ratios or ())),
        f"{middle:.3g}" if is_finite(middle) else "not on most" if reached else ABSENT,
        share_of(r["failed"], r["runs"]),
        share if runs else ABSENT,
    ]


def claims(laws: Sequence[Mapping[str, Any]]) -> str:
    """ "2 of 3" claims kept in every run; a claim that no system of the run can show does not count."""
    claimed = [law for law in laws if law["claimed"]]
    shown = [law for law in claimed if law["of"]]
    if not shown:
        return "none" if not claimed and any(law["claimed"] is False for law in laws) else ABSENT
    missing = f", {len(claimed) - len(shown)} not measured" if len(claimed) > len(shown) else ""
    return share_of(sum(law["kept"] == law["of"] for law in shown), len(shown)) + missing


def _order(order: Mapping[str, Any] | None) -> str:
    if order is None or order["low"] is None:
        return ABSENT
    low, high = f"{order['low']:.2f}", f"{order['high']:.2f}"
    declared = f" ({order['declared']:g})" if is_finite(order["declared"]) else ""
    return f"{low if low == high else f'{low}..{high}'}{declared}"


def _step(step: Mapping[str, Any] | None) -> str:
    if step is None or not step["of"]:
        return ABSENT
    if not step["limited"]:
        return "no limit"
    smallest = f"{step['least']:.3g}" if step["least"] else "none"
    return f"{smallest} ({share_of(step['of'] - step['limited'], step['of'])} free)"


def remarks(tables: Tables) -> list[str]:
    """Sentences below the table: what failed, and what the paper's statements came to."""
    ladder = tables.get("conservation")
    return [*_failed(tables), *_hidden(ladder), *_beyond(ladder),
            *lost(tables), *_missing(tables), *without_number(tables),
            *filter(None, [paper(tables.get("claims"))])]  # fmt: skip


def lost(tables: Tables) -> list[str]:
    """Of declared invariants that runs depart from."""
    return [f"{text[0].upper()}{text[1:]}." for text in departed(tables)[:REASONS]]


def _failed(tables: Tables) -> list[str]:
    ladders = ladder_runs(tables)
    bad = ladders.loc[ladders["status"].ne("ok"), "mark"]
    if len(bad):
        how = as_text(bad.value_counts().to_dict())
        return [f"{share_of(len(bad), len(ladders))} runs of the ladders failed, which is a result: {how}."]
    whole = f"All {len(ladders)} runs of the ladders of steps and tolerances reached their"
    return [f"{whole if len(ladders) > 1 else 'The only run reached its'} end."] if len(ladders) else []


def _hidden(table: DataFrame | None) -> list[str]:
    """Scenarios whose energy cannot be judged: its round-off is as large as what moves."""
    if table is None or "energy_round_off" not in table:
        return []
    rows = table[table["energy_round_off"] > HIDDEN].drop_duplicates("scenario")
    return [
        f"No verdict on the energy on {name}: E is a sum of terms so large that its round-off is {share:.2g} of what "
        "moves. Count a bath's energy from its start: C T0 expm1(s/C) for C T0 exp(s/C)."
        for name, share in zip(rows["scenario"], rows["energy_round_off"], strict=True)
    ]


def _beyond(table: DataFrame | None) -> list[str]:
    """Of the runs that ended well the one that left the exact range of temperatures by most: no law forbids it."""
    if table is None or "range_left" not in table:
        return []
    rows = table[table["status"].eq("ok") & (table["range_left"] > FAR_OUT)].sort_values("range_left")
    if not len(rows):
        return []
    row = rows.iloc[-1]
    exact = (": temperatures from {theta_min:.5g} to {theta_max:.5g}, exactly {theta_min_exact:.5g} to "
             "{theta_max_exact:.5g}".format_map(row) if "theta_min" in rows else "")  # fmt: skip
    return [
        f"{len(rows)} runs ended well and left the exact range of temperatures or positive quantities by more than "
        f"{FAR_OUT:.0%} of it, most {row['integrator']} on {row['scenario']} by {row['range_left']:.0%}{exact}."
    ]


def _missing(tables: Tables) -> list[str]:
    """What gave no result and which orders none, with the reasons, each reason once."""
    said = [(f"No result of {{}}: {one.why}", f"{one.study} of {one.where}") for one in unmeasured(tables)]
    if (fits := tables.get("convergence")) is not None and {"note", "verdict"} <= {*fits}:
        whole = of_whole_state(fits).reindex(columns=["integrator", "scenario", "note", "verdict", "status"])
        unclear = whole[whole["verdict"].eq("undetermined") & whole["note"].notna() & ~whole["status"].isin(LOUD)]
        said += [(f"Order undetermined of {{}}: {note}", f"{m} on {s}") for m, s, note, *_ in unclear.to_numpy()]
    reasons: dict[str, dict[str, None]] = {}
    for why, what in said:
        reasons.setdefault(why, {})[what] = None
    return [why.replace("{}", some(what, 2), 1) for why, what in reasons.items()][:REASONS]


def without_number(tables: Tables) -> list[str]:
    """Which metrics of plugins gave no number, on how many runs, each reason once."""
    table = tables.get("conservation")
    if table is None or "metric_failure" not in table:
        return []
    reasons = Counter(str(text) for text in table["metric_failure"].dropna())
    return [f"{why} ({count} of {len(table)} runs)." for why, count in reasons.most_common(REASONS)]


def paper(table: DataFrame | None) -> str:
    """How many statements of Romero (2009) were checked, and what came of it."""
    if table is None or not len(table):
        return ""
    counts = Counter(str(v) for v in table["verdict"] if isinstance(v, str))
    verdicts = [f"{counts['holds']} hold"]
    for verdict, n in counts.items():
        plural = verdict.replace("does", "do").replace("contradicts", "contradict")
        verdicts += [f"{n} {verdict if n == 1 else plural}"] if verdict != "holds" else []
    return f"The paper's statements: {counts.total()} checked, {', '.join(verdicts)}."
