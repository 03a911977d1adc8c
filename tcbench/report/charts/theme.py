"""What an author changes of a chart: order and names of the methods, sizes, a style file, axes of one's own."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import matplotlib

from ...errors import TcbenchError

FONT_SIZE = 9.0  # of the charts as they are; the other sizes follow it
SMALLEST, LARGEST = 3.0, 40.0  # points, inches


@dataclass
class Theme:
    """labels : names of methods -> what to write instead, in the order in which they are drawn; others are left out.

    settings : matplotlib's, over those of the charts. font_size in points. size : width and height in inches.
    axes : draw into these instead of a new figure. looks : of this drawing, filled in by it.
    """

    labels: Mapping[str, str] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    font_size: float = FONT_SIZE
    size: tuple[float, float] | None = None
    axes: Any = None
    looks: dict[str, Any] = field(default_factory=dict)

    @property
    def scale(self) -> float:
        return self.font_size / FONT_SIZE


_CURRENT: ContextVar[Theme] = ContextVar("theme")
_PLAIN = Theme()


def current() -> Theme:
    """The theme of the drawing under way."""
    return _CURRENT.get(_PLAIN)


@contextmanager
def using(theme: Theme) -> Iterator[None]:
    token = _CURRENT.set(theme)
    try:
        yield
    finally:
        _CURRENT.reset(token)


def own_settings() -> dict[str, Any]:
    """What the user's own matplotlibrc changes of matplotlib's defaults, colours and sizes and fonts."""
    given: Any = matplotlib.rcParamsOrig  # type: ignore[attr-defined]
    plain: Any = matplotlib.rcParamsDefault
    return {k: v for k, v in given.items() if not k.startswith(("backend", "toolbar", "interactive"))
            and k in plain and plain[k] != v}  # fmt: skip


def style_settings(style: str | Path) -> dict[str, Any]:
    """The settings of a matplotlib style: a file, or the name of one that matplotlib has."""
    from matplotlib import style as styles

    library: Any = styles.library
    if str(style) in library:
        return dict(library[str(style)])
    path = Path(style)
    if not path.is_file():
        raise TcbenchError(
            f"{str(style)!r} is neither a file nor a style of matplotlib: {', '.join(styles.available)}."
        )
    try:
        found: Any = matplotlib.rc_params_from_file(path, fail_on_error=True, use_default_template=False)
        return dict(found)
    except (KeyError, ValueError, UnicodeDecodeError) as error:
        raise TcbenchError(f"{str(path)!r} is no matplotlib style: {str(error).strip()[:300]}") from None


def parse_size(text: str) -> tuple[float, float]:
    """ "6x4", in inches, or "15x10cm"."""
    number, unit = (text[:-2], 1 / 2.54) if text.endswith("cm") else (text.removesuffix("in"), 1.0)
    width, times, height = number.partition("x")
    try:
        size = float(width) * unit, float(height) * unit
    except ValueError:
        times = ""
        size = (0.0, 0.0)
    if not times or not all(0.5 <= length <= LARGEST for length in size):
        raise TcbenchError(f"{text!r} is no size: write WIDTHxHEIGHT in inches, 6x4, or 15x10cm; 0.5 to 40 inches.")
    return size


def parse_methods(text: str) -> dict[str, str]:
    """ "tc_monolithic=TC,midpoint_entropy": names in order, with what to write for them."""
    found = {}
    for item in _split(text):
        end = item.rfind("]") + 1  # a name may hold an equals sign in its brackets
        equals = item.find("=", end)
        name, label = (item, item) if equals < 0 else (item[:equals], item[equals + 1 :])
        found[name.strip()] = label.strip()
    if not all(found) or not found:
        raise TcbenchError(f"{text!r}: write the methods as NAME,NAME=LABEL,...")
    return found


def _split(text: str) -> list[str]:
    """At commas outside brackets."""
    parts, depth = [""], 0
    for letter in text:
        depth += {"[": 1, "]": -1}.get(letter, 0)
        if letter == "," and not depth:
            parts.append("")
        else:
            parts[-1] += letter
    return parts


def checked_font_size(value: float) -> float:
    if not SMALLEST <= value <= LARGEST:
        raise TcbenchError(f"A font size of {value:g} points is not between {SMALLEST:g} and {LARGEST:g}.")
    return float(value)


def scaled(settings: Mapping[str, Any], factor: float) -> dict[str, Any]:
    """The settings with every font size given in points multiplied."""
    sized = ("font.size", "axes.titlesize", "axes.labelsize", "xtick.labelsize", "ytick.labelsize", "legend.fontsize")
    return {k: v * factor if k in sized and isinstance(v, int | float) else v for k, v in settings.items()}


def distinct(names: list[str], look: Callable[[str], Any], markers: tuple[str, ...]) -> dict[str, Any]:
    """The looks of these names, with markers that none of them shares as long as there are enough."""
    used: set[str] = set()
    found = {}
    for name in names:
        style = look(name)
        if style.marker in used:
            free = [m for m in markers if m not in used]
            style = style._replace(marker=free[0]) if free else style
        used.add(style.marker)
        found[name] = style
    return found
