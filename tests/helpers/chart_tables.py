"""Made-up tables of ensembles for charts, of any methods."""

import numpy as np
import pandas as pd

from tcbench.analysis.statistics import wilson


def share_table(methods):
    rows = []
    for place, name in enumerate(methods):
        for dt in (0.1, 0.2, 0.4):
            failed = min(100, int(place * 90 * dt))
            low, high = wilson(failed, 100)
            rows.append({"integrator": name, "dt": dt, "tolerance": np.nan, "runs": 100, "failed": failed,
                         "share": failed / 100, "low": low, "high": high})  # fmt: skip
    return pd.DataFrame(rows)


def profile_table(methods):
    return pd.DataFrame([
        {"integrator": name, "measure": measure, "target": target, "tau": tau, "share": min(1.0, tau / (10 + place)),
         "low": 0.0, "high": 1.0, "runs": 30, "without_reference": 4}
        for place, name in enumerate(methods) for measure, target in (("state", 1e-6), ("energy", 1e-12))
        for tau in (1.0, 3.0, 10.0, 100.0)
    ])  # fmt: skip


def point_table(methods):
    return pd.DataFrame([
        {"integrator": name, "value": 10.0**-k, "seed": seed, "error": 10.0 ** (-k + 0.1 * seed), "time_s": 1e-4 * k}
        for name in methods for k in (3, 6, 9) for seed in range(5)
    ])  # fmt: skip


def law_table(methods):
    return pd.DataFrame([
        {"integrator": name, "law": law, "claimed": place % 2 == 0, "median": 0.0, "quantile_99": 1e-14, "worst": 1e-9}
        for place, name in enumerate(methods) for law in ("energy", "entropy")
    ])  # fmt: skip


def map_table(methods):
    return pd.DataFrame([
        {"integrator": name, "x_name": "dt", "x_low": dt, "x_high": dt, "y_name": "stiffness", "y_low": low,
         "y_high": 10 * low, "share": 0.5, "runs": 20}
        for name in methods for dt in (0.1, 0.2) for low in (1.0, 10.0, 100.0)
    ])  # fmt: skip
