"""tcbench beside a hand-written C++ step, plain numpy and SciPy, in one run, as ratios.

    python benchmarks/compare_limits.py [--repeats 30] [--target x86-64 | x86-64-v3 | x86-64-v4] [--steps-only]

Every figure is the minimum of interleaved repeats, so that drift of a shared machine hits all of them.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

import tcbench
from tcbench.compiler.machine import TARGET

CASES = (("short_term", 0.3, 83), ("long_term", 0.3, 1666), ("bound_equilibrium", 0.05, 1000))
METHODS = ("tc_monolithic", "tc_staggered", "tc_strang", "midpoint_entropy", "midpoint_temperature")
SOURCE = Path(__file__).with_name("tc_step.cpp")


def compile_limit(folder: str, target: str) -> str | None:
    compiler = shutil.which("g++") or shutil.which("c++")
    if compiler is None:
        print("No C++ compiler here: the hand-written step is left out.")
        return None
    program = f"{folder}/tc_step"
    subprocess.run([compiler, "-O3", f"-march={target or 'native'}", str(SOURCE), "-o", program], check=True)
    return program


def cpp_time(program: str, scenario: tcbench.Scenario, h: float, steps: int, inner: int) -> tuple[float, float]:
    """(seconds per step, Newton iterations per step) of the hand-written step."""
    m = scenario.model
    constants = [*m.masses, *m.stiffness, *m.natural_lengths, m.conductivity, m.reference_temperature, m.coupling]
    numbers = [h, steps, inner, *constants, m.heat_capacity, *scenario.z0]
    out = subprocess.run([program, *(repr(float(v)) for v in numbers)], check=True, capture_output=True, text=True)
    seconds, iterations, *_ = map(float, out.stdout.split())
    return seconds, iterations


def tcbench_time(method: str, scenario: tcbench.Scenario, h: float, steps: int, inner: int) -> tuple[float, float]:
    best, run = np.inf, None
    for _ in range(inner):
        run = tcbench.simulate(method, scenario, dt=h, t_end=h * steps, record_every=None)
        assert run.ok, run.failure
        best = min(best, run.wall_time_s)
    assert run is not None
    return best / run.steps, run.solver.newton_iterations / run.steps


def numpy_time(scenario: tcbench.Scenario, h: float, steps: int) -> float:
    """Steps near the end of a run, where Newton needs no continuation."""
    from numpy_step import step as numpy_step  # beside this script; asv, which imports this file too, is not

    z = tcbench.simulate("tc_monolithic", scenario, dt=h, t_end=h * 80, record_every=None).z[-1]
    begin = time.perf_counter()
    for _ in range(steps):
        z = numpy_step(z, h, scenario.model)
    return (time.perf_counter() - begin) / steps


def scipy_time(method: str, scenario: tcbench.Scenario, t_end: float, **options: object) -> tuple[float, int]:
    model = scenario.model

    def field(t: float, z: np.ndarray) -> np.ndarray:
        return np.asarray(model.vector_field(z))

    begin = time.perf_counter()
    solution = solve_ivp(field, (0, t_end), scenario.z0, method, rtol=1e-6, atol=1e-6, **options)
    return time.perf_counter() - begin, len(solution.t) - 1


def call_overheads(repeats: int) -> dict[str, float]:
    """Seconds of the processor of a warm simulate call beside its steps, of every fixed-step method: that of one short
    step, less a step (a third of what three more take)."""
    base, h = tcbench.scenarios()["short_term"], 0.01
    scenarios = {steps: base.replace(t_end=steps * h, dt=h) for steps in (1, 4)}
    known = tcbench.integrators().values()
    methods = [i for i in known if i.kind != "adaptive" and not i.lacks and not i.suits(base.model)]
    best: dict[tuple[str, int], float] = {}
    for _ in range(1 + repeats):  # interleaved
        for method in methods:
            for steps, scenario in scenarios.items():
                begin = time.process_time()
                for _ in range(100):
                    tcbench.simulate(method, scenario)
                key, spent = (method.name, steps), (time.process_time() - begin) / 100
                best[key] = min(best.get(key, np.inf), spent)
    return {i.name: best[i.name, 1] - (best[i.name, 4] - best[i.name, 1]) / 3 for i in methods}


def python_step_overhead(scenario: tcbench.Scenario) -> float:
    """Seconds that tcbench adds to each step of a plain Python integrator."""

    def still(z: np.ndarray, h: float, system: tcbench.System) -> np.ndarray:
        return z

    method = tcbench.Integrator(name="still", order=1, step=still)
    runs = [tcbench.simulate(method, scenario, dt=0.01, record_every=None) for _ in range(5)]
    return min(run.wall_time_s / run.steps for run in runs)


def compare(case: tuple[str, float, int], program: str | None, repeats: int, steps_only: bool) -> None:
    name, h, steps = case
    scenario = tcbench.scenarios()[name].replace(t_end=1500.0, name=f"{name}_long")
    inner = max(1, 4000 // steps)
    for method in METHODS:
        tcbench_time(method, scenario, h, steps, 1)
    best: dict[str, tuple[float, float]] = {}
    for _ in range(repeats):  # interleaved
        for method in METHODS:
            best[method] = min(best.get(method, (np.inf, 0.0)), tcbench_time(method, scenario, h, steps, inner))
        if program:
            best["C++"] = min(best.get("C++", (np.inf, 0.0)), cpp_time(program, scenario, h, steps, inner))
    limit = best["C++"][0] if program else best["tc_monolithic"][0]
    print(f"\n{name}, h = {h:g}, {steps} steps ({'ratios to C++' if program else 'ratios to tc_monolithic'})")
    for label, (seconds, iterations) in best.items():
        print(f"  {label:22s} {1e6 * seconds:9.3f} us/step {seconds / limit:9.2f}   {iterations:5.2f} Newton/step")
    if steps_only:
        return
    plain = min(numpy_time(scenario, h, 30) for _ in range(3))
    own = best["tc_monolithic"][0]
    print(
        f"  {'plain numpy':22s} {1e6 * plain:9.1f} us/step {plain / limit:9.0f}   ({plain / own:.0f} x tc_monolithic)"
    )
    for method, options in (("Radau", {"jac": lambda t, z: scenario.model.jacobian(z)}), ("LSODA", {})):
        seconds, taken = min(scipy_time(method, scenario, h * steps, **options) for _ in range(3))
        ratio = seconds / (own * steps)
        print(
            f"  SciPy {method}, rtol 1e-6: {1e3 * seconds:8.2f} ms for {taken} steps: {ratio:.0f} x tc_monolithic's run"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=30, help="interleaved repeats; minima are reported")
    parser.add_argument("--target", default="", help="processor that both are compiled for; this machine's by default")
    parser.add_argument("--steps-only", action="store_true", help="neither numpy nor SciPy")
    options = parser.parse_args()
    os.environ[TARGET] = options.target  # read when the first kernel is compiled
    with tempfile.TemporaryDirectory() as folder:
        program = compile_limit(folder, options.target)
        for case in CASES:
            compare(case, program, options.repeats, options.steps_only)
    scenario = tcbench.scenarios()["short_term"]
    calls = call_overheads(options.repeats)
    print(
        f"\nwarm simulate call beside its steps: {1e6 * min(calls.values()):.0f} to {1e6 * max(calls.values()):.0f} us"
    )
    print("  " + ", ".join(f"{name} {1e6 * seconds:.0f}" for name, seconds in calls.items()))
    print(f"added to a plain Python step:        {1e6 * python_step_overhead(scenario):.1f} us a step")


if __name__ == "__main__":
    main()
