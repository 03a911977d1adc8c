"""Units of measure of a system whose author declares them: its formulas are run on units in the place of numbers.

    units = {"q": "m", "p": "kg m/s", "s": "J/K", "mass": "kg", "stiffness": "N/m"}

Units are those of pint, and names of your own. What is not named is a pure number, "energy" is in J, "entropy" in J/K
and "time" in s unless they are named; entries of an array that differ are a list of units. Of elements, units of q, p
and s say what each formula owes. A sum of two units, or a function of one, ends with the line that it is on.
"""

from __future__ import annotations

import inspect
import tokenize
from collections.abc import Callable, Mapping
from functools import cache, partial
from typing import Any

import numpy as np
import pint

from ..compiler.ops import by_numpy
from ..compiler.trace_errors import where_in_user_code
from ..errors import TcbenchError, unknown_name
from ..systems.as_written import place
from ..systems.system import System

REGISTRY: Any = pint.UnitRegistry(cache_folder=None)
NONE = REGISTRY.Unit("")
SHOWN = ("J", "N", "W", "Pa", "Hz", "C", "V", "F", "ohm", "H", "Wb", "T", "S")  # what a product is called that is one
DEFAULTS = {"energy": "J", "entropy": "J/K", "time": "s"}
SUMS = ("add", "subtract", "hypot", "maximum", "minimum")  # of one unit, which is that of what they give
COMPARED = ("arctan2", "less", "less_equal", "greater", "greater_equal", "equal", "not_equal")
OF_SPACES = ("spaces", "n_positions", "n_elements")  # what an instance has of them, beside its tables
NEGLIGIBLE = 1e-9  # of a ratio of two units: exponents may be sums of fractions


class UnitsDiffer(TcbenchError):
    """Two units where one is needed; the message names the line."""


@cache
def _ratio(one: Any, other: Any) -> float:
    """How many of the other one is, 0 where they are not of one kind."""
    ratio = REGISTRY.Quantity(1.0, one / other).to_base_units()
    near = all(abs(power) <= NEGLIGIBLE for power in ratio.dimensionality.values())
    return float(ratio.magnitude) if near else 0.0


class Unit(np.lib.mixins.NDArrayOperatorsMixin):
    """What a formula is run on: a unit; and the number, where one is known, for exponents.

    log(a) - log(b) is that of a ratio: a logarithm of a unit may be added, and taken a known number of times; what is
    left of `logs` where a number is needed is an error of the line on which the first was taken.
    """

    def __init__(self, of: Any = NONE, value: float | None = None, logs: Any = NONE, line: str = "") -> None:
        self.of, self.logs, self.value, self.line = of, logs, value, line

    @property
    def is_number(self) -> bool:
        return self.like(ONE)

    def __str__(self) -> str:
        if self.is_number:
            return "a pure number"
        names = (name for name in SHOWN if self.like(unit(name)))
        return next(names, f"{self.of:~P}".replace("⋅", "·"))  # pint's dot differs by version

    def like(self, other: Unit) -> bool:
        return abs(_ratio(self.of, other.of) - 1.0) <= NEGLIGIBLE

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **named: Any) -> Any:
        if method == "__call__" and hasattr(np, ufunc.__name__) and not any(map(np.ndim, inputs)):
            return _applied(ufunc.__name__, *inputs)
        return getattr(ufunc, method)(*map(_wrapped, inputs), **named)  # arrays do it entry by entry

    def __getattr__(self, name: str) -> Callable[..., Any]:
        """What numpy calls of the entries of an array."""
        if name not in ("conjugate", "sqrt") and by_numpy(name) is None:
            raise AttributeError(name)
        return lambda *others: _applied(name, self, *others)

    def settled(self) -> Unit:
        """The same, of which no logarithm of a unit is left."""
        if not Unit(self.logs).is_number:
            raise UnitsDiffer(f"{self.line}: the argument of log is a pure number, not {Unit(self.logs)}.")
        return self

    def number(self, what: str) -> Unit:
        if not self.settled().is_number:
            raise UnitsDiffer(f"{where_in_user_code()}: {what} is a pure number, not {self}.")
        return ONE


def _wrapped(x: Any) -> Any:
    """A unit as an array of no dimension."""
    if isinstance(x, Unit):
        (array := np.empty((), dtype=object))[()] = x
        return array
    return x


