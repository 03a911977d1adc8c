"""`tcbench run` with plugins that hang, crash, lie and shout: one row for every planned cell, the others untouched."""

import json
import sys

import deadlines
import pytest
from click.testing import CliRunner

from tcbench.cli import main

HEADER = "import ctypes, os, sys, time\nimport numpy as np\nfrom tcbench import Integrator, hookimpl\n"
FOOTER = """
@hookimpl
def tcbench_integrators():
    return [Integrator(name={name!r}, order=1, step=step)]
"""
FAULTS = {  # body of step(z, h, system) -> status of the row
    "hang": ("print('hanging', flush=True); time.sleep(1e6)", "timeout"),
    "segfault": ("ctypes.string_at(0)", "crash"),
    "leaver": ("os._exit(0)", "crash"),
    "shouter": ("raise RuntimeError('x' * 10_000_000)", "exception"),
    "misshapen": ("return z[:3]", "exception"),
    "not_a_number": ("return z * np.nan", "nonfinite"),
    "greedy": ("return z + np.ones(20 * 2**27).sum()", "exception"),
    "printer": ("while True: print('never mind ' * 100)", "timeout"),
}
BROKEN = {"syntax": "def broken(:\n", "importing": "import no_such_module\n"}
GOOD = ("-i", "tc_monolithic", "-i", "midpoint_entropy", "-s", "short_term")


def run(out, *extra):
    return CliRunner().invoke(main, ["run", *GOOD, "--study", "conservation", "--dt", "0.3", "-o", str(out), *extra])


def rows(out):
    lines = [json.loads(line) for line in (out / "cells.jsonl").read_text().splitlines()]
    return [(line["cell"]["integrator"], line["cell"]["scenario"], line["row"]) for line in lines]


@pytest.mark.skipif(sys.platform != "linux", reason="the memory limit is enforced on Linux only")
def test_faulty_plugins_cost_their_own_cells_and_nothing_else(tmp_path, monkeypatch, capfd):
    plugins = tmp_path / "plugins"
    plugins.mkdir()
    for name, (body, _) in FAULTS.items():
        text = HEADER + f"def step(z, h, system):\n    {body}\n" + FOOTER.format(name=name)
        (plugins / f"{name}.py").write_text(text)
    slow = HEADER + "time.sleep(1.0)\ndef step(z, h, system):\n    return z\n" + FOOTER.format(name="slow_import")
    (plugins / "slow_import.py").write_text(slow)
    for name, text in BROKEN.items():
        (plugins / f"{name}.py").write_text(text)

    clean = run(tmp_path / "clean")
    assert clean.exit_code == 0, clean.output
    chosen = [word for name in [*FAULTS, "slow_import"] for word in ("-i", name)]
    deadlines.only_for(monkeypatch, ["hang"], ["printer"])
    limits = ("--timeout", str(deadlines.LIMIT), "--memory-limit", "6000")
    faulty = run(tmp_path / "faulty", "--plugins-dir", str(plugins), *chosen, *limits)
    assert faulty.exit_code == 0, faulty.output
    shouted = capfd.readouterr()
    assert len(faulty.output) < 20_000 and len(shouted.out + shouted.err) < 20_000  # whoever shouts, shouts into a file

    found = rows(tmp_path / "faulty")
    names = [(integrator, scenario) for integrator, scenario, _ in found]
    assert len(names) == len(set(names)) == 2 + len(FAULTS) + 1  # every planned cell has exactly one row
    for integrator, _, row in found:
        expected = FAULTS[integrator][1] if integrator in FAULTS else None
        if expected:
            assert row["status"] == expected, (integrator, row)
            assert row["failure"] and len(row["failure"]) < 5000
    timing = {"us_per_step", "wall_time_s", "cell_time_s", "shared_runs"}
    untouched = {(i, s): {k: v for k, v in row.items() if k not in timing} for i, s, row in found}
    for integrator, scenario, row in rows(tmp_path / "clean"):
        assert untouched[integrator, scenario] == {k: v for k, v in row.items() if k not in timing}  # bit for bit
