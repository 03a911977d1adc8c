"""Pieces of the report page: tables and scripts as text that can stand inside an HTML file."""

from __future__ import annotations

import base64
import gzip
import hashlib
import math
from importlib.resources import files
from typing import TYPE_CHECKING, Any

import numpy as np
import orjson

from ..studies.columns import column
from ..table import Table

if TYPE_CHECKING:
    from pandas import DataFrame, Series

LONGEST = 12_000  # characters of a message that are kept
LAW_DIGITS = 9
SENTENCES = ("failure", "metric_failure")  # bookkeeping that a reader needs


def packed_table(table: DataFrame, schema: Table) -> str:
    """A table as columns of JSON, compressed, in base64; without what only says where its rows come from, and with the
    tolerance, which is far behind in a file, beside the step.

    schema : what its study says of it, and of the digits that the page keeps; the files have them all. Of what a law
    holds all that a series has: what is lost of it is little beside it, and would be drawn as stairs.

    A column of words is a list of the distinct ones and the places in it; -1 is no word. NaN and infinities are null;
    of a column that few rows have only the parts with numbers are there, each from a row on.
    """
    shown = [c for c in table.columns if column(str(c), schema).shown or c in SENTENCES]
    if {"dt", "tolerance"}.issubset(shown):
        shown.remove("tolerance")
        shown.insert(shown.index("dt") + 1, "tolerance")
    laws = {name for name in map(str, table.columns) if f"{name}_error" in table or name == "entropy"}
    digits = {str(c): column(str(c), schema).digits or schema.digits for c in shown}
    digits |= dict.fromkeys(laws & digits.keys(), max(schema.digits, LAW_DIGITS))
    columns = {str(c): _column(table[c], digits[str(c)]) for c in shown if table[c].notna().any()}
    return packed_json(columns)


def packed_json(data: Any) -> str:
    """Packed JSON, in which NaN and infinities are null."""
    options = orjson.OPT_NON_STR_KEYS | orjson.OPT_SERIALIZE_NUMPY
    return packed(orjson.dumps(data, default=str, option=options).decode())


def packed(text: str) -> str:
    return base64.b64encode(gzip.compress(text.encode("utf-8", "replace"), mtime=0)).decode()


def _column(values: Series, digits: int) -> Any:
    from pandas import factorize

    kind = values.dtype.kind
    if kind in "biu":
        return values.tolist()
    if kind == "f":
        plain = [float(f"{v:.{digits}g}") if math.isfinite(v) else None for v in values.tolist()]
        present = np.isfinite(values.to_numpy(float))
        ends = np.flatnonzero(np.diff(present, prepend=False, append=False)).reshape(-1, 2).tolist()
        few = 2 * sum(b - a for a, b in ends) + 8 * len(ends) < len(plain)
        return {"from": [a for a, _ in ends], "of": [plain[a:b] for a, b in ends]} if few else plain
    plain = values.astype(object).where(values.notna(), None).tolist()
    if all(v is None or isinstance(v, bool) for v in plain):
        return plain
    places, distinct = factorize(np.array([v if v is None else str(v)[:LONGEST] for v in plain], dtype=object))
    return {"words": distinct.tolist(), "at": places.tolist()}


def vendored() -> str:
    """DataTables, which the page unpacks for the first table. Licence: templates/vendor/LICENSES.txt."""
    return (files(__package__) / "templates" / "vendor" / "dataTables.min.js").read_text("utf-8")


def script_hash(text: str) -> str:
    """What a Content-Security-Policy calls a script that may run: with it, no other does."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def script_text(name: str) -> str:
    """A script of the page, as it may stand inside a script element."""
    return (files(__package__) / "templates" / name).read_text("utf-8").replace("</script", "<\\/script")
