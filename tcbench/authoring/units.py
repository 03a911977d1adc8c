"""Units of measure of a system whose author declares them: its formulas are run on units in the place of numbers.

    units = {"q": "m", "p": "kg m/s", "s": "J/K", "mass": "kg", "stiffness": "N/m"}

What is not named is a pure number, "energy" is in J, "entropy" in J/K and "time" in s unless they are named; entries of
an array that differ are a list of units. A sum of two units, or a function of one, ends with the line that it is on.
"""

from __future__ import annotations

import ast
import inspect
import operator
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from ..compiler.sentences import where_in_user_code
from ..errors import TcbenchError, unknown_name
from ..systems.as_written import place

if TYPE_CHECKING:
    from ..systems.system import System

Powers = Mapping[str, float]  # base unit -> exponent, none of them 0
DERIVED = {
    "J": "kg*m**2/s**2", "N": "kg*m/s**2", "W": "kg*m**2/s**3", "Pa": "kg/m/s**2", "Hz": "1/s", "C": "A*s",
    "V": "kg*m**2/s**3/A", "F": "A**2*s**4/kg/m**2", "ohm": "kg*m**2/s**3/A**2", "rad": "1",
}  # fmt: skip
DEFAULTS = {"energy": "J", "entropy": "J/K", "time": "s"}
OF_NUMBERS = (
    "exp", "log", "expm1", "log1p", "sin", "cos", "tan", "arcsin", "arccos", "arctan", "sinh", "cosh", "tanh",
)  # fmt: skip
NEGLIGIBLE = 1e-9  # difference of two exponents that are sums of fractions


class UnitsDiffer(TcbenchError):
    """Two units where one is needed; the message names the line."""


