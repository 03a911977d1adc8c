"""The tables of docs/methods-measured.md from a run folder: python benchmarks/methods_tables.py results/latest"""

import math
import sys

import pandas as pd

SCENARIOS = ("short_term", "stiff_spring", "long_term", "bound_equilibrium")
OTHERS = ("cold_spring", "fast_conduction", "relative_equilibrium", "gas_containers")
METHODS = [
    "tc_auto",
    "tc_gauss_adaptive",
    "tc_taylor",
    "tc_gauss",
    "controlled",
    "gauss3",
    "gauss2",
    "projected",
    "verlet_heat4",
    "verlet_heat",
    "tc_monolithic",
    "tc_strang",
    "tc_strang_exact",
    "tc_gonzalez",
    "tc_mean_value",
    "midpoint_entropy",
    "scipy_odeint",
    "scipy_dopri5",
    "scipy_dop853",
    "solve_ivp_lsoda",
    "solve_ivp_radau",
    "solve_ivp_bdf",
    "cvode",
    "heyoka",
]
TARGETS = (("error", 1e-3, "state 1e-3"), ("error", 1e-6, "state 1e-6"), ("error", 1e-9, "state 1e-9"),
           ("energy_error_max", 1e-12, "energy 1e-12"))  # fmt: skip


def main() -> None:
    folder = sys.argv[1]
    table = pd.read_csv(f"{folder}/tables/time_to_accuracy.csv")
    precision = pd.read_csv(f"{folder}/tables/work_precision.csv")
    peers = precision[["integrator", "peer"]].drop_duplicates().set_index("integrator")["peer"].fillna("")

    def times(scenario: str, measure: str, target: float) -> pd.Series:
        near = (table["target"] / target - 1).abs() < 1e-6
        return table[(table["scenario"] == scenario) & (table["measure"] == measure) & near].set_index("integrator")[
            "time_s"
        ]

    def cell(method: str, scenario: str, target: float) -> str:
        us = 1e6 * times(scenario, "error", target).get(method, math.nan)
        return "-" if math.isnan(us) else f"{us:.0f}" if us < 1e5 else f"{us:.2g}"

    head("microseconds to 1e-3 / 1e-6 / 1e-9", SCENARIOS)
    for method in METHODS:
        row = (" / ".join(cell(method, s, target) for _, target, _ in TARGETS[:3]) for s in SCENARIOS)
        print(f"| `{method}` | " + " | ".join(row) + " |")
    for scenarios in (SCENARIOS, OTHERS):
        print()
        head("`tc_auto`, times faster than", scenarios)
        for who, kinds in (("the best SciPy solver", {"scipy"}), ("the best peer of all", {"scipy", "other"})):
            for measure, target, label in TARGETS:
                row = []
                for scenario in scenarios:
                    found = times(scenario, measure, target)
                    best = found[[name for name in found.index if peers.get(name) in kinds]].dropna()
                    ratio = best.min() / found.get("tc_auto", math.nan) if len(best) else math.nan
                    row.append("-" if math.isnan(ratio) else f"{ratio:.1f} ({best.idxmin()})")
                print(f"| {who}, {label} | " + " | ".join(row) + " |")


def head(title: str, scenarios: tuple[str, ...]) -> None:
    print(f"| {title} | " + " | ".join(scenarios) + " |\n" + "|---" * (len(scenarios) + 1) + "|")


if __name__ == "__main__":  # asv imports every file here
    main()
