"""Instructions a step and a call, counted by valgrind: a gate that a noisy machine can judge (x86-64 Linux).

    python benchmarks/instructions.py            # fails where results/instructions.json has 5 % less, of a call 10 %
    python benchmarks/instructions.py --write    # counts and keeps

valgrind's processor is the same on every machine, and code is compiled for x86-64-v3, so that counts differ by what
Python does on its way only: less than 0.1 % of a step, 1 % of a call. They are compared where LLVM, Python and the C
library are those that made the kept ones, and shown elsewhere.
"""

from __future__ import annotations

import json
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT)]

from benchmarks.every_commit import METHODS, PART  # noqa: E402

KEPT = ROOT / "results" / "instructions.json"
SCENARIOS = ["short_term", "stiff_spring"]
MARGIN, OF_CALL = 0.05, 0.10  # a call is Python, of which any change is some percent
FEW, MANY = 50, 5050  # steps: the difference is that of whole steps
CALLS = 50
TARGET = "x86-64-v3"


def measured():
    """Name -> (what is run, how often the thing counted happens in it)."""
    import tcbench

    def steps(method, scenario, count):
        dt = PART * scenario.dt
        assert tcbench.simulate(method, scenario, dt, count * dt, record_every=None).ok

    found = {}
    for name in SCENARIOS:
        scenario = tcbench.scenarios()[name]
        for method in [*METHODS, "projected"]:
            for count in (FEW, MANY):
                found[f"{method} {name} {count}"] = lambda m=method, s=scenario, n=count: steps(m, s, n)
    one = tcbench.scenarios()["short_term"].replace(t_end=0.3)
    for count in (0, CALLS):
        found[f"call {count}"] = lambda n=count: [tcbench.simulate("tc_monolithic", one) for _ in range(n)]
    return found


def count(controlled):
    """In the process that valgrind watches: run each part between two marks. Without one: compile, and warm up."""

    def control(*words):
        subprocess.run(["callgrind_control", *words, str(os.getpid())], check=True, capture_output=True)

    for name, part in measured().items():
        part()
        if controlled:
            control("-i", "on")
            part()
            control("-i", "off")
            control(f"--dump={name}")


def counted():
    """Name -> instructions of one step, or one call; and why there are none."""
    environment = os.environ | {"PYTHONHASHSEED": "0", "TCBENCH_TARGET": TARGET, "OMP_NUM_THREADS": "1"}
    command = [sys.executable, __file__]
    subprocess.run([*command, "--warm"], check=True, env=environment)
    with tempfile.TemporaryDirectory() as folder:
        tool = ["valgrind", "-q", "--tool=callgrind", "--instr-atstart=no", f"--callgrind-out-file={folder}/out"]
        done = subprocess.run([*tool, *command, "--count"], env=environment, capture_output=True, text=True)
        if done.returncode:
            return {}, (done.stderr.strip().splitlines() or ["it says nothing"])[-1]
        texts = [path.read_text() for path in Path(folder).glob("out.*")]
    totals = {re.search("Trigger: dump (.*)", t)[1]: int(re.search(r"^totals: (\d+)", t, re.M)[1]) for t in texts}
    found = {
        name.removesuffix(f" {MANY}"): (total - totals[name.replace(str(MANY), str(FEW))]) / (MANY - FEW)
        for name, total in totals.items()
        if name.endswith(f" {MANY}")
    }
    found["call"] = (totals[f"call {CALLS}"] - totals["call 0"]) / CALLS
    return {name: round(value) for name, value in sorted(found.items())}, ""


def made_with():
    import llvmlite.binding

    libc = "-".join(platform.libc_ver())
    return {"python": platform.python_version(), "llvm": list(llvmlite.binding.llvm_version_info), "libc": libc}


def main():
    if not shutil.which("callgrind_control") or platform.machine() != "x86_64":
        print("no valgrind, or no x86-64: nothing is counted")
        return 0
    found, why = counted()
    if not found:
        print(f"valgrind cannot run this here: {why}")
        return 0
    now = {"made_with": made_with(), "instructions": found}
    if "--write" in sys.argv:
        KEPT.write_text(json.dumps(now, indent=1) + "\n")
    kept = json.loads(KEPT.read_text())
    ratios = {name: n / kept["instructions"][name] for name, n in now["instructions"].items()}
    for name, n in now["instructions"].items():
        print(f"{name:42} {n:10,d}  {ratios[name]:.3f}")
    if kept["made_with"] != now["made_with"]:
        print(f"made with {now['made_with']}, the kept ones with {kept['made_with']}: not compared")
        return 0
    worse = {k: f"{x:.3f}" for k, x in ratios.items() if x > 1 + (OF_CALL if k == "call" else MARGIN)}
    print(f"more instructions than before: {worse}" if worse else "as many instructions as before, or fewer")
    return 1 if worse else 0


if __name__ == "__main__":
    if {"--warm", "--count"} & set(sys.argv):
        count("--count" in sys.argv)
    else:
        sys.exit(main())
