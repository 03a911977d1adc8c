"""How often `tcbench compare` is wrong about timings: equal runs it calls changed, and a slower method it misses.

    python -m benchmarks.false_alarms --pairs 30 --slower 10 --folder /tmp/alarms

Each pair is two runs of the same code, one after the other; the slower method is the file `mine.py` with 20 % more
work in each step. On an idle machine and on a busy one the first is to be at most 1 of 30, the second at least 9 of 10.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path

from tcbench.runner.compare import compare, in_both, regressions

METHODS = ("tc_monolithic", "mine")
SCENARIOS = ("short_term",)
STEPS = ("0.1", "0.05", "0.025", "0.0125")
WORK, SLOWER = 11, 15  # evaluations a step, of which one would do; 20 % more time, with all else that a step does
MINE = """
from tcbench import Integrator, hookimpl

def step(z, h, system):
    for _ in range({work}):
        a = system.vector_field(z)
    b = system.vector_field(z + h / 2 * a)
    c = system.vector_field(z + h / 2 * b)
    return z + h / 6 * (a + 2 * b + 2 * c + system.vector_field(z + h * c))

@hookimpl
def tcbench_integrators():
    return [Integrator(name="mine", order=4, source="a test", step=step)]
"""


def run(folder: Path, name: str, work: int) -> Path:
    """One run of the study work_precision into a folder of this name; a run that is there is used again."""
    plugin, out = folder / f"plugin{work}" / "mine.py", folder / name
    plugin.parent.mkdir(parents=True, exist_ok=True)
    plugin.write_text(MINE.format(work=work))
    words = [w for name in METHODS for w in ("-i", name)] + [w for name in SCENARIOS for w in ("-s", name)]
    words += [w for step in STEPS for w in ("--dt", step)]
    words += ["--study", "work_precision", "-q", "--plugins-dir", str(plugin), "-o", str(out)]
    subprocess.run([sys.executable, "-m", "tcbench", "run", *words], check=True)
    return out


def main() -> None:
    """Count both kinds of errors, and say what was found each time."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--pairs", type=int, default=30)
    options.add_argument("--slower", type=int, default=10)
    options.add_argument("--folder", type=Path, required=True)
    chosen = options.parse_args()
    alarms = found = others = 0
    for n in range(chosen.pairs):
        a, b = (run(chosen.folder, f"{n}{side}", WORK) for side in "ab")
        changes = in_both(compare(a, b))
        alarms += len(changes) > 0
        said = f"{n}: {alarms} of {n + 1} pairs of equal runs differ, load {os.getloadavg()[0]:.1f}"
        print(said, flush=True)
        if len(changes):
            print(changes.to_string(), flush=True)
        if n < chosen.slower:
            worse = regressions(compare(a, run(chosen.folder, f"{n}slow", SLOWER)))
            found += "mine" in set(worse["integrator"])
            others += bool(set(worse["integrator"]) - {"mine"})
            print(f"{n}: {found} of {n + 1} slower ones found, {others} times others, too", flush=True)
            print(worse.to_string(), flush=True)


if __name__ == "__main__":
    main()
