"""Made-up tables for charts and the report: ordinary ones, and ones that no study would give on a good day."""

import numpy as np
import pandas as pd

from tcbench.runner.codec import digest
from tcbench.runner.rows import Store

FIVE = ["tc_monolithic", "tc_staggered", "tc_strang", "midpoint_entropy", "midpoint_temperature"]
PEERS = ["scipy_radau", "cvode_bdf"]
FORTY = [*FIVE, *PEERS, *(f"method_{i:02d}" for i in range(33))]
SCENARIOS = ["short_term", "stiff_spring", "cold_spring"]
HOSTILE = "<script>alert('x')</script>\"'&$x_1$ \u202eאבג مرحبا"


def grid(methods, scenarios, **columns):
    """A row for each scenario, method and value of the further columns; which methods are consistent; the places of
    each row's scenario, method and values."""
    values = {"scenario": scenarios, "integrator": methods, **columns}
    rows = pd.MultiIndex.from_product(values.values(), names=values).to_frame(index=False)
    places = np.indices([len(of) for of in values.values()]).reshape(len(values), -1)
    return rows[["integrator", "scenario", *columns]], rows["integrator"].str.startswith("tc"), *places


def work_precision(methods, scenarios=SCENARIOS, failing=("midpoint_temperature",)):
    rows, tc, _, m, k = grid(methods, scenarios, k=range(7))
    name = rows["integrator"]
    adaptive, order = name.isin(PEERS), np.where(name.str.contains("staggered"), 1, 2)
    value = np.where(adaptive, 10.0 ** (-3.0 - k), 0.3 / 2.0**k)
    error = np.where(adaptive, value * 3, (0.4 + 0.1 * m) * value**order)
    failed = name.isin(failing) & (k < 2) & rows["scenario"].ne("short_term")
    seconds = 1e-5 * (1 + m) * np.where(adaptive, value**-0.25 * 30, 1 / value)
    measured = pd.DataFrame({
        "error_q": error, "error_p": 2 * error, "error_s": 0.3 * error,
        "error_theta": np.where(error < 1e-5, np.nan, 30 * error),
        "energy_error_max": np.where(tc, 1e-14, 0.1 * error),
    }).mask(failed)  # fmt: skip
    return rows[["integrator", "scenario"]].assign(
        control=np.where(adaptive, "rtol", "dt"), value=value, status=np.where(failed, "blowup", "ok"), **measured,
        wall_time_min_s=np.where(failed & (k == 0), np.nan, seconds), wall_time_median_s=1.1 * seconds, repeats=9,
        steps=np.where(adaptive, 300, 25 / value).astype(int), newton_iterations=300, rhs_evaluations=0,
    )  # fmt: skip


def stability(methods, scenarios=SCENARIOS, nothing=False):
    rows, tc, s, m = grid(methods, scenarios)
    kind = np.where(tc, "none", np.array(["none", "physical", "branch", "solver"])[(m + s) % 4])
    free = kind == "none"
    stable = np.where(free, 12.0, 0.03 * 1.7 ** (m % 6 + s))
    stable[((m + s) % 11 == 10) | nothing] = np.nan
    return rows.assign(
        dt_stable=stable, dt_unstable=np.where(free, np.nan, stable * 1.011), limit=kind, dt_cap=12.0,
        dt_half=np.where(free, np.nan, stable * 1.3), dt_fold=np.nan, non_monotone=m % 5 == 3,
        dt_stable_plain=0.6 + 0.05 * m, limit_plain="solver",
    )  # fmt: skip


def stability_points(methods, scenarios=SCENARIOS, t_end=25.0):
    rows, tc, _, m, _ = grid(methods, scenarios, dt=[2.0 ** (k / 4) for k in range(-14, 16)])
    h, fails = rows["dt"], ~tc & (rows["dt"] > 0.1 * (m + 1))
    return rows.assign(
        status=np.where(fails, "blowup", "ok"), continuation_steps=0,
        blowup_time=np.minimum(t_end, 4 + 3 / h + np.sin(9 * h)).where(fails),
    )  # fmt: skip


def sensitivity(methods, scenarios=SCENARIOS):
    rows, tc, *_ = grid(methods, scenarios)
    return rows[~tc].assign(dt=0.6, factor=1.0, median=9.0, earliest=5.0, latest=14.0).reset_index(drop=True)


def convergence(methods, scenarios=SCENARIOS, failing=()):
    rows, _, _, m, _, k = grid(methods, scenarios, variable=["q", "p", "s", "theta"], k=range(10))
    name = rows["integrator"]
    order, h = np.where(name.str.contains("staggered"), 1, 2), 0.5 / 2.0**k
    failed = name.isin(failing) | ((k == 0) & (m % 3 == 2))
    used = ~failed & (k >= 3) & (k <= 7)
    reason = np.select([failed, used, k > 7], ["failed", "used", "round-off"], "pre-asymptotic")
    error = np.maximum((1 + 0.2 * m) * h**order * (1 + h), 3e-12 / h)
    points = rows[["integrator", "scenario", "variable"]].assign(
        dt=h, status=np.where(failed, "nonconverged", "ok"), error=np.where(failed, np.nan, error), local_order=order,
        used=used, reason=reason,
    )  # fmt: skip
    fits = points[k == 0][["integrator", "scenario", "variable"]].assign(declared=order[k == 0]).reset_index(drop=True)
    lost, order = fits["integrator"].isin(failing), fits["declared"]
    fits = fits.assign(order=(order + 0.003).mask(lost), order_low=order - 0.02, order_high=order + 0.02, points_used=5,
                       dt_min=0.004, dt_max=0.06, verdict="as declared")  # fmt: skip
    return fits, points


