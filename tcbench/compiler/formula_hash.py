"""The hash of a formula: of its code and of the values that the code reads; None where it may read more than that.

Two formulas with one hash give the same numbers. Code of tcbench, numpy, SciPy and modules of Python that only compute
enters by its name. A user's code enters by its bytecode (lines and files left out), defaults, closure, and the global
names that it reads, in turn, down to numbers, arrays and text. Code that may read a file, the environment, the clock,
random numbers or computed names has no hash: it is traced each time.

Each run asks for the hash of its formulas, so that an edit of a closure or a global is noticed. Snapshots of what a
hash depends on are kept with it and compared by identity, in a tenth of the time of hashing again.
"""

from __future__ import annotations

import dis
import enum
import functools
import hashlib
import itertools
import sys
import sysconfig
import types
from collections.abc import Callable, Collection, Mapping
from functools import cache, lru_cache
from operator import is_
from pathlib import Path
from typing import Any

import numpy as np

_Snapshot = tuple[Callable[[Any], tuple[Any, ...]], Any, tuple[Any, ...]]  # (view, object, what the view gave)

MOST_BYTES = 4096  # of an array that is compared; larger ones are hashed again
MOST_KEPT = 1000  # hashes in memory
# modules whose functions read nothing but their arguments
PURE = frozenset({
    "tcbench", "tcbench_plugins", "numpy", "scipy", "builtins", "math", "cmath", "_operator", "operator", "functools",
    "_functools", "itertools", "collections", "_collections", "_collections_abc", "numbers", "fractions", "dataclasses",
    "enum", "typing", "types", "abc", "__future__", "copy", "copyreg", "contextlib", "reprlib",
})  # fmt: skip
READERS = frozenset({  # functions in them that read files, draw numbers, or compute names
    "load", "loadtxt", "genfromtxt", "fromfile", "fromregex", "memmap", "DataSource", "random", "default_rng",
    "attrgetter", "methodcaller", "import_module", "__import__", "eval", "exec", "globals", "locals", "vars", "compile",
    "open", "input",
})  # fmt: skip
READS_BY_NAME = frozenset({"getattr", "hasattr"})  # any name of a module, then
# attributes of a class or function that are made on demand, or say where it was written
NOT_CONTENT = frozenset({
    "__dict__", "__weakref__", "__doc__", "__module__", "__firstlineno__", "__static_attributes__", "__annotations__",
    "__annotate__", "__annotate_func__", "__annotations_cache__", "_abc_impl", "__abstractmethods__", "__wrapped__",
    "__qualname__", "__type_params__", "__slotnames__",
})  # fmt: skip
HEAP_TYPE = 1 << 9  # flag of classes that a class statement made
FIXED = (  # kinds that change only with their parts
    types.CodeType, types.BuiltinFunctionType, types.MethodWrapperType, types.MethodType, types.ModuleType,
    staticmethod, classmethod, property, np.ufunc, np.dtype, slice, range, frozenset, enum.Enum,
    functools.cached_property, functools.partial,
)  # fmt: skip
PLAIN = (type(None), bool, int, float, complex, str, bytes, types.EllipsisType, types.NotImplementedType)
_MISSING = object()
_KEPT: dict[tuple[int, ...], tuple[tuple[Any, ...], list[_Snapshot], str]] = {}  # kept alive: ids are unique


class HashlessError(Exception):
    """A formula reads what a hash cannot describe."""


def formula_hash(*objects: Any) -> str | None:
    """Sha256, hexadecimal, of what these objects are and compute; None where they may read more than that."""
    key = tuple(map(id, objects))
    kept = _KEPT.get(key)
    if kept is not None and all(_as_before(*snapshot) for snapshot in kept[1]):
        return kept[2]
    seen = _Seen()
    try:
        seen.add(*objects)
    except Exception:  # of a user's __reduce__, too; RecursionError is one as well
        return None
    digest = seen.hash.hexdigest()
    if seen.snapshots is not None:
        if len(_KEPT) >= MOST_KEPT:
            _KEPT.clear()
        _KEPT[key] = objects, seen.snapshots, digest
    return digest


def _as_before(view: Callable[[Any], tuple[Any, ...]], item: Any, before: tuple[Any, ...]) -> bool:
    now = view(item)
    return len(now) == len(before) and all(map(is_, now, before))


def _of_function(item: types.FunctionType) -> tuple[Any, ...]:
    return item.__code__, item.__defaults__, item.__kwdefaults__, *vars(item).values()


def _of_mapping(item: Any) -> tuple[Any, ...]:
    return *item.keys(), *item.values()


def _of_class(item: type) -> tuple[Any, ...]:
    return item.__bases__, *_of_mapping(vars(item))


def _of_cell(item: types.CellType) -> tuple[Any, ...]:
    try:
        return (item.cell_contents,)
    except ValueError:  # not filled yet
        return ()


