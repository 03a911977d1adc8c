"""What an author changes of a chart: order and names of the methods, sizes, a style file, axes of one's own."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib

from ...errors import TcbenchError

if TYPE_CHECKING:
    from .style import Look

FONT_SIZE = 9.0  # of the charts as they are; the other sizes follow it, and margins are measured for it
SMALLEST, LARGEST = 3.0, 40.0  # points, inches
SHEET = Path(__file__).parents[1] / "templates" / "charts.mplstyle"
STYLE: Any = dict(matplotlib.rc_params_from_file(SHEET, use_default_template=False))
INK = STYLE["text.color"]
LINES = ("lines.linewidth", "lines.markersize")
SIZES = ("font.size", "axes.titlesize", "axes.labelsize", "xtick.labelsize", "ytick.labelsize", "legend.fontsize")
CYCLE = "axes.prop_cycle"


@dataclass(eq=False)
class Theme:
    """labels : names of methods -> what to write instead, in the order in which they are drawn; others are left out.

    settings : matplotlib's, over those of the charts. size : width and height in inches. axes : draw into these instead
    of a new figure. looks : of the methods of the run, and of the chart under way. fore : scenario -> the methods that
    are in colour where many ran, those of "" in charts of several; rest : those that it draws in grey. families : of
    the methods, each of which has some in colour.
    """

    labels: Mapping[str, str] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    size: tuple[float, float] | None = None
    axes: Any = None
    looks: Mapping[str, Look] = field(default_factory=dict)
    fore: Mapping[str, Sequence[str]] = field(default_factory=dict)
    rest: frozenset[str] = frozenset()
    families: Mapping[str, str] = field(default_factory=dict)


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


def rc(settings: Mapping[str, Any]) -> Any:
    """STYLE with these over it; a size of type that is given alone takes all others along, and lines and markers."""
    k = float(settings.get("font.size", FONT_SIZE)) / FONT_SIZE
    return STYLE | {name: STYLE[name] * k for name in (*SIZES, *LINES)} | dict(settings)


def scale() -> float:
    """How large the type of the drawing under way is against the one that margins are measured for."""
    return float(matplotlib.rcParams["font.size"]) / FONT_SIZE


def theme_of(
    methods: str | Sequence[str] | Mapping[str, str] | None, size: str | Sequence[float] | None,
    font_size: float | None, style: str | Path | Mapping[str, Any] | None, axes: Any = None,
) -> Theme:  # fmt: skip
    """The theme of these options, over what the user's own matplotlibrc or script sets."""
    if hasattr(methods, "columns"):  # a table is several of its columns
        raise TcbenchError(
            "methods are names, as ['tc_auto', 'tc_gauss'], not a table: give list(table['integrator'])."
        )
    wanted = parse_methods(methods) if isinstance(methods, str) else methods or ()
    labels = dict(wanted) if isinstance(wanted, Mapping) else {name: name for name in wanted}
    settings = own_settings() | ({} if style is None else style_settings(style))
    if font_size is not None:
        if not SMALLEST <= font_size <= LARGEST:
            raise TcbenchError(f"A font size of {font_size:g} points is not between {SMALLEST:g} and {LARGEST:g}.")
        settings = {k: v for k, v in settings.items() if k not in SIZES} | {"font.size": float(font_size)}
    return Theme(labels, settings, None if size is None else parse_size(size), axes)


def own_settings() -> dict[str, Any]:
    """What the user's matplotlibrc, or script, sets otherwise than matplotlib does, of what charts would set."""
    now: Any = matplotlib.rcParams
    plain: Any = matplotlib.rcParamsDefault
    return {name: now[name] for name in (*STYLE, CYCLE) if now[name] != plain[name]}


def style_settings(style: str | Path | Mapping[str, Any]) -> dict[str, Any]:
    """The settings of a matplotlib style: a file, the name of one that matplotlib has, or the settings themselves."""
    from matplotlib import style as styles

    library: Any = styles.library
    is_mapping, name = isinstance(style, Mapping), "The style" if isinstance(style, Mapping) else repr(str(style))
    try:
        values: Any = (
            matplotlib.RcParams(style) if is_mapping else library[str(style)] if str(style) in library
            else matplotlib.rc_params_from_file(str(style), True, use_default_template=False)
        )  # fmt: skip
    except OSError:
        available = ", ".join(styles.available)
        raise TcbenchError(f"{name} is neither a file nor a style of matplotlib: {available}.") from None
    except (KeyError, ValueError) as error:
        raise TcbenchError(f"{name} is no matplotlib style: {str(error).strip()[:300]}") from None
    settings = {k: v for k, v in values.items() if not k.startswith(("backend", "interactive", "toolbar"))}
    if not settings:
        raise TcbenchError(f"{name} sets nothing that matplotlib knows; its lines are like `font.size: 8`.")
    return settings


def parse_size(size: str | Sequence[float]) -> tuple[float, float]:
    """Inches of "6x4", of "15x10cm", or of two numbers of them."""
    text = size if isinstance(size, str) else "x".join(map(str, size))
    text, unit = (text[:-2], 1 / 2.54) if text.endswith("cm") else (text.removesuffix("in"), 1.0)
    try:
        width, height = (float(length) * unit for length in text.split("x"))
    except ValueError:
        width = height = 0.0
    if not all(0.5 <= length <= LARGEST for length in (width, height)):
        raise TcbenchError(f"{size!r} is no size: write WIDTHxHEIGHT in inches, 6x4, or 15x10cm; 0.5 to 40 inches.")
    return width, height


def parse_methods(text: str) -> dict[str, str]:
    """ "tc_monolithic=TC,midpoint_entropy": names in order, with what to write for them."""
    labels = {}
    for item in re.split(r",(?![^\[]*\])", text):  # at commas outside brackets, where a name may have an equals sign
        name, _, label = re.fullmatch(r"((?:[^\[=]|\[[^\]]*\])*)(=?)(.*)", item).groups()  # type: ignore[union-attr]
        labels[name.strip()] = (label or name).strip()
    if not all(labels) or not all(labels.values()):
        raise TcbenchError(f"{text!r}: write the methods as NAME,NAME=LABEL,...")
    return labels
