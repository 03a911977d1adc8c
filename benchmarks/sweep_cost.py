"""Time of a sweep against its number of cells: start-up, the cost of one more cell, and the exponent of the growth.

python benchmarks/sweep_cost.py
Cells are runs of tc_monolithic over short_term with steps between 0.01 and 0.02, about 1 ms each, through the whole
engine: worker processes, rows on disk, tables. Each sweep starts in an empty folder with kernels compiled before.
"""

import math
import tempfile
import time

import numpy as np

import tcbench

CELLS = (50, 100, 200, 400, 800)
REPEATS = 3


def sweep(cells, jobs):
    """Wall seconds of one sweep, and the seconds that its runs took by themselves."""
    steps = np.linspace(0.01, 0.02, cells).round(6).tolist()
    with tempfile.TemporaryDirectory() as folder:
        begin = time.perf_counter()
        results = tcbench.run(["tc_monolithic"], ["short_term"], ["conservation"], dt=steps, output=folder, jobs=jobs)
        wall = time.perf_counter() - begin
    table = results.tables["conservation"]
    if len(table) != cells or set(table["status"]) != {"ok"}:
        raise SystemExit(f"{len(table)} of {cells} cells came back, with statuses {sorted(set(table['status']))}.")
    return wall, float(table["wall_time_s"].sum())


def main():
    sweep(2, 1)
    print("jobs  cells  seconds  of which runs")
    for jobs in (1, 2):
        points = []
        for cells in CELLS:
            wall, runs = min(sweep(cells, jobs) for _ in range(REPEATS))
            points.append((cells, wall))
            print(f"{jobs:4}  {cells:5}  {wall:7.3f}  {runs:13.3f}")
        n, t = np.array(points).T
        slope, start = np.polyfit(n, t, 1)
        growth = math.log((t[-1] - start) / (t[1] - start)) / math.log(n[-1] / n[1])
        print(f"      start-up {start:.2f} s, {1e3 * slope:.2f} ms a cell, beyond start-up as cells^{growth:.2f}")


if __name__ == "__main__":
    main()
