"""Tables of runs of random sizes, with gaps, for what reads them."""

import math

import numpy as np
import pandas as pd


def records(tables, name):
    return tables[name].to_dict("records") if name in tables else []


def is_number(value):
    return isinstance(value, int | float) and math.isfinite(value)


def random_tables(seed):
    """A run of random size whose methods are good and bad at everything, with gaps."""
    random, other = np.random.default_rng(seed), np.random.default_rng(seed + 1000)
    methods = [f"m{i:02d}" for i in range(int(random.integers(1, 40)))]
    scenarios = [f"s{i}" for i in range(int(random.integers(1, 9)))]
    peers = set(methods[-3:]) if len(methods) > 6 else set()
    good = {m for m in methods if random.random() < 0.3}
    narrow = set(methods[::3])  # of even seeds: methods that do not run everywhere
    conservation, work, times, stable = [], [], [], []
    for s in scenarios:
        has_momentum = random.random() < 0.7
        for m in methods:
            for h in (0.1, 0.3, 0.9):
                failed = m not in good and random.random() < 0.1
                conservation.append({
                    "integrator": m, "scenario": s, "dt": math.nan if m in peers else h * (1 + (s == "s0")),
                    "status": "blowup" if failed else "ok", "steps": 0 if failed and random.random() < 0.5 else 80,
                    "energy_error_max": 1e-14 if m in good else 10.0 ** random.uniform(-12, 0),
                    "second_law_violations": 0 if m in good else int(random.integers(0, 3)),
                    "angular_momentum_error_max": 1e-15 if has_momentum else math.nan,
                })  # fmt: skip
                work.append({
                    "integrator": m, "scenario": s, "control": "rtol" if m in peers else "dt", "value": h,
                    "status": "ok" if random.random() < 0.95 else "nonconverged",
                    "error_theta": random.choice([10.0 ** random.uniform(-5, 0), math.nan], p=[0.9, 0.1]),
                    "error_entropy_produced": other.choice([10.0 ** other.uniform(-5, 0), math.nan], p=[0.9, 0.1]),
                    "steps": 80, "wall_time_min_s": other.choice([other.uniform(1e-5, 1e-3), math.nan]),
                    "inner_steps_mean": 1.0 + 4.25 * (m not in peers and int(m[1:]) % 3 == 0),
                    "reference_floor": 1e-12, "peer": "scipy" if m == methods[-1] else "other" if m in peers else "",
                })  # fmt: skip
            kind = random.choice(["none", "physical", "solver"])
            if m not in peers:
                stable.append({
                    "integrator": m, "scenario": s, "limit": kind, "dt_stable": random.uniform(0.1, 1), "dt_cap": 4.0,
                    "dt_unstable": math.nan if kind == "none" else random.uniform(1, 2),
                })  # fmt: skip
        for target in (1e-3, 1e-6, 1e-9):
            reached = {
                m: random.uniform(1e-4, 1)
                if random.random() < (1.0 if m in narrow else 0.5 - 0.1 * (seed % 5))
                else math.nan
                for m in methods
            }
            of = {m: reached[m] for m in peers if is_number(reached[m])}
            scipy = reached[methods[-1]] if methods[-1] in of else math.nan
            best = min(of, key=of.get) if of else ""
            times += [{
                "integrator": m, "scenario": s, "measure": "error", "target": target, "time_s": t, "best_peer": best,
                "ratio_to_best_peer": of.get(best, math.nan) / t, "best_scipy": methods[-1] if is_number(scipy) else "",
                "ratio_to_best_scipy": scipy / t,
            } for m, t in reached.items() if seed % 2 or m not in narrow or s not in ("s5", "s6", "s7")]  # fmt: skip
    shares = [
        {"ensemble": ensemble, "integrator": m, "runs": 100 + 50 * (m == "m01"),
         "failed": 0 if m in good else int(random.integers(0, 99)),
         "dt": math.nan if m in peers else h, "tolerance": h / 100 if m in peers else math.nan}
        for ensemble in ("random", "other") for m in methods for h in (0.1, 0.4)
    ]  # fmt: skip
    for row in shares[: 2 * (seed % 3)]:  # a slow method, of which there was time for few runs
        row |= {"runs": 3, "failed": min(row["failed"], 1)}
    for row in random.choice(shares, 2):  # a tolerance for which there was no time
        row |= {"runs": 0, "failed": 0}
    shares = [row | {"share": row["failed"] / row["runs"] if row["runs"] else math.nan} for row in shares]
    made = {"conservation": conservation, "work_precision": work, "time_to_accuracy": times}
    made |= {"stability": stable, "failure_share": shares}
    return {name: pd.DataFrame(rows) for name, rows in made.items() if rows}
