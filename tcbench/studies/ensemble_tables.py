"""The tables of the study `ensemble`, from the rows of its cells."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from operator import itemgetter
from typing import TYPE_CHECKING, Any

import numpy as np

from ..analysis.statistics import profile, quantile, wilson
from ..reference.certified import gap
from ..study import Row
from ..table import Column, Table
from .cost import reach
from .ensemble_runs import KINDS

if TYPE_CHECKING:
    from pandas import DataFrame

USABLE = 0.1  # a scenario counts for a target if what no run in doubles can tell is at most this part of it
TARGETS = (("state", 1e-3), ("state", 1e-6), ("state", 1e-9), ("energy", 1e-12))
MEASURES = {"state": "error", "energy": "energy_error"}
TAUS = tuple(float(f"{x:.4g}") for x in np.geomspace(1.0, 100.0, 33))
MIDDLE = 1e-6  # the target whose references an error of the state is measured with
LOST = "lost"  # with its block, which timed out or crashed
FAILED = KINDS[1:6]  # a run that is too slow is not made: it has not failed
FAILURES = Table(
    "failure_share",
    (
        "ensemble", "integrator", "dt", "tolerance", "runs", "failed", "share", "low", "high", *FAILED, LOST,
        "too slow", "example", "first_seed",
    ),
    key=("dt", "tolerance", "first_seed", "runs"),
    terminal=(
        "integrator", "dt", "tolerance", "runs", "failed", "share", "low", "high", "solver", "branch", "physical",
        "law",
    ),
)  # fmt: skip
LAWS = Table(
    "ensemble_laws",
    (
        "ensemble", "integrator", "law", "claimed", "runs", Column("broken", worse="higher"), "worst",
        Column("quantile_99", short="99 %"), "median", "worst_seed", Column("worst_*"), "first_seed",
    ),
    key=("law", "first_seed", "runs"),
    terminal=("integrator", "law", "claimed", "runs", "broken", "median", "quantile_99", "worst"),
)  # fmt: skip
_quantiles = ("10", "median", "90")
ACCURACY = Table(
    "ensemble_accuracy",
    (
        "ensemble", "integrator", "control", "value", "runs", "without_reference", "failed", "not_begun",
        *(Column(f"error_{q}", worse="larger") for q in _quantiles),
        *(Column(f"time_{q}_s", f"time {q}", unit="s", worse="higher", timing=True) for q in _quantiles), "first_seed",
    ),
    key=("control", "value", "first_seed"),
    long=True,
)  # fmt: skip
POINTS = Table(
    "ensemble_points",
    (
        "ensemble", "integrator", "seed", "control", "value", "error", Column("energy_error", worse="larger"), "time_s",
        "repeats", "first_seed",
    ),
    key=("seed", "control", "value"),
    timed=True,
    long=True,
)  # fmt: skip
PROFILE = Table(
    "performance_profile",
    (
        "ensemble", "integrator", "measure", "target", Column("tau", "time over the fastest method's, τ"), "share",
        "low", "high", "runs", "without_reference", "share_s", "first_seed",
    ),
    derived=True,
    long=True,
)  # fmt: skip
SCENARIOS = Table(
    "ensemble_scenarios",
    (
        "ensemble", "seed", Column("reference_gap", worse="larger"), "lyapunov", "solvers", "floor", "smallest_target",
        "first_seed",
    ),
    key=("seed",),
    long=True,
)  # fmt: skip
TABLES = (FAILURES, LAWS, ACCURACY, POINTS, PROFILE, SCENARIOS)


def tables(records: Sequence[Row]) -> dict[str, DataFrame]:
    """Every table of the study; of several ensembles (families, or their ranges) one below the other."""
    import pandas as pd

    found: dict[str, list[DataFrame]] = {}
    for name in dict.fromkeys(record["ensemble"] for record in records):
        here = sorted((r for r in records if r["ensemble"] == name), key=lambda r: (r["integrator"], r["seeds"][0]))
        first = min(r["seeds"][0] for r in here)
        for table, frame in _one_ensemble(here).items():
            if len(frame):
                frame.insert(0, "ensemble", name)
                found.setdefault(table, []).append(frame.assign(first_seed=first))
    frames = {table: pd.concat(parts, ignore_index=True) for table, parts in found.items()}
    if "failure_share" in frames:
        frames["failure_share"] = frames["failure_share"].reindex(columns=FAILURES.names)
    return frames


def _one_ensemble(records: Sequence[Row]) -> dict[str, DataFrame]:
    import pandas as pd

    known = scenario_rows(records)
    ladders = with_errors(records, known)
    runs = pd.DataFrame([*run_rows(records)])
    scenarios = [{k: v for k, v in row.items() if k != "state"} for row in known.values()]
    rows = {
        "failure_share": share_rows(runs), "ensemble_laws": law_rows(runs),
        "ensemble_accuracy": accuracy_rows(ladders, known), "ensemble_points": point_rows(ladders, known),
        "performance_profile": profile_rows(records, ladders, known), "ensemble_scenarios": scenarios,
    }  # fmt: skip
    return {name: pd.DataFrame(found) for name, found in rows.items()}


# -- failures and laws


def run_rows(records: Sequence[Row]) -> Iterator[Row]:
    """Each run: integrator, claims, control, value, seed, kind, sentence, and for each law its error `law.NAME` and
    whether it was broken, `broken.NAME`. Runs of adaptive solvers are those of the timings; of a cell that timed out or
    crashed all runs are lost."""
    for record in records:
        common = {"integrator": record["integrator"], "claims": frozenset(record.get("claims", ()))}
        seeds = range(*record["seeds"])
        if record["part"] == "shares":
            gone = LOST if record.get("status") in ("timeout", "crash") else "exception"
            for row in record.get("rows") or [{"dt": dt} for dt in record["dt"]]:
                for i, seed in enumerate(seeds):
                    sentence = row.get("sentences", {}).get(str(i), record.get("failure", ""))
                    kind = KINDS[row["kinds"][i]] if "kinds" in row else gone
                    of_laws = {f"law.{name}": values[i] for name, values in row.get("laws", {}).items()}
                    of_laws |= {f"broken.{name}": values[i] for name, values in row.get("broken", {}).items()}
                    told = {"control": "dt", "value": row["dt"], "seed": seed, "kind": kind, "sentence": sentence}
                    yield common | told | of_laws
        elif record["part"] == "timings" and record.get("control") == "tolerance":
            for seed, rungs in zip(seeds, record["ladders"], strict=True):
                for rung in rungs:  # laws of those that were observed
                    of_laws = {f"law.{name}": value for name, value in rung.get("laws", {}).items()}
                    of_laws |= {f"broken.{name}": value for name, value in rung.get("broken", {}).items()}
                    told = {"control": "tolerance", "value": rung["value"], "seed": seed, "kind": KINDS[rung["kind"]]}
                    yield common | told | {"sentence": rung.get("sentence", "")} | of_laws


def share_rows(runs: DataFrame) -> list[Row]:
    """Shares of failed runs with their 95 % intervals; `example`: the first failure's seed and sentence."""
    rows = []
    for (name, control, value), group in runs.groupby(["integrator", "control", "value"]) if len(runs) else ():
        made = group[group["kind"] != "too slow"]
        failed = made[made["kind"] != "ok"]
        low, high = wilson(len(failed), len(made))
        first = failed.loc[failed["seed"].idxmin()] if len(failed) else None
        rows.append(
            {"integrator": name, control: value, "runs": len(made), "failed": len(failed)}
            | {"share": len(failed) / len(made) if len(made) else math.nan, "low": low, "high": high}
            | {kind: int((failed["kind"] == kind).sum()) for kind in (*FAILED, LOST)}
            | {"too slow": len(group) - len(made)}
            | {"example": "" if first is None else f"seed {first['seed']}: {first['sentence']}"}
        )
    return rows


