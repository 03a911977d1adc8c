"""`Kind`: what a chart needs, and the function that draws it. A file of charts lists its own as KINDS."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame

Tables = Mapping[str, Any]
SERIES = "series"  # runs in time, thin, as rows of the conservation study keep them
OPENING = "opening"  # their first steps, every one of them


@dataclass(frozen=True)
class Kind:
    """One kind of chart.

    needs : tables that must be there, the first one is what the chart shows; also : tables used where they are there.
    figure : these tables in this order (None for an absent one), of one scenario if by_scenario, and the options that
    it names -> Figure. study : what measures it. picks : the column whose values are its panels, where the option y
    names some of these.
    """

    name: str
    study: str
    text: str
    needs: tuple[str, ...]
    figure: Callable[..., Figure]
    also: tuple[str, ...] = ()
    by_scenario: bool = True
    options: tuple[str, ...] = ()
    picks: str = ""

    def draw(self, tables: Tables, **options: Any) -> Figure:
        return self.figure(*(tables.get(name) for name in (*self.needs, *self.also)), **options)

    def possible(self, tables: Tables) -> bool:
        return all(name in tables and len(tables[name]) for name in self.needs)

    def select(self, tables: Tables, scenario: str | None) -> dict[str, DataFrame]:
        """The tables that this chart draws, of one scenario."""
        chosen = {name: tables[name] for name in (*self.needs, *self.also) if name in tables}
        return {name: of_scenario(table, scenario) for name, table in chosen.items()}

    def scenarios(self, tables: Tables) -> list[str | None]:
        """The scenarios that it can be drawn for; [None] for a chart of all together."""
        table = tables[self.needs[0]]
        if not self.by_scenario or "scenario" not in table:
            return [None]
        return [str(name) for name in dict.fromkeys(table["scenario"].dropna())]


def of_scenario(table: DataFrame, scenario: str | None) -> DataFrame:
    if scenario is None or "scenario" not in table:
        return table
    return table[table["scenario"].astype(str) == scenario]
