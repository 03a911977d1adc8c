"""tc_auto beside the two methods that it chooses from: microseconds of whole runs, interleaved minima, one process."""

import time

import numpy as np

import tcbench
from tcbench.studies.work_precision import horizon

NAMES = ("tc_taylor", "tc_gauss_adaptive", "tc_auto")
REPEATS, TOLERANCES = 40, (1e-4, 1e-7, 1e-10)
IN_TURN = 3  # runs of one: the first finds the processor's caches full of another's


def main() -> None:
    solvers = {name: tcbench.integrators()[name].adaptive for name in NAMES}
    print(f"{'scenario':22}{'tolerance':>10}" + "".join(f"{name:>20}" for name in NAMES) + f"{'over the better':>18}")
    for scenario in tcbench.scenarios().values():
        end = np.array([0.0, horizon(scenario)])
        for tolerance in TOLERANCES:
            best = dict.fromkeys(NAMES, np.inf)
            for _ in range(REPEATS):
                for name, solve in solvers.items():
                    for _ in range(IN_TURN):
                        begin = time.perf_counter()
                        solve(scenario.model, scenario.z0, end, tolerance, tolerance)
                        best[name] = min(best[name], 1e6 * (time.perf_counter() - begin))
            ratio = best["tc_auto"] / min(best["tc_taylor"], best["tc_gauss_adaptive"])
            print(
                f"{scenario.name:22}{tolerance:>10g}" + "".join(f"{best[n]:>20.0f}" for n in NAMES) + f"{ratio:>18.2f}"
            )


if __name__ == "__main__":  # asv imports every file here
    main()
