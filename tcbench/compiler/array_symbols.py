"""Arrays over spaces as formulas see them: numpy arrays without a length, whose entries have no numbers.

A formula in plain numpy runs once on them. An operation that does not treat all entries alike is refused at its line.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NoReturn

import numpy as np
from numpy.lib.array_utils import normalize_axis_index
from numpy.lib.mixins import NDArrayOperatorsMixin

from .array_tensors import TENSORS, matmul, parts_of, rearranged
from .arrays import Map, Path, collect, count, join, part, take, total
from .choices import KINKED, boxed
from .derivatives import maximum, minimum
from .kinks import kinked
from .symbols import TAKE, array, const, lifted
from .tables import alone_or_all
from .trace_errors import refused

SAME = "A formula does the same with all of them: what differs from one to the next is a constant over them"

_OVER = {  # ufunc -> name of the total over all entries, ufunc of symbols
    np.add: ("add", np.add), np.maximum: ("max", np.frompyfunc(maximum, 2, 1)),
    np.minimum: ("min", np.frompyfunc(minimum, 2, 1)),
}  # fmt: skip


class ArraySymbol(NDArrayOperatorsMixin):
    """An array with one entry for each member of `space`; parts : the components of an entry, an object array."""

    __array_priority__ = 100.0

    def __init__(self, space: str, parts: Any) -> None:
        self.space, self.parts = space, boxed(parts)

    def __repr__(self) -> str:
        return f"<array over {self.space}s{', ' + str(self.parts.shape) + ' each' if self.parts.shape else ''}>"

    @property
    def ndim(self) -> int:
        return 1 + int(self.parts.ndim)

    def _no_length(self, *_: Any) -> NoReturn:
        raise refused(
            f"how many {self.space}s there are is not known while a formula is traced",
            f"Sums and means over them are x.sum() and x.mean(). {SAME}",
        )

    __len__ = __iter__ = _no_length
    shape = size = property(_no_length)

    def __array__(self, *_: Any, **__: Any) -> NoReturn:
        self._no_length()

    def __bool__(self) -> bool:
        raise refused("a branch on the value of a symbol (if, while, and, max, min, ==)")

    def __float__(self) -> float:
        raise refused("a symbol cannot become a float (a call into math, SciPy or numpy.linalg?)")

    def __getitem__(self, key: Any) -> Any:
        if isinstance(key, TableSymbol):
            return key.of(self)
        keys = key if isinstance(key, tuple) else (key,)
        if keys[0] is Ellipsis and sum(k is not None for k in keys[1:]) <= self.parts.ndim:
            return ArraySymbol(self.space, self.parts[keys])
        if isinstance(keys[0], slice) and keys[0] == slice(None):
            return ArraySymbol(self.space, self.parts[keys[1:]]) if keys[1:] else self
        raise refused(
            f"one or some of the {self.space}s are asked for by number",
            f"x[:, k] is a component of each, x[self.table] are those that a table names. {SAME}",
        )

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        if any(hasattr(x, "blocks") for x in inputs):
            return NotImplemented  # Blocks do it
        if ufunc is np.matmul and method == "__call__":
            return matmul(*inputs)
        if method == "reduce" and ufunc in _OVER and options.keys() <= {"axis", "keepdims"}:
            return self._over(ufunc, **{"axis": 0, **options})
        if method != "__call__" or options or ufunc.nout != 1:
            raise unknown_way(ufunc, method, options)
        ufunc = kinked(ufunc) if ufunc in KINKED else ufunc
        return ArraySymbol(space_of(inputs), ufunc(*map(parts_of, inputs)))

    def __array_function__(self, function: Any, types: Any, args: Any, kwargs: Any) -> Any:
        return call_function(function, args, kwargs)

    def _over(self, ufunc: Any, axis: Any, keepdims: bool = False) -> Any:
        op, of_symbols = _OVER[ufunc]
        axes = range(self.ndim) if axis is None else axis if isinstance(axis, tuple) else (axis,)
        inner, parts = sorted((_inner_axis(k, self.ndim) for k in axes), reverse=True), self.parts
        over_all = bool(inner) and inner[-1] < 0
        if keepdims and over_all:
            raise refused(f"a sum over all {self.space}s has no axis of them", "Leave keepdims to components")
        of_components = of_symbols if op == "add" else kinked(ufunc)
        for k in inner[: len(inner) - over_all]:
            parts = of_components.reduce(parts, axis=k, keepdims=keepdims)
        if not over_all:
            return ArraySymbol(self.space, parts)
        return array(total(op, lifted(x), self.space) for x in boxed(parts).ravel()).reshape(np.shape(parts))[()]

    def sum(self, axis: Any = None, keepdims: bool = False) -> Any:
        return self._over(np.add, axis, keepdims)

    def max(self, axis: Any = None, keepdims: bool = False) -> Any:
        return self._over(np.maximum, axis, keepdims)

    def min(self, axis: Any = None, keepdims: bool = False) -> Any:
        return self._over(np.minimum, axis, keepdims)

    def mean(self, axis: Any = None, keepdims: bool = False) -> Any:
        axes = range(self.ndim) if axis is None else axis if isinstance(axis, tuple) else (axis,)
        inner = [_inner_axis(k, self.ndim) for k in axes]
        numbers = int(np.prod([self.parts.shape[k] for k in inner if k >= 0]))
        return self.sum(axis, keepdims) / (numbers * (count(self.space) if -1 in inner else 1.0))

    def transpose(self, *axes: Any) -> Any:
        return rearranged(np.transpose, self, axes[0] if axes and isinstance(axes[0], tuple | list) else axes or None)

    def reshape(self, *shape: Any) -> Any:
        return rearranged(np.reshape, self, shape[0] if isinstance(shape[0], tuple | list) else shape)

    def __getattr__(self, name: str) -> Any:
        if name == "mT":
            return rearranged(np.matrix_transpose, self)
        of_numpy = getattr(np, name, None) if name in METHODS else None
        if of_numpy is None:
            raise AttributeError(f"{self!r} has no {name!r} (a formula is traced on symbols)")
        return lambda *args, **options: call_function(of_numpy, (self, *args), options)

    @property
    def T(self) -> Any:
        """The components, arrays over the space: x, y = q.T."""
        if self.parts.ndim > 1:
            raise refused("x.T of an array with several axes of components", "x.mT transposes the matrix of each")
        return Rows(ArraySymbol(self.space, x) for x in self.parts) if self.parts.ndim else self


def unknown_way(ufunc: Any, method: str, options: Iterable[str]) -> Exception:
    """The error for a call of a ufunc that is not supported."""
    if "out" in options:
        return refused("an array is changed in place (+=, out=)", "Write x = x + y")
    return refused(f"np.{ufunc.__name__} with {method} or {sorted(options)} is not known for arrays over a space")


class Rows(tuple[Any, ...]):
    """The value of `.T`: a tuple that refuses arithmetic, by which `2 * q.T` would repeat it."""

    def _no_arithmetic(self, _: Any) -> NoReturn:
        raise refused("arithmetic with x.T, the components one by one", "Name them: x, y = q.T")

    __add__ = __radd__ = __mul__ = __rmul__ = _no_arithmetic

    def __getitem__(self, key: Any) -> Any:
        rows = super().__getitem__(key)
        return Rows(rows) if isinstance(key, slice) else rows


def _inner_axis(axis: Any, ndim: int) -> int:
    """The number of an axis among the components of an array with `ndim` axes; -1 for the space, its first axis."""
    return int(normalize_axis_index(axis, ndim)) - 1


def space_of(inputs: Iterable[Any]) -> str:
    """The common space of the arrays among the operands; TraceError for several, and for shapes that do not fit."""
    inputs = list(inputs)
    arrays = [x for x in inputs if isinstance(x, ArraySymbol)]
    if len({x.space for x in arrays}) > 1:
        raise refused(f"an array over {arrays[0].space}s meets one over {arrays[-1].space}s", TAKE)
    if len({x.ndim for x in arrays}) > 1:
        raise refused("arrays with and without components meet", "Write x[:, None] for the one without")
    if any(np.ndim(x) >= arrays[0].ndim for x in inputs if not isinstance(x, ArraySymbol)):
        raise refused(
            f"an array over {arrays[0].space}s meets one that is none",
            f"Declare it as a constant over them: constants = {{'name': ({arrays[0].space!r},)}}",
        )
    return arrays[0].space


def _stack(arrays: Sequence[Any], axis: int = 0) -> Any:
    space = space_of(arrays)
    shape = next(x for x in arrays if isinstance(x, ArraySymbol)).parts.shape
    inner = _inner_axis(axis, len(shape) + 2)
    if inner < 0:
        raise refused("arrays over a space are stacked along their components", "Write axis=1 or axis=-1")
    full = [np.broadcast_to(x.parts if isinstance(x, ArraySymbol) else boxed(x), shape) for x in arrays]
    return ArraySymbol(space, np.stack(full, axis=inner))


def _column_stack(arrays: Sequence[Any]) -> Any:
    return _concatenate([x[:, None] if np.ndim(x) == 1 else x for x in arrays], axis=1)


def _concatenate(arrays: Sequence[Any], axis: int = 0) -> Any:
    inner = _inner_axis(axis, np.ndim(arrays[0]))
    if inner >= 0:
        return ArraySymbol(space_of(arrays), np.concatenate([x.parts for x in arrays], axis=inner))
    blocks: list[Any] = []
    for x in arrays:
        blocks += x.blocks if isinstance(x, Blocks) else [array(x) if isinstance(x, list | tuple) else x]
    return Blocks(blocks)


def _cross(a: Any, b: Any) -> Any:
    (x, y, z), (u, v, w) = a.T, b.T
    return _stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=1)


METHODS = ("swapaxes", "dot", "trace", "clip", "diagonal", "squeeze", "repeat", "take")  # of arrays, as functions
_FUNCTIONS: dict[Any, Callable[..., Any]] = {
    np.sum: ArraySymbol.sum, np.mean: ArraySymbol.mean, np.max: ArraySymbol.max, np.amax: ArraySymbol.max,
    np.min: ArraySymbol.min, np.amin: ArraySymbol.min,
    np.stack: _stack, np.column_stack: _column_stack, np.concatenate: _concatenate, np.cross: _cross,
    np.linalg.cross: lambda a, b: _cross(a, b), np.ndim: lambda x: x.ndim,
    np.zeros_like: lambda x: x * 0.0, np.ones_like: lambda x: x * 0.0 + 1.0, **TENSORS,
}  # fmt: skip


def call_function(function: Any, args: Any, kwargs: Any) -> Any:
    implementation = _FUNCTIONS.get(function)
    if implementation is None:
        names = sorted({f.__name__ for f in _FUNCTIONS})
        raise refused(f"np.{function.__name__} is not known for arrays over a space", f"Known are {', '.join(names)}")
    try:
        return implementation(*args, **kwargs)
    except (TypeError, ValueError, np.exceptions.AxisError) as error:
        raise refused(f"np.{function.__name__} is not called so for an array over a space ({error})", SAME) from error


# tables -------------------------------------------------------------------------------------------------------------


class TableSymbol:
    """A table as formulas see it: the members of `target` that each entry of `source` names. summed : numbers of the
    spaces of a target "a+b" that `sums` is over."""

    __array_ufunc__ = None

    def __init__(self, name: str, source: str, target: str, columns: Any, summed: tuple[int, ...] = (0,)) -> None:
        self.name, self.source, self.target, self.columns = name, source, target, np.asarray(columns)
        self.summed = summed

    def _of(self, columns: Any) -> TableSymbol:
        return TableSymbol(self.name, self.source, self.target, columns, self.summed)

    def __getitem__(self, key: Any) -> TableSymbol:
        if isinstance(key, tuple) and key and isinstance(key[0], slice) and key[0] == slice(None):
            return self._of(self.columns[key[1:]])
        raise refused(f"a row of the table {self.name!r} is asked for", f"self.{self.name}[:, k] is a column. {SAME}")

    @property
    def T(self) -> Rows:
        """Its columns: first, second = self.ends.T."""
        return Rows(map(self._of, self.columns.T))

    def _no_numbers(self, *_: Any, **__: Any) -> NoReturn:
        raise refused(f"the numbers of the table {self.name!r}, or how many, are asked for", SAME)

    __len__ = __iter__ = __array__ = __eq__ = __ne__ = _no_numbers
    __hash__ = None  # type: ignore[assignment]

    def _paths(self) -> list[tuple[tuple[int, ...], Path]]:
        return [(i, (Map(self.name, int(c), self.source, self.target),)) for i, c in np.ndenumerate(self.columns)]

    def of(self, x: Any) -> ArraySymbol:
        """x[table], over the source."""
        if x.space != self.target:
            raise refused(f"the table {self.name!r} names {self.target}s, and the array is over {x.space}s")
        taken = np.empty((*self.columns.shape, *x.parts.shape), dtype=object)
        for i, path in self._paths():
            taken[i] = np.frompyfunc(lambda y, p=path: take(lifted(y), p), 1, 1)(x.parts)
        return ArraySymbol(self.source, taken)

    def sums(self, x: Any) -> Any:
        """For each member of the target the sum of x over the table's entries that name it: the transpose of x[table].

        For a target "a+b" an array over each space that has variables: fixed places get no sums.
        """
        if isinstance(x, ArraySymbol) and x.space != self.source:
            raise refused(f"sums() of the table {self.name!r} are of an array over {self.source}s, not {x.space}s")
        parts = boxed(parts_of(x))
        if not isinstance(x, ArraySymbol):  # a number, or one for each column
            parts = np.broadcast_to(parts, self.columns.shape)
        inner = parts.shape[self.columns.ndim :]
        if parts.shape[: self.columns.ndim] != self.columns.shape:
            raise refused(
                f"sums() of the table {self.name!r} needs components {self.columns.shape} for each of {self.source}, "
                f"not {parts.shape}",
                f"np.stack([a, b], axis=1) makes them; self.{self.name}[:, k].sums(x) is one column's",
            )
        sums_of_parts = np.empty(inner, dtype=object)
        for k in np.ndindex(*inner):
            sums_of_parts[k] = collect([(lifted(parts[(*i, *k)]), path) for i, path in self._paths()])
        spaces, own = self.target.split("+"), np.frompyfunc(lambda y, k: part(y, k, self.target), 2, 1)
        return alone_or_all([ArraySymbol(spaces[k], own(sums_of_parts, k)) for k in self.summed])


class Blocks(NDArrayOperatorsMixin):
    """Arrays over several spaces, and numbers, one after the other; a state where they have names.

    names : name -> number of the block. Arithmetic is block by block.
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
            names = ", ".join(self.__dict__.get("names", {})) or "none"
            raise AttributeError(f"a state has no variable {name!r}; its variables: {names}") from None

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        if method != "__call__" or options:
            raise unknown_way(ufunc, method, options)
        if ufunc is np.matmul:
            a, b = inputs
            return sum(((x * y).sum() if np.ndim(x) else x * y for x, y in zip(a.blocks, b.blocks, strict=True)),
                       const(0.0))  # fmt: skip
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
        return sum((np.sum(x) for x in self.blocks), const(0.0))

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
    """Several arrays as one over the joined space "a+b"."""
    if not all(isinstance(x, ArraySymbol) for x in arrays) or len({x.parts.shape for x in arrays}) > 1:
        raise refused("arrays over spaces are joined with others of as many components each")
    space = "+".join(x.space for x in arrays)
    whole = np.empty(arrays[0].parts.shape, dtype=object)
    for k in np.ndindex(*whole.shape):
        whole[k] = join([lifted(x.parts[k]) for x in arrays], space)
    return ArraySymbol(space, whole)
