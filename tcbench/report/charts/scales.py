"""Axes on which 1e-15 and 1e+3 both show, with ticks that can be read."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullFormatter, NullLocator

ROUND_OFF = 1e-12  # relative errors below it are round-off, over any number of steps: no axis tells them apart
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


TICKS = (  # up to so many decades on an axis: where in each decade ticks stand
    (1.0, (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0)),
    (1.7, (1.0, 2.0, 5.0)),
    (np.inf, (1.0,)),
)


def power_text(value: float, _position: int | None = None) -> str:
    """10⁻³ for powers of ten, plain digits near 1, nothing between."""
    if value == 0:
        return "0"
    if not np.isfinite(value):
        return ""
    exponent = int(np.floor(np.log10(abs(value)) + 1e-9))
    mantissa = value / 10.0**exponent
    if -3 < exponent < 4:
        return f"{value:.4g}"
    digits = f"10{str(exponent).translate(_SUPERSCRIPTS)}"
    if abs(abs(mantissa) - 1) < 1e-6:
        return digits if value > 0 else f"−{digits}"
    return f"{mantissa:.3g}·{digits}"


def log_axis(ax: Axes, which: str, values: Any = None) -> None:
    """A logarithmic axis. Over less than two decades ticks at 1, 2, 5 are named too, over less than one most digits."""
    axis = ax.xaxis if which == "x" else ax.yaxis
    ax.set(**{f"{which}scale": "log"})
    good = np.asarray([] if values is None else values, dtype=float)
    good = good[np.isfinite(good) & (good > 0)]
    low, high = (good.min(), good.max()) if len(good) else (1e-2, 1e2)
    pad = max((high / low) ** 0.06, 1.15) if len(good) else 1.0
    ax.set(**{f"{which}lim": (low / pad, high * pad)})
    decades = np.log10(high / low)
    subs = next(ticks for most, ticks in TICKS if decades < most)
    axis.set_major_locator(LogLocator(subs=subs))
    axis.set_major_formatter(FuncFormatter(power_text))
    axis.set_minor_locator(NullLocator())
    axis.set_minor_formatter(NullFormatter())


def round_off_band(ax: Axes, which: str = "y") -> None:
    """Grey where an axis of errors shows round-off only."""
    low, high = ax.get_ylim() if which == "y" else ax.get_xlim()
    if low < ROUND_OFF:
        (ax.axhspan if which == "y" else ax.axvspan)(low, ROUND_OFF, color="#808080", alpha=0.16, linewidth=0, zorder=0)
        (ax.set_ylim if which == "y" else ax.set_xlim)(low, high)


def zero_log_axis(ax: Axes, values: Any) -> None:
    """A vertical axis for magnitudes: logarithmic down to round-off, and below that a grey band with a place for 0.

    A plain symlog axis spends most of its room on the linear part or drops ticks there; here the linear part takes
    most of a decade and only whole decades, evenly thinned out, are named.
    """
    good = np.abs(np.asarray(values, dtype=float))
    good = good[np.isfinite(good)]
    top = float(good.max()) if len(good) and good.max() > 0 else ROUND_OFF
    top = 10.0 ** np.ceil(np.log10(max(top, 1e3 * ROUND_OFF)) + 0.05)
    ax.set_yscale("symlog", linthresh=ROUND_OFF, linscale=0.7)
    ax.set_ylim(-0.25 * ROUND_OFF, top)
    round_off_band(ax)
    low, high = int(np.log10(ROUND_OFF)), int(np.log10(top))
    stride = next(s for s in (1, 2, 3, 4, 5, 6, 10, 20, 50, 100, 400) if (high - low) / s <= 6)
    decades = [d for d in range(low, high + 1) if (d - low) % stride == 0]
    ax.yaxis.set_major_locator(FixedLocator([0.0, *(10.0**d for d in decades)]))
    ax.yaxis.set_major_formatter(FuncFormatter(power_text))
    ax.yaxis.set_minor_locator(NullLocator())