def law_rows(runs: DataFrame) -> list[Row]:
    """Largest error of each law over a run: the worst, 99 % and the median of all runs, and how many broke it."""
    rows = []
    for name, group in runs.groupby("integrator") if len(runs) else ():
        for law in law_names(group):
            seen = group[np.isfinite(group[f"law.{law}"].astype(float))]
            if not len(seen):
                continue
            values = seen[f"law.{law}"].astype(float)
            worst = seen.loc[values.idxmax()]
            rows.append({
                "integrator": name, "law": law, "claimed": law in worst["claims"], "runs": len(seen),
                "broken": int(seen[f"broken.{law}"].sum()), "worst": float(values.max()),
                "quantile_99": quantile(values.to_numpy(), 0.99), "median": quantile(values.to_numpy(), 0.5),
                "worst_seed": worst["seed"], f"worst_{worst['control']}": worst["value"],
            })  # fmt: skip
    return rows


def law_names(runs: DataFrame) -> list[str]:
    """Of the columns law.NAME and broken.NAME of a table of runs."""
    return [name.removeprefix("law.") for name in runs if name.startswith("law.")]


# -- errors and times


def scenario_rows(records: Sequence[Row]) -> dict[int, Row]:
    """By seed: error bar of the reference, growth of a disturbance, and the state at the end."""
    rows: dict[int, Row] = {}
    for record in records:
        if record["part"] == "references":
            for seed, found in zip(range(*record["seeds"]), record.get("references") or [], strict=False):
                floor = math.inf if found["floor"] is None else found["floor"]
                rows[seed] = {
                    "seed": seed, "reference_gap": math.inf if found["gap"] is None else found["gap"],
                    "lyapunov": found["lyapunov"], "solvers": 2, "floor": floor, "smallest_target": floor / USABLE,
                    "state": found["state"],
                }  # fmt: skip
    return rows


