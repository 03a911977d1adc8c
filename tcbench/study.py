"""`Study`: which cells to run, what to measure in one, and the tables made of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

from .errors import TcbenchError, calling, expect_words, shown

if TYPE_CHECKING:
    from pandas import DataFrame

    from .integrator import Integrator
    from .systems.scenario import Scenario

Row = dict[str, Any]
Cells: TypeAlias = "list[tuple[Integrator, Scenario, Row]]"  # what runs on what, and the options of the cell


@dataclass(frozen=True)
class Study:
    """A study as three functions: what is measured, run by `tcbench run --study NAME`.

    Parameters
    ----------
    name, description : str
        What it is called, and what it measures.
    tables : tuple of str
        The names of its tables, in their order.
    plan : function
        plan(integrators, scenarios, options) -> list of (integrator, scenario, cell options), one a cell; options are
        those of the run ("dt": list of steps in the scenario's dimensionless time, ...), cell options are JSON values.
    measure : function
        measure(integrator, scenario, cell options) -> row, in a worker process; nested lists and NaN are allowed.
        Exceptions become rows of status "exception".
    tabulate : function
        tabulate(records) -> tables by name, in the process that asks for them; a record is the row with integrator,
        scenario and the cell options; rows of failed cells have "status" and "failure" and may lack everything else.
    place : int
        Studies run, and their tables stand, in this order.
    by_default : bool
        False for one that runs only when named.
    timed : bool or function
        Cells run alone on the machine, after all others (of a function of the cell options: which of them do).
    metrics : bool
        Rows have the columns of plugins' metrics.
    sampled : bool
        plan draws its scenarios from families.
    scenarios : tuple of str
        Names of those that it runs on where none is named; () for all.
    fresh : bool
        Each cell in a process that has run no other.
    of_random : str
        The study that takes its place where all scenarios are random ones.
    drawn : function, optional
        drawn(scenario, cell options) -> JSON values: what else a cell computes with, such as scenarios that it draws.
    plugin : str
        Filled in by the registry.

    Raises
    ------
    TcbenchError
        For names of tables that are none. A cell that raises is a row that says so; what `plan` and `tabulate` raise is
        a sentence.

    References
    ----------
    docs/architecture.md; tcbench/studies/conservation.py is one.
    """

    name: str
    description: str
    tables: tuple[str, ...]
    plan: Callable[[Sequence[Integrator], Sequence[Scenario], Mapping[str, Any]], Cells]
    measure: Callable[[Integrator, Scenario, Row], Row]
    tabulate: Callable[[Sequence[Row]], dict[str, DataFrame]]
    place: int = 100
    by_default: bool = True
    timed: bool | Callable[[Row], bool] = False
    metrics: bool = False
    sampled: bool = False
    scenarios: tuple[str, ...] = ()
    fresh: bool = False
    of_random: str = ""
    drawn: Callable[[Scenario, Row], Any] | None = None
    plugin: str = ""

    def __post_init__(self) -> None:
        expect_words(f"The study {self.name!r}", vars(self), "tables", "scenarios")

    def planned(self, methods: Sequence[Integrator], scenarios: Sequence[Scenario], options: Row) -> Cells:
        """What `plan` returns, if it is a list of cells."""
        with calling(f"plan of the study {self.name!r} failed"):
            found: Any = self.plan(methods, scenarios, options)
            cells: list[Any] = [found] if found is None else list(found)
        for cell in cells:
            three = isinstance(cell, tuple) and len(cell) == 3
            if not (three and hasattr(cell[0], "suits") and hasattr(cell[1], "model") and isinstance(cell[2], Mapping)):
                raise TcbenchError(
                    f"plan of the study {self.name!r} must return a list of (integrator, scenario, options), a dict in "
                    f"the third place, not {shown(cell)}."
                )
        return cells

    def tabulated(self, records: Sequence[Row]) -> dict[str, DataFrame]:
        """What `tabulate` returns, if it is tables of the declared names."""
        with calling(f"The rows of the study {self.name!r} cannot be tabulated"):
            found: Any = self.tabulate(records)
        named = found if isinstance(found, Mapping) else {}
        if found is not named or any(not hasattr(table, "groupby") for table in named.values()):
            raise TcbenchError(
                f"tabulate of the study {self.name!r} must return a dict of DataFrames by the name of the table, not "
                f"{shown(found)}."
            )
        if others := [name for name in named if name not in self.tables]:
            raise TcbenchError(
                f"tabulate of the study {self.name!r} returns the table {others[0]!r}; write tables={(*named,)!r}, "
                f"where it says {(*self.tables,)!r}."
            )
        return {**found}

    def is_timed(self, options: Row) -> bool:
        """Does the cell of these options run alone?"""
        return self.timed(options) if callable(self.timed) else self.timed
