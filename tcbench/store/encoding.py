"""Rows and tables as bytes: strict JSON lines that keep NaN, CSV and Parquet that keep every digit.

JSON has no NaN and no infinity: they are written as ``null``, and ``"nonfinite"`` maps the JSON pointer (RFC
6901) of each such ``null`` to ``"nan"``, ``"inf"`` or ``"-inf"``; reading puts them back.
"""

from __future__ import annotations

import io
import json
import math
import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pandas import DataFrame


SURROGATE = re.compile(r"\\u[dD][89a-fA-F]")  # in JSON: half of a pair, or the beginning of one
FORMULA = re.compile(r"[=+\-@\t\r\n\uff1d\uff0b\uff0d\uff20].", re.DOTALL)  # what a spreadsheet reads as one


def canonical_json(value: Any) -> str:
    """JSON text, equal for equal values: sorted keys, no spaces. Allows NaN (for hashing only)."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), default=plain)


def plain(value: Any) -> Any:
    """A NumPy scalar or array as a number or list (a `json` default); else raises `TypeError`."""
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, (set, frozenset)):
        return sorted(value)
    raise TypeError(f"{type(value).__name__} is not a JSON value")


def json_text(values: Mapping[str, Any]) -> str:
    """Strict JSON text of `values`: NumPy made plain, NaN and infinities null and listed under "nonfinite".

    Halves of surrogate pairs, which no file can hold, are written as \\udXXX.
    """
    try:  # most rows hold finite numbers only, and the C encoder finds out fastest
        text = json.dumps({**values, "nonfinite": {}}, allow_nan=False, separators=(",", ":"))
        if not SURROGATE.search(text):
            return text
    except (ValueError, TypeError):
        pass
    nonfinite: dict[str, str] = {}
    data = writable(json.loads(json.dumps(values, default=plain)))
    found: dict[str, Any] = _without_nonfinite(data, "", nonfinite)
    return json.dumps(found | {"nonfinite": nonfinite}, allow_nan=False, separators=(",", ":"))


def writable(value: Any) -> Any:
    """A JSON value whose text can be written to any file: lone surrogates spelt out."""
    if isinstance(value, str):
        return value.encode("utf-8", "backslashreplace").decode()
    if isinstance(value, dict):
        return {writable(k): writable(v) for k, v in value.items()}
    return [writable(v) for v in value] if isinstance(value, list) else value


def restore_nonfinite(data: Any, nonfinite: Mapping[str, str]) -> None:
    """Put NaN and infinities back, in place, where the JSON pointers of `nonfinite` say."""
    for pointer, text in nonfinite.items():
        *way, last = [part.replace("~1", "/").replace("~0", "~") for part in pointer.split("/")[1:]]
        parent = data
        for part in way:
            parent = parent[int(part) if isinstance(parent, list) else part]
        value = {"nan": math.nan, "inf": math.inf, "-inf": -math.inf}[text]
        parent[int(last) if isinstance(parent, list) else last] = value


def decode_line(piece: bytes | str) -> dict[str, Any]:
    """One line of `cells.jsonl`, NaN and infinities restored; `ValueError` and kin when it is none."""
    line: dict[str, Any] = json.loads(piece)
    text = piece if isinstance(piece, bytes) else piece.encode("utf-8", "replace")
    if b"\\u" in text and SURROGATE.search(text.decode("utf-8", "replace")):
        line = writable(line)  # of versions that wrote them
    restore_nonfinite(line, line.pop("nonfinite", {}))
    key, cell, row = line["key"], line["cell"], line["row"]
    if not (isinstance(key, str) and isinstance(row, dict) and isinstance(cell, dict)):
        raise ValueError("not a row")
    if not (isinstance(line["provenance"], str) and isinstance(row.get("status", ""), str)):
        raise ValueError("not what wrote a row, or not how it ended")
    named = all(isinstance(cell.get(name), str) for name in ("study", "integrator", "scenario"))
    if cell and not (named and isinstance(cell.get("options", {}), dict)):
        raise ValueError("not a cell")
    return line


def encode_line(key: str, row: Mapping[str, Any], cell: Mapping[str, Any] | None, provenance: str) -> bytes:
    line = {"key": key, "cell": dict(cell or {}), "row": dict(row), "provenance": provenance}
    return json_text(line).encode() + b"\n"


def _without_nonfinite(value: Any, pointer: str, nonfinite: dict[str, str]) -> Any:
    if isinstance(value, float) and not math.isfinite(value):
        nonfinite[pointer] = str(float(value))  # "nan", "inf" or "-inf"
        return None
    if isinstance(value, dict):
        escaped = {k: k.replace("~", "~0").replace("/", "~1") for k in value}
        return {k: _without_nonfinite(v, f"{pointer}/{escaped[k]}", nonfinite) for k, v in value.items()}
    if isinstance(value, list):
        return [_without_nonfinite(v, f"{pointer}/{i}", nonfinite) for i, v in enumerate(value)]
    return value


def pretty(data: Mapping[str, Any]) -> bytes:
    return json.dumps(data, indent=2, default=plain, sort_keys=True).encode() + b"\n"


def csv_bytes(frame: DataFrame) -> bytes:
    """The table as CSV: digits that read back as the same double, NaN empty, nested values as JSON.

    Text that a spreadsheet would take for a formula begins with an apostrophe.
    """
    text: str = inert(_flat(frame)).to_csv(index=False, lineterminator="\n")
    return text.encode()


def inert(frame: DataFrame) -> DataFrame:
    """The table with an apostrophe before text that begins as a formula does (CWE-1236); "-" alone is none."""
    frame = frame.copy()
    for name in [n for n in frame.columns if frame[n].dtype.kind not in "biufM"]:
        if any(isinstance(v, str) and FORMULA.match(v) for v in frame[name].unique()):  # of a hundred thousand a few
            frame[name] = [f"'{v}" if isinstance(v, str) and FORMULA.match(v) else v for v in frame[name]]
    frame.columns = [f"'{name}" if FORMULA.match(str(name)) else name for name in frame.columns]
    return frame


def active(frame: DataFrame) -> DataFrame:
    """The inverse of `inert`."""
    frame = frame.rename(columns=lambda name: str(name).removeprefix("'") if FORMULA.match(str(name)[1:]) else name)
    for name in [n for n in frame.columns if frame[n].dtype.kind not in "biufM"]:
        texts = [v[1:] if isinstance(v, str) and v.startswith("'") and FORMULA.match(v[1:]) else v for v in frame[name]]
        frame[name] = texts
    return frame


def parquet_bytes(frame: DataFrame) -> bytes:
    """The table as Parquet; columns of mixed types, which Parquet does not know, become text."""
    import pyarrow

    frame = _flat(frame)
    for name in [n for n in frame.columns if frame[n].dtype.kind == "O"]:
        try:
            pyarrow.array(frame[name], from_pandas=True)
        except (pyarrow.ArrowInvalid, pyarrow.ArrowTypeError):
            frame[name] = frame[name].map(str, na_action="ignore")
    buffer = io.BytesIO()
    frame.to_parquet(buffer, index=False)
    return buffer.getvalue()


def _flat(frame: DataFrame) -> DataFrame:
    """A copy whose cells are scalars: nested values as JSON text, column names as text."""
    frame = frame.copy()
    frame.columns = [str(name) for name in frame.columns]
    for name in [n for n in frame.columns if frame[n].dtype == object]:  # not of text, which nests nothing
        nested = [isinstance(value, (list, tuple, dict, set)) or hasattr(value, "tolist") for value in frame[name]]
        if any(nested):
            values = [json.dumps(v, default=plain) if n else v for v, n in zip(frame[name], nested, strict=True)]
            frame[name] = values
    return frame
