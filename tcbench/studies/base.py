"""`Study`: which cells to run, what to measure in one, and the tables made of them."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import is_pattern, matching, unknown_name

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
    place : studies run, and their tables stand, in this order. by_default : False for one that runs only when named.
    timed : cells run alone on the machine, after all others (or a function of the cell options: which of them do).
    metrics : rows have the columns of plugins' metrics. sampled : plan draws its scenarios from families.
    scenarios : names of those that it runs on where none is named; () for all. fresh : each cell in a process that has
        run no other.
    of_random : the study that takes its place where all scenarios are random ones.
    drawn(scenario, cell options) -> JSON values: what else a cell computes with, such as the scenarios that it draws.
    """

    name: str
    description: str
    tables: tuple[str, ...]
    plan: Callable[
        [Sequence[Integrator], Sequence[Scenario], Mapping[str, Any]], list[tuple[Integrator, Scenario, Row]]
    ]
    measure: Callable[[Integrator, Scenario, Row], Row]
    tabulate: Callable[[Sequence[Row]], dict[str, DataFrame]]
    place: int = 100
    by_default: bool = True
    timed: bool | Callable[[Row], bool] = False
    metrics: bool = False
    sampled: bool = False
    scenarios: tuple[str, ...] = ()
    fresh: bool = False
    of_random: str = ""
    drawn: Callable[[Scenario, Row], Any] | None = None

    def is_timed(self, options: Row) -> bool:
        """Does the cell of these options run alone?"""
        return self.timed(options) if callable(self.timed) else self.timed


def studies() -> dict[str, Study]:
    """Every study by name, in the order of their places."""
    found = sorted(map(find_study, study_names()), key=lambda study: (study.place, study.name))
    return {study.name: study for study in found}


def default_studies() -> dict[str, Study]:
    """Those that a run does where none is named."""
    return {name: study for name, study in studies().items() if study.by_default}


@cache
def study_names() -> tuple[str, ...]:
    """Names of the files beside this one that define a STUDY; none is imported to find out."""
    files = sorted(Path(__file__).parent.glob("*.py"))
    return tuple(file.stem for file in files if "\nSTUDY = " in file.read_text(encoding="utf-8"))


def expand_studies(names: Iterable[str]) -> list[str]:
    """The studies of these names, each once; a pattern such as `con*` is every one run by default whose name fits."""
    known = default_studies()
    found = [one for name in names for one in (matching("study", name, known) if is_pattern(name) else [name])]
    return list(dict.fromkeys(found))


def find_study(name: str) -> Study:
    """The study in the file of this name beside this one, imported when it is first asked for."""
    if name not in study_names():
        raise unknown_name("study", name, default_studies())
    study: Study = importlib.import_module(f".{name}", __package__).STUDY
    return study
