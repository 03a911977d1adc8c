"""The tables of the study `ensemble`, from the rows of its cells."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
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

    parts_of: dict[str, list[DataFrame]] = {}
    for name in dict.fromkeys(record["ensemble"] for record in records):
        here = sorted((r for r in records if r["ensemble"] == name), key=lambda r: (r["integrator"], r["seeds"][0]))
        first = min(r["seeds"][0] for r in here)
        for table, frame in _one_ensemble(here).items():
            if len(frame):
                frame.insert(0, "ensemble", name)
                parts_of.setdefault(table, []).append(frame.assign(first_seed=first))
    frames = {table: pd.concat(parts, ignore_index=True) for table, parts in parts_of.items()}
    if "failure_share" in frames:
        frames["failure_share"] = frames["failure_share"].reindex(columns=FAILURES.names)
    return frames


def _one_ensemble(records: Sequence[Row]) -> dict[str, DataFrame]:
    import pandas as pd

    members, runs = scenario_rows(records), pd.DataFrame([*run_rows(records)])
    rows: dict[str, Any] = {"failure_share": share_rows(runs), "ensemble_laws": law_rows(runs)}
    if len(rungs := pd.DataFrame([*rung_rows(records, members)])):
        rungs["good"] = rungs["seed"].isin(usable(members, "state", MIDDLE, members))
        rows |= {"ensemble_accuracy": accuracy_rows(rungs), "ensemble_points": point_rows(rungs),
                 "performance_profile": profile_rows(records, rungs, members)}  # fmt: skip
    rows["ensemble_scenarios"] = [{k: v for k, v in row.items() if k != "state"} for row in members.values()]
    return {name: pd.DataFrame(table) for name, table in rows.items()}


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
                    facts = {"control": "dt", "value": row["dt"], "seed": seed, "kind": kind, "sentence": sentence}
                    yield common | facts | of_laws
        elif record["part"] == "timings" and record.get("control") == "tolerance":
            for seed, rungs in zip(seeds, record["ladders"], strict=True):
                for rung in rungs:  # laws of those that were observed
                    of_laws = {f"law.{name}": value for name, value in rung.get("laws", {}).items()}
                    of_laws |= {f"broken.{name}": value for name, value in rung.get("broken", {}).items()}
                    facts = {"control": "tolerance", "value": rung["value"], "seed": seed, "kind": KINDS[rung["kind"]]}
                    yield common | facts | {"sentence": rung.get("sentence", "")} | of_laws


def share_rows(runs: DataFrame) -> list[Row]:
    """Shares of failed runs with their 95 % intervals; `example`: the first failure's seed and sentence."""
    rows = []
    for (name, control, value), group in runs.groupby(["integrator", "control", "value"]) if len(runs) else ():
        begun = group[group["kind"] != "too slow"]
        failed = begun[begun["kind"] != "ok"]
        low, high = wilson(len(failed), len(begun))
        first = failed.loc[failed["seed"].idxmin()] if len(failed) else None
        rows.append(
            {"integrator": name, control: value, "runs": len(begun), "failed": len(failed)}
            | {"share": len(failed) / len(begun) if len(begun) else math.nan, "low": low, "high": high}
            | {kind: int((failed["kind"] == kind).sum()) for kind in (*FAILED, LOST)}
            | {"too slow": len(group) - len(begun)}
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
            for seed, reference in zip(range(*record["seeds"]), record.get("references") or [], strict=False):
                floor = math.inf if reference["floor"] is None else reference["floor"]
                rows[seed] = {
                    "seed": seed, "reference_gap": math.inf if reference["gap"] is None else reference["gap"],
                    "lyapunov": reference["lyapunov"], "solvers": 2, "floor": floor, "smallest_target": floor / USABLE,
                    "state": reference["state"],
                }  # fmt: skip
    return rows


def rung_rows(records: Sequence[Row], members: Mapping[int, Row]) -> Iterator[Row]:
    """Each timed run with its `error` (NaN where there is no reference); of a cell that was lost a row a seed without a
    value: no method gets away with a crash."""
    for record in records:
        if record["part"] != "timings":
            continue
        seeds = range(*record["seeds"])
        for seed, rungs in zip(seeds, record.get("ladders") or [[]] * len(seeds), strict=True):
            exact = members.get(seed, {}).get("state")
            for rung in rungs or [{"value": math.nan, "kind": 0}]:
                error = gap(rung["state"], exact) if rung.get("state") is not None and exact is not None else math.nan
                yield {"integrator": record["integrator"], "seed": seed, "control": record.get("control", ""),
                       "value": rung["value"], "status": KINDS[rung["kind"]], "error": error,
                       "energy_error": rung.get("energy_error"), "wall_time_min_s": rung.get("time_s"),
                       "repeats": rung.get("repeats")}  # fmt: skip


def usable(members: Mapping[int, Row], measure: str, target: float, seeds: Iterable[int]) -> list[int]:
    """The scenarios of which a run in doubles can tell something at a target; an error of the energy needs none."""
    if measure == "energy":
        return list(seeds)
    return [seed for seed in seeds if seed in members and members[seed]["floor"] <= USABLE * target]


def accuracy_rows(rungs: DataFrame) -> list[Row]:
    """Quantiles of error and time of each rung, over the scenarios with a reference good to 1e-7 (`good`)."""
    rows, scenarios = [], rungs.groupby("integrator")["seed"].nunique()
    for (name, value), group in rungs.groupby(["integrator", "value"]):
        begun = group[group["status"].ne("too slow")]
        done = begun[begun["status"].eq("ok") & begun["good"]]
        rows.append(
            {"integrator": name, "control": group["control"].iloc[0], "value": value, "runs": len(done),
             "without_reference": int((~begun["good"]).sum()), "failed": int(begun["status"].ne("ok").sum()),
             "not_begun": int(scenarios[name]) - len(begun)}
            | {f"{column}_{label}{ending}": quantile(done[key].to_numpy(float), q)
               for column, key, ending in (("error", "error", ""), ("time", "wall_time_min_s", "_s"))
               for label, q in (("10", 0.1), ("median", 0.5), ("90", 0.9))}
        )  # fmt: skip
    return rows


def point_rows(rungs: DataFrame) -> DataFrame:
    """Every run that has an error: the cloud whose quantiles `accuracy_rows` gives."""
    shown = rungs[rungs["status"].eq("ok") & rungs["good"] & rungs["value"].notna()]
    shown = shown.rename(columns={"wall_time_min_s": "time_s"})
    return shown[[name for name in POINTS.names if name in shown]].reset_index(drop=True)


def profile_rows(records: Sequence[Row], rungs: DataFrame, members: Mapping[int, Row]) -> list[Row]:
    """Performance profiles with their bands, over common scenarios; at tau = 1 how often each method was the first."""
    names = sorted(rungs["integrator"].unique())
    methods_of = rungs.groupby("seed")["integrator"].nunique()
    common = sorted(methods_of.index[methods_of.eq(len(names))])
    share_s = next(r["share_s"] for r in records if r["part"] == "timings")
    ladders = {key: group.to_dict("records") for key, group in rungs.groupby(["seed", "integrator"])}
    profiles = []
    for measure, target in TARGETS:
        seeds = usable(members, measure, target, common)
        times = [[reach(ladders[seed, name], MEASURES[measure], target) for name in names] for seed in seeds]
        middle, low, high = profile(np.array(times).reshape(len(seeds), len(names)), np.array(TAUS))
        counts = {"runs": len(seeds), "without_reference": len(common) - len(seeds), "share_s": share_s}
        for j, name in enumerate(names):
            what = {"integrator": name, "measure": measure, "target": target}
            profiles += [
                what | {"tau": tau, "share": middle[j, k], "low": low[j, k], "high": high[j, k]} | counts
                for k, tau in enumerate(TAUS)
            ]
    return profiles
