"""Who is first to an accuracy of the state: consistent methods beside the fastest peers, in turn in one process.

    python benchmarks/first_to_accuracy.py random 200     # random springs to t = 10: how often a consistent one is
    python benchmarks/first_to_accuracy.py draws 200      # general systems from random states, constants times 1/2 to 2
    python benchmarks/first_to_accuracy.py scenarios      # every scenario, to the end that `until` says
    python benchmarks/first_to_accuracy.py stiff 100      # with so many times the dissipation
    python benchmarks/first_to_accuracy.py systems        # a truss of three masses, chains and a net, to t = 5

Seconds are the processor's. Errors are against the certified reference; a scenario counts for an accuracy where they
mean something (as in the study work_precision): ten times what rounding its start to doubles does is within it. In
chaos that is more than 1e-9, and who comes within it is luck.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable

import numpy as np

import tcbench
from tcbench.plugins import find_integrator, find_scenario
from tcbench.reference.certified import gap
from tcbench.reference.collocation import ReferenceFailed
from tcbench.reference.lookup import reference_for
from tcbench.studies.cost import HIDES
from tcbench.studies.work_precision import horizon

CONSISTENT = ("tc_auto", "tc_taylor", "tc_gauss_adaptive")
PEERS = ("heyoka", "scipy_odeint", "scipy_dop853", "cvode")
# In tables these as well, where they are installed. None has been first anywhere, and each takes seconds a scenario.
SLOWER = ("pydiffsol", "diffrax", "diffrax[solver=dopri8]")
TARGETS = (1e-3, 1e-6, 1e-9)
TOLERANCES = [10.0 ** (-k / 2) for k in range(2, 29)]  # by decades, where errors happen to lie counts for 15 %
FIRST = 3  # runs that a rung is judged by: one alone, of a solver just compiled, may take five times as long
REPEATS, LONG_S = 20, 0.05  # runs of a rung, but one of those that take long; after a far longer one no finer rung
FAR_LONGER_S = 0.25
LOOK_S = 3e-5  # of runs between two looks at the clock: these take 0.6 microseconds, a run of the reaction 3
LOST_S, LOSSES = 1.0, 2  # a method that has given up so often after so long is asked for no finer rung
LIKELY, CLOSE = 3, 10.0  # rungs of a target that are timed again: so many of a method, within so many times the fastest
ROUNDS, WARM = 20, 4  # each has the fastest of so many runs: the first finds another method's data in the cache
DISSIPATION = ("conductivity", "kappa", "friction", "damping", "speed")  # constants that it grows with
LONGEST = 60.0  # horizon
TABLE_S = 1.0  # of rounds for a row of a table: longer than a processor stays at one speed


class Truss(tcbench.ElementSystem):
    """Three masses and three springs in the plane, free; springs that share a mass conduct heat."""

    name = "truss"
    tables = {"ends": ("element", 4, "position"), "pairs": ("link", 2, "element")}
    constants = {"mass": ("position",), "stiffness": ("element",), "kappa": (), "reference_temperature": ()}

    def inertia(self):
        return self.mass

    def shape(self, q):
        ends = q[self.ends]
        return ((ends[:, 2:] - ends[:, :2]) ** 2).sum(axis=1)

    def element_energy(self, pi, s):
        strain, warm = 0.5 * np.log(pi), self.reference_temperature
        return self.stiffness / 2 * strain**2 + warm * (0.2 * strain + 5 * (np.exp((s - 0.2 * strain) / 5) - 1))

    def conduction(self, theta):
        a, b = theta[self.pairs].T
        return self.pairs.sums(self.kappa * np.stack([(b - a) / a, (a - b) / b], axis=1))

    def entropies(self, q, theta):
        return 0.1 * np.log(self.shape(q)) + 5 * np.log(theta / self.reference_temperature)


def truss() -> tcbench.Scenario:
    constants = {"mass": np.repeat([1.0, 2.0, 1.5], 2), "stiffness": np.array([20.0, 10.0, 15.0]), "kappa": 1.0}
    constants |= {"ends": [[0, 1, 2, 3], [2, 3, 4, 5], [4, 5, 0, 1]], "pairs": [[0, 1], [1, 2], [2, 0]]}
    return tcbench.Scenario(
        "truss", Truss, constants | {"reference_temperature": 300.0}, positions=[0.0, 0.0, 1.2, 0.1, 0.5, 0.9],
        momenta=[0.3, -0.5, 0.2, 0.8, -0.5, -0.3], temperatures=[330.0, 300.0, 280.0], t_end=5.0, dt=0.05,
    )  # fmt: skip


def times_to(
    scenario: tcbench.Scenario, t_end: float, names: Iterable[str], least_s: float = 0.0
) -> dict[str, list[float]]:
    """Seconds of the fastest run of each method within each target; infinity where none is.

    The fastest rungs are timed again in turn, for `least_s` at least, and the median is told: drift of the machine hits
    all of them.
    """
    reference = reference_for(scenario, [t_end])
    exact, span = reference.states[-1], np.array([0.0, t_end])
    targets = [target if HIDES * reference.floor[-1] <= target else np.nan for target in TARGETS]

    def seconds_of(name: str, tolerance: float, repeats: int = 1) -> float:
        solve, took, count = find_integrator(name).adaptive, [], 1
        while len(took) < repeats and sum(took) < LONG_S:
            begin = time.process_time()
            for _ in range(count):
                solve(scenario.model, scenario.z0, span, tolerance, tolerance)
            took.append((time.process_time() - begin) / count)
            count = max(1, round(LOOK_S / took[-1]))
        return min(took)

    times: dict[tuple[str, float], list[float]] = {}
    chosen, finest = {}, []  # seconds of the finest rung of each consistent method
    for name in names:
        rungs, lost = [], 0
        longest = (
            np.inf if name in CONSISTENT else CLOSE * min(finest, default=np.inf)
        )  # what takes longer is timed once
        for tolerance in TOLERANCES:
            begin = time.process_time()
            try:
                states, _ = find_integrator(name).adaptive(scenario.model, scenario.z0, span, tolerance, tolerance)
            except Exception as error:  # a solver that gives up is slower than any
                print(f"  {name} at {tolerance:g}: {str(error)[:80]}", file=sys.stderr)
                lost += time.process_time() - begin > LOST_S
                if lost == LOSSES:
                    break
                continue
            took = seconds_of(name, tolerance, FIRST)
            took = min(took, seconds_of(name, tolerance, REPEATS)) if took < longest else took
            times[name, tolerance] = [took]
            rungs.append((gap(states[-1], exact), took, tolerance))
            if rungs[-1][0] <= TARGETS[-1] or took > (FAR_LONGER_S if least_s else longest):  # finer ones take longer
                break
        finest += [rungs[-1][1]] if name in CONSISTENT and rungs else []
        within = [[(took, tolerance) for error, took, tolerance in rungs if error <= target] for target in TARGETS]
        chosen[name] = [[x for _, x in sorted(found)[:LIKELY]] for found in within]
    fastest = [
        min((times[name, x[i][0]][0] for name, x in chosen.items() if x[i]), default=0.0) for i in range(len(TARGETS))
    ]
    again = {
        (name, x)
        for name, found in chosen.items()
        for likely, best in zip(found, fastest, strict=True)
        for x in likely
        if times[name, x][0] <= CLOSE * best
    }
    rounds, begin = 0, time.process_time()
    while rounds < ROUNDS or time.process_time() - begin < least_s:
        rounds += 1
        for name, tolerance in again:
            times[name, tolerance].append(seconds_of(name, tolerance, WARM))
    return {
        name: [np.nan if np.isnan(target) else min((float(np.median(times[name, x])) for x in likely), default=np.inf)
               for likely, target in zip(found, targets, strict=True)]
        for name, found in chosen.items()
    }  # fmt: skip


def stiff(scenario: tcbench.Scenario, times: float) -> tcbench.Scenario:
    """The same with so many times the dissipation."""
    values = {name: times * np.asarray(x) for name, x in scenario.constants.items() if name in DISSIPATION}
    if "viscosity" in scenario.constants:
        values["viscosity"] = np.asarray(scenario.constants["viscosity"]) / times
    return scenario.replace(name=f"{scenario.name}, {times:g} times the dissipation", **values)


def until(scenario: tcbench.Scenario) -> float:
    """The horizon of work_precision, where it has a stored reference; else the end, or the longest."""
    return horizon(scenario) if scenario.model.defines("element_energy") else min(scenario.t_end, LONGEST)


def general() -> list[tcbench.Scenario]:
    return [x for x in tcbench.scenarios().values() if not x.model.defines("element_energy")]


def drawn(seed: int) -> tcbench.Scenario:
    """One of the general systems, in turn, from a random state near its own, with constants 1/2 to 2 times as large."""
    scenario, rng = general()[seed % len(general())], np.random.default_rng(seed)
    while True:
        constants = {name: np.asarray(x) * 2.0 ** rng.uniform(-1.0, 1.0) for name, x in scenario.constants.items()}
        try:
            initial = scenario.model.initial_of(scenario.model.nearby(scenario.z0, rng))
            return scenario.replace(name=f"{scenario.name} {seed}", **constants, **initial)
        except tcbench.TcbenchError:  # no admissible state
            continue


def random_scenarios(cases: Iterable[tuple[tcbench.Scenario, float]]) -> None:
    first = {name: np.zeros(len(TARGETS), int) for name in ("a consistent method", "tc_auto")}
    counted = np.zeros(len(TARGETS), int)
    for seed, (scenario, t_end) in enumerate(cases):
        try:
            found = times_to(scenario, t_end, (*CONSISTENT, *PEERS))
        except ReferenceFailed as error:
            print(f"{scenario.name}: {error}", file=sys.stderr)
            continue
        peers = np.min([found[name] for name in PEERS], axis=0)
        best = np.min([found[name] for name in CONSISTENT], axis=0)
        some = np.isfinite(np.minimum(peers, best))
        counted += some
        first["a consistent method"] += some & (best < peers)
        ahead = np.array(found["tc_auto"]) < peers
        first["tc_auto"] += some & ahead
        if np.any(some & ~ahead):
            print(f"{scenario.name}: the best peer over tc_auto: {np.round(peers / found['tc_auto'], 2)}", flush=True)
        if (seed + 1) % 10 == 0:
            print(f"{seed + 1} scenarios, counted to {TARGETS}: {counted}", flush=True)
            for name, wins in first.items():
                print(f"    first is {name}: {wins}, {np.round(100 * wins / np.maximum(counted, 1), 1)} %", flush=True)


def table(cases: Iterable[tuple[tcbench.Scenario, float]]) -> None:
    peers = [*PEERS, *(name for name in SLOWER if not find_integrator(name).lacks)]
    for scenario, t_end in cases:
        found = times_to(scenario, t_end, (*CONSISTENT, *peers), TABLE_S)
        best = np.min([found[name] for name in peers], axis=0)
        ours = np.min([found[name] for name in CONSISTENT], axis=0)
        ratios = [" / ".join(f"{ratio:.1f}" for ratio in best / x) for x in (found["tc_auto"], ours)]
        print(f"{scenario.name}: microseconds of a run within {TARGETS}")
        print(f"    the best peer over tc_auto: {ratios[0]}; over the best consistent method: {ratios[1]}")
        for name, seconds in found.items():
            print(f"    {name:20}" + "".join(f"{1e6 * s:12.0f}" for s in seconds), flush=True)


def main(what: str = "scenarios", count: str = "200") -> None:
    if what in tcbench.scenarios():
        scenario = stiff(find_scenario(what), float(count)) if count != "200" else find_scenario(what)
        table([(scenario, until(scenario))])
    elif what == "random":
        random_scenarios((find_scenario(f"random[seed={seed}]"), 10.0) for seed in range(int(count)))
    elif what == "draws":
        random_scenarios((x, x.t_end / 4) for x in map(drawn, range(int(count))))
    elif what == "stiff":
        cases = [stiff(scenario, float(count)) for scenario in tcbench.scenarios().values()]
        table((x, until(x)) for x in cases)
    elif what == "systems":
        chain, net = find_scenario("chain[n=4]"), find_scenario("net[nx=3,ny=3]")
        table((scenario, 5.0) for scenario in (truss(), chain, net, *(stiff(x, 1e3) for x in (truss(), chain, net))))
    else:
        table((scenario, until(scenario)) for scenario in tcbench.scenarios().values())


if __name__ == "__main__":
    main(*sys.argv[1:])
