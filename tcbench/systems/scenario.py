"""`Scenario`: a system with its constants, initial data, horizon and step: frozen data."""

from __future__ import annotations

import copy
import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from dataclasses import replace as dataclass_replace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ..errors import TcbenchError, expect, positive, shown, unknown_name
from .declaration import SETTINGS
from .energy_scale import energy_round_off, energy_scale
from .magnitudes import REST
from .refusals import Fixed
from .state import fixed, formulas_hash, real
from .system import System

KINDS_OF_FIELDS = {
    "system": "a class", "constants": "a mapping", "initial": "a mapping", "shows": "a word", "source": "a word",
    "plugin": "a word", "ladder": "numbers"}  # fmt: skip
SAID = ("name", "shows", "source", "plugin", "_cache")  # fields on which no number depends
LENGTHS = ("t_end", "dt", "t_converge", "blowup_factor")
ELEMENTS = ("positions", "momenta", "temperatures")  # the initial data of an ElementSystem


@dataclass(frozen=True)
class Scenario:
    """A system with its constants, its initial state, a final time and steps. All numbers are dimensionless.

    Parameters
    ----------
    name : str
        Unique.
    system : class
        A subclass of `System`.
    constants : mapping of str to number or array
        Of the system, by name; arrays of the shape that it declares, such as shape (n_elements,).
    positions, momenta, temperatures : sequence of float
        Initial data of an ElementSystem, shape (n_positions,), (n_positions,) and (n_elements,).
    t_end : float
        Final time.
    dt : float
        The scenario's own step.
    initial : mapping of str to number or array
        Initial data of any other system: its variables by name, of the shape that each has.
    t_converge : float
        Time at which errors are measured.
    blowup_factor : float
        |E - E0| beyond this times V0 (`initial_exergy`) is a blow-up.
    shows : str
        A sentence that says what it is for.
    source : str
        Paper and section.
    plugin : str
        Filled in by the registry.
    ladder : sequence of float
        Steps of the conservation study, as multiples of dt.

    Raises
    ------
    TcbenchError
        For constants and initial values that the system does not have or cannot take, numbers that are not finite, a
        step that is not positive or longer than the horizon.

    References
    ----------
    Romero (2009), section 6, is where the built-in ones come from; V is eq. (37); docs/add-scenario.md.
    """

    name: str
    system: type[System]
    constants: Mapping[str, Any]
    positions: tuple[float, ...] = ()
    momenta: tuple[float, ...] = ()
    temperatures: tuple[float, ...] = ()
    t_end: float = field(kw_only=True)
    dt: float = field(kw_only=True)
    initial: Mapping[str, Any] = field(default_factory=dict)
    t_converge: float = 1.0
    blowup_factor: float = 1.0
    shows: str = ""
    source: str = ""
    plugin: str = ""
    ladder: tuple[float, ...] = (0.25, 0.5, 1.0, 2.0, 4.0)
    _cache: dict[str, Any] = field(default_factory=dict, compare=False, repr=False)

    def __post_init__(self) -> None:
        put = object.__setattr__
        name: Any = self.name  # whatever an author wrote
        if not (isinstance(name, str) and name.strip()):
            raise TcbenchError(f"The name of a scenario is a word, not {name!r}.")
        expect(f"Scenario {self.name!r}", vars(self), KINDS_OF_FIELDS)
        if not issubclass(self.system, System):
            raise TcbenchError(f"Scenario {self.name!r}: system must be a class of System, not {shown(self.system)}.")
        for name in (*ELEMENTS, "ladder"):
            put(self, name, _numbers(name, getattr(self, name)))
        put(self, "initial", Fixed({name: _checked(name, value) for name, value in self.initial.items()}))
        self._check_lengths()
        put(self, "_cache", {"model": self.system(**self.constants), "horizon": self.t_end})
        put(self, "constants", Fixed({k: _plain(v) for k, v in self.constants.items()}))
        self._cache["z0"] = self._start()

    def _check_lengths(self) -> None:
        for name in LENGTHS:
            object.__setattr__(self, name, positive(name, getattr(self, name)))
        if min(self.ladder, default=0.0) <= 0.0:
            raise TcbenchError(f"Scenario {self.name!r}: ladder has multiples of dt, each above 0, not {self.ladder}.")
        if self.dt > self.t_end:
            raise TcbenchError(f"Scenario {self.name!r}: dt = {self.dt:g} is longer than t_end = {self.t_end:g}.")

    def __repr__(self) -> str:
        said = f": {self.shows}" if self.shows else ""
        return f"<Scenario {self.name} of {self.system.name}, t_end = {self.t_end:g}, dt = {self.dt:g}{said}>"

    def __getstate__(self) -> dict[str, Any]:
        """For copies and pickles: the numbers and the system, not what is derived from them."""
        return {**vars(self), "_cache": {k: self._cache[k] for k in ("model", "horizon")}}

    def _start(self) -> NDArray[np.float64]:
        wanted = self.model.initial_data
        for name in (*ELEMENTS, "initial"):
            if name not in wanted and len(getattr(self, name)):
                raise TcbenchError(
                    f"Scenario {self.name!r}: {self.system.name!r} starts from {', '.join(wanted)}, not from {name}."
                )
        try:
            z0 = self.model.start(**{name: getattr(self, name) for name in wanted})
        except TcbenchError as error:
            if str(error).startswith(f"{self.system.__name__}:"):  # of the class, whatever the scenario
                raise
            raise TcbenchError(f"Scenario {self.name!r}: {error}") from None
        self.model.begin(fixed(z0), self.t_end)
        return z0

    @property
    def model(self) -> System:
        """The system with this scenario's constants."""
        return cast(System, self._cache["model"])

    def current(self) -> Scenario:
        """This scenario; made anew where the formulas of its system have changed since it was made (in a notebook)."""
        return self if formulas_hash(self.system) == self.model.formulas else dataclass_replace(self)

    @property
    def z0(self) -> NDArray[np.float64]:
        """Initial state, shape (n,)."""
        if "z0" not in self._cache:
            self._cache["z0"] = self._start()
        return cast("NDArray[np.float64]", self._cache["z0"])

    @property
    def initial_exergy(self) -> float:
        """V0, the scale of energy errors: the exergy at the start, or the energy that moves (`energy_scale`)."""
        if "V0" not in self._cache:
            self._cache["V0"] = energy_scale(self.model, self.z0, self._cache.get("horizon", self.t_end))
        return float(self._cache["V0"])

    @property
    def energy_round_off(self) -> float:
        """The round-off of the energy's formula at the start, in the unit of energy."""
        if "round-off" not in self._cache:
            self._cache["round-off"] = energy_round_off(self.model, self.z0)
        return float(self._cache["round-off"])

    @property
    def bound(self) -> float:
        """Largest |E - E0| of a run that is no blow-up."""
        if "E0" not in self._cache:
            self._cache["E0"] = float(self.model.energy(self.z0))
        bound = self.blowup_factor * self.initial_exergy
        return bound if bound > REST * abs(self._cache["E0"]) else max(bound, self.energy_round_off)

    def consistent(self) -> Scenario:
        """The variant that starts at the nearest state on the constraints, with velocities along them."""
        from .multipliers import consistent_start  # of few systems

        return cast(Scenario, consistent_start(self))

    def replace(self, **changes: Any) -> Scenario:
        """A variant: settings (name, t_end, dt, positions, ...), constants, or variables (their initial values)."""
        settings: dict[str, Any] = {}
        constants = dict(self.constants)
        for name, value in changes.items():
            if name in self.system.constants or name in self.system.tables:
                constants[name] = value
            elif name == "initial":
                expect(f"Scenario {self.name!r}", changes, {name: KINDS_OF_FIELDS[name]})
                settings["initial"] = {**settings.get("initial", self.initial), **value}
            elif name in SETTINGS:
                settings[name] = value
            elif name in self.initial:
                settings["initial"] = {**settings.get("initial", self.initial), name: value}
            else:
                own = [n for n in SETTINGS if n in self.model.initial_data or n not in (*ELEMENTS, "initial")]
                raise unknown_name("setting of a scenario", name, [*own, *constants, *self.initial])
        if "dt" not in changes and "t_end" in changes:
            settings["dt"] = min(self.dt, positive("t_end", changes["t_end"]))
        if not set(changes) <= set(LENGTHS):
            return dataclass_replace(self, constants=constants, **{"name": self.name, **settings})
        changed = copy.copy(now := self.current())  # of the same system and start, whose cache serves both
        vars(changed).update(settings, _cache=now._cache)
        changed._check_lengths()
        return changed

    def as_dict(self) -> dict[str, Any]:
        """The data that determine a run, JSON-able."""
        return {
            "system": self.system.name,
            "constants": {k: _plain(v) for k, v in sorted(self.constants.items())},
            **{name: dict(sorted(self.initial.items())) if name == "initial" else list(getattr(self, name))
               for name in self.model.initial_data},
            "t_end": self.t_end, "blowup_factor": self.blowup_factor,
        }  # fmt: skip

    def data(self) -> dict[str, Any]:
        """Every number and the system, JSON-able, without name, source and other words."""
        parts = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in SAID}
        parts |= {"system": f"{self.system.name} {self.system.__qualname__}", "constants": self.as_dict()["constants"]}
        return {name: list(value) if isinstance(value, tuple) else value for name, value in parts.items()}

    def numbers(self) -> dict[str, float]:
        """Constants and initial values by name, those of arrays with their index: coupling, stiffness0, stiffness1."""
        initial = {name: getattr(self, name) for name in self.model.initial_data if name != "initial"}
        by_name: dict[str, float] = {}
        constants = {name: value for name, value in self.constants.items() if name not in self.system.tables}
        for name, value in {**constants, **initial, **self.initial}.items():
            values = np.ravel(np.asarray(value, dtype=float)).tolist()
            by_name |= {name: values[0]} if np.ndim(value) == 0 else {f"{name}{i}": x for i, x in enumerate(values)}
        return by_name

    @property
    def hash(self) -> str:
        """Hash of the data that determine the exact solution, 16 hexadecimal digits."""
        data = {k: v for k, v in self.as_dict().items() if k not in ("t_end", "blowup_factor")}
        return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()[:16]

    def steps(self, dt: float) -> int:
        """Number of steps of size dt: the last one ends at or just past t_end."""
        if not (count := self.t_end / dt) < 2**53:  # otherwise t + dt is t
            raise TcbenchError(f"dt = {dt:g} is so small that the steps to t_end = {self.t_end:g} cannot be counted.")
        return max(1, math.ceil(count - 1e-9))


def _checked(name: str, value: Any) -> Any:
    """The initial value of a variable: a number or nested lists of them."""
    try:
        return _plain(value)
    except (TypeError, ValueError, OverflowError):
        raise TcbenchError(f"The initial value of {name!r} must be numbers, not {shown(value)}.") from None


def _numbers(name: str, value: Any) -> tuple[float, ...]:
    try:
        numbers = tuple(real(value).ravel().tolist())
    except (TypeError, ValueError, OverflowError):
        raise TcbenchError(f"{name} must be numbers, not {shown(value)}.") from None
    if not all(math.isfinite(v) for v in numbers):
        raise TcbenchError(f"{name} must be finite, not {shown(value)}.")
    return numbers


def _plain(value: Any) -> Any:
    """Numbers and lists of numbers, for JSON and comparison."""
    array = np.asarray(value)
    array = array if array.dtype.kind == "i" and array.ndim else real(value)  # whole numbers of tables
    return float(array) if array.shape == () else array.tolist()
