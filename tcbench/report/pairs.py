"""What each method came to on each scenario: the one table that terminal, page and sentences read."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from ..chart import Tables
from ..studies.columns import ERROR_MAX, LAW_TOLERANCE, claim_column, invariant_columns
from ..systems.energy_scale import HIDDEN
from .marks import MARKS, mark_of, mark_of_limit
from .words import is_finite, power

if TYPE_CHECKING:
    from pandas import DataFrame, Series

PAIR = ["integrator", "scenario"]
TIMES = {
    "time 0.001": ("error", 1e-3), "time 1e-06": ("error", 1e-6), "time 1e-09": ("error", 1e-9),
    "time energy 1e-12": ("energy_error_max", 1e-12),
}  # fmt: skip
DEPARTS = 1e-10  # over its size, by which a declared invariant may be off without a sentence
LOOSE = 1e-3  # tolerances above it ask for so little that what a solver does with them is no failure
NUMBERS = (*TIMES, "coarse", "produced", "energy", "step", "cost")  # columns that hold one number a pair


def pairs(tables: Tables, declared: Tables) -> DataFrame:
    """A row for each method and scenario of any table, indexed by both and sorted; absent studies leave columns out.

    failed, runs : of `ladder_runs`, and mark_B, mark_S ... how many of these runs ended with which of `marks.MARKS`;
    ladder_failed, ladder_runs : of `conservation` alone, with dt_most, its largest step, and done, its runs with a
    completed step. kept_LAW, of_LAW : the runs that kept a law, of those whose system has it; worst_LAW, at_LAW : its
    largest loss, and at which step or tolerance. lawful : those that ended and kept every one. fails : whether one of
    them failed or there is a largest stable step; fails_from : the least step at which that is so.
    order, fits : the fitted order of the state, of the lowest variable where that was not fitted; how many fits.
    limit, dt_stable, dt_unstable, dt_cap : as in `stability`; limit_mark : of its limit;
    dt_coarsest : the scenario's, in `work_precision`, and inner, the steps that the method took inside of one of them.
    NUMBERS : times to an accuracy, s; errors of the temperatures and of the entropy produced at the coarsest step; the
    energy error at the scenario's own step; the largest stable step; µs a step. Infinite where it was asked for and not
    reached, or the run failed; NaN where it was not measured.
    """
    import pandas as pd

    plain = {name: table.dropna(subset=PAIR) for name, table in tables.items() if {*PAIR} <= set(table)}
    plain = {name: table.assign(**{of: table[of].astype(str) for of in PAIR}) for name, table in plain.items()}
    names = [table[PAIR] for table in plain.values()]
    if not names:
        return pd.DataFrame(index=pd.MultiIndex.from_arrays([[], []], names=PAIR))
    index = pd.MultiIndex.from_frame(pd.concat(names).drop_duplicates()).sort_values()
    parts = [_ladders(plain), *_of_ladder(plain.get("conservation"), declared)]
    parts += [_orders(plain.get("convergence")), _steps(plain.get("stability")), _cost(plain, declared)]
    parts += [*_times(plain.get("time_to_accuracy")), *_coarsest(plain.get("work_precision"))]
    columns = [part for part in parts if part is not None]
    return _with_failures(pd.concat([pd.DataFrame(index=index), *columns], axis=1).reindex(index))


def _with_failures(results: DataFrame) -> DataFrame:
    """The table with what both ladders, of runs and of stable steps, say of failures."""
    import pandas as pd

    limit, runs = (results.get(name, pd.Series(math.nan, results.index)) for name in ("limit", "ladder_runs"))
    limited = limit.notna() & limit.ne("none")
    fails = limited | (results["ladder_failed"] > 0 if "ladder_failed" in results else False)
    steps = results.reindex(columns=["least_failed", "dt_unstable"])
    steps["dt_unstable"] = steps["dt_unstable"].where(limited)
    asked = limit.notna() | runs.notna()
    return results.assign(fails=fails.astype(float).where(asked), fails_from=steps.min(axis=1))


def to_numbers(table: DataFrame, column: str) -> Any:
    """A column as floats; NaN where the table has none."""
    import pandas as pd

    return pd.to_numeric(table[column] if column in table else pd.Series(math.nan, table.index), errors="coerce")


def times_over_best(results: DataFrame, key: str = "time 1e-06") -> dict[str, list[float]]:
    """Method -> its time over the fastest method's, one a scenario; infinite where it did not get there."""
    if key not in results:
        return {}
    times = results[key].dropna()
    ratios = times / times.groupby(level="scenario").transform("min")
    return {name: of.fillna(math.inf).tolist() for name, of in ratios.groupby(level="integrator")}


def is_kept(law: str, value: Any) -> Any:
    """Whether a law is kept by this loss, or by each of a column of them."""
    return value <= (0 if law == "entropy" else LAW_TOLERANCE)


