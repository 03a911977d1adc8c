"""What the class of a system declares, checked when it is made: names, shapes, values, and what its formulas return."""

from __future__ import annotations

import keyword
from collections.abc import Callable, Mapping
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..compiler import derivatives as trace
from ..errors import TcbenchError, unknown_name
from .state import State, fixed

if TYPE_CHECKING:
    from .system import System

SETTINGS = (
    "name", "t_end", "dt", "initial", "positions", "momenta", "temperatures", "t_converge", "blowup_factor",
)  # fmt: skip
COLUMNS = ("t", "energy", "entropy", "theta", "all")  # of tables
ELEMENTS = ("n_positions", "n_elements", "inertia", "shape", "element_energy", "conduction", "entropies")


def check_declared(cls: type[System], general: type[System]) -> None:
    """TcbenchError where a class declares variables or constants that cannot be; or is one of elements."""
    base = next(c for c in cls.__mro__ if "written" in c.__dict__)
    own = {n for c in cls.__mro__[: cls.__mro__.index(base)] for n in c.__dict__}
    if old := [name for name in ELEMENTS if name in own and base is general and "energy" not in own]:
        raise TcbenchError(
            f"{cls.__name__} has {', '.join(old)}: it is a system of elements. Write "
            f"class {cls.__name__}(ElementSystem), from tcbench import ElementSystem; all else stays. System is the "
            "class of any GENERIC system (docs/add-system.md)."
        )
    for name in cls.constants:
        if name in SETTINGS:
            raise _taken(cls, "constant", name)
    if base is general and cls is not general:
        _check_variables(cls)


def _check_variables(cls: type[System]) -> None:
    if not isinstance(cls.variables, Mapping):
        raise TcbenchError(f"{cls.__name__}: variables are names and shapes, {{'q': (), 'p': (2,)}}.")
    shape: Any  # whatever an author wrote
    for name, shape in cls.variables.items():
        if not (name.isidentifier() and not keyword.iskeyword(name) and not name.startswith("_")):
            raise TcbenchError(f"{cls.__name__}: a variable has a name that Python takes, as in z.q, not {name!r}.")
        if hasattr(State, name) or name in (*SETTINGS, *COLUMNS, *cls.constants):
            raise _taken(cls, "variable", name)
        if not (isinstance(shape, tuple) and all(isinstance(n, int) and n > 0 for n in shape)):
            raise TcbenchError(
                f"{cls.__name__}: the shape of the variable {name!r} is () for a number, (3,) for three; not {shape!r}."
            )


def _taken(cls: type[System], kind: str, name: str) -> TcbenchError:
    return TcbenchError(
        f"{cls.__name__}: no {kind} can be called {name!r}, the name of something else; call it otherwise."
    )


def checked_constant(system: System, name: str, shape: tuple[int, ...], value: Any) -> Any:
    """The value of a constant, a number or an array."""
    try:
        array = np.array(value, dtype=float)  # not the caller's own, which may change
    except (TypeError, ValueError, OverflowError):
        raise TcbenchError(f"Constant {name!r} must be a number or {shape} numbers, not {value!r}.") from None
    if array.shape != shape:
        raise TcbenchError(f"Constant {name!r} must have shape {shape}, not {array.shape}.")
    if not np.all(np.isfinite(array)):
        raise TcbenchError(f"Constant {name!r} must be finite, not {value!r}.")
    if name in system.positive and not np.all(array > 0):
        raise TcbenchError(f"Constant {name!r} must be positive, not {value!r}.")
    if name in system.non_negative and not np.all(array >= 0):
        raise TcbenchError(f"Constant {name!r} must not be negative, not {value!r}.")
    return float(array) if shape == () else fixed(array)


def as_written(formula: Callable[..., Any], name: str) -> Callable[..., Any]:
    """An author's formula on arrays: its arguments get their names, and the rates that it names become a vector."""

    @wraps(formula)
    def body(self: System, *states: Any) -> Any:
        try:
            found = formula(self, *map(self.state, states))
        except TcbenchError:
            raise
        except Exception as error:  # numpy and Python refuse symbols with errors of their own
            message = f"{_place(formula, error)}: {name}() of {type(self).__name__} cannot be evaluated"
            raise TcbenchError(f"{message}: {type(error).__name__}: {error}") from error
        where = f"{_place(formula)}: {name}() of {type(self).__name__}"
        if name in ("energy", "entropy"):
            return _number(found, where)
        return self.state(_rates(self, found, where))

    body.__name__ = name  # whatever the author's function is called: kernels are known by it
    return body


def _place(formula: Callable[..., Any], error: Exception | None = None) -> str:
    """File and line of what an author wrote, as deep in its file as the error goes."""
    code: Any = getattr(formula, "__code__", None)
    name, line, step = (
        getattr(code, "co_filename", "?"),
        getattr(code, "co_firstlineno", 0),
        getattr(error, "__traceback__", None),
    )
    while step is not None:
        if step.tb_frame.f_code.co_filename == name:
            line = step.tb_lineno
        step = step.tb_next
    return f"{Path(name).name}, line {line}"


def _number(found: Any, where: str) -> Any:
    array = np.asarray(found, dtype=object)
    if array.size != 1 or array.item() is None or isinstance(array.item(), str):
        raise TcbenchError(
            f"{where} returns one number, not "
            + ("nothing (is `return` missing?)." if found is None else f"shape {array.shape}; sum() adds up.")
        )
    return array.item()


def _rates(self: System, found: Any, where: str) -> Any:
    if not isinstance(found, Mapping):
        example = next(iter(self.variables), "q")
        given = "nothing (is `return` missing?)" if found is None else type(found).__name__
        raise TcbenchError(f"{where} returns rates by the name of their variable, {{{example!r}: ...}}, not {given}.")
    rates = trace.array([trace.const(0.0)] * self.size)
    for name, value in found.items():
        if name not in self.variables:
            raise unknown_name(f"variable of {self.name!r}", str(name), self.variables)
        first, end, shape = self.layout[name]
        array = np.asarray(value, dtype=object)
        if array.shape != shape:
            raise TcbenchError(f"{where}: the rate of {name!r} is {whole(shape)}, not shape {array.shape}.")
        rates[first:end] = [trace.lifted(x) for x in array.ravel()]
    return rates


def whole(shape: tuple[int, ...]) -> str:
    """A shape in words."""
    return f"numbers of shape {shape}" if shape else "a number"


def finite(system: System, name: str, value: Any) -> float:
    """A formula's value at a state of numbers."""
    try:
        return float(value)
    except (TypeError, ValueError):
        raise TcbenchError(f"{name}() of {type(system).__name__} gives {value!r}, which is no number.") from None
