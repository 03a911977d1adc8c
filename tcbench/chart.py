"""`Chart`: which tables a picture needs and what it shows of them, as data that a picture and the page draw alike."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeAlias

from .errors import TcbenchError, expect_names, expect_words, several, shown

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.figure import Figure
    from numpy.typing import NDArray
    from pandas import DataFrame
    from pandas import Series as Column

    Numbers: TypeAlias = Sequence[float] | NDArray[np.float64] | Column[Any] | "Slice"

Tables = Mapping[str, Any]
RUNS = "series"  # the table of runs in time, thin, as rows of the conservation study keep them
OPENING = "opening"  # their first steps, every one of them
SCALES = ("log", "linear", "share", "zero")
MARKS = ("o", ".", "s", "^", "D", ">", "|", "_", "x", "B", "S", "R", "P")  # of rows; ".": a small o; "_": a | in grey


@dataclass(frozen=True, eq=False)
class Slice:
    """Some rows of a column of numbers: what a pandas Series is, but thousands of them are made in a moment.

    name : of the column. index : the rows of the table, shape (n,). values : their numbers, shape (n,).
    """

    name: str
    index: NDArray[Any]
    values: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.values)

    def __getitem__(self, rows: Any) -> Slice:
        return Slice(self.name, self.index[rows], self.values[rows])

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[np.float64]:
        return self.values if dtype is None else self.values.astype(dtype)


@dataclass(frozen=True, eq=False)
class Series:
    """One line of a panel.

    Give columns of the chart's first table, as pandas returns them or as a `Slice`: the page then stores them once,
    and a point shows its row.

    Parameters
    ----------
    name : str
        Of the method, which has the same colour, marker and dash in every chart.
    x, y : sequence of float
        Of shape (n,) each, in the units of the axes; values that are not finite are left out.
    low, high : sequence of float
        A band around the line, or bars where points are not joined, of shape (n,); () for none.
    crosses : sequence of float
        Positions on the x axis at which runs failed; NaN is drawn at its right end.
    text : str
        Label at the end of the line; by default its name, in a panel whose lines are labelled there.
    line, marks : bool and str
        Whether points are joined; "filled", "hollow", "." for the small ones of a cloud, or "" for no markers.
    plain : bool
        Whether it belongs to no single method; it is then drawn in the colour of the text.
    ended : bool
        Whether it is a run that failed; it then has a cross at its last point.

    Raises
    ------
    TcbenchError
        For values that are no numbers, or not as many as x has.

    References
    ----------
    docs/gallery.md.
    """

    name: str
    x: Numbers
    y: Numbers
    low: Numbers = ()
    high: Numbers = ()
    crosses: Numbers = ()
    text: str = ""
    line: bool = True
    marks: str = "filled"
    plain: bool = False
    ended: bool = False

    def __post_init__(self) -> None:
        for name in ("x", "y", "low", "high", "crosses"):
            if not several(values := getattr(self, name)):
                raise TcbenchError(
                    f"Series {self.name!r}: {name} must be numbers, as of a column, not {shown(values)}."
                )
        for name, values in (("y", self.y), ("low", self.low), ("high", self.high)):
            if len(values) != len(self.x) and (len(values) or name == "y"):
                raise TcbenchError(f"Series {self.name!r}: x has {len(self.x)} numbers, and {name} has {len(values)}.")


@dataclass(frozen=True, eq=False)
class Row:
    """One method of a panel of rows: a bar and marks, in the unit of the x axis; a bar from NaN begins at its left end.

    Parameters
    ----------
    name : str
        Of the method.
    marks : mapping of str to sequence of float
        A marker of matplotlib (one of MARKS) -> its positions.
    bar : (float, float), or None
        Its two ends, in the unit of the axis.
    dotted : float
        End of a dotted extension of the bar, in the same unit; NaN for none.
    text : str
        Label behind it.
    hollow : bool
        Whether its marks are hollow.

    Raises
    ------
    TcbenchError
        For marks that are none.

    References
    ----------
    docs/gallery.md.
    """

    name: str
    marks: Mapping[str, Numbers]
    bar: tuple[float, float] | None = None
    dotted: float = math.nan
    text: str = ""
    hollow: bool = False

    def __post_init__(self) -> None:
        for mark, places in self.marks.items():
            if mark not in MARKS or not several(places):
                pair = f"{{{shown(mark)}: {shown(places)}}}"
                raise TcbenchError(
                    f"Row {self.name!r}: marks are numbers by their mark, {{'o': [0.1]}}, one of {' '.join(MARKS)}, "
                    f"not {pair}."
                )


@dataclass(frozen=True, eq=False)
class Panel:
    """A pair of axes and their lines.

    Parameters
    ----------
    series : sequence of Series
        The first is drawn below the others.
    x, y : str
        Labels of the axes, with units.
    x_scale, y_scale : str
        "log", "linear", "share" (0 to 100 %) or "zero": logarithmic, with a place for 0 where round-off begins.
    title, note : str
        Text above the panel, and instead of lines if there are none.
    errors : bool
        Whether y (for rows, x) are relative errors; the range of round-off is then grey.
    x_values, y_values : sequence of float or None
        Values that the axes must cover; None for the points.
    rank : mapping of str to float, or None
        With many methods, those of the lowest rank (dimensionless) in each family are in colour; None: those that
        lead on the scenario.
    stepped, largest : bool
        Whether lines stay level up to the next point; whether they show the largest magnitude so far.
    rows : sequence of Row
        Instead of lines: methods below each other, with their names.
    keys : mapping of str to str
        Meaning of the marks of rows, or of the text behind them.

    Raises
    ------
    TcbenchError
        For a scale that is none, and for series and rows that are none.

    References
    ----------
    docs/gallery.md.
    """

    series: Sequence[Series]
    x: str
    y: str
    x_scale: str = "log"
    y_scale: str = "log"
    title: str = ""
    note: str = ""
    errors: bool = False
    x_values: Any = None
    y_values: Any = None
    rank: Mapping[str, float] | None = None
    stepped: bool = False
    largest: bool = False
    rows: Sequence[Row] = ()
    keys: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, scale in (("x_scale", self.x_scale), ("y_scale", self.y_scale)):
            if scale not in SCALES:
                raise TcbenchError(f"Panel: {name} is one of {', '.join(SCALES)}, not {shown(scale)}.")
        for name, parts, kind in (("series", self.series, Series), ("rows", self.rows, Row)):
            wrong = [part for part in parts if not isinstance(part, kind)] if several(parts) else [parts]
            if wrong:
                raise TcbenchError(f"Panel: {name} are a list of {kind.__name__}, not {shown(wrong[0])}.")


@dataclass(frozen=True, eq=False)
class Sheet:
    """Panels with what is settled for all of them.

    columns : of the picture, at the most; size : inches of a panel. named : lines are named at their ends and not in a
    legend. hollow : what the legend says of hollow marks.
    """

    panels: Sequence[Panel]
    columns: int = 3
    size: tuple[float, float] = (3.6, 2.9)
    named: bool = False
    hollow: str = ""


def sheet_of(drawn: Any) -> Sheet:
    """What the panels of a chart returned, no figure, as a Sheet."""
    if isinstance(drawn, Sheet):
        return drawn
    panels = [*drawn] if several(drawn) else [drawn]
    if not several(drawn) or not all(isinstance(panel, Panel) for panel in panels):
        raise TcbenchError(f"The panels of a chart must return a list of Panel, or a Figure, not {shown(drawn)}.")
    return Sheet(panels)


@dataclass(frozen=True)
class Chart:
    """One kind of chart: `tcbench plot NAME`, `tcbench.draw(name, ...)`, and a place on the page.

    Parameters
    ----------
    name, text : str
        Its name, and a sentence that says what it shows.
    needs : tuple of str
        The tables that it requires; the first one is the one shown.
    panels : function
        panels(*tables, **options) -> sequence of Panel, or a matplotlib Figure (see `picture`). The tables are those of
        `needs` and `also`, in this order (None for an absent one), of one scenario if `by_scenario`.
    also : tuple of str
        Tables that are used if present.
    by_scenario : bool
        Whether each scenario has a chart of its own.
    options : tuple of str
        "x", "y": columns that `panels` takes as keywords.
    picks : str
        The column whose values are its panels, if the option y selects among these.
    study : str
        The study that measures it.
    picture : bool
        Whether it is left out of the page, as what returns a Figure must be.
    plugin : str
        Filled in by the registry.

    Raises
    ------
    TcbenchError
        For invalid names, of itself and of tables; missing tables are named when it is drawn.

    References
    ----------
    docs/gallery.md.
    """

    name: str
    text: str
    needs: tuple[str, ...]
    panels: Callable[..., Sequence[Panel] | Sheet | Figure]
    also: tuple[str, ...] = ()
    by_scenario: bool = True
    options: tuple[str, ...] = ()
    picks: str = ""
    study: str = ""
    picture: bool = False
    plugin: str = ""

    def __post_init__(self) -> None:
        expect_words(f"The chart {self.name!r}", vars(self), "needs", "also", "options")
        expect_names(f"The chart {self.name!r}", self.name)
        if not self.needs:
            raise TcbenchError(f"The chart {self.name!r} needs a table: write needs=('NAME',), the first is shown.")

    def of(self, tables: Tables) -> list[Any]:
        """The tables as `panels` takes them."""
        return [tables.get(name) for name in (*self.needs, *self.also)]

    def possible(self, tables: Tables) -> bool:
        """Whether there is something to draw."""
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
    """Its rows of a scenario; all of them where none is named."""
    if scenario is None or "scenario" not in table:
        return table
    return table[table["scenario"].astype(str) == scenario]
