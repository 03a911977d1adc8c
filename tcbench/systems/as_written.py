"""Wraps the formulas of a system's author: arguments get names and are read-only, and the type and shape of what is
returned is checked. Errors name the author's file and line."""

from __future__ import annotations

import inspect
import traceback
from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np

from ..compiler import derivatives as trace
from ..compiler.array_states import Blocks, fitted, is_array
from ..compiler.array_symbols import ArraySymbol
from ..compiler.caches import cached
from ..compiler.repeats import REMEDY, same_again
from ..compiler.trace_errors import ELEMENTARY
from ..errors import TcbenchError, misnamed, unknown_name
from .constrained import named_constraints
from .declaration import whole
from .state import State, shape_of
from .traced import derived

if TYPE_CHECKING:
    from .system import System

Check = Callable[["System", Any, str], Any]  # (system, the value of a formula, where it is written) -> the value
# by formula, the hashes of classes in which it has been seen to give the same when it is called again
_REPEATED: WeakKeyDictionary[Callable[..., Any], set[str]] = WeakKeyDictionary()


def as_written(formula: Callable[..., Any], name: str) -> Callable[..., Any]:
    """An author's formula as a function of vectors: its arguments get names, and named rates become a vector."""
    returned = RETURNED[name]

    @wraps(formula)
    def body(self: System, *states: Any) -> Any:
        symbolic = is_array(*states) or any(np.asarray(state).dtype == object for state in states)

        def call() -> Any:
            return formula(self, *(_read_only(self, state) for state in states))

        try:
            value = call()
            repeatable = not symbolic or self.formulas in _REPEATED.get(formula, ()) or same_again(value, call)
        except TcbenchError:
            raise
        except Exception as error:  # numpy and Python refuse symbols with errors of their own
            why = misnamed(error).rstrip(".")
            if "read-only" in why:
                why += ": a formula does not write to its arguments. Write a = a + b, not a += b"
            elif symbolic:
                why += f". {ELEMENTARY}"
            message = f"{place(formula, error)}: {name}() of {type(self).__name__} cannot be evaluated"
            raise TcbenchError(f"{message}: {why}.") from error
        where = f"{place(formula)}: {name}() of {type(self).__name__}"
        if not repeatable:
            raise TcbenchError(f"{where} {REMEDY}.")
        if symbolic:
            _REPEATED.setdefault(formula, set()).add(self.formulas)
        return returned(self, value, where)

    body.__name__ = name  # kernels are found by it, whatever the author's function is called
    return body


@cached
def check_repeats(model: System) -> None:
    """TcbenchError where a formula does not give the same when it is called again.

    model : the symbolic system. Methods that trace formulas see to it themselves; solvers in Python would go on.
    """
    if model.large:
        return
    with trace.tracing():
        z, dE, dS = (model.unknowns(name) for name in ("z", "dE", "dS"))
        if "energy" in model.written:
            model.energy(z), model.entropy(z), model.reversible(z, dE, dS), model.irreversible(z, dE, dS)
        elif not same_again(model.free_rate(z), lambda: model.free_rate(z)):  # of elements, whose parts have no names
            raise TcbenchError(f"A formula of {model.name!r} {REMEDY}.")


def _read_only(self: System, values: Any) -> Any:
    """The state, read-only: a formula that wrote to it would change the method's own array."""
    state = self.state(values)
    if not is_array(state):
        state.setflags(write=False)
    return state


def place(formula: Callable[..., Any], error: Exception | None = None) -> str:
    """File and line of an author's function; of an error the deepest line in that file."""
    code: Any = getattr(inspect.unwrap(formula), "__code__", None)
    name, line = getattr(code, "co_filename", "?"), getattr(code, "co_firstlineno", 0)
    for frame in traceback.extract_tb(error.__traceback__) if error else ():
        if frame.filename == name:
            line = frame.lineno
    return f"{Path(name).name}, line {line}"


def _number(self: System, value: Any, where: str) -> Any:
    if is_array(value):
        raise TcbenchError(f"{where} returns one number, not {value!r}; x.sum() adds up.")
    array = np.asarray(value, dtype=object)
    if array.size != 1 or array.item() is None or isinstance(array.item(), str):
        raise TcbenchError(
            f"{where} returns one number, not "
            + ("nothing (is `return` missing?)." if value is None else f"shape {array.shape}; sum() adds up.")
        )
    return array.item()


