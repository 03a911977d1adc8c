"""What a run ends with on a terminal: one row a method, then what failed and the paper's statements."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from statistics import median
from typing import TYPE_CHECKING, Any

from ..chart import Tables
from ..errors import LOUD
from ..systems.energy_scale import HIDDEN
from .page_data import methods, unmeasured
from .pairs import is_finite, ladder_runs, of_whole_state, pairs, times_over_best

if TYPE_CHECKING:
    from pandas import DataFrame

HEADINGS = (
    "method", "claims kept", "order (declared)", "stable step", "to 1e-6", "x best", "failed runs",
    "random failed",
)  # fmt: skip
FAR_OUT = 0.1  # of the exact range of a temperature, beyond which a run is told
REASONS = 4  # sentences on what has no result: the tables have the rest
FOLD_ABOVE = 20  # methods, so that 30 lines hold everything
HOLDS = "holds"


def by_method(tables: Tables, declared: Tables) -> list[list[str]]:
    """HEADINGS, then one row a method: best first within families; SciPy's solvers are one row where many run.

    claims kept: of those that some system of the run can show. stable step: the least over the scenarios, and how many
    have no limit. to 1e-6: scenarios on which the error of the state reached it; x best: its time over that of the
    fastest method, median over all scenarios, infinite where it did not get there. random failed: runs of an
    ensemble, over all steps or tolerances.
    """
    found = pairs(tables, declared)
    rows, ratios = methods(found, tables, declared), times_over_best(found)
    rows.sort(key=lambda r: (r["family"], *_rank(ratios.get(r["name"], [])), r["name"]))
    folded = _scipy(tables) if len(rows) > FOLD_ABOVE else set()
    table = tables.get("failure_share")
    random = (
        {}
        if table is None or not len(table)
        else table.groupby("integrator")[["failed", "runs"]].sum().T.to_dict("list")
    )
    shown = [_row(r, ratios.get(r["name"]), random) for r in rows if r["name"] not in folded]
    group = [r for r in rows if r["name"] in folded]
    if group:
        shown.append(_folded(group, ratios, random))
    used = [i for i in range(len(HEADINGS)) if i == 0 or any(row[i] != "-" for row in shown)]
    return [[HEADINGS[i] for i in used], *([row[i] for i in used] for row in shown)]


def _rank(ratios: Sequence[float]) -> tuple[float, float]:
    return median(ratios) if ratios else math.inf, -sum(map(is_finite, ratios))


def _scipy(tables: Tables) -> set[str]:
    table = tables.get("work_precision")
    return set() if table is None or "peer" not in table else set(table.loc[table["peer"].eq("scipy"), "integrator"])


def _row(r: Mapping[str, Any], ratios: Sequence[float] | None, random: Mapping[str, tuple[int, int]]) -> list[str]:
    reached = [x for x in ratios or () if is_finite(x)]
    return [
        str(r["name"]),
        claims(r["laws"]),
        _order(r["order"]),
        _step(r["step"]),
        f"{len(reached)} of {len(ratios)}" if ratios else "-",
        "-" if not reached else f"{middle:.3g}" if is_finite(middle := median(ratios or ())) else "not on most",
        f"{r['failed']} of {r['runs']}" if r["runs"] else "-",
        _share(*random.get(r["name"], (0, 0))),
    ]


def _share(failed: int, runs: int) -> str:
    if not runs:
        return "-"
    return f"{100 * failed / runs:.3g} % of {runs}" if failed else f"none of {runs}"


def claims(laws: Sequence[Mapping[str, Any]]) -> str:
    """ "2 of 3" claims kept in every run; a claim that no system of the run can show does not count."""
    claimed = [law for law in laws if law["claimed"]]
    shown = [law for law in claimed if law["of"]]
    if not claimed:
        return "none" if any(law["claimed"] is False for law in laws) else "-"
    if not shown:
        return "-"
    kept = sum(law["kept"] == law["of"] for law in shown)
    missing = len(claimed) - len(shown)
    return f"{kept} of {len(shown)}" + (f", {missing} not measured" if missing else "")


def _order(order: Mapping[str, Any] | None) -> str:
    if order is None or order["low"] is None:
        return "-"
    low, high = f"{order['low']:.2f}", f"{order['high']:.2f}"
    declared = f" ({order['declared']:g})" if is_finite(order["declared"]) else ""
    return f"{low if low == high else f'{low}..{high}'}{declared}"


def _step(step: Mapping[str, Any] | None) -> str:
    if step is None or not step["of"]:
        return "-"
    if not step["limited"]:
        return "no limit"
    least = f"{step['least']:.3g}" if step["least"] else "none"
    return f"{least} ({step['of'] - step['limited']} of {step['of']} free)"


def _folded(
    group: Sequence[Mapping[str, Any]], ratios: Mapping[str, Sequence[float]], random: Mapping[str, tuple[int, int]]
) -> list[str]:
    best = min(group, key=lambda r: _rank(ratios.get(r["name"], [])))
    failed, runs = sum(r["failed"] for r in group), sum(r["runs"] for r in group)
    row = _row(best, ratios.get(best["name"]), random)
    return [f"{len(group)} of SciPy's; best: {best['name']}", *row[1:6], f"{failed} of {runs}", row[7]]


def remarks(tables: Tables) -> list[str]:
    """Sentences below the table: what failed, and what the paper's statements came to."""
    ladder = tables.get("conservation")
    said = (
        _failed(tables), *_hidden(ladder), *_beyond(ladder), *_missing(tables), *without_number(tables),
        paper(tables.get("claims")),
    )  # fmt: skip
    return [sentence for sentence in said if sentence]


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
    degrees = f"temperatures from {row['theta_min']:.5g} to {row['theta_max']:.5g}" if "theta_min" in rows else ""
    exact = f", exactly {row['theta_min_exact']:.5g} to {row['theta_max_exact']:.5g}" if degrees else ""
    return [
        f"{len(rows)} runs ended well and left the exact range of temperatures or positive quantities by more than "
        f"{FAR_OUT:.0%} of it, most {row['integrator']} on {row['scenario']} by {row['range_left']:.0%}"
        f"{': ' * bool(degrees)}{degrees}{exact}."
    ]