def with_errors(records: Sequence[Row], known: Mapping[int, Row]) -> dict[str, dict[int, list[Row]]]:
    """Rungs by integrator and seed, each with its `error`; none where there is no reference."""
    found: dict[str, dict[int, list[Row]]] = {}
    for record in records:
        if record["part"] != "timings":
            continue
        mine = found.setdefault(record["integrator"], {})
        for seed, rungs in zip(range(*record["seeds"]), record.get("ladders") or [], strict=False):
            exact = known[seed]["state"] if seed in known else None
            mine[seed] = [_with_error(rung, exact) | {"control": record["control"]} for rung in rungs]
        for seed in range(*record["seeds"]):
            mine.setdefault(seed, [])  # of a cell that was lost: no method gets away with a crash
    return found


def _with_error(rung: Row, exact: Any) -> Row:
    good = rung["kind"] == 0
    error = gap(rung["state"], exact) if good and exact is not None else math.nan
    return rung | {"status": KINDS[rung["kind"]], "error": error, "wall_time_min_s": rung.get("time_s")}


def usable(known: Mapping[int, Row], measure: str, target: float, seeds: Iterable[int]) -> list[int]:
    """The scenarios of which a run in doubles can tell something at a target; an error of the energy needs none."""
    if measure == "energy":
        return list(seeds)
    return [seed for seed in seeds if seed in known and known[seed]["floor"] <= USABLE * target]


def accuracy_rows(ladders: Mapping[str, Mapping[int, list[Row]]], known: Mapping[int, Row]) -> list[Row]:
    """Quantiles of error and time of each rung, over the scenarios with a reference good to 1e-7."""
    rows = []
    for name, by_seed in ladders.items():
        good = set(usable(known, "state", MIDDLE, by_seed))
        runs = [rung | {"seed": seed} for seed, rungs in by_seed.items() for rung in rungs]
        runs.sort(key=itemgetter("value"))
        for value, rungs in groupby(runs, itemgetter("value")):
            group = list(rungs)
            made = [rung for rung in group if rung["status"] != "too slow"]
            done = [rung for rung in made if rung["status"] == "ok" and rung["seed"] in good]
            row: Row = {"integrator": name, "control": group[0]["control"], "value": value, "runs": len(done)}
            row["without_reference"] = sum(rung["seed"] not in good for rung in made)
            row["failed"] = sum(rung["status"] != "ok" for rung in made)
            row["not_begun"] = len(by_seed) - len(made)
            for column, key, ending in (("error", "error", ""), ("time", "wall_time_min_s", "_s")):
                values = [rung[key] for rung in done]
                for label, q in (("10", 0.1), ("median", 0.5), ("90", 0.9)):
                    row[f"{column}_{label}{ending}"] = quantile(values, q)
            rows.append(row)
    return rows


def point_rows(ladders: Mapping[str, Mapping[int, list[Row]]], known: Mapping[int, Row]) -> list[Row]:
    """Every run that has an error: the cloud whose quantiles `accuracy_rows` gives."""
    return [
        {"integrator": name, "seed": seed, "control": rung["control"], "value": rung["value"], "error": rung["error"]}
        | {"energy_error": rung["energy_error"], "time_s": rung["wall_time_min_s"], "repeats": rung["repeats"]}
        for name, by_seed in ladders.items()
        for seed in usable(known, "state", MIDDLE, by_seed)
        for rung in by_seed[seed]
        if rung["status"] == "ok"
    ]


def times_to(ladders: Mapping[str, Mapping[int, list[Row]]], names: Sequence[str], seeds: Sequence[int], measure: str,
             target: float) -> Any:  # fmt: skip
    """Seconds to a target, shape (scenarios, methods); NaN where it was not reached."""
    times = np.full((len(seeds), len(names)), np.nan)
    for j, name in enumerate(names):
        for i, seed in enumerate(seeds):
            times[i, j] = reach(ladders[name][seed], MEASURES[measure], target)
    return times


def profile_rows(
    records: Sequence[Row], ladders: Mapping[str, Mapping[int, list[Row]]], known: Mapping[int, Row]
) -> list[Row]:
    """Performance profiles with their bands, over common scenarios; at tau = 1 how often each method was the first."""
    names = sorted(ladders)
    if not names:
        return []
    common = sorted(set.intersection(*(set(ladders[name]) for name in names)))
    share_s = next(r["share_s"] for r in records if r["part"] == "timings")
    profiles = []
    for measure, target in TARGETS:
        seeds = usable(known, measure, target, common)
        times = times_to(ladders, names, seeds, measure, target)
        middle, low, high = profile(times, np.array(TAUS))
        counts = {"runs": len(seeds), "without_reference": len(common) - len(seeds), "share_s": share_s}
        for j, name in enumerate(names):
            what = {"integrator": name, "measure": measure, "target": target}
            profiles += [
                what | {"tau": tau, "share": middle[j, k], "low": low[j, k], "high": high[j, k]} | counts
                for k, tau in enumerate(TAUS)
            ]
    return profiles
