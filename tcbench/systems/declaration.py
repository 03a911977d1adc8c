"""What the class of a system declares, checked when it is made: names, shapes, values."""

from __future__ import annotations

import keyword
import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import TcbenchError, shown
from .state import State, fixed, real

if TYPE_CHECKING:
    from .system import System

SETTINGS = (
    "name", "t_end", "dt", "initial", "positions", "momenta", "temperatures", "t_converge", "blowup_factor",
)  # fmt: skip
COLUMNS = re.compile(  # names of columns of tables, which no variable may have
    r"(t|tolerance|integrator|scenario|status|all|energy(_error)?|entropy(_fall|_produced)?|lyapunov_rise|at_[xy]_\d+)\Z"
)
WARM = re.compile(r"(theta\d*|temperature_[a-z])\Z")  # names of columns of systems with temperatures
OF_ELEMENTS = re.compile(r"(theta\d+|(temperature|strain)_[a-z]|[xyq]_\d+)\Z")
OTHERS = "something else (of numpy, as T, a setting, or a column of tables, as theta, the temperatures)"
MATRICES = {"reversible": "poisson", "irreversible": "friction"}  # what may stand in the place of a rate
ELEMENTS = ("n_positions", "n_elements", "inertia", "shape", "element_energy", "conduction", "entropies")


def check_declared(cls: type[System], general: type[System]) -> None:
    """TcbenchError for variables or constants that cannot be, and for an `ElementSystem` written as a `System`."""
    base = next(c for c in cls.__mro__ if "written" in c.__dict__)
    own = {n for c in cls.__mro__[: cls.__mro__.index(base)] for n in c.__dict__}
    if old := [name for name in ELEMENTS if name in own and base is general and "energy" not in own]:
        raise TcbenchError(
            f"{cls.__name__} has {', '.join(old)}: it is a system of elements. Write "
            f"class {cls.__name__}(ElementSystem), from tcbench import ElementSystem; all else stays. System is the "
            "class of any GENERIC system (docs/add-system.md)."
        )
    for name in (*cls.constants, *cls.tables):
        if name in SETTINGS:
            raise taken(cls, "constant", name)
    _check_spaces(cls)
    if base is general and cls is not general:
        _check_variables(cls)
        for rate, matrix in MATRICES.items():
            if cls.defines(matrix) and cls.has_spaces():
                raise TcbenchError(
                    f"{cls.__name__} has variables over spaces and a matrix, {matrix}(); write {rate}(), a formula."
                )
            if cls.defines(rate) and cls.defines(matrix):
                raise TcbenchError(
                    f"{cls.__name__} has {rate}() and {matrix}(), which say the same; write one of them."
                )


def _check_variables(cls: type[System]) -> None:
    if not isinstance(cls.variables, Mapping):
        raise TcbenchError(f"{cls.__name__}: variables are names and shapes, {{'q': (), 'p': (2,)}}.")
    name: Any  # whatever an author wrote
    shape: Any
    for name, shape in cls.variables.items():
        if not (
            isinstance(name, str) and name.isidentifier() and not keyword.iskeyword(name) and not name.startswith("_")
        ):
            raise TcbenchError(f"{cls.__name__}: a variable has a name that Python takes, as in z.q, not {name!r}.")
        if hasattr(State, name) or name in (*State.__annotations__, *SETTINGS, *cls.constants) or is_column(name, cls):
            raise taken(cls, "variable", name, "a constant" * (name in cls.constants) or OTHERS)
        _check_shape(cls, f"the variable {name!r}", shape)


def _check_shape(cls: type[System], what: str, shape: Any) -> None:
    sizes = shape[1:] if isinstance(shape, tuple) and shape and _is_space(shape[0]) else shape
    if not (isinstance(sizes, tuple) and all(isinstance(n, int) and n > 0 for n in sizes)):
        raise TcbenchError(
            f"{cls.__name__}: the shape of {what} is () for a number, (3,) for three, ('node', 2) for two of each "
            f"node; not {shape!r}."
        )


