"""The table `ensemble_seeds`: a row a method and a random scenario, with the numbers that were drawn as columns."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..study import Row
from ..systems.scenario import Scenario

if TYPE_CHECKING:
    from pandas import DataFrame


def drawn_numbers(scenarios: Sequence[Scenario]) -> Row:
    """Of a block, as its row keeps them: a list each, of those that differ; one number of those that are alike."""
    rows = [scenario.numbers() for scenario in scenarios]
    columns = {name: [row.get(name, math.nan) for row in rows] for name in rows[0]} if rows else {}
    return {name: values[0] if len(set(values)) == 1 else values for name, values in columns.items()}


def seed_rows(records: Sequence[Row], runs: DataFrame, known: Mapping[int, Row]) -> DataFrame:
    """How many runs of each method on each scenario failed, the first of them (least step, or loosest tolerance) and
    how, and the largest error of each law over all of them; error bar and growth rate, where they are known."""
    import pandas as pd

    if not len(runs):
        return pd.DataFrame()
    made = runs[runs["kind"] != "too slow"]
    by = made.groupby(["integrator", "seed"], sort=True)
    failed = made[made["kind"] != "ok"]
    order = np.where(failed["control"] == "dt", failed["value"], -failed["value"])
    first = failed.iloc[np.argsort(order, kind="stable")].groupby(["integrator", "seed"], sort=True)
    table = by[["control"]].first().assign(runs=by.size()).join(first.size().rename("failed"))
    table["failed"] = table["failed"].fillna(0).astype(int)
    table = table.join(first[["value", "kind"]].first().rename(columns={"value": "fails_from"}))
    laws = {f"law.{name}": f"{name}_error_max" for name in law_names(made)} | {"law.entropy": "entropy_fall_max"}
    worst = [name for name in laws if name in made]
    table = table.join(by[worst].max().rename(columns=laws)).reset_index()
    for column in ("reference_gap", "lyapunov") if known else ():
        table[column] = [known[seed][column] if seed in known else math.nan for seed in table["seed"]]
    return table.join(_numbers(records), on="seed")


def law_names(runs: DataFrame) -> list[str]:
    """Of the columns law.NAME and broken.NAME of a table of runs."""
    return [name.removeprefix("law.") for name in runs if name.startswith("law.")]


def _numbers(records: Sequence[Row]) -> DataFrame:
    """The numbers that were drawn, by seed."""
    import pandas as pd

    blocks = {tuple(record["seeds"]): record["drawn"] for record in records if record.get("drawn")}
    frames = [pd.DataFrame(drawn, index=range(*seeds)) for seeds, drawn in sorted(blocks.items())]
    every = pd.concat(frames) if frames else pd.DataFrame()
    return every[~every.index.duplicated()]
