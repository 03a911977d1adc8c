"""The text of a translation, found again without translating: by a hash of all that the translation may read.

That is: the code of the functions as it is loaded, with annotations and closures, and what each name in it stands for:
numbers, other functions, the fields of records, modules down to the attributes that the code names; and the translator
itself, its constants, too. Names of files do not count, nor what the files say meanwhile. What cannot be described in
this way is translated each time.
"""

from __future__ import annotations

import hashlib
import importlib
import inspect
import re
import sys
import types
from collections.abc import Iterable, Mapping
from functools import lru_cache
from operator import is_
from pathlib import Path
from typing import Any

from .. import cache
from . import language, records, values
from .code_hash import Hasher, hashed
from .installed import installed
from .records import Record

PACKAGE = __package__
TRANSLATOR = ("arithmetic", "expressions", "short_vectors", "special", "statements", "translator")
ALWAYS = (language, records, values)  # what it reads that is loaded before
FIXED = ("numpy", "scipy", "llvmlite")  # told by their versions, as Python itself is
_WORD = re.compile(r"[A-Za-z_]\w*")


@lru_cache(maxsize=10_000)
def described(code: types.CodeType) -> tuple[bytes, frozenset[str]]:
    """Hash of a code object, lines and files left out, and every name in it."""
    inner = [described(x) if isinstance(x, types.CodeType) else None for x in code.co_consts]
    constants = [
        found[0] if found else sorted(map(repr, x)) if isinstance(x, frozenset) else x  # a set has no order
        for x, found in zip(code.co_consts, inner, strict=True)
    ]
    parts = (
        code.co_code, constants, code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars,
        code.co_flags & ~inspect.CO_NESTED,
        code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_exceptiontable,
    )  # fmt: skip
    names = frozenset(code.co_names).union(*(found[1] for found in inner if found is not None))
    return hashlib.sha256(repr(parts).encode("utf-8", "surrogatepass")).digest(), names


class Inputs(Hasher):
    """The hash of what a translation of these objects may read; `read`: globals, as (namespace, name, value)."""

    def __init__(self) -> None:
        super().__init__()
        self.read: list[tuple[Mapping[str, Any], str, Any]] = []

    def home(self, name: str, file: str | None) -> str | None:
        top = name.partition(".")[0]
        return installed(name, file) if top in FIXED or top in sys.stdlib_module_names else None

    def _function(self, function: types.FunctionType) -> None:
        known = function.__globals__
        home = self.home(str(known.get("__name__", "")), known.get("__file__"))
        if home is not None:
            self.note("function", home, function.__module__, function.__qualname__)
            return
        digest, names = described(function.__code__)
        ours = vars(language).get(function.__name__) is function  # the translator knows it by what it is
        self.note(
            "function",
            function.__name__ if ours else "",
            *(getattr(function, mark, False) for mark in ("rare", "exact")),
        )
        self.digest.update(digest)
        for name, kind in function.__annotations__.items():
            self.note(name)
            self.add(kind)
            if isinstance(kind, str):
                self._named(_WORD.findall(kind), known, names)
        for cell in function.__closure__ or ():
            self._cell(cell)
        self._named(sorted(names), known, names)

    def _named(self, names: Iterable[str], known: Mapping[str, Any], attributes: frozenset[str]) -> None:
        for name in names:
            if name in known:
                self.note("global", name)
                self.read.append((known, name, known[name]))
                if isinstance(known[name], types.ModuleType):
                    self._module(known[name], attributes)
                    inside = vars(known[name])
                    self.read += [(inside, x, inside[x]) for x in sorted(attributes & inside.keys())]
                else:
                    self.add(known[name])

    def _class(self, item: type) -> None:
        if not issubclass(item, Record):
            super()._class(item)
            return
        self.note("record", item.mutable, len(item.fields))
        for field in item.fields.values():
            self.note(field.name, field.kind, field.index, *field.lengths)
            self._named(_WORD.findall(" ".join([field.kind, *field.lengths])), item.names, frozenset())


def inputs(*objects: Any) -> str | None:
    """Hash of what a translation of these objects may read; None where something in it has none."""
    return hashed(Inputs(), objects)


def globals_read(*functions: Any) -> list[tuple[Mapping[str, Any], str, Any]]:
    """What the functions, and those that they call, read of their modules: (namespace, name, value)."""
    found = Inputs()
    hashed(found, functions)
    return found.read


def made_of(*objects: Any) -> str | None:
    """Hash of all that the text of their translation depends on; None where it is not known."""
    translator, found = translator_hash(), inputs(*objects)
    return translator and found and f"{translator} {found}"


# the translator itself ----------------------------------------------------------------------------------------------

_SEEN: list[Any] = []  # what its modules held, and their hash


def translator_hash() -> str | None:
    """Hash of the translator as it is loaded; where it is not, of what loading it gave the last time.

    That is kept under a hash of its files: to import it takes ten times as long as all else that a warm start looks up.
    """
    loaded = any(f"{PACKAGE}.{name}" in sys.modules for name in TRANSLATOR)
    held = _held((*ALWAYS, *(_translator() if loaded else ())))
    if not _SEEN or len(held) != len(_SEEN[0]) or not all(map(is_, held, _SEEN[0])):
        _SEEN[:] = [held, _loaded_hash() if loaded else _kept_hash()]
    found: str | None = _SEEN[1]
    return found


def _translator() -> list[types.ModuleType]:
    return [importlib.import_module(f".{name}", PACKAGE) for name in (*TRANSLATOR, "kernels")]


def _held(modules: Iterable[types.ModuleType]) -> list[Any]:
    """What these modules and their classes consist of now."""
    held: list[Any] = []
    for module in modules:
        content = list(vars(module).values())
        own = [list(vars(x).values()) for x in content if isinstance(x, type) and x.__module__ == module.__name__]
        held += content + [x for part in own for x in part]
    return held


def _loaded_hash() -> str | None:
    *_, translator, kernels = _translator()
    return inputs(translator.Module, described(kernels._code.__code__)[0], kernels.namespace())


def _kept_hash() -> str | None:
    mark = _files_hash()
    found = mark and cache.read("code", f"{mark}.text")
    if found:
        return found.decode()
    made = _loaded_hash()
    if mark and made and mark == _files_hash():  # nobody edited the files meanwhile
        cache.write("code", f"{mark}.text", made.encode())
    return made


def _files_hash() -> str | None:
    """Hash of the translator's files, and of what is loaded of it already."""
    return inputs(*(Path(__file__).with_name(f"{name}.py").read_bytes() for name in TRANSLATOR), *ALWAYS)
