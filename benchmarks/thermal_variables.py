"""Which thermal variable? One monolithic method in entropies, temperatures and energies: cost, accuracy, robustness.

    python benchmarks/thermal_variables.py    # half a minute: prints the tables of the page, and draws its picture

Everything but the times is counted or compared with a reference, so that another machine finds the same.
"""

from __future__ import annotations

import statistics
import time
from pathlib import Path
from typing import Any

import numpy as np

import tcbench
from tcbench.plugins import find_integrator, find_scenario
from tcbench.simulation.metrics import newton_iterations_mean
from tcbench.studies.measures import path_errors

ROOT = Path(__file__).parent.parent
PICTURE = ROOT / "docs" / "thermal_variables.png"
METHODS = {"s": "tc_monolithic", "theta": "tc_temperature", "u": "tc_energy"}
SCENARIOS = ("short_term", "long_term", "relative_equilibrium", "bound_equilibrium", "stiff_spring", "cold_spring",
             "fast_conduction", "gas_containers")  # fmt: skip
HORIZON = 25.0
RUNGS = range(-24, 13)  # of steps 2^(k/4): 1/64 to 8
SEEDS, RANDOM_T, RANDOM_STEPS = 400, 5.0, (0.1, 0.4, 1.6)
ROUNDS = 15  # of timed runs, in turn


def accuracy(method: str, name: str) -> dict[str, float]:
    """Errors of the state, its root mean square over eight times, and of the temperatures, at the scenario's step over
    four: there every method is well behaved."""
    scenario = find_scenario(name)
    row = path_errors(find_integrator(method), scenario, {"dt": scenario.dt / 4})
    return {"error": row["error_path_rms"], "error_theta": row["error_theta"]}


def iterations(method: str, name: str) -> float:
    """Newton iterations a step, at the scenario's own step."""
    scenario = tcbench.scenarios()[name]
    return newton_iterations_mean(tcbench.simulate(method, scenario, t_end=min(HORIZON, scenario.t_end)))


def largest_plain_step(method: str, name: str) -> float:
    """The last step on the ladder before plain Newton, started at z0, first fails; 0 where it fails on the first."""
    scenario, last = tcbench.scenarios()[name], 0.0
    for h in (2.0 ** (k / 4) for k in RUNGS):
        if not tcbench.simulate(method, scenario, dt=h, t_end=min(HORIZON, scenario.t_end), continuation=False).ok:
            break
        last = h
    return last


def failures(method: str, h: float, plain: bool, seeds: int = SEEDS) -> int:
    """Runs that fail of so many random pendulums, to t = 5."""
    starts = (find_scenario(f"random[seed={seed}]") for seed in range(seeds))
    return sum(not tcbench.simulate(method, s, dt=h, t_end=RANDOM_T, continuation=not plain).ok for s in starts)


def times(name: str) -> dict[str, float]:
    """Microseconds of processor time a step: medians of runs in turn."""
    scenario = tcbench.scenarios()[name].replace(t_end=300 * tcbench.scenarios()[name].dt)
    found: dict[str, list[float]] = {variable: [] for variable in METHODS}
    for _ in range(ROUNDS):
        for variable, method in METHODS.items():
            begin = time.process_time()
            run = tcbench.simulate(method, scenario, record_every=None)
            found[variable].append(1e6 * (time.process_time() - begin) / run.steps)
    return {variable: statistics.median(took) for variable, took in found.items()}


def tables(found: dict[str, dict[str, Any]], random: dict[float, dict[str, Any]]) -> str:
    """As the page has them."""
    columns = ("error of the state", "error of temperatures", "Newton a step", "plain Newton's largest step")
    lines = [f"| scenario | {' | '.join(f'{what}, s / θ / u' for what in columns)} |", "|---" * 5 + "|"]
    forms = (("error", ".2g"), ("error_theta", ".2g"), ("iterations", ".2f"), ("plain_step", ".3g"))
    for name, of in found.items():
        cells = [" / ".join(written(of[v][key], form) for v in METHODS) for key, form in forms]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    head = f"| failures of {SEEDS} random starts to t = {RANDOM_T:g} | plain Newton, s / θ / u | with continuation |"
    lines += ["", head, "|---|---|---|"]
    for h, of in random.items():
        plain, full = (" / ".join(str(of[v][i]) for v in METHODS) for i in (0, 1))
        lines.append(f"| h = {h:g} | {plain} | {full} |")
    return "\n".join(lines)


def written(value: float, form: str) -> str:
    return "-" if value is None or not np.isfinite(value) else format(value, form)


def picture(found: dict[str, dict[str, Any]], random: dict[float, dict[str, Any]]) -> None:
    """Three panels: errors and largest plain steps over those in entropies, and failures at random starts."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 3.4), layout="constrained")
    axes, names = figure.subplots(1, 3), list(found)
    at, width, colours = np.arange(len(names)), 0.35, {"s": "#777777", "theta": "#c44e52", "u": "#4c72b0"}
    words = {"s": "entropies", "theta": "temperatures", "u": "energies"}
    for ax, key, label in zip(axes, ("error", "plain_step"), ("error of the state", "plain Newton's largest step"),
                              strict=False):  # fmt: skip
        for i, v in enumerate(("theta", "u")):
            more = [found[n][v][key] / found[n]["s"][key] - 1 for n in names]
            ax.bar(at + (i - 0.5) * width, more, width, bottom=1, color=colours[v], label=words[v])
        ax.axhline(1, color=colours["s"], linewidth=1)
        ax.set_yscale("log", base=2)
        ax.yaxis.set_major_formatter("{x:g}")
        ax.set_xticks(at, names, rotation=60, ha="right", fontsize=7)
        ax.set_ylabel(f"{label},\nover that in entropies", fontsize=8)
    at = np.arange(len(random))
    for i, v in enumerate(METHODS):
        share = [100 * of[v][0] / SEEDS for of in random.values()]
        axes[2].bar(at + (i - 1) * 0.25, share, 0.25, color=colours[v], label=words[v])
    axes[2].set_xticks(at, [f"h = {h:g}" for h in random])
    axes[2].set_ylabel(f"plain Newton's failures,\n% of {SEEDS} random starts", fontsize=8)
    axes[2].legend(frameon=False, fontsize=8)
    figure.savefig(PICTURE, dpi=150)


def main() -> None:
    found: dict[str, dict[str, Any]] = {}
    for name in SCENARIOS:
        found[name] = {v: accuracy(m, name) | {"iterations": iterations(m, name)} for v, m in METHODS.items()}
        for v, m in METHODS.items():
            found[name][v]["plain_step"] = largest_plain_step(m, name)
    random = {h: {v: [failures(m, h, plain) for plain in (True, False)] for v, m in METHODS.items()}
              for h in RANDOM_STEPS}  # fmt: skip
    print(tables(found, random))
    for name in ("bound_equilibrium", "gas_containers"):
        of = times(name)
        print(f"\n{name}: {' / '.join(f'{of[v]:.2f}' for v in METHODS)} microseconds a step, s / θ / u")
    picture(found, random)


if __name__ == "__main__":
    main()
