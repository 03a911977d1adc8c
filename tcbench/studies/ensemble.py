"""Ensemble: methods on hundreds of random scenarios. How often does each fail, what does it keep, how fast is it?

Three parts. `shares`: every method with a step on every scenario at every step; `references`: the exact end of each
scenario, as well as it is known; `timings`: error against time on the first of them, within a budget that is divided
equally. A cell is a part, a method and a block of scenarios. docs/ensembles.md says what it means.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any

from .. import plugins
from ..errors import TcbenchError
from ..integrator import Integrator
from ..study import Cells, Row, Study
from ..systems.scenario import Scenario
from .ensemble_tables import TABLES, tables

STEPS = (0.025, 0.05, 0.1, 0.2, 0.4, 0.8, 1.6)
SIZE = 100  # scenarios, if nothing else is asked for
BUDGET_S = 20.0  # seconds of measured time, over all methods and scenarios
SHARE_S = 0.03  # of that for one method on one scenario
BLOCK, TIMED_BLOCK = 50, 10  # scenarios in a cell
APART = 1_000_000  # between the first scenarios of two ensembles: the largest size
SHARES, REFERENCES, TIMINGS = "shares", "references", "timings"
OWNER = "tc_monolithic"  # in whose name the cells of references stand: one that is always there


def plan(integrators: Sequence[Integrator], scenarios: Sequence[Scenario], options: Mapping[str, Any]) -> Cells:
    """Cells of the families that the scenarios belong to; options: size, seed, budget (seconds) and dt (steps)."""
    size = whole(options, "size", SIZE, 2, APART)
    first = APART * whole(options, "seed", 0, 0, 10**9)
    steps = list(options.get("dt") or STEPS)
    methods = [method for method in integrators if not method.lacks]
    families = random_families(scenarios)
    timed = timed_size(size, len(methods) * max(1, len(families)), options)
    cells: Cells = []
    for family, values in families:
        cells += _family_cells(methods, family, values, (first, size, timed), steps)
    return cells


def _family_cells(
    methods: Sequence[Integrator], family: str, values: Mapping[str, str], sizes: tuple[int, int, int],
    steps: list[float],
) -> Cells:  # fmt: skip
    first, size, timed = sizes
    owner, cells = None, []
    for part, count, length in ((SHARES, size, BLOCK), (REFERENCES, timed, TIMED_BLOCK), (TIMINGS, timed, TIMED_BLOCK)):
        for start, stop in blocks(count, length):
            scenario = plugins.find_family(family).member(**values, seed=str(first + start))
            cell: Row = {"part": part, "ensemble": label(family, values), "seeds": [first + start, first + stop]}
            if part == REFERENCES:
                owner = owner or plugins.find_integrator(OWNER)
                if methods:
                    cells.append((owner, scenario, cell))
            elif part == TIMINGS:
                cells += [(method, scenario, cell | {"share_s": SHARE_S}) for method in methods]
            else:
                fitting = [dt for dt in steps if dt <= scenario.t_end]
                stepping = [method for method in methods if method.kind != "adaptive"]
                cells += [(method, scenario, cell | {"dt": fitting}) for method in stepping]
    return cells


def random_families(scenarios: Sequence[Scenario]) -> list[tuple[str, dict[str, str]]]:
    """Families that can be drawn from, and the ranges given: of the scenarios that are members of one."""
    families: dict[str, tuple[str, dict[str, str]]] = {}
    for scenario in scenarios:
        if plugins.is_sampled(scenario):
            name, values = plugins.split_name(scenario.name)
            values.pop("seed", None)
            families.setdefault(label(name, values), (name, values))
    return list(families.values())


def label(family: str, values: Mapping[str, str]) -> str:
    """`random`, or `random[stiffness=10:300]`."""
    spelled = ",".join(f"{name}={value}" for name, value in sorted(values.items()))
    return f"{family}[{spelled}]" if spelled else family


def timed_size(size: int, methods: int, options: Mapping[str, Any]) -> int:
    """How many scenarios are timed: whole blocks, as many as the budget pays for, at least one block."""
    budget = options.get("budget")
    budget = BUDGET_S if budget is None else budget
    if isinstance(budget, bool) or not isinstance(budget, (int, float)) or not 0 <= budget < float("inf"):
        raise TcbenchError(f"The budget of an ensemble is a number of seconds, at least 0, not {budget!r}.")
    if budget == 0:
        return 0
    paid = int(budget / (SHARE_S * max(1, methods))) // TIMED_BLOCK * TIMED_BLOCK
    return min(size, max(TIMED_BLOCK, paid))


def whole(options: Mapping[str, Any], name: str, default: int, low: int, high: int) -> int:
    value = options.get(name)
    value = default if value is None else value
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise TcbenchError(f"The {name} of an ensemble is a whole number from {low} to {high}, not {value!r}.")
    return value


def blocks(count: int, length: int) -> Iterator[tuple[int, int]]:
    """Blocks at fixed places, so that a larger ensemble goes on where a smaller one stopped."""
    return ((start, min(start + length, count)) for start in range(0, count, length))


def members(scenario: Scenario, seeds: Sequence[int], **ranges: str) -> list[Scenario]:
    """The scenarios of these seeds (first, one past the last), with the ranges of the one given and these over them."""
    name, values = plugins.split_name(scenario.name)
    family = plugins.find_family(name)
    return [family.member(**(values | ranges | {"seed": str(seed)})) for seed in range(*seeds)]


def numbers_hash(scenario: Scenario, seeds: Sequence[int], **ranges: str) -> str:
    """Of all numbers of `members`."""
    sample = plugins.find_family(plugins.split_name(scenario.name)[0]).sample
    return _numbers_hash(scenario.name, tuple(seeds), tuple(ranges.items()), sample)


@lru_cache(maxsize=256)  # one block after the other, each for all methods
def _numbers_hash(scenario: str, seeds: tuple[int, ...], ranges: tuple[tuple[str, str], ...], sample: Any) -> str:
    data = [member.data() for member in members(plugins.find_scenario(scenario), seeds, **dict(ranges))]
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()


def drawn(scenario: Scenario, options: Row) -> list[Any]:
    """The numbers of all members of a block; of references, what computes them."""
    numbers: list[Any] = [numbers_hash(scenario, options["seeds"])]
    if options["part"] == REFERENCES:
        from ..reference.lookup import algorithm

        numbers.append(algorithm())
    return numbers


def measure(integrator: Integrator, scenario: Scenario, options: Row) -> Row:
    from . import ensemble_runs as runs

    scenarios = members(scenario, options["seeds"])
    if options["part"] == REFERENCES:
        return {"status": "ok", "references": runs.references(scenarios)}
    common: Row = {"status": "ok", "claims": sorted(integrator.claims)}
    if options["part"] == SHARES:
        return common | {"rows": runs.shares(integrator, scenarios, options["dt"])}
    control = "tolerance" if integrator.kind == "adaptive" else "dt"
    ladders = runs.timings(integrator, scenarios, options["share_s"], options["seeds"][0])
    return common | {"ladders": ladders, "control": control}


STUDY = Study(
    name="ensemble",
    description="hundreds of random scenarios: shares of failures, laws, error against time, performance profiles",
    tables=TABLES,
    plan=plan,
    measure=measure,
    tabulate=tables,
    place=55,
    timed=lambda options: options["part"] == TIMINGS,
    sampled=True,
    drawn=drawn,
)  # fmt: skip
