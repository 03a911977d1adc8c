"""`Table` and `Column`: what a study says of its tables; terminal, page, comparison and LaTeX read it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from fnmatch import fnmatchcase
from typing import Any

from .errors import TcbenchError, expect_names, shown

WORSE = ("", "higher", "lower", "larger")
PAGE_DIGITS = 10  # of a number on the page; the files have them all


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Parameters
    ----------
    name : str
        Of the column; with a `*`, of every column of the table so called of which neither it nor tcbench says more.
    label, short, unit : str
        What stands on the axis of a chart (a `*` in it is what the name has there), what heads the column on a
        terminal, and the unit of the values, "" if they are dimensionless. Without a label it is called as it is.
    worse : str
        Which values are worse: "higher", "lower" or "larger" (in magnitude, of errors, which may be signed); "" where
        neither is: `tcbench compare` then tells changes and no regressions.
    good : tuple of str
        Of a column of words those that say that all went well; another word after one of them is a regression.
    digits : int
        That the page keeps of a number; 0 for those of the table.
    filter : bool
        Whether the page can choose rows by it.
    narrow : int
        Columns with a number go first, the least first, where a terminal is too narrow for all.
    optional : bool
        Whether it is left out where no row has it.
    timing : bool
        Whether it is measured with a clock: the comparison shows ratios and judges none.
    shown : bool
        Whether it says what came out; otherwise it says where a row comes from, and only the files have it.
    compared : bool
        Whether differences between runs count.

    Raises
    ------
    TcbenchError
        For another word in `worse`.

    References
    ----------
    docs/add-study.md; docs/measures.md says how tcbench's own columns are measured.
    """

    name: str
    label: str = ""
    short: str = ""
    unit: str = ""
    worse: str = ""
    good: tuple[str, ...] = ()
    digits: int = 0
    filter: bool = False
    narrow: int = 0
    optional: bool = False
    timing: bool = False
    shown: bool = True
    compared: bool = True

    def __post_init__(self) -> None:
        if self.worse not in WORSE:
            raise TcbenchError(f"The column {self.name!r}: worse is one of {WORSE}, not {shown(self.worse)}.")

    def named(self, name: str) -> Column:
        """It under the name of a column that it fits, with a label, its unit in it, and a heading."""
        before, _, after = self.name.partition("*")
        label, short = (
            text.replace("*", name[len(before) : len(name) - len(after)]) for text in (self.label, self.short)
        )
        label = label or name.replace("_", " ")
        changes = {"name": name, "label": f"{label}, {self.unit}" if self.unit else label, "short": short or name}
        return Column(**{**vars(self), **changes})


@dataclass(frozen=True)
class Table:
    """A table of a study.

    Parameters
    ----------
    name : str
        Of the table: letters, digits, _ and -.
    columns : tuple of Column or str
        Its columns in their order; a name alone is one that tcbench describes (`dt`, `status`, `energy_error_max`, ...)
        or one of which there is nothing to say.
    key : tuple of str
        Columns that tell its rows apart, beside integrator and scenario.
    terminal : tuple of str
        The columns that a terminal shows, in order; () for all.
    digits : int
        That the page keeps of a number, where its column does not say.
    derived : bool
        Whether it sums up other tables, or holds the rows of a chart: it is never compared.
    timed : bool
        Whether its rows were measured alone on the machine.
    long : bool
        Whether a terminal shows it only when it is asked for by name.

    Raises
    ------
    TcbenchError
        For an invalid name, and for columns that are none.

    References
    ----------
    docs/add-study.md; tcbench/studies/size.py has two.
    """

    name: str
    columns: tuple[Column | str, ...] = ()
    key: tuple[str, ...] = ()
    terminal: tuple[str, ...] = ()
    digits: int = PAGE_DIGITS
    derived: bool = False
    timed: bool = False
    long: bool = False

    def __post_init__(self) -> None:
        expect_names("The table", self.name)
        columns: Any = self.columns  # whatever an author wrote
        if not isinstance(columns, tuple) or any(not isinstance(one, Column | str) for one in columns):
            raise TcbenchError(
                f"The table {self.name!r}: columns is a tuple of Column or of names, not {shown(self.columns)}."
            )

    @property
    def names(self) -> list[str]:
        """The columns that it has in any case or may have, in order."""
        names = [one if isinstance(one, str) else one.name for one in self.columns]
        return [name for name in names if "*" not in name]

    def column(self, name: str) -> Column | None:
        """What it says of a column of this name; None where it says nothing."""
        return next((one for one in self.columns if isinstance(one, Column) and one.name == name), None)

    def pattern(self, name: str) -> Column | None:
        """The first of its patterns that fits."""
        patterns = (one for one in self.columns if isinstance(one, Column) and "*" in one.name)
        return next((one for one in patterns if fnmatchcase(name, one.name)), None)

    def as_dict(self) -> dict[str, Any]:
        """It as JSON values; `from_dict` makes it of them."""
        return _parts(self) | {"columns": [one if isinstance(one, str) else _parts(one) for one in self.columns]}


def from_dict(data: Mapping[str, Any]) -> Table | None:
    """The table of what a run folder says; None where that is no table."""
    try:
        parts = _tuples(data)
        columns = (one if isinstance(one, str) else Column(**_tuples(one)) for one in parts.get("columns", ()))
        parts["columns"] = tuple(columns)
        return Table(**parts)
    except (TypeError, ValueError, AttributeError, TcbenchError):
        return None


def _tuples(data: Mapping[str, Any]) -> dict[str, Any]:
    """JSON has lists in their place."""
    return {name: tuple(value) if isinstance(value, list) else value for name, value in data.items()}


def _parts(one: Column | Table) -> dict[str, Any]:
    """Its fields that are not as they are by default."""
    return {f.name: value for f in fields(one) if (value := getattr(one, f.name)) != f.default or f.default is MISSING}
