"""The measured order of convergence: a slope over the asymptotic window, with its interval.

An error e(h) = C h^p (1 + d h^q + ...) shows its order only where h is small enough for the bracket to be 1
and large enough for e to stand above round-off, solver tolerance and the reference's own error. `fit_order`
finds that window, or says that there is none. The declared order is never used to choose points: a fit that
looks for 2 finds 2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

Reason = Literal["used", "pre-asymptotic", "round-off", "reference-limited", "solver", "failed"]
Floats = NDArray[np.float64]

REFERENCE_FACTOR = 10.0  # errors within 10x of the certificate measure the reference, not the method
SOLVER_FACTOR = 10.0
# How far local slopes may differ in a window, for steps that halve; the tightest that fits is taken. Noise
# of a given size moves the slope between closer steps in proportion more, so `_agree` allows them more.
SPREADS = (0.03, 0.06, 0.12, 0.25)
MIN_POINTS = 3
SHORT = (
    0.05  # by which slopes over steps that are not 0 may miss the order: part of the interval, which verdicts follow
)
DRIFT = 1e-3  # slopes that move less than this are settled
MIN_SLOPE = 0.2  # below this, errors do not decrease: no order is claimed
CONFIDENCE = 0.95


@dataclass(frozen=True, eq=False)
class OrderFit:
    """Result of `fit_order`; arrays keep the caller's sequence of points.

    order, order_low, order_high : NaN when there is no window.  used : (n,) bool.  reason : n words, why a
        point is in or out.
    dt_min, dt_max : ends of the window.  local_order : (n,) slope to the next larger h, NaN where undefined.
    note : one sentence.
    """

    order: float
    order_low: float
    order_high: float
    used: NDArray[np.bool_]
    reason: tuple[Reason, ...]
    dt_min: float
    dt_max: float
    points_used: int
    local_order: Floats
    note: str

    def verdict(self, expected: float | None) -> str:
        """'as declared', 'lower than declared', 'higher than declared', 'undetermined' or 'not declared'.

        As declared: the interval contains the declared order, and is no wider than +-0.55.
        """
        if expected is None:
            return "not declared"
        if not np.isfinite(self.order) or self.order_high - self.order_low > 1.0 + 2 * SHORT:
            return "undetermined"
        if self.order_low <= expected <= self.order_high:
            return "as declared"
        return "lower than declared" if self.order < expected else "higher than declared"


def fit_order(
    dt: ArrayLike,
    error: ArrayLike,
    certificate: ArrayLike = 0.0,
    *,
    solver_floor: ArrayLike = 0.0,
    roundoff: ArrayLike = 1e-9,
) -> OrderFit:
    """Order of convergence from errors over a ladder of step sizes, in any sequence and with any ratios.

    dt : (n,) step sizes actually taken.  error : (n,) errors; NaN or infinite for a failed run.
    certificate, solver_floor : scalar or (n,), accuracy of the reference and error that Newton's tolerance
        leaves.
    roundoff : scalar or (n,), errors above this must keep decreasing. A plateau higher up is not round-off but a
        method that converges to something else, and gets no order; below, the smallest steps may be dropped.

    The window is the longest run of consecutive points whose local slopes agree, reaching down to the smallest step
    that is not lost to a floor, or to a drift that grows as the step shrinks. The interval is the least-squares one
    (Student's t, 95 %) plus the drift of slopes inside the window.
    """
    h, e = np.asarray(dt, float).ravel(), np.asarray(error, float).ravel()
    if h.shape != e.shape or np.any(~(h > 0)) or len(np.unique(h)) != len(h):
        raise ValueError("fit_order needs one error per step size, and step sizes that are positive and distinct.")
    reason = _floors(e, np.broadcast_to(certificate, e.shape), np.broadcast_to(solver_floor, e.shape))
    down = [int(i) for i in np.argsort(-h) if reason[i] == "used"]  # from the largest step to the smallest
    local = np.full(len(h), np.nan)
    for i, j in pairwise(down):
        local[j] = np.log(e[i] / e[j]) / np.log(h[i] / h[j])
    window, note = _window(down, h, local, e, np.broadcast_to(np.asarray(roundoff, float), e.shape))
    order, half = _slope(h[window], e[window]) if window else (np.nan, np.nan)
    if len(window) == MIN_POINTS and np.isfinite(local[window[0]]):
        half += abs(local[window[0]] - order)  # three points agree by chance too easily
    if order - half <= 0:
        window, order, half, note = [], np.nan, np.nan, "The slope cannot be told from zero: no order."
    for place, i in enumerate(down):
        if i not in window:
            below = bool(window) and place > down.index(window[-1])
            reason[i] = "round-off" if below or (not window and e[i] <= 1e-14) else "pre-asymptotic"
    used = np.array([r == "used" for r in reason], bool)
    return OrderFit(
        order=order,
        order_low=order - half - SHORT,
        order_high=order + half + SHORT,
        used=used,
        reason=tuple(reason),
        dt_min=float(h[window[-1]]) if window else np.nan,
        dt_max=float(h[window[0]]) if window else np.nan,
        points_used=len(window),
        local_order=local,
        note=note,
    )


def _floors(e: Floats, certificate: Floats, solver: Floats) -> list[Reason]:
    """'used' for every point that stands above the known floors, else the floor's name."""
    reason: list[Reason] = []
    for error, certified, left in zip(e, certificate, solver, strict=True):
        if not np.isfinite(error) or error < 0:
            reason.append("failed")
        elif error == 0:
            reason.append("round-off")
        elif error <= REFERENCE_FACTOR * certified or not np.isfinite(certified):
            reason.append("reference-limited")
        elif error <= SOLVER_FACTOR * left:
            reason.append("solver")
        else:
            reason.append("used")
    return reason


def _window(down: Sequence[int], h: Floats, local: Floats, e: Floats, roundoff: Floats) -> tuple[list[int], str]:
    """Indices of the asymptotic window, from large to small h, and one sentence. Empty when there is none."""
    n = len(down)
    if n < MIN_POINTS:
        return [], f"Only {n} points stand above every floor; {MIN_POINTS} are needed."
    # Small steps may be left out only if all of them are small enough to be round-off.
    stops = [k for k in range(n, MIN_POINTS - 1, -1) if all(e[i] <= roundoff[i] for i in down[k:])]
    for spread in SPREADS:
        # Four points can contradict a slope, three hardly can: take three only when nothing else is left.
        least = MIN_POINTS if spread == SPREADS[-1] else min(n, 4)
        runs = (list(down[start:stop]) for stop in stops for start in range(stop - least + 1))
        best = max((run for run in runs if _agree(h, local, run, spread)), key=len, default=[])
        if best:
            best = _without_drift(best, local, e <= roundoff)
            return best, f"Local slopes agree within {spread:g} over {len(best)} points."
    if local[down[-1]] <= MIN_SLOPE and e[down[-1]] > roundoff[down[-1]]:
        return [], "The errors do not decrease with h: no order."
    return [], "No three consecutive points have slopes that agree: the ladder shows no asymptotic window."


def _without_drift(run: list[int], local: Floats, small: NDArray[np.bool_]) -> list[int]:
    """The window without its smallest steps while accumulated round-off bends them.

    Slopes of an error expansion settle as h shrinks. Where they move more from step to step instead, at errors small
    enough to be round-off, a drift in proportion to the number of steps has begun.
    """
    while len(run) > MIN_POINTS + 1 and small[run[-1]]:
        before, last = np.abs(np.diff(local[run[-3:]]))
        if not last > max(before, DRIFT):
            break
        run = run[:-1]
    return run


def _agree(h: Floats, local: Floats, run: Sequence[int], spread: float) -> bool:
    slopes = local[list(run[1:])]
    closest = float(np.min(-np.diff(np.log(h[list(run)]))))
    return bool(np.ptp(slopes) <= spread * max(1.0, np.log(2) / closest) and slopes.min() > MIN_SLOPE)


def _slope(h: Floats, e: Floats) -> tuple[float, float]:
    """Least-squares order over the window (h decreasing) and half the width of its interval.

    With four points or more, d h^q of the error expansion (q = 1 or 2) joins the fit if that explains the
    scatter at least four times better: then the order belongs to h -> 0, as in Richardson's extrapolation,
    not to the window's middle.
    """
    y, x = np.log(e), np.log(h / h[0])
    plain = _fit(np.column_stack([np.ones_like(x), x]), y)
    order, half, scatter = plain
    if len(h) >= 4:
        for q in (1, 2):
            richer = _fit(np.column_stack([np.ones_like(x), x, (h / h[0]) ** q]), y)
            if richer[2] < 0.25 * scatter and abs(richer[0] - plain[0]) < 0.5:
                order, half, scatter = richer
    # What the fit cannot know: slopes that drift across the window may drift as far again.
    slopes = np.diff(y) / np.diff(x)
    drift = abs(slopes[-1] - slopes[0])
    half = max(half, abs(slopes[-1] - order) + (drift if order == plain[0] else 0.0))
    if np.ptp(slopes) > SPREADS[1]:  # a window chosen because its slopes agree looks more certain than it is
        half += np.ptp(slopes)
    return float(order), float(half + 1e-3)


def _fit(design: Floats, y: Floats) -> tuple[float, float, float]:
    """Slope (second column), half width of its 95 % interval, and residual standard deviation."""
    from scipy.special import stdtrit  # Student's t as scipy.stats has it, whose import takes three times as long

    freedom = len(y) - design.shape[1]
    coefficients, *_ = np.linalg.lstsq(design, y, rcond=None)
    scatter = float(np.sqrt(np.sum((y - design @ coefficients) ** 2) / freedom))
    spread = float(np.sqrt(np.linalg.inv(design.T @ design)[1, 1]))
    return (
        float(coefficients[1]),
        float(stdtrit(freedom, 0.5 + CONFIDENCE / 2)) * scatter * spread,
        scatter,
    )
