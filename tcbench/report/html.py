"""Pieces of the report page: charts as inline SVG, tables as embedded files, numbers as text."""

from __future__ import annotations

import base64
import gzip
import io
import json
import math
import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ..store.encoding import inert

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame

COMPRESS = 30_000  # bytes from which an embedded CSV is compressed
PICTURE_DPI = 90
_ID = re.compile(r'\bid="([^"]*)"')
_REFERENCE = re.compile(r'(url\(#|xlink:href="#|href="#)([^")]+)')
_STYLE = re.compile(r'style="([^"]*)"')
_TAG = re.compile(r"<[^>]*>")
_DECIMALS = re.compile(r"(?<=\d\.\d)\d+")  # of coordinates: tenths of a point are enough
_COLOUR = re.compile(r"#[0-9a-f]{6}\b")


class Charts:
    """Turns figures into elements of one page. Their styles are collected in one sheet.

    Written out, styles are the larger part of a chart, and as classes their colours can follow the page's theme.
    """

    def __init__(self) -> None:
        self._classes: dict[str, str] = {}
        self._count = 0

    def sheet(self) -> str:
        """The style sheet of all charts so far; a colour is a variable whose default is the print colour."""
        rules = (f".{name}{{{_themed(style)}}}" for style, name in self._classes.items())
        return "\n".join(rules)

    def element(self, svg: str) -> str:
        """An SVG document as an element of the page: unique ids, styles as classes, no more digits than can be seen."""
        svg = svg[svg.index("<svg") :]
        self._count += 1
        prefix = f"c{self._count}-"
        used = {match[2] for match in _REFERENCE.finditer(svg)}
        svg = _ID.sub(lambda m: f'id="{prefix}{m[1]}"' if m[1] in used else "", svg)
        svg = _REFERENCE.sub(lambda m: f"{m[1]}{prefix}{m[2]}", svg)
        svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
        svg = _STYLE.sub(lambda m: f'class="{self._class(m[1])}"', svg)
        svg = _TAG.sub(lambda m: _DECIMALS.sub("", m[0]), svg)
        return re.sub(r"\s+(?=[/>])|(?<=\n)\s+", "", svg)

    def _class(self, style: str) -> str:
        return self._classes.setdefault(style, f"s{len(self._classes)}")


def _themed(style: str) -> str:
    return _COLOUR.sub(lambda c: f"var(--{c[0][1:]},{c[0]})", style)


def svg_text(figure: Figure) -> str:
    """The figure as an SVG document on no background."""
    import matplotlib

    from .charts.style import STYLE

    with matplotlib.rc_context(STYLE | {"path.simplify_threshold": 0.3}):
        buffer = io.StringIO()
        figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    return buffer.getvalue()


def png_element(figure: Figure) -> str:
    """The figure as an image element of few colours, its data inside."""
    from PIL import Image

    buffer, small = io.BytesIO(), io.BytesIO()
    figure.savefig(buffer, format="png", dpi=PICTURE_DPI)
    Image.open(buffer).convert("RGB").quantize(64, method=Image.Quantize.FASTOCTREE).save(
        small, format="png", optimize=True
    )
    width, height = (round(PICTURE_DPI * v) for v in figure.get_size_inches())
    data = base64.b64encode(small.getvalue()).decode()
    return f'<img class="picture" alt="" width="{width}" height="{height}" src="data:image/png;base64,{data}">'


def table_href(table: DataFrame, digits: int = 12) -> tuple[str, str]:
    """A table as a data URI and the suffix of its file: CSV, compressed where large (pandas reads both)."""
    data = inert(table).to_csv(index=False, lineterminator="\n", float_format=f"%.{digits}g").encode("utf-8", "replace")
    if len(data) < COMPRESS:
        return f"data:text/csv;base64,{base64.b64encode(data).decode()}", "csv"
    packed = gzip.compress(data, mtime=0)
    return f"data:application/gzip;base64,{base64.b64encode(packed).decode()}", "csv.gz"


def cell(value: Any) -> dict[str, Any]:
    """A table cell: text to show, number to sort by (None for text), and what a tooltip adds."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return {"text": "", "order": "", "exact": ""}
    if hasattr(value, "item"):
        value = value.item()
    if isinstance(value, bool):
        return {"text": "yes" if value else "no", "order": None, "exact": ""}
    if isinstance(value, int):
        return {"text": str(value), "order": value, "exact": ""}
    if isinstance(value, float):
        return {"text": f"{value:.3g}", "order": repr(value), "exact": repr(value)}
    return {"text": str(value), "order": None, "exact": ""}


def is_numeric(table: DataFrame, column: str) -> bool:
    return table[column].dtype.kind in "iuf"


def script_json(data: Any) -> str:
    """JSON that can stand inside a script element."""
    text = json.dumps(_strict(data), separators=(",", ":"), ensure_ascii=True, allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _strict(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(k): _strict(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_strict(v) for v in value]
    if hasattr(value, "item"):
        value = value.item()
    if isinstance(value, float):
        return float(f"{value:.6g}") if math.isfinite(value) else None
    return value if value is None or isinstance(value, bool | int | str) else str(value)