def losses(table: DataFrame, law: str) -> Any:
    """The losses of a law in rows of `conservation`; of energy as far as they are seen: 0 within its round-off, NaN
    where that hides what moves."""
    values = to_numbers(table, law_columns(table)[law])
    if law != "energy" or "energy_round_off" not in table:
        return values
    round_off = to_numbers(table, "energy_round_off")
    return values.mask(values <= round_off, 0.0).mask(round_off > HIDDEN)


def law_columns(table: DataFrame) -> dict[str, str]:
    """Law -> column of `conservation`: energy, entropy, and each invariant that some system of the run has."""
    columns = {law: claim_column(law) for law in ("energy", "entropy") if claim_column(law) in table}
    others = [c for c in invariant_columns(table.columns) if table[c].notna().any()]
    return columns | {c.removesuffix(ERROR_MAX): c for c in others}


def departed(tables: Tables) -> list[str]:
    """Of each declared invariant that a run loses which ends well: how many do, and most which; and why a method does
    that claims it."""
    table, said = tables.get("conservation"), []
    if table is None or "status" not in table:
        return []
    for law, name in law_columns(table).items():
        values = to_numbers(table, name).where(table["status"].eq("ok"))
        if law in ("energy", "entropy") or not (lost := values > DEPARTS).any():
            continue
        row = table.loc[values.idxmax()]
        said.append(
            f"{law.replace('_', ' ')} departs by more than {DEPARTS:g} in {lost.sum()} of {values.notna().sum()} runs "
            f"that ended well, most by {values.max():.1g} ({row['integrator']} on {row['scenario']})"
        )
        if "invariants_lost" in table:
            causes = (
                table["invariants_lost"]
                .dropna()
                .astype(str)
                .str.split(r"; (?=\w[\w ]* changes by )", regex=True)
                .explode()
            )
            own = causes[causes.str.startswith(f"{law.replace('_', ' ')} changes")]
            said[-1] += f"; of {table.loc[own.index[0], 'integrator']} {own.iloc[0]}" if len(own) else ""
    return said


def laws(results: DataFrame) -> list[str]:
    """The laws that were judged."""
    return [str(name).removeprefix("kept_") for name in results if str(name).startswith("kept_")]


def ladder_runs(tables: Tables) -> DataFrame:
    """The runs of the ladders of steps and tolerances up to LOOSE, of which failures are counted: integrator,
    scenario, status, failure, dt (NaN where a tolerance was asked for), tolerance, and mark, "" for a good end."""
    import pandas as pd

    parts = []
    for name, table in tables.items():
        if name == "conservation":
            steps, asked = to_numbers(table, "dt"), to_numbers(table, "tolerance")
        elif name == "work_precision":
            values, fixed = to_numbers(table, "value"), table["control"].eq("dt")
            steps, asked = values.where(fixed), values.mask(fixed)
        else:
            continue
        fell = to_numbers(table, "second_law_violations") > 0
        marks = [mark_of(status, bad) for status, bad in zip(table["status"], fell, strict=True)]
        parts.append(table.reindex(columns=[*PAIR, "status", "failure"]).assign(dt=steps, tolerance=asked, mark=marks))
    columns = [*PAIR, "status", "failure", "dt", "tolerance", "mark"]
    runs = pd.concat(parts) if parts else pd.DataFrame(columns=columns)
    return runs[~(runs["tolerance"] > LOOSE)]


def _ladders(tables: Tables) -> DataFrame | None:
    runs = ladder_runs(tables)
    counts = {f"mark_{mark}": runs["mark"].eq(mark) for mark in MARKS}
    counts |= {"failed": runs["status"].ne("ok")}
    return runs[PAIR].assign(runs=1, **counts).groupby(PAIR).sum() if len(runs) else None


def _of_ladder(table: DataFrame | None, declared: Tables) -> list[Any]:
    """Laws, failures and the energy error of the study `conservation`."""
    if table is None:
        return []
    table = table.reset_index(drop=True)
    bad, steps, worst = table["status"].ne("ok"), to_numbers(table, "dt"), []
    done = to_numbers(table, "steps") > 0 if "steps" in table else bad | True
    rows = table[PAIR].assign(ladder_failed=bad, ladder_runs=1, done=done)
    whole, some = ~bad, bad & False
    for law in law_columns(table):
        values = losses(table, law).where(done)
        rows[f"kept_{law}"], rows[f"of_{law}"] = is_kept(law, values), values.notna()
        most = values[values.groupby([table[name] for name in PAIR]).transform("max").eq(values)].index
        worst.append(
            _last(table.loc[most[::-1]], **{f"worst_{law}": values[most], f"at_{law}": settings(table.loc[most])})
        )
        whole, some = whole & (rows[f"kept_{law}"] | values.isna()), some | values.notna()
    sums = rows.assign(lawful=whole & some).groupby(PAIR).sum()
    ends = table[PAIR].assign(least_failed=steps.where(bad), dt_most=steps).groupby(PAIR)
    lost = _one(_at_own_step(table, declared), "energy_error_max", "energy")
    return [sums, *worst, ends["least_failed"].min(), ends["dt_most"].max(), lost]