def _one(operation: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """Arrays do it entry by entry themselves."""
    return lambda self, other: NotImplemented if isinstance(other, np.ndarray) else operation(self, other)


class Unit:
    """What a formula is run on: a unit; and the number, where one is known, for exponents."""

    def __init__(self, powers: Powers, value: float | None = None) -> None:
        self.powers = {name: n for name, n in powers.items() if abs(n) > NEGLIGIBLE}
        self.value = value

    def __str__(self) -> str:
        if not self.powers:
            return "a pure number"
        names = (name for name in DERIVED if self.like(unit(name)))
        return next(names, " ".join(name if n == 1 else f"{name}^{n:g}" for name, n in self.powers.items()))

    def like(self, other: Unit) -> bool:
        return not (self / other).powers

    @_one
    def _sum(self, other: Any) -> Unit:
        if isinstance(other, Unit):
            if not self.like(other):
                raise UnitsDiffer(f"{where_in_user_code()}: {self} and {other} are added, subtracted or compared.")
        elif other != 0.0 and self.powers:  # 0 is that of any unit
            raise UnitsDiffer(f"{where_in_user_code()}: {self} and the pure number {other} are added or subtracted.")
        return Unit(self.powers)

    __add__ = __radd__ = __sub__ = __rsub__ = hypot = _sum

    def arctan2(self, other: Any) -> Unit:
        self._sum(other)
        return Unit({})

    def _times(self, other: Any, sign: float) -> Any:
        if not isinstance(other, Unit) and other == 0.0:
            return 0.0
        mine, others = self.powers, other.powers if isinstance(other, Unit) else {}
        return Unit({name: mine.get(name, 0) + sign * others.get(name, 0) for name in {**mine, **others}})

    @_one
    def __mul__(self, other: Any) -> Any:
        return self._times(other, 1.0)

    __rmul__ = __mul__

    @_one
    def __truediv__(self, other: Any) -> Any:
        return self._times(other, -1.0)

    @_one
    def __rtruediv__(self, other: Any) -> Any:
        return (self**-1) * other

    @_one
    def __pow__(self, exponent: Any) -> Unit:
        if isinstance(exponent, Unit):
            exponent._number("an exponent")
            exponent = exponent.value
        if exponent is None and self.powers:
            raise UnitsDiffer(f"{where_in_user_code()}: the power of {self} is no number that is known.")
        return Unit({name: n * exponent for name, n in self.powers.items()})

    @_one
    def __rpow__(self, base: Any) -> Unit:
        return self._number("an exponent")

    def __neg__(self) -> Self:
        return self

    __pos__ = __abs__ = conjugate = __neg__

    def sqrt(self) -> Any:
        return self**0.5

    def _number(self, what: str) -> Unit:
        if self.powers:
            raise UnitsDiffer(f"{where_in_user_code()}: {what} is a pure number, not {self}.")
        return Unit({})


def _of_number(name: str) -> Callable[[Unit], Unit]:
    return lambda x: x._number(f"the argument of {name}")


for _name in OF_NUMBERS:
    setattr(Unit, _name, _of_number(_name))


def unit(text: Any) -> Unit:
    """Of "kg m^2/s^2", "J/(kg K)", "1"; any other name is a unit of its own."""
    actions = {ast.Mult: operator.mul, ast.Div: operator.truediv, ast.Pow: operator.pow}

    def of(node: ast.AST) -> Any:
        match node:
            case ast.Name(id=name):
                return unit(DERIVED[name]) if name in DERIVED else Unit({name: 1.0})
            case ast.Constant(value=int() | float() as number):
                return Unit({}, float(number))
            case ast.UnaryOp(op=ast.USub(), operand=inner):
                return Unit({}, -of(inner).value)
            case ast.BinOp(left=left, op=op, right=right) if type(op) in actions:
                a, b = of(left), of(right)
                if a.value is not None and b.value is not None:
                    return Unit({}, actions[type(op)](a.value, b.value))
                return actions[type(op)](a, b)
        raise ValueError

    try:
        found = of(ast.parse("*".join(text.replace("^", "**").split()) or "1", mode="eval").body)
    except (SyntaxError, ValueError, AttributeError, TypeError):
        raise TcbenchError(f"{text!r} is no unit; write it as in 'kg m^2/s^2', 'J/(kg K)' or '1'.") from None
    return Unit(found.powers)


def check_units(system: System) -> None:
    """TcbenchError where a formula of the system does not agree with the units that its author declares."""
    kind, given = type(system), {**DEFAULTS, **system.units}
    known = (*DEFAULTS, *system.variables, *system.constants)
    for name in given:
        if name not in known:
            raise TcbenchError(f"{kind.__name__}.units: {unknown_name('variable or constant', name, known)}")
    E, S, t = (unit(given[name]) for name in DEFAULTS)
    z = _flat(given, system.variables)
    clone = object.__new__(kind)
    for name, shape in system.constants.items():
        values = np.ravel(getattr(system, name))
        parts = [Unit(u.powers, float(x)) for u, x in zip(_flat(given, {name: shape}), values, strict=True)]
        clone.__dict__[name] = np.array([*parts, None], dtype=object)[:-1].reshape(shape)[()]
    state, dE, dS = (system.state(np.array(x, dtype=object)) for x in (z, [E / u for u in z], [S / u for u in z]))

    def asked(name: str, *states: Any) -> Any:
        return inspect.unwrap(getattr(kind, name))(clone, *states)

    def owes(name: str, found: Any, wanted: Unit, what: str) -> None:
        if not (found if isinstance(found, Unit) else Unit({})).like(wanted) and not _is_zero(found):
            where = f"{place(getattr(kind, name))}: {name}() of {kind.__name__}"
            raise UnitsDiffer(f"{where} gives {what} in {_told(found)}; it is {wanted}.")

    for name, wanted in (("energy", E), ("entropy", S)):
        owes(name, np.asarray(asked(name, state), dtype=object).item(), wanted, f"the {name}")
    for name, matrix, of in (("reversible", "poisson", E), ("irreversible", "friction", S)):
        if system.defines(name):
            for variable, rate in asked(name, state, dE, dS).items():
                first, end, _ = system.layout[variable]
                for x, u in zip(np.ravel(np.asarray(rate, dtype=object)), z[first:end], strict=True):
                    owes(name, x, u / t, f"the rate of {variable}")
        elif system.defines(matrix):
            entries = np.asarray(asked(matrix, state), dtype=object)
            for (i, j), x in np.ndenumerate(entries):
                owes(matrix, x, z[i] * z[j] / (of * t), f"row {i}, column {j}")
    if system.defines("temperature"):
        for x in np.ravel(np.asarray(asked("temperature", state, dE, dS), dtype=object)):
            owes("temperature", x, E / S, "a temperature")
    if system.defines("exergy_offset"):
        owes("exergy_offset", asked("exergy_offset"), E, "the offset")
    for name in ("invariants", "measures"):  # of any unit, each of one
        if system.defines(name):
            asked(name, state)


def _flat(given: Mapping[str, Any], shapes: Mapping[str, tuple[int, ...]]) -> list[Unit]:
    """The unit of each number."""
    found: list[Unit] = []
    for name, shape in shapes.items():
        text, count = given.get(name, "1"), int(np.prod(shape))
        units = [text] * count if isinstance(text, str) else [str(x) for x in np.ravel(text)]
        if len(units) != count:
            raise TcbenchError(f"units has {len(units)} for the {count} numbers of {name!r}: one for all, or one each.")
        found += map(unit, units)
    return found


def _is_zero(found: Any) -> bool:
    return not isinstance(found, Unit) and found == 0.0


def _told(found: Any) -> str:
    return str(found) if isinstance(found, Unit) else "a pure number"
