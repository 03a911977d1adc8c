"""tc_auto beside the two methods that it chooses from: microseconds of whole runs, in turn in one process."""

import time

import numpy as np

import tcbench
from tcbench.studies.work_precision import horizon

NAMES = ("tc_taylor", "tc_gauss_adaptive", "tc_auto")
ROW_S, TOLERANCES = 2.0, (1e-4, 1e-7, 1e-10)  # longer than a processor stays at one speed
IN_TURN = 3  # runs of one: the first finds the processor's caches full of another's


def main() -> None:
    solvers = {name: tcbench.integrators()[name].adaptive for name in NAMES}
    print(f"{'scenario':22}{'tolerance':>10}" + "".join(f"{name:>20}" for name in NAMES) + f"{'over the better':>18}")
    for scenario in tcbench.scenarios().values():
        end = np.array([0.0, horizon(scenario)])
        for tolerance in TOLERANCES:
            times: dict[str, list[float]] = {name: [] for name in NAMES}
            start = time.process_time()
            while time.process_time() < start + ROW_S:
                for name, solve in solvers.items():
                    took = []
                    for _ in range(IN_TURN):
                        begin = time.process_time()
                        solve(scenario.model, scenario.z0, end, tolerance, tolerance)
                        took.append(1e6 * (time.process_time() - begin))
                    times[name].append(min(took))
            found = {name: float(np.median(times[name])) for name in NAMES}
            ratio = found["tc_auto"] / min(found["tc_taylor"], found["tc_gauss_adaptive"])
            cells = "".join(f"{found[name]:>20.0f}" for name in NAMES)
            print(f"{scenario.name:22}{tolerance:>10g}{cells}{ratio:>18.2f}", flush=True)


if __name__ == "__main__":  # asv imports every file here
    main()
