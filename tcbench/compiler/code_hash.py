"""A hash of what a function computes: its code, and the values that the code can see.

Two functions with one hash give the same numbers as long as what they read from files, the environment, the clock and
the like is the same (`formula_hash` asks no such thing). The hash covers the bytecode (names of local variables,
line numbers and files left out), defaults, closure, and the global names that the code reads, in turn, down to numbers,
arrays and text. A class counts with its methods, attributes and bases, an instance with its class and state. Code of
installed packages and of Python itself is told by name and version; that of `tcbench_plugins` by the hash of its files.

What has no such description (an open file, a lock, a generator, `eval`) has no hash, and nothing that was computed
with it may be used again.
"""

from __future__ import annotations

import builtins
import dataclasses
import dis
import enum
import functools
import hashlib
import importlib.metadata
import importlib.util
import itertools
import re
import sys
import types
import weakref
from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from .installed import installed

MOST_OBJECTS = 100_000  # that a formula may see: beyond, hashing would take longer than computing
HASHLESS = frozenset({"eval", "exec", "globals", "locals", "vars", "compile", "open", "input"})  # code out of sight
READS_BY_NAME = frozenset({"getattr", "hasattr", "import_module", "__import__"})  # of a module, then, any name
# of a class or function: what is made when it is first needed, or says where it was written
NOT_CONTENT = frozenset({
    "__dict__", "__weakref__", "__doc__", "__module__", "__firstlineno__", "__static_attributes__", "__annotations__",
    "__annotate__", "__annotate_func__", "__annotations_cache__", "_abc_impl", "__abstractmethods__", "__wrapped__",
    "__qualname__", "__type_params__", "__slotnames__",
})  # fmt: skip


HEAP_TYPE = 1 << 9  # flag of classes that a class statement made


class HashlessError(Exception):
    """Something that a function sees cannot be described by a hash."""


def content_hash(*objects: Any) -> str | None:
    """Sha256, hexadecimal, of what these objects are and compute; None where something in them has no hash."""
    return hashed(Hasher(), objects)


def hashed(hasher: Hasher, objects: tuple[Any, ...]) -> str | None:
    """What a hasher makes of these objects; None where it refuses one, or one of them fails."""
    try:
        for item in objects:
            hasher.add(item)
    except Exception:  # of a user's __reduce__, too; RecursionError is one as well
        return None
    return hasher.digest.hexdigest()


@dataclasses.dataclass(frozen=True)
class _Code:
    """What of a code object never changes: a hash, the global names that it reads, the attributes, the imports."""

    digest: bytes
    names: tuple[str, ...]
    attributes: frozenset[str]
    imports: tuple[tuple[str, int], ...]


def constants_of(code: types.CodeType) -> list[Any]:
    """Its constants, those of a class that are in the order of a set (`__static_attributes__`, Python 3.13) sorted."""
    found = list(code.co_consts)
    if "__static_attributes__" in code.co_names:
        for load, store in itertools.pairwise(dis.get_instructions(code)):
            if store.argval == "__static_attributes__" and load.opname == "LOAD_CONST" and load.arg is not None:
                found[load.arg] = tuple(sorted(load.argval))
    return found