def conservation(
    methods, scenarios=SCENARIOS, failing=lambda name, h: "midpoint" in name and h > 0.2, failure="blew up"
):
    rows, tc, _, m, _ = grid(methods, scenarios, dt=[0.075, 0.15, 0.3, 0.6, 1.2])
    h = rows["dt"]
    failed = pd.Series([failing(name, step) for name, step in zip(rows["integrator"], h, strict=True)])
    return rows.assign(
        status=np.where(failed, "blowup", "ok"), blowup_time=(3 / h).where(failed),
        energy_error_max=np.where(tc, 1e-15 * (m + 1), np.where(failed, 1e3, h**2)),
        energy_error_final=np.where(tc, 1e-15, h**2), energy_drift=0.0,
        entropy_increment_min=np.where(tc, 0.0, -1e-6 * h * (m % 2)),
        second_law_violations=np.where(tc, 0, 3 * (m % 2)), angular_momentum_error_max=1e-14,
        lyapunov_increment_max=0.0, residual_max=1e-16, newton_iterations_mean=4.0, us_per_step=2.0 + m, t_final=25.0,
        steps=(25 / h).astype(int), failure=np.where(failed, failure, ""),
    )  # fmt: skip


def equilibrium(methods, scenarios=("bound_equilibrium",)):
    rows, _, _, m, _ = grid(methods, scenarios, t=np.geomspace(0.3, 1500, 60))
    gap = (1 + 0.1 * m) * np.exp(-rows["t"] / 200)
    gaps = {"entropy_gap": 0.05 * gap, "strain_gap": gap, "temperature_gap": 20 * gap, "rotation_gap": 0.1 * gap}
    return rows.assign(dt=0.3, **gaps)


def claims():
    rows = [
        ("TC: E exact, S only grows, J exact", "Theorems 1 to 3", "exact", "|dE|/V0 = 1e-13", "holds"),
        ("midpoint_temperature blows up at t = 12", "section 6", "t = 12", "runs to the end", "does not hold"),
        ("midpoint_entropy: E and S oscillate", "section 6", "S falls", HOSTILE, "contradicts the printed equations"),
    ]
    return pd.DataFrame(rows, columns=["claim", "section", "expected", "measured", "verdict"])


def series(methods, scenarios=SCENARIOS):
    """Runs in time as rows keep them; `opening` is their first steps."""
    t = np.linspace(0, 25, 90)
    frames = []
    for scenario in scenarios:
        for i, name in enumerate(methods):
            lost = np.zeros_like(t) if name.startswith("tc") else 1e-3 * (i + 1) * t
            columns = {
                "t": t,
                "energy": 60 + lost,
                "entropy": 0.1 * t,
                "energy_error": lost,
                "entropy_fall": 0.1 * lost,
            }
            columns |= {"angular_momentum": 4 + 0 * t, "angular_momentum_error": 0 * t, "lyapunov_rise": 0 * t}
            columns |= {f"temperature_{x}": 300 + k + 0 * t for k, x in enumerate("ab")}
            columns |= {f"strain_{x}": 0.1 * np.sin(t + k) for k, x in enumerate("ab")}
            columns |= {f"{x}_{k}": k + np.cos(t + k) for k in (1, 2) for x in "xy"}
            known = {"integrator": name, "scenario": scenario, "dt": 0.3, "status": "ok"}
            frames.append(pd.DataFrame(known | columns))
    return pd.concat(frames, ignore_index=True)


def everything(methods, scenarios=SCENARIOS, **settings):
    """Every table of a full run."""
    fits, points = convergence(methods, scenarios)
    return {
        "conservation": conservation(methods, scenarios, **settings),
        "convergence": fits,
        "convergence_points": points,
        "work_precision": work_precision(methods, scenarios),
        "time_to_accuracy": time_to_accuracy(methods, scenarios),
        "stability": stability(methods, scenarios),
        "stability_points": stability_points(methods, scenarios),
        "blowup_sensitivity": sensitivity(methods, scenarios),
        "equilibrium": equilibrium(methods),
        "claims": claims(),
        "series": series(methods, scenarios),
        "opening": series(methods, scenarios),
    }


