"""Rows and tables as bytes: JSON lines with a checksum each, CSV and Parquet that keep every digit.

JSON has no NaN and no infinity, and long lists of numbers are slow to write and to read. So {"f8": "nan"} is a number
that JSON has not, and {"f8": BASE64} a list of doubles (little-endian); a dict that has the key "f8" itself is
{"f8": [[key, value], ...]}.
"""

from __future__ import annotations

import hashlib
import io
import math
import sys
import zlib
from array import array
from base64 import b64decode, b64encode
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import orjson

if TYPE_CHECKING:
    from pandas import DataFrame

PACKED = "f8"
LONG = 8  # numbers in a list that is packed
HEAD = b'{"crc":"%08x",'
HEAD_LENGTH = len(HEAD % 0)
NAMES = ("study", "integrator", "scenario")
BIG = 5000  # rows of a table that Arrow writes as CSV, ten times as fast as pandas


def to_json(value: Any, packed: bool = False, option: int = 0) -> bytes:
    """The one writer of JSON. packed : long lists of numbers as one text each. TypeError for what is no JSON value."""
    return orjson.dumps(pack(value, LONG if packed else sys.maxsize), option=option)


def from_json(text: bytes) -> Any:
    """The inverse of `to_json`; ValueError for what is no JSON."""
    return unpack(orjson.loads(text))


def canonical_json(value: Any) -> str:
    """JSON text, equal for equal values: sorted keys, no spaces."""
    return to_json(value, option=orjson.OPT_SORT_KEYS).decode()


def digest(value: Any) -> str:
    """Sha256, hexadecimal, of a JSON value."""
    return hashlib.sha256(canonical_json(value).encode()).hexdigest()


def plain(value: Any) -> Any:
    """A NumPy scalar or array, or a set, as a number or list; else raises `TypeError`."""
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, (set, frozenset)):
        return sorted(value)
    raise TypeError(f"{type(value).__name__} is not a JSON value")


def pack(value: Any, long: int = LONG) -> Any:
    """A value as JSON has it. long : lists of at least as many doubles become one text each.

    Halves of surrogate pairs, which no file can hold, are spelt out; whole numbers beyond 64 bits become doubles.
    """
    if value is None or isinstance(value, bool):
        return value
    if isinstance(value, str):
        return str(value) if value.isascii() else value.encode("utf-8", "backslashreplace").decode()
    if isinstance(value, int):
        return value if -(2**63) <= value < 2**64 else pack(_rounded(value))
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else {PACKED: str(float(value))}
    if isinstance(value, Mapping):
        if PACKED in value:
            return {PACKED: [[pack(k), pack(v, long)] for k, v in value.items()]}
        return {pack(str(k)): pack(v, long) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        if len(value) >= long and all(isinstance(v, float) for v in value):
            numbers = array("d", value)
            if sys.byteorder == "big":
                numbers.byteswap()
            return {PACKED: b64encode(numbers.tobytes()).decode()}
        return [pack(v, long) for v in value]
    return pack(plain(value), long)


def _rounded(number: int) -> float:
    try:
        return float(number)
    except OverflowError:
        return math.inf if number > 0 else -math.inf


def unpack(value: Any) -> Any:
    """The inverse of `pack`: lists and numbers."""
    if isinstance(value, dict):
        if PACKED in value and len(value) == 1:
            content = value[PACKED]
            if isinstance(content, list):
                return {k: unpack(v) for k, v in content}
            if len(content) <= 4:
                return float(content)
            numbers = array("d")
            numbers.frombytes(b64decode(content, validate=True))
            if sys.byteorder == "big":
                numbers.byteswap()
            return numbers.tolist()
        return {k: unpack(v) for k, v in value.items()}
    return [unpack(v) for v in value] if isinstance(value, list) else value


def row_bytes(row: Mapping[str, Any]) -> bytes:
    """A row as JSON; TypeError for what is no JSON value."""
    return to_json(dict(row), packed=True)


def encode_line(
    key: str, row: Mapping[str, Any] | bytes, cell: Mapping[str, Any], provenance: str = "", made_by: str = ""
) -> bytes:
    """A line of `cells.jsonl`; a row that a worker has encoded is written as it is."""
    head = to_json({"key": key, "made_by": made_by, "provenance": provenance, "cell": cell})
    content = head[1:-1] + b',"row":' + (row if isinstance(row, bytes) else row_bytes(row)) + b"}\n"
    return HEAD % zlib.crc32(content) + content


def decode_line(piece: bytes) -> dict[str, Any]:
    """One line, its row still packed; `ValueError` and kin where it is not what was written, or not of its cell."""
    content = piece[HEAD_LENGTH:].rstrip(b"\n") + b"\n"
    if piece[:HEAD_LENGTH] != HEAD % zlib.crc32(content):
        raise ValueError("not what was written")
    line: dict[str, Any] = orjson.loads(piece)
    if not isinstance(line["row"]["status"], str) or digest(line["cell"]) != line["key"]:
        raise ValueError("not the row of its cell")
    return line


def pretty(data: Mapping[str, Any]) -> bytes:
    """JSON to be read by people, too."""
    return to_json(data, option=orjson.OPT_SORT_KEYS | orjson.OPT_INDENT_2 | orjson.OPT_APPEND_NEWLINE)


def csv_bytes(frame: DataFrame) -> bytes:
    """The table as CSV: digits that read back as the same double, NaN empty, nested values as JSON."""
    frame = flat(frame)
    if len(frame) > BIG and all(frame[n].dtype.kind in "fi" or frame[n].dtype.kind in "OU" for n in frame.columns):
        import pyarrow
        from pyarrow import csv

        try:
            buffer = io.BytesIO()
            options = csv.WriteOptions(quoting_style="needed")
            csv.write_csv(pyarrow.Table.from_pandas(frame, preserve_index=False), buffer, options)
            return buffer.getvalue()
        except pyarrow.ArrowException:
            pass  # columns of mixed types
    text: str = frame.to_csv(index=False, lineterminator="\n")
    return text.encode()


def parquet_bytes(frame: DataFrame) -> bytes:
    """The table as Parquet; columns of mixed types, which Parquet does not know, become text."""
    import pyarrow

    frame = flat(frame)
    for name in [n for n in frame.columns if frame[n].dtype.kind == "O"]:
        try:
            pyarrow.array(frame[name], from_pandas=True)
        except (pyarrow.ArrowInvalid, pyarrow.ArrowTypeError):
            frame[name] = frame[name].map(str, na_action="ignore")
    buffer = io.BytesIO()
    frame.to_parquet(buffer, index=False)
    return buffer.getvalue()


def flat(frame: DataFrame) -> DataFrame:
    """A copy whose cells are scalars: nested values as JSON text, column names as text."""
    frame = frame.copy(deep=False)
    frame.columns = [str(name) for name in frame.columns]
    for name in [n for n in frame.columns if frame[n].dtype == object]:  # not of text, which nests nothing
        nested = [isinstance(value, (list, tuple, dict, set)) or hasattr(value, "tolist") for value in frame[name]]
        if any(nested):
            frame[name] = [to_json(v).decode() if n else v for v, n in zip(frame[name], nested, strict=True)]
    return frame
