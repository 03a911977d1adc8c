"""Is any TC step lost? Random steps of random pendulums, each of which has a root (docs/physics.md, section 8).

    python benchmarks/audit_steps.py [--steps 1000000] [--methods tc_monolithic tc_staggered] [--jobs 2] [--seed 0]

h is log-uniform from 0.01 to 10, constants span three decades: stiffness 0.03 to 300, conductivity 0.1 to 3000, heat
capacity 1 to 20, coupling 0 to 1, masses 0.3 to 3, natural lengths 0.5 to 3; lengths at 0.4 to 2.5 of the natural ones,
momenta normal with a deviation from 0.1 to 10, temperatures 0.7 to 1.4 of the reference. Exits with 1 if one is lost.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np

import tcbench
from tcbench.compiler.library import evaluate
from tcbench.simulation.prepared import Prepared
from tcbench.simulation.recorder import cause_of
from tcbench.solver.implicit_step import OK, compiled_flows

BATCH = 10_000
SHARE = {
    "retried": "a second guess",
    "tracked": "tracking in h",
    "arcs": "the arc",
    "detours": "a detour",
    "folds": "folds on the way",
}


def draw(rng: np.random.Generator, count: int, reference: float) -> dict[str, np.ndarray]:
    """Constants, (q, p, theta) and step of `count` cases, one a row."""

    def log_uniform(low: float, high: float, *shape: int) -> np.ndarray:
        return np.exp(rng.uniform(math.log(low), math.log(high), (count, *shape)))

    natural = rng.uniform(0.5, 3.0, (count, 2))
    length, angle = natural * log_uniform(0.4, 2.5, 2), rng.uniform(0.0, 2 * math.pi, (count, 2))
    arms = length[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    q = np.cumsum(arms, axis=1).reshape(count, 4)
    p = rng.normal(size=(count, 4)) * log_uniform(0.1, 10.0, 1)
    theta = reference * rng.uniform(0.7, 1.4, (count, 2))
    return {
        "masses": rng.uniform(0.3, 3.0, (count, 2)), "stiffness": log_uniform(0.03, 300.0, 2),
        "natural_lengths": natural, "conductivity": log_uniform(0.1, 3000.0),
        "reference_temperature": np.full(count, reference), "coupling": rng.uniform(0.0, 1.0, count),
        "heat_capacity": rng.uniform(1.0, 20.0, count), "y": np.concatenate([q, p, theta], axis=1),
        "h": log_uniform(0.01, 10.0),
    }  # fmt: skip


class Stepper:
    """One step of a method from any state of any pendulum: what `simulate` does, without making a scenario for each."""

    def __init__(self, name: str) -> None:
        self.method, self.scenario = tcbench.integrators()[name], tcbench.scenarios()["short_term"]
        self.model = model = self.scenario.model
        self.ready = Prepared(model, self.method, compiled_flows(self.method.flows, model.symbolic))
        self.tally = self.ready.tally
        self.entropies, self.exergy = (model.kernel(name)[0] for name in ("entropy_variables", "exergy"))

    def __call__(self, constants: np.ndarray, y: np.ndarray, h: float) -> int:
        """Why there is no step, or OK."""
        run, V0, z = self.ready.run, np.zeros(1), np.zeros(self.model.size)
        run.c[1 : 1 + len(constants)] = constants
        evaluate(self.entropies.address, y, run.c, z)
        evaluate(self.exergy.address, z, run.c, V0)
        for flow, _, _ in self.ready.flows:
            flow.bound = max(float(V0[0]), 1e-10)
        self.ready.set_length(h)
        return self.ready.step(z)


def audit(name: str, seed: int, batches: range) -> tuple[Counter, list[dict[str, Any]]]:
    """What the steps of these batches needed, and those that were lost."""
    step = Stepper(name)
    names, reference = list(step.model.constants), step.model.reference_temperature
    counts: Counter = Counter()
    lost = []
    for batch in batches:
        cases = draw(np.random.default_rng([seed, batch]), BATCH, reference)
        constants = np.concatenate([cases[n].reshape(BATCH, -1) for n in names], axis=1)
        for i, (values, y, h) in enumerate(zip(constants, cases["y"], cases["h"], strict=True)):
            reason = step(values, y, float(h))
            if reason != OK:
                case = {n: cases[n][i].tolist() for n in names}
                lost.append(
                    {
                        "case": (batch, i),
                        "reason": cause_of(reason, step.model, step.method),
                        "h": float(h),
                        "y": y.tolist(),
                        **case,
                    }
                )
    numbers = step.tally.as_numbers()._asdict()
    counts.update({key: numbers[key] for key in ("iterations", *SHARE)})
    counts["steps"] = len(batches) * BATCH
    return counts, lost


def report(name: str, counts: Counter, lost: list[dict[str, Any]], seconds: float) -> None:
    steps = counts["steps"]
    print(f"{name}: {steps} steps in {seconds:.0f} s, {counts['iterations'] / steps:.2f} Newton iterations a step")
    for key, words in SHARE.items():
        print(f"  {words:16s} {counts[key]:8d} ({100 * counts[key] / steps:.3f} %)")
    print(f"  lost             {len(lost):8d}")
    for case in lost[:20]:
        print(f"    {case}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=1_000_000, help=f"of each method, in batches of {BATCH}")
    parser.add_argument("--methods", nargs="+", default=["tc_monolithic", "tc_staggered"])
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    batches, failed = max(1, options.steps // BATCH), False
    for name in options.methods:
        Stepper(name)  # compiled once, not by every process
        begin = time.perf_counter()
        counts: Counter = Counter()
        lost: list[dict[str, Any]] = []
        with ProcessPoolExecutor(options.jobs) as pool:
            parts = [
                pool.submit(audit, name, options.seed, range(j, batches, options.jobs)) for j in range(options.jobs)
            ]
            for part in parts:
                found, missing = part.result()
                counts.update(found)
                lost += missing
        report(name, counts, lost, time.perf_counter() - begin)
        failed = failed or bool(lost)
    sys.exit(failed)


if __name__ == "__main__":
    main()
