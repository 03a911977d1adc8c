"""A table as LaTeX, for a paper: the columns that a terminal shows, under the names that charts give them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from ..studies.columns import column, shown_columns
from ..table import Table

if TYPE_CHECKING:
    from pandas import DataFrame

SPECIAL = {
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_", "{": r"\{", "}": r"\}",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "|": r"$|$", "<": r"$<$", ">": r"$>$", "θ": r"$\theta$",
    "τ": r"$\tau$", "µ": r"$\mu$", "−": "$-$", "₀": "$_0$", "ω": r"$\omega$", "Δ": r"$\Delta$",
}  # fmt: skip


def to_latex(table: DataFrame, schema: Table) -> str:
    """A tabular, numbers with three digits; needs no package but amsmath's, and asks for none."""
    columns = schema.terminal or shown_columns(table.columns, schema)
    filled = [c for c in dict.fromkeys(["scenario", *columns]) if c in table and table[c].notna().any()]
    sides = "".join("r" if table[c].dtype.kind in "fiu" else "l" for c in filled)
    head = " & ".join(text(column(c, schema).label) for c in filled)
    rows = [" & ".join(cell(value) for value in row) for row in table[filled].itertuples(index=False)]
    body = "".join(f"{row} \\\\\n" for row in rows)
    return f"\\begin{{tabular}}{{{sides}}}\n\\hline\n{head} \\\\\n\\hline\n{body}\\hline\n\\end{{tabular}}\n"


def text(words: Any) -> str:
    """Words as LaTeX prints them."""
    plain = (letter if letter.isprintable() else " " for letter in str(words))  # control characters are no text
    return "".join(SPECIAL.get(letter, letter) for letter in plain)


def cell(value: Any) -> str:
    """A number with three digits, as a power of ten where that is shorter; words as they are; a dash for nothing."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "--"
    if not isinstance(value, float):
        return text(value)
    if math.isinf(value):
        return r"$\infty$" if value > 0 else r"$-\infty$"
    digits, power, exponent = f"{value:.3g}".partition("e")
    if not power:
        return digits if value >= 0 else f"${digits}$"
    times = {"1": "", "-1": "-"}.get(digits, rf"{digits} \cdot ")
    return f"${times}10^{{{int(exponent)}}}$"
