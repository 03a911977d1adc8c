"""`Table`: what a study says of each of its tables; comparison, terminal and page read it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Column:
    """A column of a table.

    label : what people read. worse : which values are worse, "higher", "lower" or "larger" (in magnitude); "" where
    neither is. digits : that are shown. terminal : whether it is among those that a terminal shows; narrow : the order
    in which columns go where it is too narrow, the least first, 0 for never. filter : the page can choose by it.
    """

    name: str
    label: str = ""
    worse: str = ""
    digits: int = 4
    terminal: bool = False
    narrow: int = 0
    filter: bool = False


@dataclass(frozen=True)
class Table:
    """A table of a study.

    key : columns that tell its rows apart, beside integrator and scenario. derived : a sum of other tables, or the rows
    of a chart: never compared. timed : its rows ran alone. long : shown when it is asked for by name.
    """

    name: str
    key: tuple[str, ...] = ()
    columns: tuple[Column, ...] = ()
    derived: bool = False
    timed: bool = False
    long: bool = False

    @property
    def shown(self) -> tuple[str, ...]:
        """The columns that a terminal shows, in order."""
        return tuple(column.name for column in self.columns if column.terminal)