def _applied(name: str, *inputs: Any) -> Any:
    """What a function of numpy gives of units and numbers; UnitsDiffer where it has none."""
    a, *others = (x if isinstance(x, Unit) else Unit(value=float(x)) for x in inputs)
    if name in (*SUMS, *COMPARED):
        return _sum(name, inputs, a, others[0])
    if name in ("multiply", "divide"):
        return _product(a, others[0], 1 if name == "multiply" else -1)
    if name == "power":
        others[0].number("an exponent")
        exponent = others[0].value
        if exponent is None and not a.is_number:
            raise UnitsDiffer(f"{where_in_user_code()}: the power of {a} is no number that is known.")
        return Unit(a.settled().of ** (exponent or 1.0))
    if name == "negative":
        return Unit(a.of, logs=a.logs**-1, line=a.line)
    if name in ("positive", "conjugate", "absolute"):
        return a.settled() if name == "absolute" else a
    if name == "sqrt":
        return Unit(a.settled().of ** 0.5)
    if name == "log":
        return Unit(logs=a.settled().of, line=str(where_in_user_code()))
    if name == "exp" and a.is_number:
        return Unit(a.logs)
    for x in (a, *others):
        x.number(f"the argument of {name}")
    return ONE


def _sum(name: str, inputs: Any, a: Unit, b: Unit) -> Unit:
    if name not in ("add", "subtract"):
        a.settled()
    numbers = [x for x in inputs if not isinstance(x, Unit)]
    if not numbers and not a.like(b):
        raise UnitsDiffer(f"{where_in_user_code()}: {a} and {b} are added, subtracted or compared.")
    one = b if numbers and not isinstance(inputs[0], Unit) else a
    if numbers and numbers[0] != 0.0 and not one.is_number:  # 0 is that of any unit
        raise UnitsDiffer(f"{where_in_user_code()}: {one} and the pure number {numbers[0]} are added or subtracted.")
    logs = a.logs * b.logs ** (-1 if name == "subtract" else 1)
    return Unit(one.of, logs=logs, line=a.line or b.line) if name in SUMS else ONE


def _product(a: Unit, b: Unit, sign: int) -> Any:
    if 0.0 in (a.value, b.value) and sign > 0:
        return 0.0
    for one, by in ((a, b), (b, a)):
        if one.logs != NONE and by.value is not None and by.is_number and (sign > 0 or one is a):
            return Unit(logs=one.logs ** (by.value**sign), line=one.line)
    return Unit(a.settled().of * b.settled().of ** sign)


ONE = Unit()


def unit(text: str) -> Unit:
    """Of "kg m^2/s^2", "J/(kg K)", "1"; any name that is no unit of pint's is one of its own."""
    while True:
        try:
            return Unit(REGISTRY.Unit(text))
        except pint.UndefinedUnitError as error:
            names: Any = error.unit_names  # a word, or several
            name = names if isinstance(names, str) else names[0]
            if not name.isidentifier():
                break
            REGISTRY.define(f"{name} = [{name}]")
        except (pint.PintError, AssertionError, TypeError, ValueError, tokenize.TokenError):
            break
    raise TcbenchError(f"{text!r} is no unit; write it as in 'kg m^2/s^2', 'J/(kg K)' or '1'.")


def check_units(system: System) -> None:
    """TcbenchError where a formula of the system does not agree with the units that its author declares."""
    checked = _Checked(system)
    if system.defines("element_energy"):
        checked.elements()
    else:
        checked.system_of_any_kind()
    if system.defines("exergy_offset"):
        checked.owes("exergy_offset", checked.value_of("exergy_offset"), checked.E, "the offset")


