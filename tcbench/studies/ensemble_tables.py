"""The tables of the study `ensemble`, from the rows of its cells."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .base import Row
from .cost import reach
from .ensemble_runs import KINDS
from .quick_reference import USABLE, distance, reference_for
from .statistics import profile, quantile, wilson

if TYPE_CHECKING:
    from pandas import DataFrame

TARGETS = (("state", 1e-3), ("state", 1e-6), ("state", 1e-9), ("energy", 1e-12))
MEASURES = {"state": "error", "energy": "energy_error"}
TAUS = tuple(float(f"{x:.4g}") for x in np.geomspace(1.0, 100.0, 33))
MIDDLE = 1e-6  # the target whose references an error of the state is measured with
LOST = "lost"  # with its block, which timed out or crashed
FAILED = KINDS[1:6]  # a run that is too slow is not made: it has not failed
SHARE_COLUMNS = (
    "ensemble", "integrator", "dt", "tolerance", "runs", "failed", "share", "low", "high", *FAILED, LOST, "too slow",
    "example", "first_seed",
)  # fmt: skip


def tables(records: Sequence[Row]) -> dict[str, DataFrame]:
    """Every table of the study; of several ensembles (families, or their ranges) one below the other."""
    import pandas as pd

    found: dict[str, list[Row]] = {
        "failure_share": [], "ensemble_laws": [], "ensemble_accuracy": [], "ensemble_points": [],
        "performance_profile": [], "first_share": [], "ensemble_scenarios": [],
    }  # fmt: skip
    for name in dict.fromkeys(record["ensemble"] for record in records):
        here = sorted((r for r in records if r["ensemble"] == name), key=lambda r: (r["integrator"], r["seeds"][0]))
        first = min(r["seeds"][0] for r in here)
        made = _one_ensemble(here)
        for table, rows in made.items():
            found[table] += [{"ensemble": name} | row | {"first_seed": first} for row in rows]
    frames = {table: pd.DataFrame(rows) for table, rows in found.items()}
    if len(frames["failure_share"]):
        frames["failure_share"] = frames["failure_share"].reindex(columns=list(SHARE_COLUMNS))
    return {table: frame for table, frame in frames.items() if len(frame)}


def _one_ensemble(records: Sequence[Row]) -> dict[str, list[Row]]:
    known = scenario_rows(records)
    ladders = with_errors(records, known)
    runs = [*stepped_runs(records), *adaptive_runs(records)]
    profiles, firsts = profile_rows(records, ladders, known)
    return {
        "failure_share": share_rows(runs), "ensemble_laws": law_rows(runs),
        "ensemble_accuracy": accuracy_rows(ladders, known), "ensemble_points": point_rows(ladders, known),
        "performance_profile": profiles, "first_share": firsts,
        "ensemble_scenarios": [{k: v for k, v in row.items() if k != "states"} for row in known.values()],
    }  # fmt: skip


# -- failures and laws


def stepped_runs(records: Sequence[Row]) -> list[Row]:
    """One row a run at a step: integrator, control, value, seed, kind, sentence, laws, broken."""
    found = []
    for record in records:
        if record["part"] != "shares":
            continue
        seeds = range(*record["seeds"])
        gone = LOST if record.get("status") in ("timeout", "crash") else "exception"
        lost: Row = {"kinds": [], "laws": {}, "broken": {}, "sentences": {}}
        rows = record.get("rows") or [lost | {"dt": dt} for dt in record["dt"]]
        for row in rows:
            for i, seed in enumerate(seeds):
                found.append({
                    "integrator": record["integrator"], "claims": record.get("claims", ()), "control": "dt",
                    "value": row["dt"], "seed": seed, "kind": KINDS[row["kinds"][i]] if row["kinds"] else gone,
                    "sentence": row["sentences"].get(str(i), record.get("failure", "")),
                    "laws": {name: values[i] for name, values in row["laws"].items()},
                    "broken": {name: values[i] for name, values in row["broken"].items()},
                })  # fmt: skip
    return found


def adaptive_runs(records: Sequence[Row]) -> list[Row]:
    """The same of adaptive solvers, whose runs are those of the timings; laws of those that were observed."""
    found = []
    for record in records:
        if record["part"] != "timings" or record.get("control") != "tolerance":
            continue
        method = {"integrator": record["integrator"], "claims": record["claims"], "control": "tolerance"}
        for seed, rungs in zip(range(*record["seeds"]), record["ladders"], strict=True):
            for rung in rungs:
                run = {"value": rung["value"], "seed": seed, "kind": KINDS[rung["kind"]]}
                seen = {"laws": rung.get("laws", {}), "broken": rung.get("broken", {})}
                found.append(method | run | seen | {"sentence": rung.get("sentence", "")})
    return found


def share_rows(runs: Sequence[Row]) -> list[Row]:
    """Shares of failed runs with their 95 % intervals; `example`: the first failure's seed and sentence."""
    rows = []
    for (name, control, value), group in grouped(runs, "integrator", "control", "value"):
        made = [run for run in group if run["kind"] != "too slow"]
        failed = [run for run in made if run["kind"] != "ok"]
        low, high = wilson(len(failed), len(made))
        first = min(failed, key=lambda run: run["seed"], default=None)
        rows.append(
            {"integrator": name, control: value, "runs": len(made), "failed": len(failed)}
            | {"share": len(failed) / len(made) if made else math.nan, "low": low, "high": high}
            | {kind: sum(run["kind"] == kind for run in failed) for kind in (*FAILED, LOST)}
            | {"too slow": len(group) - len(made)}
            | {"example": f"seed {first['seed']}: {first['sentence']}" if first else ""}
        )
    return rows