def _missing(tables: Tables) -> list[str]:
    """What gave no result and which orders none, with the reasons, each reason once."""
    reasons: dict[str, list[str]] = {}
    for item in unmeasured(tables):
        reasons.setdefault(item.why, []).append(f"{item.study} of {item.integrator} on {item.scenario}")
    sentences = [f"No result of {_some(what)}: {why}" for why, what in reasons.items()]
    notes: dict[str, list[str]] = {}
    for row in of_whole_state(tables["convergence"]).to_dict("records") if "convergence" in tables else ():
        if row.get("verdict") == "undetermined" and row.get("status") not in LOUD and isinstance(row.get("note"), str):
            notes.setdefault(row["note"], []).append(f"{row['integrator']} on {row['scenario']}")
    sentences += [f"Order undetermined of {_some(dict.fromkeys(what))}: {note}" for note, what in notes.items()]
    return sentences[:REASONS]


def without_number(tables: Tables) -> list[str]:
    """Which metrics of plugins gave no number, on how many runs, each reason once."""
    table = tables.get("conservation")
    if table is None or "metric_failure" not in table:
        return []
    reasons = Counter(str(text) for text in table["metric_failure"].dropna())
    return [f"{why} ({count} of {len(table)} runs)." for why, count in reasons.most_common(REASONS)]


def _some(names: Iterable[str]) -> str:
    found = list(names)
    return ", ".join(found[:2]) + (f" and {len(found) - 2} more" if len(found) > 2 else "")


def _failed(tables: Tables) -> str:
    ladders = ladder_runs(tables)
    runs, statuses = len(ladders), Counter(str(s) for s in ladders["status"] if s != "ok")
    if not runs:
        return ""
    if not statuses:
        whole = f"All {runs} runs of the ladders of steps and tolerances reached their"
        return f"{whole if runs > 1 else 'The only run reached its'} end."
    parts = ", ".join(f"{count} {status}" for status, count in statuses.most_common())
    return f"{statuses.total()} of {runs} runs of the ladders failed, which is a result: {parts}."


def paper(table: DataFrame | None) -> str:
    """How many statements of Romero (2009) were checked, and what came of it."""
    if table is None or not len(table):
        return ""
    counts = Counter(str(v) for v in table["verdict"] if isinstance(v, str))
    rest = ", ".join(
        f"{n} {verdict if n == 1 else verdict.replace('does', 'do').replace('contradicts', 'contradict')}"
        for verdict, n in counts.items() if verdict != HOLDS
    )  # fmt: skip
    told = f"{counts[HOLDS]} hold" + (f", {rest}" if rest else "")
    return f"The paper's statements: {sum(counts.values())} checked, {told}."
