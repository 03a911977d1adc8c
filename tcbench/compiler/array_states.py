"""States of arrays over spaces, and what does the same for arrays of symbols entry by entry and over spaces."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NoReturn

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from . import symbols
from .array_symbols import SAME, ArraySymbol, TableSymbol, boxed, call_function, parts_of, space_of, unknown_way
from .arrays import join
from .sentences import refused
from .symbols import TAKE, array, lifted


class Blocks(NDArrayOperatorsMixin):
    """Arrays over several spaces, and numbers, one after the other; a state where they have names.

    names: name -> which block. Arithmetic does the same with all of them.
    """

    __array_priority__ = 200.0

    def __init__(self, blocks: Sequence[Any], names: Mapping[str, int] | None = None) -> None:
        self.__dict__.update(blocks=list(blocks), names=names or {})

    def __repr__(self) -> str:
        return f"<{self.names or 'blocks'}: {self.blocks}>"

    def __getattr__(self, name: str) -> Any:
        try:
            return self.__dict__["blocks"][self.__dict__["names"][name]]
        except KeyError:
            known = ", ".join(self.__dict__.get("names", {})) or "none"
            raise AttributeError(f"a state has no variable {name!r}; its variables: {known}") from None

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        if method != "__call__" or options:
            raise unknown_way(ufunc, method, options)
        if ufunc is np.matmul:
            a, b = inputs
            return sum(((x * y).sum() if np.ndim(x) else x * y for x, y in zip(a.blocks, b.blocks, strict=True)),
                       symbols.const(0.0))  # fmt: skip
        if any(np.ndim(x) for x in inputs if not isinstance(x, Blocks)):
            raise refused("a whole state meets an array", f"Name its blocks: z.q. {SAME}")
        sides = [x.blocks if isinstance(x, Blocks) else [x] * len(self.blocks) for x in inputs]
        names = next((x.names for x in inputs if isinstance(x, Blocks) and x.names), None)
        return Blocks([ufunc(*pair) for pair in zip(*sides, strict=True)], names)

    def __array_function__(self, function: Any, types: Any, args: Any, kwargs: Any) -> Any:
        if function.__name__ in ("concatenate", "ndim"):
            return call_function(function, args, kwargs)
        raise refused(f"np.{function.__name__} is not known for a whole state", "Name its blocks: z.q")

    @property
    def ndim(self) -> int:
        return 1

    def sum(self, axis: int | None = None) -> Any:
        return sum((np.sum(x) for x in self.blocks), symbols.const(0.0))

    def __getitem__(self, key: Any) -> Any:
        if not isinstance(key, TableSymbol):
            raise refused("a part of a whole state is asked for by number", "Name its blocks: z.q")
        return key.of(joined(self.blocks))

    def _no_length(self, *_: Any) -> NoReturn:
        raise refused("a state has no length while a formula is traced", f"Name its blocks: z.q. {SAME}")

    __len__ = __iter__ = _no_length
    shape = size = property(_no_length)

    def __array__(self, *_: Any, **__: Any) -> NoReturn:
        self._no_length()


def joined(arrays: Sequence[Any]) -> ArraySymbol:
    """Several arrays as one, over "a+b"."""
    if not all(isinstance(x, ArraySymbol) for x in arrays) or len({x.parts.shape for x in arrays}) > 1:
        raise refused("arrays over spaces are joined with others of as many components each")
    space = "+".join(x.space for x in arrays)
    found = np.empty(arrays[0].parts.shape, dtype=object)
    for k in np.ndindex(*found.shape):
        found[k] = join([lifted(x.parts[k]) for x in arrays], space)
    return ArraySymbol(space, found)


# both ways ----------------------------------------------------------------------------------------------------------


def is_array(*values: Any) -> bool:
    """Is any of them an array or a state over spaces?"""
    return any(isinstance(x, ArraySymbol | Blocks) for x in values)


def each(function: Callable[..., Any], *arrays: Any, count: int = 1) -> Any:
    """function(x, y, ...) of each entry, an array as these are; count: so many, of a function of several values."""
    if not is_array(*arrays):
        found = [function(*entry) for entry in zip(*arrays, strict=True)]
        return array(found) if count == 1 else tuple(array(side) for side in zip(*found, strict=True))
    if any(isinstance(x, Blocks) for x in arrays):
        (first, *others) = arrays
        sides = zip(first.blocks, *(x.blocks for x in others), strict=True)
        return Blocks([each(function, *side) if np.ndim(side[0]) else function(*side) for side in sides], first.names)
    parts = np.broadcast_arrays(*(boxed(parts_of(x)) for x in arrays))
    found = np.frompyfunc(function, len(arrays), count)(*parts)
    space = space_of(x for x in arrays if isinstance(x, ArraySymbol))
    return ArraySymbol(space, found) if count == 1 else tuple(ArraySymbol(space, x) for x in found)


def side_by_side(nodes: Sequence[Any]) -> Any:
    """Nodes as one array; those of arrays as blocks."""
    if not any(x.space for x in nodes):
        return array(nodes)
    return Blocks([ArraySymbol(x.space, x) if x.space else x for x in nodes])


def entries(*arrays: Any) -> list[Any]:
    """All nodes of arrays (states, numbers), one after the other."""
    found: list[Any] = []
    for x in arrays:
        if isinstance(x, Blocks):
            found += entries(*x.blocks)
        else:
            found += list(np.ravel(x.parts if isinstance(x, ArraySymbol) else np.asarray(x, dtype=object)))
    return found


def refilled(like: Any, values: Sequence[Any]) -> Any:
    """Arrays (a state, a number) with these nodes in the place of their own."""
    if isinstance(like, Blocks):
        found, at = [], 0
        for block in like.blocks:
            end = at + len(entries(block))
            found.append(refilled(block, values[at:end]))
            at = end
        return Blocks(found, like.names)
    if isinstance(like, ArraySymbol):
        return ArraySymbol(like.space, array(values).reshape(like.parts.shape))
    shape = np.shape(like)
    return array(values).reshape(shape) if shape else values[0]


def fitted(value: Any, like: Any, name: str) -> Any:
    """A value as the array, or number, that is needed there."""
    if isinstance(value, ArraySymbol) and (not isinstance(like, ArraySymbol) or value.space != like.space):
        wanted = f"over {like.space}s" if isinstance(like, ArraySymbol) else "of numbers"
        raise refused(f"{name} is an array {wanted}, and gets one over {value.space}s", TAKE)
    here = value.parts if isinstance(value, ArraySymbol) else np.asarray(value, dtype=object)
    shape = like.parts.shape if isinstance(like, ArraySymbol) else np.shape(like)
    if here.shape != shape:
        raise refused(f"{name} has components {shape}, and gets {here.shape}", "Give each component its rate")
    return refilled(like, list(map(lifted, here.ravel())))