@lru_cache(maxsize=10_000)
def code_of(code: types.CodeType) -> _Code:
    """What of a code object never changes."""
    hasher = Hasher()
    count = code.co_argcount + code.co_kwonlyargcount
    hasher.add((
        code.co_code, code.co_exceptiontable, code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount,
        code.co_flags, code.co_varnames[:count], code.co_names, code.co_freevars, code.co_cellvars, len(code.co_consts),
    ))  # fmt: skip
    names: dict[str, None] = {}
    attributes: set[str] = set()
    imports: dict[tuple[str, int], None] = {}
    for constant in constants_of(code):
        if isinstance(constant, types.CodeType):
            inner = code_of(constant)
            hasher.digest.update(inner.digest)
            names |= dict.fromkeys(inner.names)
            attributes |= inner.attributes
            imports |= dict.fromkeys(inner.imports)
        else:
            hasher.add(constant)
    loaded: list[Any] = [0, 0]
    for step in dis.get_instructions(code):
        if step.opname == "IMPORT_NAME":  # after the level (of a relative import) and the names have been loaded
            imports[str(step.argval), loaded[-2] if isinstance(loaded[-2], int) else 0] = None
        elif step.opname in ("LOAD_GLOBAL", "LOAD_NAME"):
            names[str(step.argval)] = None
        elif step.opname in ("LOAD_ATTR", "LOAD_METHOD", "IMPORT_FROM", "LOAD_SUPER_ATTR"):
            attributes.add(str(step.argval))
        if step.opname.startswith("LOAD_"):
            loaded.append(step.argval)
    return _Code(hasher.digest.digest(), tuple(names), frozenset(attributes), tuple(imports))


