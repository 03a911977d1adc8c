"""`State`, a vector with names, and the hash that shows whether formulas were edited."""

from __future__ import annotations

import uuid
from collections.abc import Mapping, Sequence
from functools import reduce
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..compiler import derivatives as trace
from ..compiler.array_states import Blocks, is_array
from ..compiler.array_tensors import SymbolArray
from ..compiler.arrays import total
from ..compiler.derivatives import Symbol
from ..compiler.formula_hash import formula_hash

if TYPE_CHECKING:
    from .system import System

Array = NDArray[Any]
LETTERS = "abcdefghijklmnopqrstuvwxyz"  # names of elements; more of them get no columns of their own
Layout = Mapping[str, tuple[int, int, tuple[int, ...]]]  # name of a variable -> first, last + 1, shape


def fixed(array: Array) -> Array:
    """The array itself, made read-only, for several holders."""
    array.setflags(write=False)
    return array


def real(value: Any) -> Array:
    """A value as a new array of floats; TypeError for complex, masked and dated values, which would lose a part."""
    if np.ma.is_masked(value) or np.asarray(value).dtype.kind in "cmMV":
        raise TypeError
    return np.array(value, dtype=float)


def in_one_row(values: Any) -> Any:
    """Numbers and arrays in one vector, one after the other."""
    parts = values if isinstance(values, list | tuple) else [values]
    if is_array(*parts):
        return Blocks(parts)
    return trace.array(x for part in parts for x in np.ravel(np.asarray(part, dtype=object)))


def shape_of(value: Any) -> tuple[int, ...] | None:
    """The shape of a value; None where its rows have several lengths."""
    try:
        return tuple(np.shape(value))
    except ValueError:
        return None


class State(np.ndarray):
    """Array, last axis all variables of a system, each also by its name: z.q, z.p, z.s of springs, z.m of a body."""

    layout: Layout

    def __new__(cls, values: Any, layout: Layout) -> State:
        state = np.asarray(values).view(cls)
        state.layout = layout
        return state

    def __array_finalize__(self, source: Any) -> None:
        self.layout = getattr(source, "layout", {})

    def __array_wrap__(self, array: Any, context: Any = None, return_scalar: bool = False) -> Any:
        """A result without axes, such as the largest component, is a number."""
        return array[()] if array.ndim == 0 else super().__array_wrap__(array, context, return_scalar)

    def __getattr__(self, name: str) -> Any:
        try:
            first, end, shape = self.__dict__["layout"][name]
        except KeyError:
            names = ", ".join(self.__dict__.get("layout", {})) or "none"
            raise AttributeError(f"a state has no variable {name!r}; its variables: {names}") from None
        block = self.view(SymbolArray if self.dtype == object else np.ndarray)[..., first:end]
        if shape == ():
            return block[..., 0][()]
        return block if len(shape) == 1 else block.reshape(*block.shape[:-1], *shape)


def laid_out(variables: Mapping[str, tuple[int, ...]]) -> Layout:
    """The place of each variable in z."""
    layout, first = {}, 0
    for name, shape in variables.items():
        end = first + int(np.prod(shape))
        layout[name], first = (first, end, tuple(shape)), end
    return layout


def blocks_of(system: System, z: Any) -> list[Any]:
    """The variables of a state z of symbols or of arrays, in declared order."""
    return z.blocks if is_array(z) else [np.asarray(z)[slice(*system.layout[name][:2])] for name in system.variables]


def products(a: Sequence[Any], b: Sequence[Any]) -> list[Symbol]:
    """The products a_i b_i, of numbers and of arrays over spaces."""
    return [trace.lifted(x) * trace.lifted(y) for x, y in zip(a, b, strict=True)]


def summed(values: Sequence[Symbol]) -> Symbol:
    """The sum of numbers and of arrays over spaces: one number."""
    return reduce(trace.add, (total("add", x, x.space) if x.space else x for x in values), trace.const(0.0))


def formulas_hash(kind: type[System]) -> str:
    """Hash of what a class of systems computes now, globals that its formulas read included.

    Formulas without a hash (see formula_hash) get a new one at each call: nothing traced is then used twice.
    """
    return formula_hash(kind) or uuid.uuid4().hex
