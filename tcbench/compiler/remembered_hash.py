"""`content_hash` at the price of a look: a hash is kept for as long as nothing that it was made of moves.

What hashing read is looked at again: the same objects in the same places (cells, globals, defaults, attributes, items),
and arrays with the same bytes. Only what is known through and through is watched in this way: functions, classes,
modules, dataclasses of libraries, tuples, lists, dicts, numbers, text, arrays. What sees anything else is hashed anew.
"""

from __future__ import annotations

import dataclasses
import functools
import re
import types
from collections.abc import Callable, Iterable
from operator import is_
from typing import Any

import numpy as np

from .code_hash import NOT_CONTENT, READS_BY_NAME, code_of, content_hash, home_of_class, installed, is_of_python

MOST_KEPT = 1000
MOST_LOOKS = 100  # for one object: of more of them hashing is as quick
MOST_PARTS = 1000  # of a list or dict
MOST_BYTES = 100_000  # of an array
ATOMS = frozenset({
    type(None), bool, int, float, complex, str, bytes, type(Ellipsis), type(NotImplemented), types.CodeType, range,
})  # fmt: skip
FIXED = np.number | np.bool_ | np.ufunc | np.dtype | re.Pattern  # no two of these that differ are one object
ABSENT = object()
Look = Callable[[Any], tuple[Any, ...]]


class UnwatchedError(Exception):
    """Something of a kind that is not known through and through."""


class _Kept:
    """An object, its hash, and what was seen when it was hashed."""

    def __init__(self, item: Any) -> None:
        self.item, self.watch = item, _Watch()
        try:
            self.watch.add(item)
            self.watched = True
        except Exception:  # an UnwatchedError, a cell that is not filled yet, an object that cannot be looked at
            self.watched = False
        self.hash = content_hash(item)

    def holds(self) -> bool:
        try:
            for look, item, seen in self.watch.looks:
                now = look(item)
                if len(now) != len(seen) or not all(map(is_, now, seen)):
                    return False
        except Exception:  # a cell that was emptied, an attribute that is gone
            return False
        return all(
            array.shape == shape and array.dtype == kind and array.tobytes() == content
            for array, shape, kind, content in self.watch.arrays
        )


_KEPT: dict[int, _Kept] = {}


def remembered_hash(item: Any) -> str | None:
    """`content_hash` of one object: some microseconds where nothing has changed since the last call."""
    kept = _KEPT.get(id(item))
    if kept is not None and kept.item is item:
        if not kept.watched:
            return content_hash(item)
        if kept.holds():
            return kept.hash
    if len(_KEPT) >= MOST_KEPT:
        _KEPT.clear()
    kept = _KEPT[id(item)] = _Kept(item)
    return kept.hash