def _is_space(name: Any) -> bool:
    return isinstance(name, str) and name.isidentifier()


def _check_spaces(cls: type[System]) -> None:
    """TcbenchError for constants or tables over spaces that are declared in another form."""
    shape: Any  # whatever an author wrote
    for name, shape in cls.constants.items():
        if isinstance(shape, tuple) and any(isinstance(n, str) for n in shape):
            _check_shape(cls, f"the constant {name!r}", shape)
    for name, shape in cls.tables.items():
        good = isinstance(shape, tuple) and len(shape) > 1 and all(isinstance(n, int) and n > 0 for n in shape[1:-1])
        if not (good and _is_space(shape[0]) and all(map(_is_space, str(shape[-1]).split("+")))):
            raise TcbenchError(
                f"{cls.__name__}: the table {name!r} is declared by what has numbers, how many each, and of what: "
                f"('spring', 2, 'node') or ('spring', 2, 'node+anchor'); not {shape!r}."
            )
        if name in cls.constants:
            raise taken(cls, "table", name)


def is_column(name: str, system: type[System] | System) -> bool:
    """Does a table have a column of this name, such as q0 of a variable q of several numbers?"""
    letters, shape = name.rstrip("0123456789"), system.variables.get(name, ())
    if system.defines("temperature") and WARM.match(f"{name}0" if shape else name):
        return True
    if system.defines("element_energy") and OF_ELEMENTS.match(name):
        return True
    return COLUMNS.match(name) is not None or (letters != name and system.variables.get(letters, ()) != ())


def taken(cls: type[System], kind: str, name: str, of: str = "something else") -> TcbenchError:
    return TcbenchError(f"{cls.__name__}: no {kind} can be called {name!r}, the name of {of}; call it otherwise.")


def named_constant(cls: type[System], what: str, name: str) -> property:
    """A property: the value of the constant that a class names in the place of a number."""
    if cls.constants.get(name) != ():
        numbers = ", ".join(n for n, shape in cls.constants.items() if shape == ()) or "none"
        raise TcbenchError(
            f"{cls.__name__}: {what} = {name!r} names no constant that is a number; those are: {numbers}."
        )
    return property(lambda self: getattr(self, name))


def checked_constant(system: System, name: str, shape: tuple[int, ...], value: Any) -> Any:
    """The value of a constant as a float or a read-only array; TcbenchError for another shape, sign or kind."""
    try:
        array = real(value)  # not the caller's own, which may change
    except (TypeError, ValueError, OverflowError):
        wanted = f"a number, or an array of shape {shape}" if shape else "a number"
        raise TcbenchError(f"Constant {name!r} must be {wanted}, not {shown(value)}.") from None
    if array.shape == (0,) and 0 in shape:  # of an empty space a list does not say the rest
        array = array.reshape(shape)
    if array.shape != shape:
        raise TcbenchError(f"Constant {name!r} must have shape {shape}, not {array.shape}.")
    if not np.all(np.isfinite(array)):
        raise TcbenchError(f"Constant {name!r} must be finite, not {shown(value)}.")
    if name in system.positive and not np.all(array > 0):
        raise TcbenchError(f"Constant {name!r} must be positive, not {shown(value)}.")
    if name in system.non_negative and not np.all(array >= 0):
        raise TcbenchError(f"Constant {name!r} must not be negative, not {shown(value)}.")
    return float(array) if shape == () else fixed(array)


def whole(shape: tuple[int, ...]) -> str:
    """A shape in words."""
    return f"numbers of shape {shape}" if shape else "a number"


def finite(system: System, name: str, value: Any) -> float:
    """The value of a formula as a float; TcbenchError where it is no number."""
    try:
        return float(value)
    except (TypeError, ValueError):
        raise TcbenchError(f"{name}() of {type(system).__name__} gives {value!r}, which is no number.") from None