def law_rows(runs: Sequence[Row]) -> list[Row]:
    """Largest error of each law over a run: the worst, 99 % and the median of all runs, and how many broke it."""
    rows = []
    for (name,), group in grouped(runs, "integrator"):
        for law in dict.fromkeys(law for run in group for law in run["laws"]):
            seen = [run for run in group if _is_number(run["laws"].get(law))]
            if not seen:
                continue
            worst = max(seen, key=lambda run: run["laws"][law])
            values = [run["laws"][law] for run in seen]
            rows.append({
                "integrator": name, "law": law, "claimed": law in worst["claims"], "runs": len(seen),
                "broken": sum(run["broken"][law] for run in seen), "worst": worst["laws"][law],
                "quantile_99": quantile(values, 0.99), "median": quantile(values, 0.5), "worst_seed": worst["seed"],
                f"worst_{worst['control']}": worst["value"],
            })  # fmt: skip
    return rows


# -- errors and times


def scenario_rows(records: Sequence[Row]) -> dict[int, Row]:
    """By seed: error bar of the reference, growth of a disturbance, and the solvers' states."""
    rows: dict[int, Row] = {}
    for record in records:
        if record["part"] == "references":
            for seed, found in zip(range(*record["seeds"]), record.get("references") or [], strict=False):
                states = found["states"]
                rows[seed] = {
                    "seed": seed, "reference_gap": found["gap"], "lyapunov": found["lyapunov"], "solvers": len(states),
                    "smallest_target": found["gap"] / USABLE, "states": states,
                }  # fmt: skip
    return rows


def with_errors(records: Sequence[Row], known: Mapping[int, Row], without: str = "") -> dict[str, dict[int, list[Row]]]:
    """Rungs by integrator and seed, each with `error` against a solver of another family; no error, no reference.

    without : a further family whose solvers are not used.
    """
    found: dict[str, dict[int, list[Row]]] = {}
    for record in records:
        if record["part"] != "timings":
            continue
        mine = found.setdefault(record["integrator"], {})
        for seed, rungs in zip(range(*record["seeds"]), record.get("ladders") or [], strict=False):
            states = known[seed]["states"] if seed in known else {}
            exact = reference_for(states, record["own"], without)
            mine[seed] = [_with_error(rung, exact) | {"control": record["control"]} for rung in rungs]
        for seed in range(*record["seeds"]):
            mine.setdefault(seed, [])  # of a cell that was lost: no method gets away with a crash
    return found


def _with_error(rung: Row, exact: Any) -> Row:
    good = rung["kind"] == 0
    error = distance(rung["state"], exact) if good and exact is not None else math.nan
    return rung | {"status": KINDS[rung["kind"]], "error": error, "wall_time_min_s": rung.get("time_s")}


def usable(known: Mapping[int, Row], measure: str, target: float, seeds: Iterable[int]) -> list[int]:
    """The scenarios whose reference is good enough for a target; an error of the energy needs none."""
    if measure == "energy":
        return list(seeds)
    return [seed for seed in seeds if seed in known and known[seed]["reference_gap"] <= USABLE * target]


def accuracy_rows(ladders: Mapping[str, Mapping[int, list[Row]]], known: Mapping[int, Row]) -> list[Row]:
    """Quantiles of error and time of each rung, over the scenarios with a reference good to 1e-7."""
    rows = []
    for name, by_seed in ladders.items():
        good = set(usable(known, "state", MIDDLE, by_seed))
        runs = [rung | {"seed": seed} for seed, rungs in by_seed.items() for rung in rungs]
        for (value,), group in grouped(runs, "value"):
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
) -> tuple[list[Row], list[Row]]:
    """Performance profiles with their bands, and how often each method was the first; over common scenarios."""
    names = sorted(ladders)
    if not names:
        return [], []
    common = sorted(set.intersection(*(set(ladders[name]) for name in names)))
    share_s = next(r["share_s"] for r in records if r["part"] == "timings")
    profiles, firsts = [], []
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
            won = round(middle[j, 0] * len(seeds)) if seeds else 0
            bounds = wilson(won, len(seeds))
            firsts.append(
                what | counts | {"first": won, "reached": int(np.isfinite(times[:, j]).sum())}
                | {"share": middle[j, 0], "low": bounds[0], "high": bounds[1]}
            )  # fmt: skip
    return profiles, firsts


def grouped(rows: Iterable[Row], *columns: str) -> list[tuple[tuple[Any, ...], list[Row]]]:
    """Rows by the values of columns, in the order of the values."""
    found: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        found.setdefault(tuple(row[column] for column in columns), []).append(row)
    return sorted(found.items())


def _is_number(value: Any) -> bool:
    return value is not None and math.isfinite(value)