class _Watch:
    """All that hashing an object reads, as looks that tell whether it is still so."""

    def __init__(self) -> None:
        self.looks: list[tuple[Look, Any, tuple[Any, ...]]] = []  # how, at what, and what was seen
        self.arrays: list[tuple[Any, ...]] = []  # with shape, kind and bytes
        self.known: dict[Any, Any] = {}  # alive, for their ids to be theirs

    def add(self, item: Any) -> None:
        kind = type(item)
        if kind in ATOMS:
            return
        if kind is tuple:
            for part in item:
                self.add(part)
        elif id(item) not in self.known:
            self.known[id(item)] = item
            self._object(item, kind)

    def look(self, how: Look, item: Any) -> tuple[Any, ...]:
        seen = how(item)
        if len(self.looks) >= MOST_LOOKS or len(seen) > MOST_PARTS:
            raise UnwatchedError
        self.looks.append((how, item, seen))
        return seen

    def _object(self, item: Any, kind: type) -> None:
        if kind is types.FunctionType:
            self._function(item)
        elif isinstance(item, type):
            self._class(item)
        elif kind is types.ModuleType:
            self._module(item, frozenset())
        elif kind is np.ndarray and not item.dtype.hasobject and item.nbytes <= MOST_BYTES:
            self.arrays.append((item, item.shape, item.dtype, item.tobytes()))
        elif kind is list:
            self._each(self.look(tuple, item))
        elif kind is dict:
            self._each(self.look(_items, item))
        elif kind in READ:
            self._each(self.look(READ[kind], item))
        elif dataclasses.is_dataclass(item) and home_of_class(kind) is not None:
            self._each(self.look(_fields, item))
        elif not _is_fixed(item):
            raise UnwatchedError

    def _each(self, parts: Iterable[Any]) -> None:
        for part in parts:
            self.add(part)

    def _function(self, function: types.FunctionType) -> None:
        self.look(_of_function, function)
        self._each((function.__defaults__, function.__kwdefaults__))
        self._each(value for name, value in function.__dict__.items() if name not in NOT_CONTENT)
        for cell in function.__closure__ or ():
            self._each(self.look(_of_cell, cell))
        known = function.__globals__
        if installed(str(known.get("__name__", "")), known.get("__file__")) is None:
            code = code_of(function.__code__)
            if code.imports or READS_BY_NAME & set(code.names):
                raise UnwatchedError
            self._names(known, code.names, code.attributes)

    def _names(self, known: dict[str, Any], names: Iterable[str], attributes: frozenset[str]) -> None:
        """What these names stand for; modules as code that reads these attributes sees them."""
        for value in self.look(_Names(names), known):
            if isinstance(value, types.ModuleType):
                self._module(value, attributes)
            elif value is not ABSENT:
                self.add(value)

    def _module(self, module: types.ModuleType, attributes: frozenset[str]) -> None:
        if installed(module.__name__, getattr(module, "__file__", None)) is not None:
            return
        if not attributes:
            raise UnwatchedError
        if (id(module), attributes) not in self.known:
            self.known[id(module), attributes] = module
            self._names(vars(module), attributes, attributes)

    def _class(self, item: type) -> None:
        if home_of_class(item) is not None:
            return
        self.look(_of_class, item)
        self._each((*item.__bases__, type(item)))
        descriptors = (types.GetSetDescriptorType, types.MemberDescriptorType)
        self._each(v for n, v in vars(item).items() if n not in NOT_CONTENT and not isinstance(v, descriptors))


class _Names:
    """A look at what some names stand for."""

    def __init__(self, names: Iterable[str]) -> None:
        self.names = tuple(names)

    def __call__(self, known: dict[str, Any]) -> tuple[Any, ...]:
        return tuple([known.get(name, ABSENT) for name in self.names])


def _is_fixed(item: Any) -> bool:
    """Never another while it is the same object: not so what np.frompyfunc makes, and numbers of a user's own class."""
    return isinstance(item, FIXED) and not is_of_python(item) and home_of_class(type(item)) is not None


def _of_function(f: types.FunctionType) -> tuple[Any, ...]:
    return (f.__code__, f.__defaults__, f.__kwdefaults__, *f.__dict__, *f.__dict__.values())


def _of_cell(cell: types.CellType) -> tuple[Any, ...]:
    return (cell.cell_contents,)


def _of_class(item: type) -> tuple[Any, ...]:
    content = vars(item)
    return (item.__bases__, *content, *content.values())


def _items(item: dict[Any, Any]) -> tuple[Any, ...]:
    return (*item, *item.values())


def _fields(item: Any) -> tuple[Any, ...]:
    return tuple([getattr(item, f.name) for f in dataclasses.fields(item) if f.compare])


# kinds of objects that are hashed by what a look at them gives
READ: dict[type, Look] = {
    functools.partial: lambda x: (x.func, x.args, x.keywords),
    types.MethodType: lambda x: (x.__func__, x.__self__),
    types.BuiltinFunctionType: lambda x: () if isinstance(x.__self__, types.ModuleType) else (x.__self__,),
    staticmethod: lambda x: (x.__func__,),
    classmethod: lambda x: (x.__func__,),
    property: lambda x: (x.fget, x.fset, x.fdel),
    functools.cached_property: lambda x: (x.func,),
    type(functools.lru_cache(len)): lambda x: (x.__wrapped__,),
}
