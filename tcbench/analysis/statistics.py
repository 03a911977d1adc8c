"""Statistics of samples of scenarios: intervals of shares, quantiles, performance profiles."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Z95 = 1.959963984540054  # two-sided 95 % point of the normal distribution


def wilson(hits: int, runs: int) -> tuple[float, float]:
    """95 % interval of a share, by Wilson (1927): right for shares near 0 and 1 too; (NaN, NaN) of no runs.

    0 of 100 gives (0, 0.037).
    """
    if runs == 0:
        return math.nan, math.nan
    share, spread = hits / runs, Z95 * Z95 / runs
    centre = (share + spread / 2) / (1 + spread)
    half = Z95 / (1 + spread) * math.sqrt(share * (1 - share) / runs + spread / (4 * runs))
    low, high = max(0.0, centre - half), min(1.0, centre + half)
    return (0.0 if hits == 0 else low), (1.0 if hits == runs else high)


def quantile(values: Sequence[float] | Floats, q: float) -> float:
    """The q-quantile of the numbers among the values, linear between neighbours; NaN of none. Infinite ones count."""
    sorted_values = np.sort(np.asarray(values, dtype=float))
    sorted_values = sorted_values[~np.isnan(sorted_values)]
    if not len(sorted_values):
        return math.nan
    place = q * (len(sorted_values) - 1)
    low, high = sorted_values[math.floor(place)], sorted_values[math.ceil(place)]
    return float(low if low == high else low + (place - math.floor(place)) * (high - low))


def ratios(times: Floats) -> Floats:
    """Times over the least of their row, shape (scenarios, methods); infinite where a method failed."""
    times = np.where(np.isfinite(times) & (times > 0), times, np.inf)
    best = times.min(axis=1, keepdims=True)
    with np.errstate(invalid="ignore"):
        return np.where(np.isfinite(times), times / best, np.inf)


def profile(times: Floats, taus: Floats) -> tuple[Floats, Floats, Floats]:
    """Performance profiles of Dolan and More (2002) and their 95 % intervals (`wilson`), each of shape (methods, taus).

    times : seconds (scenarios, methods), infinite or NaN for failures. The profile of a method at tau is the share of
    all scenarios that it solved in at most tau times the time of the fastest; at 1, those where it was the fastest.
    """
    count = len(times)
    hits = (ratios(times)[:, :, None] <= taus * (1 + 1e-12)).sum(axis=0)
    bounds = {hit: wilson(hit, count) for hit in set(hits.ravel().tolist())}
    low, high = (np.array([bounds[hit][k] for hit in hits.ravel().tolist()]).reshape(hits.shape) for k in (0, 1))
    return (hits / count if count else np.full(hits.shape, np.nan)), low, high