def _of_names(item: tuple[Mapping[str, Any], tuple[str, ...]]) -> tuple[Any, ...]:
    content, names = item
    return tuple([content.get(name, _MISSING) for name in names])


def _of_array(item: tuple[Any, tuple[Any, ...]]) -> tuple[bool]:
    array, before = item
    return ((array.dtype, array.shape, array.tobytes()) == before,)


@lru_cache(maxsize=10_000)
def code_digest(code: types.CodeType) -> str:
    """Hash of a code object, lines and files left out."""
    constants = [
        code_digest(x) if isinstance(x, types.CodeType) else sorted(map(repr, x)) if isinstance(x, frozenset) else x
        for x in code.co_consts  # a set has no order
    ]
    parts = (
        code.co_code, constants, code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars, code.co_flags,
        code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_exceptiontable,
    )  # fmt: skip
    return hashlib.sha256(repr(parts).encode("utf-8", "surrogatepass")).hexdigest()


@lru_cache(maxsize=10_000)
def _names(code: types.CodeType) -> tuple[tuple[str, ...], frozenset[str], frozenset[str]]:
    """The global names that a code object reads, the attributes, the modules that it imports when it runs."""
    names, attributes, imports = dict[str, None](), set[str](), set[str]()
    for step in dis.get_instructions(code):
        if step.opname == "IMPORT_NAME":
            imports.add(str(step.argval))
        elif step.opname in ("LOAD_GLOBAL", "LOAD_NAME"):
            names[str(step.argval)] = None
        elif step.opname in ("LOAD_ATTR", "LOAD_METHOD", "IMPORT_FROM", "LOAD_SUPER_ATTR"):
            attributes.add(str(step.argval))
    for inner in (_names(x) for x in code.co_consts if isinstance(x, types.CodeType)):
        names |= dict.fromkeys(inner[0])
        attributes |= inner[1]
        imports |= inner[2]
    return tuple(names), frozenset(attributes), frozenset(imports)


@cache
def _package(module: str, file: str | None) -> str | None:
    """The package of an installed module; None of a user's. HashlessError where its functions may read more."""
    top = module.partition(".")[0]
    places = Path(file or "").parents
    installed = top in ("tcbench", "tcbench_plugins") or top in sys.builtin_module_names
    installed = installed or bool({"site-packages", "dist-packages"} & {place.name for place in places})
    library = top in sys.stdlib_module_names if file is None else Path(sysconfig.get_paths()["stdlib"]) in places
    if not installed and not library:
        return None
    if top not in PURE:
        raise HashlessError(f"something of {module}")
    return top


def _package_of(item: type) -> str | None:
    """`_package` of a class; those that no class statement made are builtin."""
    package = _package(item.__module__, getattr(sys.modules.get(item.__module__), "__file__", None))
    return package or (None if item.__flags__ & HEAP_TYPE else "builtins")


