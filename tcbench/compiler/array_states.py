"""States of arrays over spaces, and functions that treat symbols one by one and arrays over spaces alike."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from .array_symbols import ArraySymbol, space_of
from .array_symbols import Blocks as Blocks
from .array_tensors import parts_of
from .choices import boxed
from .symbols import TAKE, array, lifted
from .trace_errors import refused

# both ways ----------------------------------------------------------------------------------------------------------


def is_array(*values: Any) -> bool:
    """Is any of them an array or a state over spaces?"""
    return any(isinstance(x, ArraySymbol | Blocks) for x in values)


def each(function: Callable[..., Any], *arrays: Any, count: int = 1) -> Any:
    """function(x, y, ...) of each entry, an array like x; a tuple of `count` arrays of a function of several values."""
    if not is_array(*arrays):
        values = [function(*entry) for entry in zip(*arrays, strict=True)]
        return array(values) if count == 1 else tuple(array(side) for side in zip(*values, strict=True))
    if any(isinstance(x, Blocks) for x in arrays):
        (first, *others) = arrays
        sides = zip(first.blocks, *(x.blocks for x in others), strict=True)
        return Blocks([each(function, *side) if np.ndim(side[0]) else function(*side) for side in sides], first.names)
    parts = np.broadcast_arrays(*(boxed(parts_of(x)) for x in arrays))
    values = np.frompyfunc(function, len(arrays), count)(*parts)
    space = space_of(x for x in arrays if isinstance(x, ArraySymbol))
    return ArraySymbol(space, values) if count == 1 else tuple(ArraySymbol(space, x) for x in values)


def side_by_side(nodes: Sequence[Any]) -> Any:
    """Nodes as one array; as blocks where some are over spaces."""
    if not any(x.space for x in nodes):
        return array(nodes)
    return Blocks([ArraySymbol(x.space, x) if x.space else x for x in nodes])


def entries(*arrays: Any) -> list[Any]:
    """All nodes of arrays, states and numbers, one after the other."""
    numbers: list[Any] = []
    for x in arrays:
        if isinstance(x, Blocks):
            numbers += entries(*x.blocks)
        else:
            numbers += list(np.ravel(x.parts if isinstance(x, ArraySymbol) else np.asarray(x, dtype=object)))
    return numbers


def refilled(like: Any, values: Sequence[Any]) -> Any:
    """An array, state or number like this one, made of other nodes."""
    if isinstance(like, Blocks):
        blocks, at = [], 0
        for block in like.blocks:
            end = at + len(entries(block))
            blocks.append(refilled(block, values[at:end]))
            at = end
        return Blocks(blocks, like.names)
    if isinstance(like, ArraySymbol):
        return ArraySymbol(like.space, array(values).reshape(like.parts.shape))
    shape = np.shape(like)
    return array(values).reshape(shape) if shape else values[0]


def fitted(value: Any, like: Any, name: str) -> Any:
    """A value as an array or number like this one; TraceError for another space or number of components."""
    if isinstance(value, ArraySymbol) and (not isinstance(like, ArraySymbol) or value.space != like.space):
        wanted = f"over {like.space}s" if isinstance(like, ArraySymbol) else "of numbers"
        raise refused(f"{name} is an array {wanted}, and gets one over {value.space}s", TAKE)
    here = value.parts if isinstance(value, ArraySymbol) else np.asarray(value, dtype=object)
    shape = like.parts.shape if isinstance(like, ArraySymbol) else np.shape(like)
    if here.shape != shape:
        raise refused(f"{name} has components {shape}, and gets {here.shape}", "Give each component its rate")
    return refilled(like, list(map(lifted, here.ravel())))
