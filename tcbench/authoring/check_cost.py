"""How long the lines of `tcbench check` will take, said before a slow method takes it; and how long a step takes."""

from __future__ import annotations

from collections.abc import Sequence

from .. import plugins
from ..integrator import Integrator
from ..simulation.run import simulate
from . import integrator_checks as contract
from .check_line import NONE, OK, Line

WORTH_SAYING_S = 10.0


def estimate(method: Integrator, names: Sequence[str]) -> Line | None:
    """The seconds that the lines of these names will take, if they are many; from a few steps, which are run for it.

    Compiled methods are never slow enough to be asked. An adaptive solver is timed at its default tolerance.
    """
    if method.kind == "flows":
        return None
    scenario, count = contract.scenarios(method)[0], 5
    h = scenario.dt * contract.GENTLE
    contract.run(method, scenario, h, count)  # what it loads or compiles at its first call is paid once
    one = contract.run(method, scenario, h, count)
    amounts = {name: amount for name, amount in _amounts(method).items() if name in names}
    unit = one.wall_time_s / max(1, one.steps) if method.kind == "step" else one.wall_time_s / (count * h)
    seconds = {name: unit * amount for name, amount in amounts.items()}
    if sum(seconds.values()) < WORTH_SAYING_S:
        return None
    longest = sorted(seconds, key=lambda name: -seconds[name])
    parts = ", ".join(f"{name} {_rounded(seconds[name])}" for name in longest if seconds[name] >= 1)
    # five small steps are the cheapest that there are: solvers work harder on large ones
    found = f"at least {_rounded(sum(seconds.values()))} more: {parts}; --only {longest[-1]} checks that line alone"
    return Line("slow", NONE, found)


def _amounts(method: Integrator) -> dict[str, float]:
    """What each line runs: steps of a method with a fixed step, time of an adaptive solver."""
    scenarios, adaptive = contract.scenarios(method), method.kind == "adaptive"
    claimed = contract.claim_lengths(method) if method.claims else []
    if adaptive:
        spans = [steps * scenario.dt for scenario, steps in claimed]
        gentle = scenarios[0].dt * contract.GENTLE
        return {
            "deterministic": 13 * gentle, "order": 6 * scenarios[0].t_converge,  # tight tolerances cost more
            "claims": sum(spans) + sum(contract.RANDOM_STEPS * s.dt for s in scenarios if claimed),
        }  # fmt: skip
    ladders = [s.t_converge / h for s in scenarios for h in contract.ladder(method, s)]
    claims = sum(steps for _, steps in claimed) + (contract.RANDOM_STEPS * len(scenarios) if claimed else 0)
    return {
        "deterministic": 13, "consistent": 8 * len(scenarios), "order": sum(ladders), "claims": claims, "restart": 24,
        "march": 10 if method.march else 0,
    }  # fmt: skip


def _rounded(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.0f} min"


def time_per_step(method: Integrator) -> Line:
    """Microseconds a step beside the built-in monolithic method; for information, no limit."""
    scenario = next((s for s in plugins.scenarios_for(method) if s.name == "short_term"), contract.scenarios(method)[0])
    if method.kind == "adaptive":
        one = simulate(method, scenario, t_end=5.0)
        return Line("time per step", OK, f"{1e6 * one.wall_time_s / max(1, one.steps):.3g} us an internal step")
    times = []
    for each in (method, plugins.find_integrator("tc_monolithic")):
        count = 2000 if each.kind == "flows" else 50
        runs = [simulate(each, scenario, dt=0.01, t_end=count * 0.01, record_every=None) for _ in range(3)]
        times.append(min(1e6 * one.wall_time_s / max(1, one.steps) for one in runs))
    return Line("time per step", OK, f"{times[0]:.3g} us (tc_monolithic: {times[1]:.3g} us)")