class _Seen:
    """The hash of what some objects are made of, and snapshots by which a change shows; None where none would.

    Objects that occur again, or in themselves, enter as the number of the first time.
    """

    def __init__(self) -> None:
        self.hash = hashlib.sha256()
        self.snapshots: list[_Snapshot] | None = []
        self.numbers: dict[int, int] = {}
        self.modules: set[tuple[int, frozenset[str]]] = (
            set()
        )  # modules within modules, with the attributes that are read
        self.alive: list[Any] = []  # ids are unique among living objects

    def note(self, *words: Any) -> None:
        self.hash.update(repr(words).encode("utf-8", "surrogatepass"))  # no two tuples of words have one text

    def snapshot(self, view: Callable[[Any], tuple[Any, ...]], item: Any) -> None:
        if self.snapshots is not None:
            self.snapshots.append((view, item, view(item)))

    def add(self, *items: Any) -> None:
        self.note(len(items))
        for item in items:
            if type(item) in PLAIN:
                self.note(type(item).__name__, item)
            elif id(item) in self.numbers:
                self.note("seen", self.numbers[id(item)])
            else:
                self.numbers[id(item)] = len(self.numbers)
                self.alive.append(item)
                self.note(type(item).__name__)
                self._object(item, type(item))

    def _object(self, item: Any, kind: type) -> None:
        if kind is types.FunctionType:
            self._function(item)
        elif isinstance(item, types.CodeType):
            self.note(code_digest(item))
        elif isinstance(item, type):
            self._class(item)
        elif isinstance(item, types.ModuleType):
            self._module(item, frozenset())
        elif kind is types.CellType:
            self.snapshot(_of_cell, item)
            self.add(*_of_cell(item))
        elif isinstance(item, types.MethodType):
            self.add(item.__func__, item.__self__)
        elif isinstance(item, types.BuiltinFunctionType | types.MethodWrapperType):
            module, owner = getattr(item, "__module__", None), item.__self__
            if module:
                _package(module, None)
            self.note(item.__qualname__, module)
            self.add(*([] if owner is None or isinstance(owner, types.ModuleType) else [owner]))
        elif kind is np.ndarray or (isinstance(item, np.generic) and _package_of(kind)):
            self._array(item)
        elif kind is dict or kind is types.MappingProxyType:
            self.snapshot(_of_mapping, item)
            self.add(*_of_mapping(item))
        elif kind is tuple:
            self.add(*item)
        elif kind is list:
            self.snapshot(tuple, item)
            self.add(*item)
        else:
            self._instance(item, kind)

    def _function(self, function: types.FunctionType) -> None:
        namespace = function.__globals__
        package = _package(str(namespace.get("__name__", "")), namespace.get("__file__"))
        self.snapshot(_of_function, function)
        self.note(package and f"{function.__module__}.{function.__qualname__}", code_digest(function.__code__))
        own = [x for pair in sorted(vars(function).items()) if pair[0] not in NOT_CONTENT for x in pair]
        self.add(function.__defaults__, function.__kwdefaults__, *(function.__closure__ or ()), *own)
        if package is not None:
            if function.__name__ in READERS:
                raise HashlessError(function.__name__)
            return
        names, attributes, imports = _names(function.__code__)
        if READERS & {*attributes, *names} or not all(name.partition(".")[0] in PURE for name in imports):
            raise HashlessError("something that reads, or is imported when it runs")
        self.snapshot(_of_names, (namespace, names))
        attributes |= {"*"} if READS_BY_NAME & set(names) else set()
        for name in names:
            self.note(name)
            if isinstance(namespace.get(name), types.ModuleType):
                self._module(namespace[name], attributes)
            elif name in namespace:
                self.add(namespace[name])

    def _module(self, module: types.ModuleType, attributes: Collection[str]) -> None:
        """Add the attributes of a module that code reads; "*", or none: all of them."""
        package, content = _package(module.__name__, getattr(module, "__file__", None)), vars(module)
        self.note(module.__name__)
        names = tuple(sorted(name for name in attributes if name in content))
        if package is not None:  # functions that were replaced count
            self.snapshot(_of_names, (content, names))
            placed = [x for x in _of_names((content, names)) if isinstance(x, types.FunctionType | np.ufunc)]
            self.add(*placed)
            return
        if "*" in attributes or not attributes:
            names, self.snapshots = tuple(sorted(name for name in content if not name.startswith("__"))), None
        self.snapshot(_of_names, (content, tuple(attributes)))
        for name in names:
            self.note(name)
            if not isinstance(content[name], types.ModuleType):
                self.add(content[name])
            elif (key := (id(content[name]), frozenset(attributes))) not in self.modules:
                self.modules.add(key)
                self._module(content[name], attributes)

    def _class(self, item: type) -> None:
        package = _package_of(item)
        self.note(package and f"{item.__module__}.{item.__qualname__}", item.__name__)
        if package is None:
            self.snapshot(_of_class, item)
            slots = types.GetSetDescriptorType | types.MemberDescriptorType
            own = [x for x in sorted(vars(item).items()) if x[0] not in NOT_CONTENT and not isinstance(x[1], slots)]
            self.add(*item.__bases__, type(item), *itertools.chain(*own))

    def _array(self, item: Any) -> None:
        self.note(item.dtype.str, item.shape)
        if item.dtype.hasobject or item.nbytes > MOST_BYTES:
            self.snapshots = None
        else:
            self.snapshot(_of_array, (item, (item.dtype, item.shape, item.tobytes())))
        if item.dtype.hasobject:
            self.add(*item.ravel().tolist())
        else:
            self.hash.update(np.ascontiguousarray(item).tobytes())

    def _instance(self, item: Any, kind: type) -> None:
        if not isinstance(item, FIXED):
            self.snapshots = None
        if isinstance(item, np.generic) or (isinstance(item, np.ufunc) and "vectorized" in item.__name__):
            raise HashlessError("a user's number, or a ufunc of a Python function")
        if kind in (set, frozenset):
            if not all(type(x) in PLAIN for x in item):
                raise HashlessError("a set of objects")
            self.note(sorted(map(repr, item)))
        elif isinstance(item, staticmethod | classmethod):
            self.add(item.__func__)
        elif isinstance(item, property):
            self.add(item.fget, item.fset, item.fdel)
        elif isinstance(item, np.ufunc):
            self.note(item.__name__)
        elif isinstance(item, functools.cached_property):
            self.add(item.func)
        elif _package_of(kind) and isinstance(wrapped := getattr(item, "__wrapped__", None), types.FunctionType):
            self.add(wrapped)  # of lru_cache
        elif kind.__module__ == "itertools":  # from Python 3.14 on they do not show their position
            raise HashlessError(f"itertools.{kind.__name__}")
        else:  # as pickle has it: constructor and state
            data = item.__reduce_ex__(2)
            parts = [data] if isinstance(data, str) else [list(p) if hasattr(p, "__next__") else p for p in data]
            self.add(kind, *parts)
