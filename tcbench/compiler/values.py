"""The types of the restricted Python (numbers, arrays, records, tuples) and their LLVM representation."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, get_args, get_origin

from ..errors import TcbenchError
from .records import DOUBLE, RANKS, TYPES, Record, Rows, annotation_text

INT, FLOAT, BOOL, NOTHING = "i64", "double", "i1", "void"
SHORT_INT, SHORT_FLOAT = "i32", "float"  # kinds in memory only: loads and stores convert
IN_MEMORY = {SHORT_INT: (INT, "sext", "trunc"), SHORT_FLOAT: (FLOAT, "fpext", "fptrunc")}
NUMPY = {FLOAT: DOUBLE, **dict(zip((INT, SHORT_INT, SHORT_FLOAT), TYPES.values(), strict=True))}  # of an array's items
ITEMS = {numpy: item for item, numpy in NUMPY.items()}
EIGHT = f"<8 x {FLOAT}>"
KINDS = {"int": INT, "Address": INT, "float": FLOAT, "bool": BOOL, "None": NOTHING, "Eight": EIGHT}
WORDS = {INT: "an int", FLOAT: "a float", BOOL: "a bool", NOTHING: "nothing"}
FUSED = "contract"  # fused multiply-add, except in functions that are `exact`
Part = str | Callable[[], str]


class TranslationError(TcbenchError):
    """Text that is not in the restricted Python; the message names function, line and text."""


@dataclass(frozen=True)
class Array:
    """A contiguous array; those of a kernel have no known lengths."""

    rank: int = 1
    item: str = FLOAT
    sized: bool = True
    fixed: bool = False  # never written to


@dataclass(frozen=True)
class RowsOf:
    record: type[Record]


@dataclass(frozen=True)
class Several:
    """A tuple of numbers, the value of a function with several results."""

    kinds: tuple[str, ...]


class Value(NamedTuple):
    kind: Any
    parts: tuple[Part, ...]
    fixed: bool = False  # never written to


def machine_kinds(kind: Any) -> list[str]:
    """LLVM's types of the parts of a value."""
    if isinstance(kind, Array):
        return ["ptr", *[INT] * (kind.rank if kind.sized else 0)]
    return [kind] if isinstance(kind, str) else list(kind.kinds) if isinstance(kind, Several) else ["ptr"]


def constant(x: float) -> str:
    """A double as LLVM writes it, all bits. Not cached: a cache takes 0.0 for -0.0."""
    return f"0x{struct.unpack('<Q', struct.pack('<d', x))[0]:016X}"


def say(kind: Any) -> str:
    """The kind in words."""
    if isinstance(kind, Array):
        of = "" if kind.item == FLOAT else f" of {NUMPY[kind.item]}"
        return f"an array{of} with {kind.rank} ax{'i' if kind.rank == 1 else 'e'}s"
    if isinstance(kind, str):
        return WORDS.get(kind, "a vector")
    return f"a {kind.__name__}" if isinstance(kind, type) else "a tuple or rows"


def kind_of(annotation: Any, names: Mapping[str, Any]) -> Any:
    """The kind of an annotation, text or object; None for kinds that are not in the language."""
    if isinstance(annotation, type) and issubclass(annotation, Record):
        return annotation
    if get_origin(annotation) is Rows:
        return RowsOf(get_args(annotation)[0])
    text = annotation_text(annotation).strip("'\"")
    if text in KINDS:
        return KINDS[text]
    if text in RANKS:
        return Array(RANKS[text], ITEMS[TYPES.get(text, DOUBLE)])
    if text.startswith("tuple["):
        parts = [kind_of(x.strip(), names) for x in text[6:-1].split(",")]
        return Several(tuple(parts)) if all(x in (INT, FLOAT, BOOL, EIGHT) for x in parts) else None
    rows = text.startswith("Rows[")
    named = names.get(text[5:-1] if rows else text)
    if isinstance(named, type) and issubclass(named, Record):
        return RowsOf(named) if rows else named
    return None
