"""docs/thermal-variables.md says what results/thermal_variables.json has, and that is what is measured."""

import json
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
SCRIPT = ROOT / "benchmarks" / "thermal_variables.py"
pytestmark = pytest.mark.skipif(not SCRIPT.exists(), reason="not in the package")


@pytest.fixture(scope="module")
def script():
    return runpy.run_path(str(SCRIPT))


@pytest.fixture(scope="module")
def kept(script):
    return json.loads(script["KEPT"].read_text())


def test_the_page_is_made_of_the_file(script, kept):
    assert script["PAGE"].read_text() == script["page"](kept), "run: python benchmarks/thermal_variables.py"
    assert script["PICTURE"].exists()


@pytest.mark.parametrize("variable", ["s", "theta", "u"])
def test_the_file_is_what_is_measured(script, kept, variable):
    """On the quickest scenario; iterations are means over steps, errors those of a run of 1000 steps."""
    method, of = script["METHODS"][variable], kept["scenarios"]["gas_containers"][variable]
    assert script["iterations"](method, "gas_containers") == pytest.approx(of["iterations"], rel=0.02)
    assert script["accuracy"](method, "gas_containers") == pytest.approx(
        {n: of[n] for n in ("error", "error_theta")}, rel=1e-6
    )
    assert script["largest_plain_step"](method, "fast_conduction") == pytest.approx(
        kept["scenarios"]["fast_conduction"][variable]["plain_step"],
        rel=0.2,  # a rung
    )


def test_entropies_fail_least_at_random_starts(script, kept):
    counted = {v: script["failures"](m, 0.4, plain=True, seeds=20) for v, m in script["METHODS"].items()}
    assert counted["s"] <= counted["u"] and all(5 <= n <= 17 for n in counted.values())
    assert kept["random"]["0.4"]["s"][0] < kept["random"]["0.4"]["theta"][0] < kept["random"]["0.4"]["u"][0]