class Hasher:
    """One hash under way; objects that occur twice, or contain themselves, are told by the number of the first time."""

    def __init__(self) -> None:
        self.digest = hashlib.sha256()
        self.numbers: dict[int, int] = {}
        self.modules: set[tuple[int, frozenset[str]]] = set()  # those in others, with what is read of them
        self.alive: list[Any] = []  # an id is of one object only as long as that lives

    def home(self, name: str, file: str | None) -> str | None:
        """How a module that nobody edits is told; None for one whose content counts."""
        return installed(name, file)

    def home_of_class(self, item: type) -> str | None:
        """The same of a class; those that no class statement made are Python's or some library's."""
        home = self.home(item.__module__, getattr(sys.modules.get(item.__module__), "__file__", None))
        return home or (None if item.__flags__ & HEAP_TYPE else "builtin")

    def note(self, *words: Any) -> None:
        self.digest.update(repr(words).encode())  # no two tuples of words and numbers have one text

    def add(self, item: Any) -> None:
        kind = type(item)
        if item is None or kind in (bool, int, str) or item is Ellipsis or item is NotImplemented:
            self.note(kind.__name__, item)
        elif kind in (float, complex):
            self.note(kind.__name__, repr(item))
        elif kind is bytes:
            self.note("bytes", len(item))
            self.digest.update(item)
        elif kind in (tuple, slice, range):
            parts = item if kind is tuple else (item.start, item.stop, item.step)
            self.note(kind.__name__, len(parts))
            for part in parts:
                self.add(part)
        elif id(item) in self.numbers:
            self.note("seen", self.numbers[id(item)])
        else:
            if len(self.numbers) >= MOST_OBJECTS:
                raise HashlessError(f"more than {MOST_OBJECTS} objects")
            self.numbers[id(item)] = len(self.numbers)
            self.alive.append(item)
            self._object(item)

    def _object(self, item: Any) -> None:
        if isinstance(item, types.FunctionType):
            self._function(item)
        elif isinstance(item, types.CodeType):
            self.digest.update(code_of(item).digest)
        elif isinstance(item, type):
            self._class(item)
        elif isinstance(item, types.ModuleType):
            self._module(item, frozenset())
        elif isinstance(item, types.MethodType):
            self._parts("method", item.__func__, item.__self__)
        elif isinstance(item, types.BuiltinFunctionType | types.MethodWrapperType):
            owner = item.__self__
            self.note("builtin", item.__qualname__, getattr(item, "__module__", ""))
            if not isinstance(owner, types.ModuleType) and owner is not None:
                self.add(owner)
        elif isinstance(item, np.ndarray | np.generic) and self._is_plain(type(item)):
            self._array(item)
        elif isinstance(item, np.generic):
            raise HashlessError(f"a {type(item).__name__}")
        elif isinstance(item, types.MappingProxyType):
            self._parts("mapping", dict(item))
        elif isinstance(item, types.CellType):
            self._cell(item)
        elif isinstance(item, weakref.ref | types.GeneratorType | types.FrameType | types.CoroutineType):
            raise HashlessError(f"a {type(item).__name__}")
        else:
            self._instance(item)

    def _parts(self, label: str, *parts: Any) -> None:
        self.note(label, len(parts))
        for part in parts:
            self.add(part)

    # -- code

    def _function(self, function: types.FunctionType) -> None:
        home = self.home(str(function.__globals__.get("__name__", "")), function.__globals__.get("__file__"))
        code = code_of(function.__code__)
        self.note("function", "" if home is None else f"{home} {function.__module__}.{function.__qualname__}")
        self.digest.update(code.digest)
        self._parts("arguments", function.__defaults__, _sorted(function.__kwdefaults__ or {}))
        for cell in function.__closure__ or ():
            self._cell(cell)
        for name, value in _sorted(function.__dict__):
            if name not in NOT_CONTENT:
                self._parts(name, value)
        if home is None:
            self._globals(function.__globals__, code)

    def _cell(self, cell: types.CellType) -> None:
        try:
            value = cell.cell_contents
        except ValueError:  # not filled yet
            self.note("empty")
            return
        self._parts("cell", value)

    def _globals(self, known: Mapping[str, Any], code: _Code) -> None:
        """What the names of a user's code stand for now."""
        attributes = code.attributes | ({"*"} if READS_BY_NAME & set(code.names) else set())
        for name in code.names:
            self.note("global", name)
            if name in known:
                if isinstance(known[name], types.ModuleType):
                    self._module(known[name], attributes)
                else:
                    self.add(known[name])
            elif name in HASHLESS and hasattr(builtins, name):
                raise HashlessError(f"{name}()")
        for name, level in code.imports:
            package = str(known.get("__package__") or "").split(".")
            parts = [*package[: len(package) - level + 1], name] if level else [name]
            full = ".".join(part for part in parts if part)
            self.note("import", full)
            self._imported(full, attributes)

    def _imported(self, name: str, attributes: frozenset[str]) -> None:
        """A module that a function imports when it runs; one that is not loaded yet is told by its file."""
        pieces = name.split(".")
        for end in range(1, len(pieces) + 1):
            module = sys.modules.get(".".join(pieces[:end]))
            if module is not None:
                self._module(module, attributes)
                continue
            try:
                spec = importlib.util.find_spec(".".join(pieces[:end]))
            except (ImportError, ValueError, AttributeError):
                spec = None
            file = getattr(spec, "origin", None)
            if file and self.home(pieces[0], file) is None:
                self.digest.update(Path(file).read_bytes())
            return

    def _module(self, module: types.ModuleType, attributes: Iterable[str]) -> None:
        """A module as code that reads these attributes sees it; "*": any."""
        home = self.home(module.__name__, getattr(module, "__file__", None))
        self.note("module", module.__name__, home or "")
        content = vars(module)
        if home is not None:
            for name in sorted(set(attributes) & set(content)):
                self._put_there(name, content[name])
            return
        every = "*" in attributes or not attributes
        for name in sorted(content if every else set(attributes) & set(content)):
            if every and name.startswith("__"):
                continue
            value = content[name]
            self.note(name)
            if not isinstance(value, types.ModuleType):
                self.add(value)
            elif (key := (id(value), frozenset(attributes))) not in self.modules:
                self.modules.add(key)
                self._module(value, attributes)

    def _put_there(self, name: str, value: Any) -> None:
        """What somebody has put in the place of a function of an installed module; nothing of what was there."""
        if isinstance(value, types.FunctionType):
            known = value.__globals__
            if self.home(str(known.get("__name__", "")), known.get("__file__")) is None:
                self._parts(name, value)
        elif isinstance(value, np.ufunc) and value.__name__ != name:  # np.abs is absolute, too
            self.note(name, value.__name__)

    def _class(self, item: type) -> None:
        home = self.home_of_class(item)
        self.note("class", item.__name__, "" if home is None else f"{home} {item.__module__}.{item.__qualname__}")
        if home is not None:
            return
        self._parts("bases", *item.__bases__, type(item))
        for name, value in _sorted(vars(item)):
            if name not in NOT_CONTENT and not isinstance(
                value, types.GetSetDescriptorType | types.MemberDescriptorType
            ):
                self._parts(name, value)

    # -- data

    def _array(self, item: Any) -> None:
        array = np.asarray(item)
        self.note("array", array.dtype.str, array.shape)
        if array.dtype.hasobject:
            self._parts("objects", *array.ravel().tolist())
        else:
            self.digest.update(np.ascontiguousarray(array).tobytes())

    def _is_plain(self, kind: type) -> bool:
        """Whether arrays of this kind have nothing but numbers; a user's may have attributes, masked ones a mask."""
        return self.home_of_class(kind) is not None and not issubclass(kind, np.ma.MaskedArray)

    def _instance(self, item: Any) -> None:
        kind = type(item)
        if isinstance(item, staticmethod | classmethod):
            self._parts(kind.__name__, item.__func__)
        elif isinstance(item, property):
            self._parts("property", item.fget, item.fset, item.fdel)
        elif isinstance(item, functools.cached_property):
            self._parts("cached_property", item.func)
        elif isinstance(item, functools.partial):
            self._parts("partial", kind, item.func, item.args, _sorted(item.keywords))
        elif isinstance(item, enum.Enum):
            self._parts("enum", kind, item.name, item.value)
        elif self.home_of_class(kind) is not None and (wrapped := _wrapped(item)) is not None:  # lru_cache, a jit
            self._parts("wrapped", kind, wrapped)
        elif is_of_python(item):
            raise HashlessError("a ufunc made by np.frompyfunc")
        elif isinstance(item, itertools.count):
            self.note("count", repr(item))
        elif kind.__module__ == "itertools":  # from Python 3.14 on they do not say where they are
            raise HashlessError(f"itertools.{kind.__name__}")
        elif isinstance(item, re.Pattern):
            self.note("pattern", item.pattern, item.flags)
        elif isinstance(item, np.ufunc | np.dtype) or kind.__module__ in ("typing", "types"):
            self.note(kind.__name__, str(item))
        elif (
            dataclasses.is_dataclass(item) and self.home_of_class(kind) is not None
        ):  # a user's may have more than fields
            self._parts("dataclass", kind, *(getattr(item, f.name) for f in dataclasses.fields(item) if f.compare))
        else:
            self._containers(item)

    def _containers(self, item: Any) -> None:
        kind = type(item)
        if kind is list:
            self._parts("list", *item)
        elif kind is bytearray:
            self._parts("bytearray", bytes(item))
        elif kind is dict:
            self._parts("dict", *(part for pair in item.items() for part in pair))
        elif kind in (set, frozenset):
            marks = [content_hash(part) for part in item]
            if None in marks:
                raise HashlessError("an element of a set")
            self._parts("set", *sorted(map(str, marks)))
        else:
            self._parts("instance", kind, *_reduced(item))


def is_of_python(item: Any) -> bool:
    """A ufunc of a Python function, which nobody can see."""
    return isinstance(item, np.ufunc) and "vectorized" in item.__name__


def _reduced(item: Any) -> list[Any]:
    """What pickle would keep of an object: how it is made, and its state."""
    found = item.__reduce_ex__(2)
    return [found] if isinstance(found, str) else [list(p) if hasattr(p, "__next__") else p for p in found]


def _wrapped(item: Any) -> Callable[..., Any] | None:
    for name in ("py_func", "__wrapped__"):
        found = getattr(item, name, None)
        if isinstance(found, types.FunctionType):
            return found
    return None


def _sorted(values: Mapping[str, Any]) -> tuple[tuple[str, Any], ...]:
    return tuple(sorted(values.items(), key=lambda pair: str(pair[0])))
