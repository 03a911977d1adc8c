"""Kinds of values, and how they stand in LLVM code."""

from __future__ import annotations

import ast
import math
import struct
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from ..errors import TcbenchError
from .language import FUNCTIONS
from .records import Record

INT, FLOAT, BOOL, NOTHING = "i64", "double", "i1", "void"
WORDS = {INT: "an int", FLOAT: "a float", BOOL: "a bool", NOTHING: "nothing"}
FUSED = "contract"  # fused multiply-add
ARITHMETIC = {ast.Add: ("add", "fadd"), ast.Sub: ("sub", "fsub"), ast.Mult: ("mul", "fmul")}
COMPARISONS: dict[type, tuple[str, str]] = {
    ast.Lt: ("slt", "olt"), ast.LtE: ("sle", "ole"), ast.Gt: ("sgt", "ogt"), ast.GtE: ("sge", "oge"),
    ast.Eq: ("eq", "oeq"), ast.NotEq: ("ne", "une"),
}  # fmt: skip
INTRINSICS: dict[Any, str] = {
    f: f"llvm.{name}.f64"
    for name in ("sqrt", "exp", "log", "sin", "cos")
    for f in (getattr(math, name), getattr(np, name), FUNCTIONS[name])
}
LIBRARY: dict[Any, str] = {  # of C
    f: name for name in ("expm1", "log1p", "tanh", "atan") for f in (getattr(math, name), FUNCTIONS[name])
}
Part = str | Callable[[], str]


class TranslationError(TcbenchError):
    """Text that is not in the restricted Python; the message names function, line and text."""


@dataclass(frozen=True)
class Array:
    """Contiguous numbers; the lengths of a kernel's arrays are not known."""

    rank: int = 1
    item: str = FLOAT
    sized: bool = True


@dataclass(frozen=True)
class RowsOf:
    record: type[Record]


@dataclass(frozen=True)
class Several:
    """A tuple of numbers: what a function with several results returns."""

    kinds: tuple[str, ...]


class Value(NamedTuple):
    kind: Any
    parts: tuple[Part, ...]


def machine_kinds(kind: Any) -> list[str]:
    """LLVM's types of the parts of a value that is passed or kept."""
    if isinstance(kind, Array):
        return ["ptr", *[INT] * (kind.rank if kind.sized else 0)]
    return [kind] if isinstance(kind, str) else list(kind.kinds) if isinstance(kind, Several) else ["ptr"]


@lru_cache(maxsize=4096)
def constant(x: float) -> str:
    """A double as LLVM writes it, all bits."""
    return f"0x{struct.unpack('<Q', struct.pack('<d', x))[0]:016X}"


def say(kind: Any) -> str:
    """The kind in words."""
    if isinstance(kind, Array):
        return f"an array with {kind.rank} ax{'i' if kind.rank == 1 else 'e'}s"
    if isinstance(kind, str):
        return WORDS[kind]
    return f"a {kind.__name__}" if isinstance(kind, type) else "a tuple or rows"
