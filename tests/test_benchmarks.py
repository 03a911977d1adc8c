"""The asv suite: what it measures by default runs, asks nothing, and the rest waits for --bench."""

import importlib
import itertools
import json
import math
import os
import subprocess
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


def test_every_method_gets_through_every_scenario_of_the_default_set(suite):
    for chosen in itertools.product(*suite.Step.params):
        one = suite.Step()
        one.setup(*chosen)  # raises where a run fails: no pair of the set is skipped
        one.time_thousand_steps(*chosen)


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


def test_asv_asks_nothing_and_runs_the_default_set(tmp_path):
    pytest.importorskip("asv")
    code = """
import json, sys
from benchmarks import asv_defaults
from asv.benchmarks import Benchmarks
Benchmarks._disc_benchmarks = classmethod(lambda cls, *a: [
    {"name": n, "params": []} for n in ("every_commit.Step.time_x", "every_method.Speed.track_y")
])
asv_defaults.setup()
conf = type("Conf", (), {"benchmark_dir": "."})
asked = [sorted(Benchmarks.discover(conf, None, [], [], regex=regex)) for regex in (None, "track_y")]
from asv.machine import Machine
print(json.dumps([asked, Machine.load(interactive=True).cpu != ""]))
"""
    environment = os.environ | {"HOME": str(tmp_path), "USERPROFILE": str(tmp_path), "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        env=environment,
        cwd=ROOT,
        stdin=subprocess.DEVNULL,
    )
    asked, known = json.loads(done.stdout.splitlines()[-1])
    assert asked == [["every_commit.Step.time_x"], ["every_method.Speed.track_y"]] and known, done.stderr
    assert (tmp_path / ".asv-machine.json").exists()
