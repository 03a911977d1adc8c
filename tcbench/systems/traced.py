"""Formulas of a system as expressions on symbols and as compiled kernels: what `System` is built on."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Mapping
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from ..compiler import derivatives as trace
from ..compiler.array_states import is_array
from ..compiler.array_tensors import SymbolArray
from ..compiler.caches import LOCK, cached_property
from ..compiler.repeats import REMEDY, same_again
from ..errors import TcbenchError, TraceError, misnamed
from .state import fixed

if TYPE_CHECKING:
    from ..compiler.kernels import Kernel

Array = NDArray[Any]
OURS = Path(__file__).parents[1]
OF_LAWS = 2  # the last of `System.magnitudes` are those of energy and entropy
ENTRY_BY_ENTRY = 24  # length of a state over spaces up to which formulas are traced entry by entry, not in loops
MOST_WHOLE = 200  # the longest that ever is: straight-line code of longer ones takes minutes to compile
# formulas that take a state in any thermal variable
OF_ANY = ["entropy_variables", "variables_of_energies", "temperature_field", "temperature_forces", "shapes"]
_SYMBOLIC: dict[tuple[Any, ...], Any] = {}
_KERNELS: dict[tuple[Any, ...], tuple[Kernel, tuple[int, ...]]] = {}


def attributes(item: Any, names: tuple[str, ...]) -> dict[str, Any]:
    """The attributes of these names in the object's own __dict__, read one by one: threads may add others meanwhile."""
    own = vars(item)
    return {name: own[name] for name in names if name in own}


def derived(body: Callable[..., Any]) -> Callable[..., Any]:
    """A function of states that is traced on symbols and compiled on floats (leading axes are a batch)."""

    @wraps(body)
    def function(self: Traced, *states: Any) -> Any:
        if is_array(*states):
            _check_names(self, body.__name__, states)
            return trace.as_symbol(body(self, *states))
        arrays = [np.asarray(state) for state in states]
        if any(a.dtype == object for a in arrays):
            _check_names(self, body.__name__, states)
            return trace.as_symbol(body(self, *arrays))
        return self._evaluate(body, [a.astype(np.float64, copy=False) for a in arrays])

    function.is_derived = True  # type: ignore[attr-defined]
    return function


def _check_names(system: Traced, name: str, states: tuple[Any, ...]) -> None:
    """TraceError where (q, p, theta) or (q, p, u) is taken for (q, p, s)."""
    if name in OF_ANY:
        return
    for state in states:
        names = getattr(state, "layout", None) or getattr(state, "names", None) or {}
        if other := [x for x in names if x not in system.variables]:
            raise trace.refused(
                f"system.{name} is of ({', '.join(system.variables)}), and gets a state that has {other[0]!r}",
                "system.entropy_variables(z) makes it of temperatures, system.variables_of_energies(z) of energies",
            )


def _run(body: Callable[..., Any], system: Any, *states: Any) -> Any:
    """The formula on symbols. An exception of numpy or Python becomes a TraceError with the author's line."""
    try:
        value = body(system, *states)
        repeatable = body.__name__ != "vector_field" or same_again(value, lambda: body(system, *states))
    except TcbenchError:
        raise
    except Exception as error:
        own = [f for f in traceback.extract_tb(error.__traceback__) if not Path(f.filename).is_relative_to(OURS)]
        where = f"{Path(own[0].filename).name}, line {own[0].lineno}: " if own else ""
        raise TraceError(
            f"{where}a formula of {type(system).__name__} cannot be traced: {misnamed(error)}. Formulas are "
            "branch-free numpy on symbols, and what they read of self are constants."
        ) from error
    if not repeatable:
        raise TraceError(f"A formula of {type(system).__name__} {REMEDY}.")
    return value


