"""Cost against size, of chains and nets: writes size_cost.csv and size_cost.png into the folder given.

python examples/cost_of_size.py docs
"""

import csv
import subprocess
import sys
from pathlib import Path

import numpy as np

SIZES = {"chain": (10, 100, 1000, 10_000, 100_000), "net": (5, 10, 20, 50, 100)}
ONE = """
import resource, sys, time
import tcbench
kind, n, dt = sys.argv[1], int(sys.argv[2]), 0.1
name = f"chain[n={n}]" if kind == "chain" else f"net[nx={n},ny={n}]"
empty = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
begin = time.perf_counter()
run = tcbench.simulate("tc_monolithic", name, dt=dt, t_end=dt)
first = time.perf_counter() - begin
steps = max(5, min(1000, 100_000 // run.scenario.model.size))
runs = [tcbench.simulate("tc_monolithic", name, dt=dt, t_end=steps * dt, record_every=None) for _ in range(3)]
step = min(run.wall_time_s / run.steps for run in runs)
grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - empty) / 1024
unknowns = int(run.solver.way.split()[1])
print(unknowns, first, 1e3 * step, grown, runs[0].summary.energy_error_max, runs[0].summary.entropy_increment_min)
"""
COLUMNS = ("kind", "n", "unknowns", "first_result_s", "ms_per_step", "memory_mb", "energy_error_max", "entropy_min")


def measured(kind, n):
    """Of a process of its own: unknowns, seconds to the first result, ms a step, MB, energy error, least rise of S."""
    done = subprocess.run([sys.executable, "-c", ONE, kind, str(n)], capture_output=True, text=True, check=True)
    return [float(x) for x in done.stdout.split()]


def exponent(rows):
    """Slope of log(ms a step) against log(unknowns) without the smallest, of which the fixed part counts."""
    x, y = np.log([[row[2], row[4]] for row in rows[1:]]).T
    return np.polyfit(x, y, 1)[0]


def draw(table, path):
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6, 4), layout="constrained")
    axes = figure.add_subplot()
    for kind, marker in (("chain", "o"), ("net", "s")):
        rows = [row for row in table if row[0] == kind]
        label = f"{kind}, exponent {exponent(rows):.2f}"
        axes.loglog([row[2] for row in rows], [row[4] for row in rows], marker=marker, label=label)
    axes.set(xlabel="unknowns", ylabel="milliseconds a step")
    axes.legend()
    figure.savefig(path, dpi=120)


def main(folder):
    table = [[kind, n, *measured(kind, n)] for kind, sizes in SIZES.items() for n in sizes]
    with (folder / "size_cost.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        writer.writerows([kind, n, int(unknowns), *(f"{x:.3g}" for x in rest)] for kind, n, unknowns, *rest in table)
    draw(table, folder / "size_cost.png")
    print((folder / "size_cost.csv").read_text(), end="")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "."))
