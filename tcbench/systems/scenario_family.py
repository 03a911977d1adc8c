"""`ScenarioFamily`: scenarios of one kind by parameters or by a seed; `around`: random variants of a scenario."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import Any, cast

import numpy as np

from ..errors import TcbenchError, expect, unknown_name
from .sampling import Draw, Range, rounded, seed_of
from .scenario import Scenario

TRIES, NEAR = 100, 0.3  # for an admissible random start; the size of a variable that is 0, for its moves
KINDS_OF_A_FAMILY = {
    "name": "a word", "make": "a function or a word or nothing", "sample": "a function or nothing",
    "defaults": "a mapping", "ranges": "a mapping", "takes": "a mapping",
}  # fmt: skip


@dataclass(frozen=True)
class ScenarioFamily:
    """Scenarios of one kind that differ by parameters: `name[param=value]`. Run when named, not with "all scenarios".

    Give `make` and `defaults`, or `sample` and `ranges`.

    Parameters
    ----------
    name : str
        Of the family.
    make : function or str, optional
        make(**values) -> Scenario of given values; TcbenchError for those that it cannot take. "package.module:name" is
        imported when a member is asked for, not when plugins are listed.
    defaults : mapping of str to str
        Every parameter, with the value that it has when the name alone is given.
    shows, source, plugin : str
        As of a `Scenario`.
    sample : function, optional
        sample(draw) -> a random Scenario, from the numbers of a `Draw`: `name[seed=7]`.
    ranges : mapping of str to Range
        What it draws, dimensionless in the built-in families; `name[seed=7,stiffness=10:300]` narrows or widens one.
        Such a family can be run by hundreds, by the study `ensemble`.
    by_default : bool
        False for a family with `sample` that studies of random scenarios draw from only where it is named.
    takes : mapping of str to (int, int), float or tuple of str
        What a parameter may be: whole numbers, the least and the most, any number, or one of these words. `make` gets a
        number then, or None for "" where that is the default. All others are strings, as they are written.

    Raises
    ------
    TcbenchError
        For both or none of make and sample; by `member`, for unknown parameters and values that cannot be.

    References
    ----------
    docs/add-scenario.md, docs/ensembles.md.
    """

    name: str
    make: Callable[..., Scenario] | str | None = None
    defaults: Mapping[str, str] = field(default_factory=dict)
    shows: str = ""
    source: str = ""
    plugin: str = ""
    sample: Callable[[Draw], Scenario] | None = None
    ranges: Mapping[str, Range] = field(default_factory=dict)
    by_default: bool = True
    takes: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        expect("A scenario family", vars(self), KINDS_OF_A_FAMILY)
        if (self.make is None) == (self.sample is None):
            raise TcbenchError(f"The scenario family {self.name!r} must give one of make= and sample=.")
        if self.sample is not None:
            spelled = {name: str(limits) for name, limits in self.ranges.items()}
            object.__setattr__(self, "defaults", {"seed": "0"} | spelled)

    def member(self, **values: str) -> Scenario:
        """The scenario of these values; its name spells all of them, of random ones the seed and the ranges given."""
        for name in values:
            if name not in self.defaults:
                raise unknown_name(f"parameter of {self.name!r}", name, self.defaults)
        chosen = {**self.defaults, **values}
        if self.sample is not None:
            ranges = {name: limits.narrowed(name, chosen[name]) for name, limits in self.ranges.items()}
            scenario = self.sample(Draw(seed_of(chosen["seed"]), ranges))
            chosen = {"seed": str(seed_of(chosen["seed"]))} | {n: str(r) for n, r in ranges.items() if n in values}
            chosen = {n: v for n, v in chosen.items() if n == "seed" or v != self.defaults[n]}
        else:
            scenario = _imported(self.make)(**{name: self._read(name, text) for name, text in chosen.items()})
        label = ",".join(f"{n}={v}" for n, v in sorted(chosen.items()) if v)  # "" stands for none
        named = copy.copy(scenario)  # a copy is not checked again: hundreds of members are made at a time
        object.__setattr__(named, "name", f"{self.name}[{label}]")
        object.__setattr__(named, "plugin", self.plugin)
        return named

    def _read(self, name: str, text: str) -> Any:
        """The value of a parameter as `make` takes it."""
        taken, example = self.takes.get(name), f"{self.name}[{name}={self.defaults[name] or 1}]"
        if taken is None:
            return text
        if not text and not self.defaults[name]:
            return None
        if isinstance(taken, tuple) and isinstance(taken[0], str):
            if text not in taken:
                raise TcbenchError(f"{name} of {self.name} is one of {', '.join(taken)}, not {text[:30]!r}: {example}.")
            return text
        if isinstance(taken, tuple):
            least, most = taken
            if not (text.isascii() and text.isdecimal() and len(text) < 20 and least <= int(text) <= most):
                raise TcbenchError(
                    f"{name} of {self.name} is a whole number from {least} to {most}, not {text[:30]!r}: {example}."
                )
            return int(text)
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            raise TcbenchError(f"{name} of {self.name} is a number, not {text[:30]!r}: {example}.")
        return number


def _imported(make: Any) -> Callable[..., Scenario]:
    if isinstance(make, str):
        module, _, name = make.partition(":")
        make = getattr(import_module(module), name)
    return cast("Callable[..., Scenario]", make)


def moved(value: Any, draw: Draw, range_name: str) -> Any:
    """An initial value of the same shape, each number x moved by a drawn part of max(|x|, NEAR)."""
    at = np.asarray(value, dtype=float)
    return rounded(at + np.maximum(NEAR, np.abs(at)) * np.reshape([draw(range_name) for _ in range(at.size)], at.shape))


def around(scenario: Scenario, ranges: Mapping[str, Range] | None = None) -> ScenarioFamily:
    """Random scenarios of the system of another, around its numbers: `random_NAME[seed=7]`.

    Parameters
    ----------
    scenario : Scenario
        Of a `System` that starts from `initial`.
    ranges : mapping of str to Range, optional
        By the name of a constant what its numbers are multiplied by (a third to three times, uniform in the logarithm,
        if nothing is given); "initial": how far each variable is moved, over its size or 0.3.

    Returns
    -------
    ScenarioFamily
        Its members have a step and a horizon as the scenario has. Numbers with which a step could not begin are drawn
        anew.

    References
    ----------
    docs/ensembles.md.
    """
    tables = scenario.system.tables
    factors = {name: Range(1 / 3, 3, log=True) for name in scenario.constants if name not in tables}
    limits = {**factors, "initial": Range(-0.5, 0.5), **(ranges or {})}

    def sample(draw: Draw) -> Scenario:
        error = TcbenchError(f"No admissible start was found around {scenario.name!r}: narrow the range of initial.")
        for _ in range(TRIES):
            constants = {
                n: v if n in tables else np.asarray(rounded(np.asarray(v) * draw(n))).tolist()
                for n, v in scenario.constants.items()
            }
            initial = {name: moved(value, draw, "initial") for name, value in scenario.initial.items()}
            try:
                return replace(scenario, constants=constants, initial=initial)
            except TcbenchError as refusal:
                error = refusal
        raise error

    return ScenarioFamily(
        f"random_{scenario.name}", sample=sample, ranges=limits, shows=f"random variants of {scenario.name}",
        source="docs/ensembles.md", by_default=False,
    )  # fmt: skip