def settings(rows: DataFrame) -> Any:
    """ "h = 0.1", or the tolerance that was asked for; "" for neither."""
    steps, tolerances = to_numbers(rows, "dt"), to_numbers(rows, "tolerance")
    other = tolerances.map(lambda value: f"tolerance {power(value)}").where(tolerances.notna(), "")
    return steps.map("h = {:.3g}".format).where(steps.notna(), other)


def _at_own_step(table: DataFrame, declared: Tables) -> DataFrame:
    """The rows of `conservation` at each scenario's own step, declared or else the middle one of its ladder; adaptive
    solvers have none."""
    steps = to_numbers(table, "dt")
    ladders = steps[steps.abs() < math.inf].groupby(table["scenario"]).unique()
    own = {name: sorted(of)[len(of) // 2] for name, of in ladders.items()}
    declared_steps = {name: facts.get("dt") for name, facts in declared.get("scenarios", {}).items()}
    own |= {name: float(dt) for name, dt in declared_steps.items() if is_finite(dt)}
    return table[(steps / table["scenario"].map(own).astype(float) - 1).abs() < 1e-9]


def _one(rows: DataFrame, column: str, name: str) -> Series:
    """The last number of each pair; infinite where there is none, or the run failed."""
    values = _plain(rows, column)
    values = values.where(rows["status"].eq("ok")) if "status" in rows else values
    return _last(rows, **{name: values.fillna(math.inf)})[name]


def _plain(rows: DataFrame, column: str) -> Any:
    """Its finite numbers."""
    return to_numbers(rows, column).replace([math.inf, -math.inf], math.nan)


def _last(rows: DataFrame, **columns: Any) -> DataFrame:
    return rows[PAIR].assign(**columns).drop_duplicates(PAIR, keep="last").set_index(PAIR)


def of_whole_state(table: DataFrame) -> DataFrame:
    """Of the orders by variable those of the state, where it was measured."""
    whole = table["variable"].astype(str).eq("all")
    return table[whole | ~whole.groupby([table[name] for name in PAIR]).transform("any")]


def _orders(table: DataFrame | None) -> DataFrame | None:
    if table is None:
        return None
    rows = of_whole_state(table)
    return rows[PAIR].assign(order=_plain(rows, "order"), fits=1).groupby(PAIR).agg({"order": "min", "fits": "sum"})


def _steps(table: DataFrame | None) -> DataFrame | None:
    """What the study `stability` found; `step` is there where it was studied at all."""
    if table is None:
        return None
    numbers = {name: _plain(table, name) for name in ("dt_stable", "dt_unstable", "dt_cap")}
    causes = table["cause"] if "cause" in table else table["limit"]
    marks = [mark_of_limit(limit, cause) for limit, cause in zip(table["limit"], causes, strict=True)]
    return _last(table, limit=table["limit"], limit_mark=marks, step=numbers["dt_stable"].fillna(math.inf), **numbers)


def _times(table: DataFrame | None) -> list[Series]:
    if table is None:
        return []
    chosen = {key: table["measure"].eq(of) & table["target"].eq(target) for key, (of, target) in TIMES.items()}
    return [_one(table[rows], "time_s", key) for key, rows in chosen.items() if rows.any()]


def _coarsest(table: DataFrame | None) -> list[Any]:
    """Errors at the end of the run with the coarsest step of a scenario's ladder. One that the reference's own hides
    counts as ten times that; a scenario without this error is left out."""
    if table is None:
        return []
    rows = table[table["control"].eq("dt")]
    rows = rows.assign(value=to_numbers(rows, "value"))
    rows = rows[rows["value"] >= (1 - 1e-9) * rows.groupby("scenario")["value"].transform("max")]
    columns: list[Any] = [_last(rows, dt_coarsest=rows["value"], inner=to_numbers(rows, "inner_steps_mean"))]
    for name, column in (("coarse", "error_theta"), ("produced", "error_entropy_produced")):
        error = to_numbers(rows, column)
        measured = error.notna().groupby(rows["scenario"]).transform("any")
        errors = rows.assign(error=_plain(rows, column).fillna(10 * to_numbers(rows, "reference_floor")))
        columns += [_one(errors[measured], "error", name)] if measured.any() else []
    return columns


def _cost(tables: Tables, declared: Tables) -> Series | None:
    """Microseconds a step of fixed-step methods: as timed alone, else beside other cells."""
    work, ladder = tables.get("work_precision"), tables.get("conservation")
    if work is not None:
        return timed_steps(work)
    if ladder is None:
        return None
    rows = _at_own_step(ladder, declared)
    rows = rows[rows["status"].eq("ok")]
    return _last(rows, cost=_plain(rows, "us_per_step"))["cost"]


def timed_steps(work: DataFrame) -> Series:
    """Microseconds a step, of the run of most steps of each method of a fixed step in `work_precision`."""
    rows = work[work["control"].eq("dt") & work["status"].eq("ok")]
    steps, seconds = to_numbers(rows, "steps"), to_numbers(rows, "wall_time_min_s")
    longest = steps.eq(steps.groupby([rows[name] for name in PAIR]).transform("max"))
    return _last(rows[longest], cost=(1e6 * seconds / steps)[longest])["cost"]