class Traced:
    """Functions of states that are traced with symbols for constants, once for all systems of one structure."""

    name: ClassVar[str] = ""
    constants: Mapping[str, Any] = {}  # name -> shape, a tuple
    variables: Mapping[str, tuple[Any, ...]] = {}  # name -> shape
    positive: ClassVar[tuple[str, ...]] = ()  # constants that must be > 0
    size: Any  # length of z
    zeros: tuple[tuple[str, int], ...] = ()  # constants (name, index) that are 0: what they switch off costs nothing
    formulas: str = ""  # hash of the formulas of the class as they were when the instance was made

    if TYPE_CHECKING:  # constants become attributes: numbers or arrays, or symbols while a formula is traced

        def __getattr__(self, name: str) -> Any: ...

    def __getstate__(self) -> dict[str, Any]:
        """For copies and pickles: the numbers; symbols and addresses of kernels are derived again."""
        derived = {
            name
            for kind in type(self).__mro__
            for name, x in dict(vars(kind)).items()
            if isinstance(x, cached_property)
        }
        # of a copy of __dict__: another thread may add to it meanwhile
        return {name: value for name, value in dict(vars(self)).items() if name not in derived}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update({name: fixed(x) if isinstance(x, np.ndarray) else x for name, x in state.items()})

    def formula(self, name: str) -> tuple[str, tuple[int, ...]]:
        """A derived function of one state ("vector_field", "energy", ...) as straight-line Python, and its shape.

        The text defines kernel(a, b, out): a the state, b `constant_values`, out the values, flat; it needs the names
        of the elementary functions that it calls.
        """
        from ..compiler.kernels import straight_line

        return self._traced(self._body(name), (self.size,), straight_line)

    def kernel(self, name: str) -> tuple[Kernel, tuple[int, ...]]:
        """`formula` compiled, for `compiler.language.call` and `compiler.library.evaluate`, and its shape."""
        return self._kernel(self._body(name), (self.size,))

    @property
    def kept(self) -> tuple[str, ...]:
        """The attributes of an instance that `symbolic` copies."""
        return "formulas", "zeros"

    @cached_property
    def symbolic(self) -> Self:
        """This system with symbols for constants: one object for all values."""
        return self.with_symbols()

    def with_symbols(self) -> Self:
        """Make `symbolic`. Other threads see it when it is complete: subclasses add to it here."""
        key = self.structure
        if key not in _SYMBOLIC:
            clone = object.__new__(type(self))
            clone.__dict__.update(attributes(self, self.kept))
            clone.name_constants()
            clone.__dict__["magnitudes"] = self.magnitude_symbols()
            _SYMBOLIC.setdefault(key, clone)  # of two threads that make one at once the first wins
        symbolic: Self = _SYMBOLIC[key]
        return symbolic

    def name_constants(self) -> None:
        """Set symbols in the place of constants."""
        for name, shape in self.constants.items():
            symbols = self.symbols_of(name)
            setattr(self, name, symbols[0] if shape == () else symbols.reshape(shape).view(SymbolArray))

    @property
    def structure(self) -> tuple[Any, ...]:
        """Systems of equal structure share formulas and kernels."""
        return (type(self), self.size, self.formulas, self.zeros)

    def magnitude_symbols(self) -> Any:
        """New symbols for `System.magnitudes`."""
        return trace.variables("magnitude", len(self.variables) + OF_LAWS)

    def symbols_of(self, name: str) -> Any:
        """New symbols for the entries of a constant, and 0 for those that are 0 in this structure."""
        symbols = trace.variables(name, int(np.prod(self.constants[name])))
        for n, i in self.zeros:
            if n == name:
                symbols[i] = trace.const(0.0)
        if name in self.positive:
            trace.positive(symbols)
        return symbols

    def constant_symbols(self) -> dict[trace.Symbol, str]:
        """Kernel inputs for the constants and magnitudes: symbol -> 'b[1]', ...; b[0] is the time step."""
        symbols = [x for name in self.constants for x in np.ravel(getattr(self.symbolic, name))]
        symbols += [*self.symbolic.magnitudes]
        return {x: f"b[{i + 1}]" for i, x in enumerate(symbols) if x.op != "const"}

    def _evaluate(self, body: Callable[..., Any], arrays: list[Array]) -> Any:
        """`body` at a state or at a batch of states (leading axes), by a compiled kernel."""
        from ..compiler.library import ROWS, evaluate

        batch = np.broadcast_shapes(*(a.shape[:-1] for a in arrays))
        if batch:
            rows = [np.broadcast_to(a, (*batch, a.shape[-1])).reshape(-1, a.shape[-1]) for a in arrays]
        entry, shape = self._kernel(body, tuple(a.shape[-1] for a in arrays))
        out = np.empty((len(rows[0]) if batch else 1, entry.size))
        if batch:
            ROWS.evaluate_rows(entry.address, np.concatenate(rows, axis=1), self.declared_values, out)
        else:  # the common case, where microseconds count
            a = arrays[0] if len(arrays) == 1 else np.concatenate(arrays)
            evaluate(entry.address, np.ascontiguousarray(a), self.declared_values, out[0])
        if not batch and not shape:
            return float(out[0, 0])
        values = out.reshape((*batch, *shape))
        return self.state(values) if shape == (self.size,) else values

    def _kernel(self, body: Callable[..., Any], sizes: tuple[int, ...]) -> tuple[Kernel, tuple[int, ...]]:
        key = (self.structure, body, sizes)
        if key not in _KERNELS:
            from ..compiler.kernels import kernel as straight

            with LOCK:
                if key not in _KERNELS:
                    _KERNELS[key] = self._traced(body, sizes, straight)
        return _KERNELS[key]

    def _traced(self, body: Callable[..., Any], sizes: tuple[int, ...], lower: Callable[..., Any]) -> tuple[Any, Any]:
        """lower(inputs, outputs) of a function of states of these sizes, one after the other in a; and its shape."""
        symbolic = self.symbolic  # before tracing, so that the numbers of its symbols do not depend on who made it
        from ..compiler.kernels import placed

        with trace.tracing():
            unknown = trace.variables("x", sum(sizes))
            result = np.asarray(_run(body, symbolic, *np.split(unknown, np.cumsum(sizes)[:-1])))
            outputs = [trace.lifted(x) for x in result.ravel()]
            return lower(placed("a", unknown) | self.constant_symbols(), outputs), result.shape

    def _body(self, name: str) -> Callable[..., Any]:
        body: Callable[..., Any] | None = getattr(getattr(type(self), name, None), "__wrapped__", None)
        if body is None:
            raise TcbenchError(f"{name!r} is no derived function of the system {self.name!r}.")
        return body
