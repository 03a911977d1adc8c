"""Records: what a compiled function reads and writes, as one table of eight bytes a field.

A field is a number, a kernel's address, an array's address, or that of another record's table. In compiled code
`record.x` is one load; in Python it is the number, the numpy array or the record, which the record keeps alive.
"""

from __future__ import annotations

import ctypes
import inspect
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np

HEAD = object.__basicsize__  # of CPython's objects; an array's data pointer follows
NUMBERS = ("int", "float", "bool", "Kernel")
R = TypeVar("R", bound="Record")
RANKS = {"Floats": 1, "Matrix": 2, "Cube": 3, "Ints": 1}


def address_of(array: np.ndarray) -> int:
    """Where the array's numbers begin (a fifth of the time of `array.ctypes.data`)."""
    return ctypes.c_size_t.from_address(id(array) + HEAD).value


@dataclass(frozen=True)
class Sized:
    """The shape of an array field: expressions of + - * in whole-number fields of the same record, and constants."""

    lengths: tuple[str, ...]


def sized(*lengths: str) -> Any:
    """Declare an array field's shape, as in `matrix: Matrix = sized("n", "n + 2")`."""
    return Sized(lengths)


class Rows(Generic[R]):
    """Several records of one kind, one after the other in memory."""

    def __init__(self, records: Sequence[R]) -> None:
        kind = type(records[0])
        self.table = np.array([r.table for r in records], dtype=np.int64)
        self.records: list[R] = [kind._over(row, r) for row, r in zip(self.table, records, strict=True)]

    def __getitem__(self, i: int) -> R:
        return self.records[i]

    def __len__(self) -> int:
        return len(self.records)


class Field:
    """One field; in Python a property of the record."""

    def __init__(self, name: str, kind: str, index: int, lengths: tuple[str, ...]) -> None:
        self.name, self.kind, self.index, self.lengths = name, kind, index, lengths

    @property
    def is_array(self) -> bool:
        return self.kind in RANKS

    @property
    def rows_of(self) -> str:
        """Name of the record class of a field of rows, or ""."""
        return self.kind.removeprefix("Rows[").removesuffix("]") if self.kind.startswith("Rows[") else ""

    def __get__(self, record: Any, owner: type) -> Any:
        if record is None:
            return self
        if self.kind in ("int", "Kernel", "bool"):
            return int(record.table[self.index])
        if self.kind == "float":
            return record.table.view(np.float64)[self.index]
        return record.kept[self.name]

    def __set__(self, record: Any, value: Any) -> None:
        if self.kind not in NUMBERS:
            raise AttributeError(f"{type(record).__name__}.{self.name} is given when the record is made")
        (record.table.view(np.float64) if self.kind == "float" else record.table)[self.index] = value


class Record:
    """Base class; a subclass annotates its fields, of kinds int, float, bool, Kernel, Floats, Matrix, Cube, Ints,
    another Record or Rows[another]. `class Tally(Record, mutable=True)` may be written by compiled code, numbers only.

    Made by keyword. An array that is not given is allocated, zero, in the shape that its declaration says.
    """

    fields: ClassVar[dict[str, Field]] = {}
    mutable: ClassVar[bool] = False
    table: np.ndarray
    kept: dict[str, Any]
    address: int

    def __init_subclass__(cls, mutable: bool = False, **arguments: Any) -> None:
        super().__init_subclass__(**arguments)
        cls.mutable, cls.fields = mutable, dict(cls.fields)
        for name, kind in inspect.get_annotations(cls).items():
            shape = cls.__dict__.get(name)
            lengths = shape.lengths if isinstance(shape, Sized) else ()
            field = Field(name, str(kind), len(cls.fields), lengths)
            if field.is_array and len(lengths) != RANKS[field.kind]:
                raise TypeError(
                    f"{cls.__name__}.{name}, of kind {kind}, needs sized(...) with {RANKS[field.kind]} lengths"
                )
            cls.fields[name] = field
            setattr(cls, name, field)
        cls.names = vars(sys.modules[cls.__module__])
        made = [f for f in cls.fields.values() if f.is_array]
        text = "".join(f"({', '.join(f.lengths)},), " for f in made)
        cls._shapes = compile(f"[{text}]", f"<shapes of {cls.__name__}>", "eval")
        cls._made = made

    names: ClassVar[dict[str, Any]]
    _made: ClassVar[list[Field]]
    _shapes: ClassVar[Any]

    def __init__(self, **values: Any) -> None:
        fields, kept = type(self).fields, {}
        table = np.empty(len(fields), dtype=np.int64)
        numbers: list[tuple[int, float]] = []
        row = [0] * len(fields)
        for name, value in values.items():
            field = fields[name]
            if field.kind == "float":
                numbers.append((field.index, value))
            elif field.kind in NUMBERS:
                row[field.index] = int(value)
            else:
                kept[name] = value
                row[field.index] = address_of(_checked(field, value) if field.is_array else value.table)
        shapes = dict(zip(type(self)._made, eval(type(self)._shapes, type(self).names, values), strict=True))
        missing = [f for f in type(self)._made if f.name not in kept]
        for f in type(self)._made:
            if f.name in kept and kept[f.name].shape != shapes[f]:
                raise TypeError(f"{f.name} has shape {kept[f.name].shape}, declared is {shapes[f]}")
        if missing:
            memory = np.zeros(sum(math.prod(shapes[f]) for f in missing))
            start, begin = 0, address_of(memory)
            for f in missing:
                stop = start + math.prod(shapes[f])
                part = memory[start:stop].reshape(shapes[f])
                kept[f.name] = part.view(np.int64) if f.kind == "Ints" else part
                row[f.index] = begin + 8 * start
                start = stop
        table[:] = row
        for index, value in numbers:
            table.view(np.float64)[index] = value
        self.table, self.kept, self.address = table, kept, address_of(table)

    @classmethod
    def _over(cls, row: np.ndarray, source: Any) -> Any:
        """The same record with its table in other memory."""
        record = object.__new__(cls)
        record.table, record.kept, record.address = row, source.kept, address_of(row)
        return record


def _checked(field: Field, array: np.ndarray) -> np.ndarray:
    """The array, if it is one that compiled code can read."""
    if array.dtype != (np.int64 if field.kind == "Ints" else np.float64) or not array.flags.c_contiguous:
        raise TypeError(f"{field.name} needs a contiguous array of {field.kind}")
    return array
