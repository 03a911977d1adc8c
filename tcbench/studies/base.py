"""`Study`: which cells to run, what to measure in one, and the tables made of them."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..errors import unknown_name

if TYPE_CHECKING:
    from pandas import DataFrame

    from ..integrator import Integrator
    from ..systems.scenario import Scenario

Row = dict[str, Any]


@dataclass(frozen=True)
class Study:
    """One study, as three functions.

    plan(integrators, scenarios, options) -> (integrator, scenario, cell options) of each cell; options are those of
        the run ("dt": list of steps, ...), cell options are JSON values.
    measure(integrator, scenario, cell options) -> row; runs in a worker process; nested lists and NaN are allowed.
        Exceptions become rows of status "exception".
    tabulate(records) -> tables by name; a record is the row with integrator, scenario and the cell options; rows of
        failed cells have "status" and "failure" and may lack everything else.
    timed : cells run alone on the machine, after all others. metrics : rows have the columns of plugins' metrics.
    """

    name: str
    description: str
    tables: tuple[str, ...]
    plan: Callable[
        [Sequence[Integrator], Sequence[Scenario], Mapping[str, Any]], list[tuple[Integrator, Scenario, Row]]
    ]
    measure: Callable[[Integrator, Scenario, Row], Row]
    tabulate: Callable[[Sequence[Row]], dict[str, DataFrame]]
    timed: bool = False
    metrics: bool = False


NAMES = ("conservation", "convergence", "equilibrium", "claims", "stability", "work_precision")  # what `run` does
OTHERS = ("map",)  # has a command of its own


def studies() -> dict[str, Study]:
    """Every study by name, in the order in which they run."""
    return {name: find_study(name) for name in NAMES}


def find_study(name: str) -> Study:
    """The study in the file of this name beside this one, imported when it is first asked for."""
    if name not in NAMES + OTHERS:
        raise unknown_name("study", name, NAMES)
    study: Study = importlib.import_module(f".{name}", __package__).STUDY
    return study