def _rates(self: System, named: Any, where: str) -> Any:
    if isinstance(named, (State, Blocks)):  # the sum of super()'s rates and others
        named = {name: getattr(named, name) for name in self.variables}
    example = next(iter(self.variables), "q")
    named = _named(named, where, f"rates by the name of their variable, {{{example!r}: ...}}")
    for name in named:
        if name not in self.variables:
            raise TcbenchError(f"{where}: {unknown_name(f'variable of {self.name!r}', str(name), self.variables)}")
    if self.by_array:
        return self.state(_array_rates(self, named, where))
    vector = trace.array([trace.const(0.0)] * self.size)
    for name, value in named.items():
        first, end, shape = self.layout[name]
        array = np.asarray(value, dtype=object)
        if array.shape != shape:
            raise TcbenchError(f"{where}: the rate of {name!r} is {whole(shape)}, not shape {array.shape}.")
        vector[first:end] = [trace.lifted(x) for x in array.ravel()]
    return self.state(vector)


def _array_rates(self: System, rates: Mapping[str, Any], where: str) -> Blocks:
    """The rates as a state of arrays over spaces."""
    z = self.fresh_state("z")
    likes = {name: getattr(z, name) for name in self.variables}
    for name, value in rates.items():
        like = likes[name]
        if isinstance(like, ArraySymbol) and not isinstance(value, ArraySymbol):
            raise TcbenchError(f"{where}: the rate of {name!r} is one for each {like.space}, not {value!r}.")
    return Blocks([fitted(rates.get(n, 0.0 * like), like, f"{where}: the rate of {n!r}") for n, like in likes.items()])


def _named(value: Any, where: str, what: str) -> Mapping[Any, Any]:
    if not isinstance(value, Mapping):
        kind = "nothing (is `return` missing?)" if value is None else type(value).__name__
        raise TcbenchError(f"{where} returns {what}, not {kind}.")
    return value


def _numbers_by_name(self: System, numbers: Any, where: str) -> Any:
    for name, value in _named(numbers, where, "numbers by name, {'spin': ...}").items():
        if is_array(value) or shape_of(value) != ():
            kind = repr(value) if is_array(value) else f"of shape {shape_of(value)}"
            raise TcbenchError(f"{where}: each is one number, not {name!r} {kind}; sum() adds up.")
    return numbers


def _numbers(self: System, values: Any, where: str) -> Any:
    if values is None or isinstance(values, (Mapping, str)):
        kind = "nothing (is `return` missing?)" if values is None else type(values).__name__
        raise TcbenchError(f"{where} returns one number or several, an array of them, not {kind}.")
    return values


def _matrix(self: System, matrix: Any, where: str) -> Any:
    if shape_of(matrix) != (self.size, self.size):
        raise TcbenchError(
            f"{where} returns a matrix of shape {(self.size, self.size)}, a row for each of "
            f"{', '.join(self.component_names[:8])}{', ...' * (self.size > 8)}; not shape {shape_of(matrix)}."
        )
    return matrix


def _as_it_is(self: System, value: Any, where: str) -> Any:
    return value


def derive(cls: type, base: type, names: Sequence[str]) -> None:
    """Replace the author's formulas by functions that trace and check them, in the class that defines each."""
    for name in names:
        if not hasattr(formula := getattr(cls, name), "is_derived"):
            own = next(kind for kind in cls.__mro__ if name in kind.__dict__)
            setattr(own if issubclass(own, base) else cls, name, derived(as_written(formula, name)))


RETURNED: Mapping[str, Check] = {  # by formula, the check of its value
    "energy": _number, "entropy": _number, "reversible": _rates, "irreversible": _rates,
    "poisson": _matrix, "friction": _matrix, "invariants": _numbers_by_name, "temperature": _numbers,
    "measures": _numbers, "points": _as_it_is, "constraints": named_constraints,  # of which systems.plane asks more
}  # fmt: skip
