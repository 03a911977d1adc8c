"""Cost of a step against the length of a chain: writes chain_cost.csv and chain_cost.png into the folder given.

python examples/chain_cost.py docs
"""

import csv
import sys
from pathlib import Path

from tcbench_plugins.chain.chain import chain

import tcbench

BANDED = (2, 3, 10, 30, 100, 300, 1000, 3000, 10_000)
TRACED = (2, 3, 5, 8)
DT, STEPS, REPEATS = 0.1, 20, 3


def rows():
    for n in BANDED:
        yield "banded", n, *measured("tc_banded", n, STEPS)
    for n in TRACED:
        yield "traced", n, *measured("tc_monolithic", n, 1000)


def measured(method, n, steps):
    """Fastest microseconds a step, and the largest relative energy error; the first run may compile."""
    scenario = chain(n, t_end=DT * steps)
    runs = [tcbench.simulate(method, scenario, dt=DT, record_every=None) for _ in range(1 + REPEATS)]
    fastest = min(1e6 * run.wall_time_s / run.steps for run in runs[1:])
    return fastest, runs[0].summary.energy_error_max


def draw(table, path):
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6, 4), layout="constrained")
    axes = figure.add_subplot()
    for kind, marker in (("banded", "o"), ("traced", "s")):
        points = [(n, us) for name, n, us, *_ in table if name == kind]
        axes.loglog(*zip(*points, strict=True), marker=marker, label=kind)
    n, us = next((n, us) for name, n, us, *_ in table if name == "banded" and n == BANDED[-1])
    axes.loglog([n / 100, n], [us / 100, us], color="0.6", linestyle=":", label="slope 1")
    axes.set(xlabel="masses", ylabel="microseconds a step")
    axes.legend()
    figure.savefig(path, dpi=120)


def main(folder):
    table = list(rows())
    with (folder / "chain_cost.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["method", "masses", "us_per_step", "relative_energy_error"])
        writer.writerows((kind, n, f"{us:.4g}", f"{drift:.2g}") for kind, n, us, drift in table)
    draw(table, folder / "chain_cost.png")
    print((folder / "chain_cost.csv").read_text(), end="")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "."))