class _Checked:
    """A system whose constants and state are units."""

    def __init__(self, system: System) -> None:
        self.system, self.kind, units_of = system, type(system), {**DEFAULTS, **system.units}
        names = (*DEFAULTS, *system.variables, *system.constants)
        for name in units_of:
            if name not in names:
                raise TcbenchError(f"{self.kind.__name__}.units: {unknown_name('variable or constant', name, names)}")
        self.E, self.S, self.t = (unit(units_of[name]) for name in DEFAULTS)
        self.z = _flat(units_of, system.variables)
        self.clone = object.__new__(self.kind)
        vars(self.clone).update({x: vars(system)[x] for x in (*OF_SPACES, *system.tables) if x in vars(system)})
        for name in system.constants:
            values = np.asarray(getattr(system, name), dtype=float)
            units = _flat(units_of, {name: values.shape})
            parts = [Unit(u.of, float(x)) for u, x in zip(units, np.ravel(values), strict=True)]
            vars(self.clone)[name] = np.array([*parts, None], dtype=object)[:-1].reshape(values.shape)[()]

    def value_of(self, name: str, *arguments: Any) -> Any:
        return inspect.unwrap(getattr(self.kind, name))(self.clone, *arguments)

    def owes(self, name: str, values: Any, wanted: Unit, what: str) -> None:
        """UnitsDiffer where what a formula gives is in another unit than it should be, or some of it."""
        for x in np.ravel(np.asarray(values, dtype=object)):
            if not (x.settled() if isinstance(x, Unit) else ONE).like(wanted) and not _is_zero(x):
                where = f"{place(getattr(self.kind, name))}: {name}() of {self.kind.__name__}"
                raise UnitsDiffer(f"{where} gives {what} in {_in_words(x)}; it is {wanted}.")

    def elements(self) -> None:
        """Formulas of elements: what each takes and gives follows from the units of q, p and s."""
        n = self.system.layout["q"][1]
        vars(self.clone)["shape"] = partial(self.value_of, "shape")  # which entropies() may ask for
        q, p, s = (
            np.array([*part, None], dtype=object)[:-1] for part in (self.z[:n], self.z[n : 2 * n], self.z[2 * n :])
        )
        if "p" not in self.system.units:  # both follow
            p = self.E * self.t / q
        if "s" not in self.system.units:
            s[:] = self.S
        theta = self.E / s
        for value, x, y in zip(np.ravel(self.value_of("inertia") * np.ones(n)), q, p, strict=True):
            self.owes("inertia", value, y * self.t / x, "the inertia of a momentum over a velocity")
            self.owes("inertia", y * y / value, self.E, "p^2 over the inertia")
        pi = np.asarray(self.value_of("shape", q), dtype=object)
        self.owes("element_energy", self.value_of("element_energy", pi, s), self.E, "the energy of an element")
        gives = [("conduction", "a rate of s", s / self.t, [theta]), ("entropies", "an entropy", s, [q, theta])]
        for name, what, wanted, arguments in gives:
            values = np.ravel(np.asarray(self.value_of(name, *arguments), dtype=object))
            for value, u in zip(values, wanted, strict=True):
                self.owes(name, value, u, what)
        if self.system.defines("entropy_scale"):
            self.owes("entropy_scale", self.value_of("entropy_scale"), s[0], "the size of an entropy")
        if self.system.defines("conduction_flow"):
            self.owes("conduction_flow", self.value_of("conduction_flow", theta, self.t)[0], s[0], "a change of s")
        if self.system.defines("invariants"):
            self.value_of("invariants", q, p)

    def system_of_any_kind(self) -> None:
        system, z, (E, S, t) = self.system, self.z, (self.E, self.S, self.t)
        state, dE, dS = (system.state(np.array(x, dtype=object)) for x in (z, [E / u for u in z], [S / u for u in z]))
        for name, wanted in (("energy", E), ("entropy", S)):
            self.owes(name, self.value_of(name, state), wanted, f"the {name}")
        for name, matrix, of in (("reversible", "poisson", E), ("irreversible", "friction", S)):
            if system.defines(name):
                for variable, rate in self.value_of(name, state, dE, dS).items():
                    first, end, _ = system.layout[variable]
                    for x, u in zip(np.ravel(np.asarray(rate, dtype=object)), z[first:end], strict=True):
                        self.owes(name, x, u / t, f"the rate of {variable}")
            elif system.defines(matrix):
                entries = np.asarray(self.value_of(matrix, state), dtype=object)
                for (i, j), x in np.ndenumerate(entries):
                    self.owes(matrix, x, z[i] * z[j] / (of * t), f"row {i}, column {j}")
        if system.defines("temperature"):
            self.owes("temperature", self.value_of("temperature", state, dE, dS), E / S, "a temperature")
        for name in ("invariants", "measures"):  # of any unit, each of one
            if system.defines(name):
                self.value_of(name, state)


def _flat(units_of: Mapping[str, Any], shapes: Mapping[str, tuple[int, ...]]) -> list[Unit]:
    """The unit of each number."""
    flat: list[Unit] = []
    for name, shape in shapes.items():
        text, count = units_of.get(name, "1"), int(np.prod(shape))
        units = [text] * count if isinstance(text, str) else [str(x) for x in np.ravel(text)]
        if len(units) != count:
            raise TcbenchError(f"units has {len(units)} for the {count} numbers of {name!r}: one for all, or one each.")
        flat += map(unit, units)
    return flat


def _is_zero(value: Any) -> bool:
    return not isinstance(value, Unit) and value == 0.0


def _in_words(value: Any) -> str:
    return str(value) if isinstance(value, Unit) else "a pure number"
