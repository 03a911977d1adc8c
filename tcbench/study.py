"""`Study`: which cells to run, what to measure in one, and the tables made of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

from .errors import TcbenchError, calling, expect_names, expect_words, shown
from .table import Table

if TYPE_CHECKING:
    from pandas import DataFrame

    from .integrator import Integrator
    from .systems.scenario import Scenario

Row = dict[str, Any]
Cells: TypeAlias = "list[tuple[Integrator, Scenario, Row]]"  # what runs on what, and the options of the cell
Tables: TypeAlias = "dict[str, DataFrame]"  # by name


@dataclass(frozen=True)
class Study:
    """What to measure, as three functions; run by `tcbench run --study NAME`.

    Parameters
    ----------
    name, description : str
        Its name, and a sentence that says what it measures.
    tables : tuple of Table or str
        Its tables, in order; a name alone is a table of which there is nothing to say.
    plan : function
        plan(integrators, scenarios, options) -> list of (integrator, scenario, cell options), one a cell; options are
        those of the run ("dt": list of steps in the scenario's dimensionless time, ...), cell options are JSON values.
    measure : function
        measure(integrator, scenario, cell options) -> row, in a worker process; nested lists and NaN are allowed.
        Exceptions become rows of status "exception".
    tabulate : function
        tabulate(records) -> tables by name, in the calling process; a record is the row with integrator,
        scenario and the cell options; rows of failed cells have "status" and "failure" and may lack everything else.
    place : int
        Studies run, and their tables are shown, in increasing order of this number.
    by_default : bool
        False for a study that runs only when named.
    timed : bool or function
        Whether cells run alone on the machine, after all others; or a function of the cell options that says so.
    metrics : bool
        Whether rows have the columns of plugins' metrics.
    sampled : bool
        Whether `plan` draws its scenarios from families.
    scenarios : tuple of str
        Names of the scenarios that it runs on if none is named; () for all.
    fresh : bool
        Whether each cell runs in a new process.
    of_random : str
        The study that replaces it if all scenarios are random.
    drawn : function, optional
        drawn(scenario, cell options) -> JSON values: further inputs of a cell, such as scenarios that it draws.
    plugin : str
        Filled in by the registry.

    Raises
    ------
    TcbenchError
        For invalid names, of itself and of tables. An exception in a cell becomes its row; one in `plan` or `tabulate`
        is told in a sentence.

    References
    ----------
    docs/architecture.md; tcbench/studies/conservation.py is one.
    """

    name: str
    description: str
    tables: tuple[Any, ...]
    plan: Callable[[Sequence[Integrator], Sequence[Scenario], Mapping[str, Any]], Cells]
    measure: Callable[[Integrator, Scenario, Row], Row]
    tabulate: Callable[[Sequence[Row]], Tables]
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
        tables: Any = self.tables  # or names of some
        names = tuple(getattr(one, "name", one) for one in tables) if isinstance(tables, tuple) else tables
        expect_words(f"The study {self.name!r}", {**vars(self), "tables": names}, "tables", "scenarios")
        expect_names(f"The study {self.name!r}", self.name, *names)
        object.__setattr__(self, "tables", tuple(Table(one) if isinstance(one, str) else one for one in tables))

    @property
    def table_names(self) -> tuple[str, ...]:
        """The names of its tables, in order."""
        return tuple(table.name for table in self.tables)

    def planned(
        self, methods: Sequence[Integrator], scenarios: Sequence[Scenario], options: Mapping[str, Any]
    ) -> Cells:
        """What `plan` returns, if it is a list of cells."""
        with calling(f"plan of the study {self.name!r} failed"):
            result: Any = self.plan(methods, scenarios, options)
            cells: list[Any] = [result] if result is None else list(result)
        for cell in cells:
            three = isinstance(cell, tuple) and len(cell) == 3
            if not (three and hasattr(cell[0], "suits") and hasattr(cell[1], "model") and isinstance(cell[2], Mapping)):
                raise TcbenchError(
                    f"plan of the study {self.name!r} must return a list of (integrator, scenario, options), a dict in "
                    f"the third place, not {shown(cell)}."
                )
        return cells

    def measured(self, method: Integrator, scenario: Scenario, options: Mapping[str, Any]) -> Row:
        """What `measure` returns, if it is a row that leaves what it is a row of as it is."""
        row: Any = self.measure(method, scenario, dict(options))
        if not isinstance(row, Mapping):
            raise TcbenchError(f"measure of the study {self.name!r} must return a dict, not {shown(row)}.")
        for name, own in {**options, "integrator": method.name, "scenario": scenario.name}.items():
            if name in row and str(row[name]) != str(own):
                raise TcbenchError(
                    f"measure of the study {self.name!r} returns {name}={shown(row[name])}, and {name!r} is what its "
                    f"cell is told by, {shown(own)} here; call it otherwise."
                )
        return {**row}

    def tabulated(self, records: Sequence[Row]) -> Tables:
        """What `tabulate` returns, if it is tables of the declared names."""
        with calling(f"The rows of the study {self.name!r} cannot be tabulated"):
            result: Any = self.tabulate(records)
        named = result if isinstance(result, Mapping) else {}
        if result is not named or any(not hasattr(table, "groupby") for table in named.values()):
            raise TcbenchError(
                f"tabulate of the study {self.name!r} must return a dict of DataFrames by the name of the table, not "
                f"{shown(result)}."
            )
        if others := [name for name in named if name not in self.table_names]:
            raise TcbenchError(
                f"tabulate of the study {self.name!r} returns the table {others[0]!r}; write tables={(*named,)!r}, "
                f"where it says {self.table_names!r}."
            )
        return {**result}

    def is_timed(self, options: Row) -> bool:
        """Does the cell of these options run alone?"""
        return self.timed(options) if callable(self.timed) else self.timed
