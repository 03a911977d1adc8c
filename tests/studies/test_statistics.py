"""Intervals and profiles against values worked out elsewhere."""

import math

import numpy as np
import pytest

from tcbench.analysis.statistics import profile, quantile, ratios, wilson


@pytest.mark.parametrize(
    ("hits", "runs", "low", "high"),
    # 0 of n: z^2/(n + z^2); n/2 of n: 1/2 -+ z/(2 sqrt(n + z^2)); the last from the roots of (p - x)^2 = z^2 x(1 - x)/n
    [
        (0, 100, 0.0, 0.0369935), (100, 100, 0.9630065, 1.0), (10, 20, 0.2992980, 0.7007020),
        (1, 10, 0.0178762, 0.4041500),
    ],
)  # fmt: skip
def test_wilson_intervals(hits, runs, low, high):
    assert wilson(hits, runs) == pytest.approx((low, high), abs=1e-7)


def test_quantiles_are_numpys_and_infinite_values_count():
    values = np.random.PCG64(3).random_raw(40).astype(float)
    for q in (0.0, 0.1, 0.5, 0.99, 1.0):
        assert quantile(values, q) == pytest.approx(np.quantile(values, q), rel=1e-14)
    assert quantile([1.0, math.inf, math.nan], 1.0) == math.inf
    assert math.isnan(quantile([math.nan], 0.5))


def test_a_performance_profile_worked_out_by_hand():
    """Four scenarios, three methods; the third fails twice, and nobody solves the last scenario."""
    nan = math.nan
    times = np.array([[1.0, 2.0, 4.0], [3.0, 1.0, nan], [1.0, 1.5, 10.0], [nan, nan, nan]])
    assert ratios(times).tolist()[:3] == [[1, 2, 4], [3, 1, math.inf], [1, 1.5, 10]]
    middle, low, high = profile(times, np.array([1.0, 2.0, 4.0, 100.0]))
    assert middle.tolist() == [[0.5, 0.5, 0.75, 0.75], [0.25, 0.75, 0.75, 0.75], [0.0, 0.0, 0.25, 0.5]]
    assert np.all(low <= middle) and np.all(middle <= high) and np.all(high[:2, 3] < 1.0001)


def test_a_share_has_one_interval_wherever_it_stands():
    """Never the first in 60 is 0 to 6 %, in the profile as in the table of firsts."""
    times = np.column_stack([np.full(60, 1.0), np.full(60, 2.0)])
    middle, low, high = profile(times, np.array([1.0, 3.0]))
    for method, hits in ((0, [60, 60]), (1, [0, 60])):
        assert middle[method].tolist() == [hit / 60 for hit in hits]
        found = list(zip(low[method], high[method], strict=True))
        assert found == [wilson(hit, 60) for hit in hits] and found[0][1] - found[0][0] > 0.05
