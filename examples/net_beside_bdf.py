"""tc_monolithic beside SciPy's BDF with the same sparse Jacobian, on a net of 20 by 20 masses.

python examples/net_beside_bdf.py
"""

import time

import numpy as np
from tcbench_plugins.net.net import net

import tcbench

SCENARIO = net(20, 20, t_end=5.0)


def timed(method, **options):
    """(processor seconds, run) of the second of two runs: the first compiles."""
    tcbench.simulate(method, SCENARIO, **options)
    begin = time.process_time()
    run = tcbench.simulate(method, SCENARIO, **options)
    return time.process_time() - begin, run


def main():
    n = SCENARIO.model.n_positions
    fine = tcbench.simulate("gauss3", SCENARIO, dt=0.05).z[-1, :n]
    runs = {
        f"tc_monolithic, h = {h:g}": timed("tc_monolithic", dt=h, record_every=None) for h in (0.1, 0.05, 0.025, 0.0125)
    }
    runs |= {f"BDF, rtol = {rtol:g}": timed("solve_ivp_bdf", tolerance=rtol) for rtol in (1e-3, 1e-4, 1e-5)}
    for name, (seconds, run) in runs.items():
        error = np.abs(run.z[-1, :n] - fine).max()
        print(f"| {name} | {seconds:.2f} | {error:.1e} | {run.summary.energy_error_max:.0e} |")


if __name__ == "__main__":
    main()