def time_to_accuracy(methods, scenarios=SCENARIOS):
    """Methods reach what they reach in the order of their places; every third misses 1e-6, every second 1e-9."""
    rows = []
    for s, scenario in enumerate(scenarios):
        for target, misses in ((1e-3, 99), (1e-6, 3), (1e-9, 2)):
            times = {
                m: 1e-5 * (1 + (i + s) % 7) / target**0.2 if (i + 1) % misses else np.nan for i, m in enumerate(methods)
            }
            of = {m: times[m] for m in PEERS if m in times and np.isfinite(times[m])}
            best = min(of, key=of.get, default="")
            rows += [
                {"integrator": m, "scenario": scenario, "measure": "error", "target": target, "time_s": t,
                 "best_peer": best, "ratio_to_best_peer": of.get(best, np.nan) / t, "best_scipy": "",
                 "ratio_to_best_scipy": np.nan}
                for m, t in times.items()
            ]  # fmt: skip
    return pd.DataFrame(rows)


def ensemble(methods):
    """The tables of runs from random starts."""
    shares, profile, laws = [], [], []
    for i, name in enumerate(methods):
        same = {"ensemble": "random", "integrator": name}
        for dt in (0.1, 0.3, 0.9):
            share = 0.0 if name.startswith("tc") else min(1.0, 0.2 * dt * (1 + i % 4))
            row = same | {"dt": dt, "tolerance": np.nan, "runs": 200, "failed": round(200 * share), "share": share}
            shares.append(row | {"low": max(0.0, share - 0.03), "high": min(1.0, share + 0.03)})
        for tau in (1, 2, 5, 10, 100, 1000):
            share = min(1.0, 0.1 * np.log(1 + tau) * (3 if i in (3, 4) else 1 + i % 2) / 2)
            row = same | {"measure": "state", "target": 1e-6, "tau": tau, "share": share, "runs": 200}
            profile.append(
                row | {"low": max(0.0, share - 0.05), "high": min(1.0, share + 0.05), "without_reference": 3}
            )
        for law in ("energy", "entropy", "angular_momentum"):
            worst = 1e-13 if name.startswith("tc") else 0.1
            row = same | {"law": law, "claimed": name.startswith("tc"), "runs": 600, "broken": 0, "worst": worst}
            laws.append(row | {"quantile_99": worst / 9, "median": worst / 99})
    made = {"failure_share": shares, "performance_profile": profile, "ensemble_laws": laws}
    return {name: pd.DataFrame(rows) for name, rows in made.items()}


def declared(methods, scenarios=SCENARIOS):
    """What a folder says of its methods and scenarios."""
    claims = ["angular_momentum", "energy", "entropy"]
    told = {
        m: {"family": "Romero (2009)" if m in FIVE else "other structure", "kind": "flows", "order": 2,
            "source": "Romero (2009), (A1)",
            "claims": claims if m.startswith("tc") else claims[:1], "description": f"What {m} is.", "tags": [],
            "formula": "def step(z0, z1, h, system):\n    return z1 - z0", "plugin": m}
        for m in methods
    }  # fmt: skip
    data = {
        "system": "pendulum", "constants": {"masses": [1.0, 2.0]}, "positions": [1.0, 0.0, 2.2, 0.0],
        "momenta": [0.0, 2.0, 1.0, 0.0], "temperatures": [380.0, 310.0], "t_end": 25.0, "blowup_factor": 1.0, "dt": 0.3,
        "shows": "what a spring does", "source": "eq. (44)", "initial_exergy": 48.5, "initial_energy": 421.6,
        "invariants": ["angular_momentum"], "links": [[0, 1], [1, 2]],
    }  # fmt: skip
    return {
        "integrators": told,
        "scenarios": {s: data | {"rates": [122.0, 16.4 if s == "stiff_spring" else 4.3]} for s in scenarios},
        "absent": {},
    }


def write_hostile(folder, report):
    """A run whose names and messages are hostile, and its page: (path, text)."""
    methods, scenarios = ["tc_monolithic", HOSTILE, "x" * 10_000], [*SCENARIOS, HOSTILE]
    settings = {"failing": lambda name, h: name != "tc_monolithic", "failure": (HOSTILE * 300)[:10_000]}
    told = declared(methods, scenarios)
    told["integrators"][HOSTILE] |= {"description": HOSTILE * 9, "formula": f"{HOSTILE}</script>", "source": HOSTILE}
    told["scenarios"][HOSTILE] = told["scenarios"]["short_term"] | {"shows": HOSTILE, "constants": {HOSTILE: 1.0}}
    path = report(write_run(folder, everything(methods, scenarios, **settings), (), told))
    return path, path.read_text("utf-8")


def write_run(folder, tables, rows=(), declared=None):
    """A run folder with these tables and rows."""
    with Store.open(folder) as store:
        store.add_provenance({"tcbench": "0.1.0", "machine": {"cpu": "a CPU"}})
        for cell, row in rows:
            store.append(digest(cell), row, cell)
        store.write_tables(tables)
        if declared is not None:
            store.write_declared(declared)
        store.write_manifest({"tcbench": "0.1.0", "command": ["/opt/x/tcbench", "run", "--all"], "started": "now"})
    return folder
