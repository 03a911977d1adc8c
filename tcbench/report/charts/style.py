"""What all charts share: the look of an integrator, its name, and the numbers of a table."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import TYPE_CHECKING, Any, NamedTuple

import matplotlib
import numpy as np
from numpy.typing import NDArray

from ...chart import Series, Slice
from . import theme

if TYPE_CHECKING:
    from pandas import DataFrame


# Okabe and Ito's colours without black and yellow, which vanish on a dark or a white page, for the paper's methods; for
# all others colours of or near Tol's muted scheme, which differ from these under every common kind of colour blindness.
BLUE, SKY, GREEN, ORANGE, RED = "#0072b2", "#56b4e9", "#009e73", "#e69f00", "#d55e00"
PURPLE, OLIVE, GREY, INDIGO, WINE, TEAL, ROSE = (
    "#aa3399", "#8a7a1f", "#7f7f7f", "#332288", "#882255", "#006d77", "#cc6677",
)  # fmt: skip
SLATE = "#4d5560"
COLOURS = (PURPLE, OLIVE, INDIGO, WINE, TEAL, ROSE)  # grey is for what is not told apart
MARKERS = ("P", "X", "h", "<", ">", "p", "*", "d")  # told apart in print
DASHES = ("-", "--", "-.", (0, (1, 1)), (0, (5, 1, 1, 1, 1, 1)))


class Look(NamedTuple):
    """How an integrator is drawn, everywhere."""

    colour: str
    marker: str
    dash: Any


PAPER = {
    "tc_monolithic": Look(BLUE, "o", "-"),
    "tc_staggered": Look(SKY, "s", "--"),
    "tc_strang": Look(GREEN, "^", "-."),
    "midpoint_entropy": Look(ORANGE, "D", "-"),
    "midpoint_temperature": Look(RED, "v", "--"),
}
FIXED = PAPER | {  # that lead or are compared with most often: those of one dash differ for the colour-blind, too
    "tc_auto": Look(INDIGO, "*", "-"),
    "tc_gauss": Look(TEAL, "h", "-"),
    "tc_gauss_adaptive": Look(WINE, "p", DASHES[4]),
    "tc_taylor": Look(ROSE, "d", "-"),
    "tc_strang_exact": Look(OLIVE, ">", "-"),
    "gauss2": Look(PURPLE, "<", "--"),
    "heyoka": Look(SLATE, "P", "-."),
    "scipy_odeint": Look(SLATE, "X", "--"),
}
OTHER = Look("#b8bec5", "", "-")  # the look of all those that are not in front


def look(name: str) -> Look:
    """The look of an integrator in the chart under way; outside of one, the look that it prefers."""
    chosen = theme.current()
    if str(name) in chosen.rest:
        return OTHER
    return chosen.looks.get(str(name)) or preferred(str(name))


def preferred(name: str) -> Look:
    """A function of the name alone. Variants, `base[parameter=value]`, keep the colour of their base."""
    if name in FIXED:
        return FIXED[name]
    number = int.from_bytes(hashlib.sha256(name.encode("utf-8", "replace")).digest()[:8], "big")
    base, bracket, _ = name.partition("[")
    colour = preferred(base).colour if bracket and base else COLOURS[number % len(COLOURS)]
    number //= len(COLOURS)
    return Look(colour, MARKERS[number % len(MARKERS)], DASHES[number // len(MARKERS) % len(DASHES)])


def looks(methods: Sequence[str], fixed: Mapping[str, Look] | None = None) -> dict[str, Look]:
    """Looks that differ: as preferred, but no marker twice while one is free, and no colour twice with one dash.

    fixed : of a whole run, which its charts keep. A cycle of properties in the theme's settings is followed instead,
    in the order of the methods.
    """
    if own := list(theme.current().settings.get(theme.CYCLE, ())):
        entries = {name: (preferred(name), entry) for name, entry in zip(methods, cycle(own))}
        return {name: Look(of.get("color", wish.colour), of.get("marker", wish.marker), of.get("linestyle", "-"))
                for name, (wish, of) in entries.items()}  # fmt: skip
    chosen = {n: FIXED[n] for n in methods if n in FIXED} | dict(fixed or {})
    for name in methods:
        if name in chosen:
            continue
        wish, taken = preferred(name), list(chosen.values())
        if "[" not in name:
            wish = wish._replace(colour=min(_from(COLOURS, wish.colour), key=[t.colour for t in taken].count))
        markers, worn = {t.marker for t in taken}, {t.marker for t in taken if t.colour == wish.colour}
        every = _from((*MARKERS, *(k.marker for k in PAPER.values())), wish.marker)
        free = [*(m for m in every if m not in markers), *(m for m in every if m not in worn), wish.marker]
        lines = {(t.colour, t.dash) for t in taken}
        dash = next((d for d in _from(DASHES, wish.dash) if (wish.colour, d) not in lines), wish.dash)
        chosen[name] = Look(wish.colour, free[0], dash)
    return {name: chosen[name] for name in methods}


def _from(values: Sequence[Any], first: Any) -> list[Any]:
    """All values, from `first` on."""
    start = values.index(first) if first in values else 0
    return [first, *values[start:], *values[:start]]


def ink() -> str:
    """The colour of what belongs to no method."""
    return str(matplotlib.rcParams["text.color"])


def names(table: DataFrame, column: str = "integrator") -> list[str]:
    """The distinct names of a column: those in grey, that others lie upon them, then in the theme's order, or those
    with a fixed look first, then by alphabet."""
    return [*by_name(table, column)]


def by_name(table: DataFrame, column: str = "integrator") -> dict[str, NDArray[np.intp]]:
    """Each of `names`, and the places of its rows."""
    groups = table.groupby(column, sort=False).indices if column in table else {}
    rows_of, first = {str(name): rows for name, rows in groups.items()}, [*theme.current().labels, *PAPER]
    rest = theme.current().rest
    order = sorted(rows_of, key=lambda n: (n not in rest, first.index(n) if n in first else len(first), n))
    return {name: rows_of[name] for name in order}


def lines(
    methods: Mapping[str, Any], x: Slice, y: Slice, keep: Any, order: Any = None, failed: Any = None, **more: Any
) -> list[Series]:  # fmt: skip
    """A line a method: y over x in the rows to keep, by the order; crosses at the x of those that failed.

    methods : as of `by_name`. keep, order, failed : of each row of the table.
    """
    series = []
    for name, rows in methods.items():
        mine = rows[keep[rows]]
        mine = mine if order is None else mine[np.argsort(order[mine], kind="stable")]
        crosses = () if failed is None else x[rows[failed[rows]]]
        series.append(Series(name, x[mine], y[mine], crosses=crosses, **more))
    return series


def numbers(table: DataFrame, column: str) -> Slice:
    """A column as floats, with everything that is not a finite number NaN; so is all of one that the table has not."""
    values = finite(table[column]) if column in table else np.full(len(table), np.nan)
    return Slice(column, table.index.to_numpy(), values)


def short(name: str, length: int = 32) -> str:
    """A name that fits a legend: as the theme says it, printable, on one line."""
    name = theme.current().labels.get(str(name), name)
    text = " ".join("".join(c if c.isprintable() else " " for c in str(name)).split())
    return text if len(text) <= length else f"{text[: length - 1]}…"


def ok(table: DataFrame) -> Any:
    """Which rows are of completed runs; all of them in a table without status."""
    return table["status"].eq("ok") if "status" in table else np.ones(len(table), dtype=bool)


def finite(values: Any) -> Any:
    """As floats, with everything that is not a finite number NaN."""
    import pandas as pd

    array = np.asarray(values)
    if array.dtype.kind not in "fiu":
        array = pd.to_numeric(pd.Series(values), errors="coerce").to_numpy(dtype=float)
    return np.where(np.isfinite(array), array, np.nan)
