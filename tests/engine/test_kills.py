"""kill -9 of a whole run of 40 cells, anywhere: while it computes, and in the middle of what it writes.

After each kill every file can be read and no row that was there is gone; at the end the tables are those of the
undisturbed run, to the last bit (but for the clock's columns). TCBENCH_KILLS=1000 for the full count.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import pandas
import pytest

from tcbench.store.rows import is_finished
from tcbench.store.store import Store

SCRIPT = Path(sys.executable).with_name("tcbench")
KILLER = Path(__file__).resolve().parents[1] / "helpers" / "killing"
KILLS = int(os.environ.get("TCBENCH_KILLS", "40"))
METHODS = ("tc_monolithic", "midpoint_entropy", "gauss2", "mine")
SCENARIOS = ("short_term", "cold_spring")
CELLS = 40  # with 5 steps of the ladder each
CLOCK = ("us_per_step", "wall_time_s", "cell_time_s", "shared_runs", "source_hash")
MINE = """
from tcbench import Integrator, hookimpl
def mine(z0, z1, h, system):
    return z1 - z0 - h * system.vector_field((z0 + z1) / 2)
@hookimpl
def tcbench_integrators():
    return [Integrator(name="mine", order=2, source="x", flows=mine)]
"""
AIMS = {"rows": 8, "tables": 6, "other": 5, "cache": 1}  # kind of file -> number of its write, at most


def start(out: Path, cache: Path, kill_at: str = "", report: bool = True) -> subprocess.Popen:
    words = [w for name in METHODS for w in ("-i", name)] + [w for name in SCENARIOS for w in ("-s", name)]
    words += ["--study", "conservation", "-q", "-o", str(out)]
    words += ["--report"] if report else []
    (out.parent / "mine.py").write_text(MINE)
    env = os.environ | {"KILL_AT": kill_at, "TCBENCH_CACHE_DIR": str(cache), "PYTHONPATH": str(KILLER)}
    env["TCBENCH_PLUGINS_DIR"] = str(out.parent / "mine.py")
    return subprocess.Popen([str(SCRIPT), "run", *words], env=env, start_new_session=True, stderr=subprocess.PIPE)


def unreadable(out: Path) -> list[str]:
    """The files of a folder that cannot be read; temporary ones are nobody's."""
    bad = []
    for path in (p for p in out.rglob("*") if p.is_file() and not p.name.startswith(".")):
        try:
            if path.suffix == ".json":
                json.loads(path.read_text())
            elif path.suffix == ".csv":
                pandas.read_csv(path)
            elif path.suffix == ".parquet":
                pandas.read_parquet(path)
            elif path.suffix == ".html":
                assert path.read_text().rstrip().endswith("</html>")
        except Exception as error:
            bad.append(f"{path}: {error!r}")
    return bad


def tables(out: Path) -> dict[str, str]:
    found = {}
    for path in sorted((out / "tables").iterdir()):
        frame = pandas.read_parquet(path) if path.suffix == ".parquet" else pandas.read_csv(path, dtype=str)
        frame = frame.drop(columns=[c for c in CLOCK if c in frame])
        found[path.name] = repr(frame.to_dict("list"))
    return found


def aimed(rng: random.Random, cache: Path, kept: int) -> str:
    """Where the next run is killed: in the middle of a write, or ("") at any time."""
    if rng.random() < 0.3:
        return ""
    aim = rng.choices(list(AIMS), weights=[4, 2, 2, 1])[0]
    if aim == "cache":
        rng.choice(sorted(cache.rglob("*.o"))).unlink()
    most = min(AIMS[aim], max(1, CELLS - kept))
    return f"{aim}:{rng.choice(['half', 'unrenamed', 'renamed'])}:{rng.randint(1, most)}"


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="kills process groups")
def test_kills_anywhere_lose_nothing(tmp_path):
    cache, rng = tmp_path / "cache", random.Random(int(os.environ.get("TCBENCH_KILLS_SEED", "2009")))
    whole = start(tmp_path / "whole", cache)
    assert whole.wait() == 0, whole.stderr.read()
    began = time.monotonic()
    again = start(tmp_path / "timed", cache, report=False)
    assert again.wait() == 0
    length = time.monotonic() - began
    expected = tables(tmp_path / "whole")
    assert len(Store.read(tmp_path / "whole").lines()) == CELLS and expected == tables(tmp_path / "timed")

    done, endings, finished = 0, Counter(), 0
    while done < KILLS:
        out, kept = tmp_path / f"run{finished}", set()
        while True:
            kill_at = aimed(rng, cache, len(kept))
            run = start(out, cache, kill_at, report=rng.random() < 0.1)  # drawing takes most of the time
            if not kill_at:
                try:
                    run.wait(rng.uniform(0.0, length))
                except subprocess.TimeoutExpired:
                    os.killpg(run.pid, signal.SIGKILL)
            errors = run.communicate()[1].decode()
            killed = run.returncode == -signal.SIGKILL
            assert killed or run.returncode == 0, errors
            done += killed
            endings[f"{kill_at.partition(':')[0] or 'anywhere'} {'killed' if killed else 'ended'}"] += 1
            print(f"{done} kills, {finished} runs finished: {dict(endings)}", flush=True)
            if out.exists():
                assert not unreadable(out)
                found = Store.read(out).rows() if (out / "cells.jsonl").exists() else {}
                keys = {key for key, row in found.items() if is_finished(row)}
                assert keys >= kept, "a row is lost"
                kept = keys
            if not killed:
                break
        assert len(kept) == CELLS and tables(out) == expected
        finished += 1
        shutil.rmtree(out)
    print(f"\n{done} kills in {finished} runs of {CELLS} cells: 0 rows lost, 0 files unreadable, {dict(endings)}")
