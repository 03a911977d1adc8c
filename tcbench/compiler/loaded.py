"""A hash of tcbench's own modules as loaded in this process (their files may have been edited since)."""

from __future__ import annotations

import hashlib
import re
from functools import lru_cache
from operator import is_
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

MADE = ("_plans",)  # of a record when it is first made, by what it is made of
_SEEN: dict[str, tuple[list[Any], str]] = {}  # by the first module's name: what the modules held, and the hash


@lru_cache(maxsize=10_000)
def digest(code: CodeType) -> str:
    """Hash of a code object, lines and files left out."""
    constants = [
        digest(x) if isinstance(x, CodeType) else sorted(map(repr, x)) if isinstance(x, frozenset) else x
        for x in code.co_consts  # a set has no order
    ]
    parts = (
        code.co_code, constants, code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars, code.co_flags,
        code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_exceptiontable,
    )  # fmt: skip
    return hashlib.sha256(repr(parts).encode("utf-8", "surrogatepass")).hexdigest()


def loaded_hash(*modules: ModuleType) -> str:
    """Of the functions, classes and constants of these modules, what they import by name included; found again as long
    as nothing in them was exchanged, thirty times as fast."""
    names = {module.__name__ for module in modules}
    held = [x for module in modules for x in list(vars(module).values())]
    held += [
        x for kind in held if isinstance(kind, type) and kind.__module__ in names for x in list(vars(kind).values())
    ]
    held += [x.__code__ for x in held if isinstance(x, FunctionType)]
    known = _SEEN.get(modules[0].__name__)
    if known is None or len(held) != len(known[0]) or not all(map(is_, held, known[0])):
        text = re.sub(" at 0x[0-9a-f]+", "", repr(_content([vars(module) for module in modules], names, {})))
        known = _SEEN[modules[0].__name__] = held, hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()
    return known[1]


def _content(item: Any, own: set[str], seen: dict[int, int]) -> Any:
    """What has a text that says all of it, but for addresses. own: names of the modules; seen: numbers of what is in it
    already."""
    if isinstance(item, property):
        item = item.fget
    elif not isinstance(item, type):
        item = getattr(item, "__wrapped__", item)  # of what is cached
    if isinstance(item, ModuleType | np.ndarray):
        return item.__name__ if isinstance(item, ModuleType) else (item.shape, item.tobytes())
    if not isinstance(item, FunctionType | type | dict | list | tuple):
        return item
    if id(item) in seen:
        return seen[id(item)]
    seen[id(item)] = len(seen)
    if isinstance(item, FunctionType):
        cells = [_content(cell.cell_contents, own, seen) for cell in item.__closure__ or ()]
        return digest(item.__code__), item.__defaults__, vars(item), cells
    if isinstance(item, type) and item.__module__ not in own:
        return item
    if isinstance(item, list | tuple):
        return [_content(x, own, seen) for x in item]
    held = vars(item) if isinstance(item, type) else item
    kept = [
        (k, x) for k, x in list(held.items()) if isinstance(x, FunctionType) or not (str(k)[:2] == "__" or k in MADE)
    ]
    return [(k, _content(x, own, seen)) for k, x in kept]
