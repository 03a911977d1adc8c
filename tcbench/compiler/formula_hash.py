"""`content_hash` of what sees nothing else: two formulas with one `formula_hash` give the same numbers.

What is traced once and used again stands on this. A formula that may read more than the hash covers (a file, the
environment, the clock, a generator of chance, names that it computes) has none, and is traced each time.

A run asks for the hash of its formulas each time, so that an edit of a closure or a global is noticed; what a hash has
seen is kept with it, and looked at again in its place: that takes a tenth of the time.
"""

from __future__ import annotations

import functools
import re
import types
from collections.abc import Callable, Iterable
from operator import is_
from typing import Any

import numpy as np

from .code_hash import Hasher, HashlessError, code_of, hashed

_Seen = tuple[Callable[[Any], tuple[Any, ...]], Any, tuple[Any, ...]]  # how to look at something, it, what it showed

# modules whose functions see nothing but their arguments; of numpy, not those that read files or draw numbers
PURE = frozenset({
    "tcbench", "tcbench_plugins", "numpy", "scipy", "builtins", "math", "cmath", "_operator", "operator", "functools",
    "_functools", "itertools", "collections", "_collections", "_collections_abc", "numbers", "fractions", "dataclasses",
    "enum", "typing", "types", "abc", "__future__", "copy", "contextlib",
})  # fmt: skip
READERS = frozenset({
    "load", "loadtxt", "genfromtxt", "fromfile", "fromregex", "memmap", "DataSource", "random", "default_rng", "open",
    "attrgetter", "methodcaller", "import_module", "__import__",
})  # fmt: skip


FIXED = (  # what cannot be changed, but for what it is made of
    types.CodeType, types.BuiltinFunctionType, types.MethodWrapperType, types.MethodType, types.CellType,
    types.ModuleType, staticmethod, classmethod, property, np.ufunc, np.dtype, re.Pattern,
)  # fmt: skip
MOST_BYTES = 4096  # of an array that is compared rather than hashed
MOST_KNOWN = 1000  # objects whose hashes are kept
_MISSING = object()
_KNOWN: dict[tuple[int, ...], tuple[tuple[Any, ...], list[_Seen], str]] = {}  # they live: an id is of one object only


def formula_hash(*objects: Any) -> str | None:
    """Sha256, hexadecimal, of what these objects are and compute; None where they may read more than that."""
    key = tuple(map(id, objects))
    known = _KNOWN.get(key)
    if known is not None and _as_before(known[1]):
        return known[2]
    hasher = _Pure()
    found = hashed(hasher, objects)
    if found is not None and hasher.seen is not None:
        if len(_KNOWN) >= MOST_KNOWN:
            _KNOWN.clear()
        _KNOWN[key] = objects, hasher.seen, found
    return found


def _as_before(seen: list[_Seen]) -> bool:
    for look, item, before in seen:
        now = look(item)
        if len(now) != len(before) or not all(map(is_, now, before)):
            return False
    return True


def _of_function(item: types.FunctionType) -> tuple[Any, ...]:
    return item.__code__, item.__defaults__, item.__kwdefaults__, *vars(item).values()


def _of_mapping(item: Any) -> tuple[Any, ...]:
    return *item.keys(), *item.values()


def _of_class(item: type) -> tuple[Any, ...]:
    return item.__bases__, *vars(item).keys(), *vars(item).values()


def _of_cell(item: types.CellType) -> tuple[Any, ...]:
    try:
        return (item.cell_contents,)
    except ValueError:  # not filled yet
        return ()


def _of_names(item: tuple[dict[str, Any], tuple[str, ...]]) -> tuple[Any, ...]:
    content, names = item
    return tuple([content.get(name, _MISSING) for name in names])


def _of_array(item: tuple[Any, tuple[Any, ...]]) -> tuple[bool]:
    array, before = item
    return ((array.dtype, array.shape, array.tobytes()) == before,)


class _Pure(Hasher):
    """Refuses what may read more than the hash covers; `seen` is what may change meanwhile, None: it cannot be told."""

    def __init__(self) -> None:
        super().__init__()
        self.seen: list[_Seen] | None = []

    def look(self, look: Callable[[Any], tuple[Any, ...]], item: Any) -> None:
        if self.seen is not None:
            self.seen.append((look, item, look(item)))

    def home(self, name: str, file: str | None) -> str | None:
        found = super().home(name, file)
        if found is not None and name.partition(".")[0] not in PURE:
            raise HashlessError(f"something of {name}")
        return found

    def _object(self, item: Any) -> None:
        if isinstance(item, types.BuiltinFunctionType) and item.__module__:
            self.home(item.__module__, None)
        kind = type(item)
        if kind is types.FunctionType:
            self.look(_of_function, item)
            if item.__kwdefaults__:
                self.look(_of_mapping, item.__kwdefaults__)
        elif isinstance(item, type):
            if self.home_of_class(item) is None:
                self.look(_of_class, item)
        elif kind is dict or kind is types.MappingProxyType:
            self.look(_of_mapping, item)
        elif kind is list:
            self.look(tuple, item)
        elif kind is functools.partial:
            self.look(_of_mapping, item.keywords)
        elif kind is functools.cached_property:
            self.look(_of_mapping, vars(item))
        elif isinstance(item, np.ndarray | np.generic) and not item.dtype.hasobject and item.nbytes <= MOST_BYTES:
            self.look(_of_array, (item, (item.dtype, item.shape, item.tobytes())))
        elif not (isinstance(item, FIXED) or (kind is frozenset and {type(part) for part in item} <= {str, int})):
            self.seen = None
        super()._object(item)

    def _function(self, function: types.FunctionType) -> None:
        if self.home(str(function.__globals__.get("__name__", "")), function.__globals__.get("__file__")) is None:
            code = code_of(function.__code__)
            if READERS & (code.attributes | set(code.names)):
                raise HashlessError("something that reads")
            if code.imports:
                self.seen = None
            self.look(_of_names, (function.__globals__, code.names))
        elif function.__name__ in READERS:
            raise HashlessError(function.__name__)
        super()._function(function)

    def _cell(self, cell: types.CellType) -> None:
        self.look(_of_cell, cell)
        super()._cell(cell)

    def _module(self, module: types.ModuleType, attributes: Iterable[str]) -> None:
        own = self.home(module.__name__, getattr(module, "__file__", None)) is None
        names = tuple(name for name in attributes if own or name in vars(module))
        if own and ("*" in names or not names):
            self.seen = None
        self.look(_of_names, (vars(module), names))
        super()._module(module, attributes)
