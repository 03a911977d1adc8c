"""The asv suite: what it tracks are numbers. That it runs, and asks nothing, `asv run --quick` of .ci/run shows."""

import importlib
import math
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
pytestmark = pytest.mark.skipif(not (ROOT / "benchmarks" / "every_commit.py").exists(), reason="not in the package")


@pytest.fixture(scope="module")
def suite():
    sys.path.insert(0, str(ROOT))
    try:
        yield importlib.import_module("benchmarks.every_commit")
    finally:
        sys.path.remove(str(ROOT))


def test_the_qualities_of_the_default_set_are_numbers(suite):
    errors = {m: suite.Accuracy().track_error(m, "short_term") for m in suite.METHODS}
    assert all(0 < e < 0.1 for e in errors.values()) and errors["tc_staggered"] > errors["tc_monolithic"]
    assert suite.Laws().track_energy_error("tc_strang", "short_term") < 1e-11
    assert suite.Laws().track_energy_error("midpoint_entropy", "short_term") > 1e-9
    assert suite.Roots().track_lost("tc_monolithic") == 0
    adaptive = suite.Adaptive()
    adaptive.setup("short_term")
    adaptive.time_to_1e6("short_term")


def test_the_rest_knows_every_method_and_gives_nan_where_one_does_not_apply(suite):
    rest = importlib.import_module("benchmarks.every_method")
    assert {"tc_gauss", "verlet_heat", "tc_strang_exact"} <= set(rest.METHODS)
    pair = ("tc_strang_exact", "gas_containers")
    one = rest.Conservation()
    one.setup(*pair)
    assert math.isnan(one.track_energy_error(*pair))
