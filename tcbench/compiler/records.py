"""Records: structures that compiled functions read and write, tables of eight bytes a field.

A field is a number, a kernel's address, an array's address, or that of another record's table. In compiled code
`record.x` is one load; in Python it is the number, the numpy array or the record, which the record keeps alive.
"""

from __future__ import annotations

import ctypes
import inspect
import math
import struct
import sys
from collections import namedtuple
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, TypeVar, get_args, get_origin

import numpy as np

HEAD = object.__basicsize__  # of CPython's objects; an array's data pointer follows
WHOLE = ("int", "bool", "Address")
NUMBERS = ("float", *WHOLE)
MOST_PLANS = 5000
R = TypeVar("R", bound="Record")
RANKS = {"Floats": 1, "Matrix": 2, "Cube": 3, "Ints": 1, "ShortInts": 1, "ShortFloats": 1}
DOUBLE: np.dtype[Any] = np.dtype(np.float64)
TYPES: dict[str, np.dtype[Any]] = {  # of arrays of another kind than doubles
    "Ints": np.dtype(np.int64), "ShortInts": np.dtype(np.int32), "ShortFloats": np.dtype(np.float32),
}  # fmt: skip


def annotation_text(annotation: Any) -> str:
    """An annotation as text; without the __future__ import it is an object."""
    if isinstance(annotation, str):
        return annotation
    if get_origin(annotation) is Rows:
        return f"Rows[{annotation_text(get_args(annotation)[0])}]"
    if get_origin(annotation) is tuple:
        return f"tuple[{', '.join(map(annotation_text, get_args(annotation)))}]"
    if hasattr(annotation, "__metadata__"):  # Floats and its like
        return str(annotation.__metadata__[0])
    return "None" if annotation is None else getattr(annotation, "__name__", str(annotation))


def address_of(array: np.ndarray) -> int:
    """The address of the array's numbers, in a fifth of the time of `array.ctypes.data`."""
    return ctypes.c_size_t.from_address(id(array) + HEAD).value


@dataclass(frozen=True)
class Sized:
    """The shape of an array field: expressions of + - * in whole-number fields of the same record, and constants."""

    lengths: tuple[str, ...]
    of: str = ""
    at: str = "0"


def sized(*lengths: str, of: str = "", at: str = "0") -> Any:
    """Declare an array field's shape, as in `matrix: Matrix = sized("n", "n + 2")`.

    of : an earlier array of which this one is a part, from its element `at` on.
    """
    return Sized(lengths, of, at)


class Rows(Generic[R]):
    """Several records of one kind, one after the other in memory."""

    def __init__(self, records: Sequence[R]) -> None:
        kind = type(records[0])
        if len(records) == 1:
            self.table, self.records = records[0].table[None], list(records)
        else:
            self.table = np.array([r.table for r in records])
            self.records = [kind._over(row, r) for row, r in zip(self.table, records, strict=True)]

    def __getitem__(self, i: int) -> R:
        return self.records[i]

    def __len__(self) -> int:
        return len(self.records)


class Field:
    """One field; in Python a property of the record."""

    def __init__(self, name: str, kind: str, index: int, sized: Sized) -> None:
        self.name, self.kind, self.index, self.sized, self.lengths = name, kind, index, sized, sized.lengths
        self.is_real, self.is_whole = kind == "float", kind in WHOLE
        self.type = TYPES.get(kind, DOUBLE)

    @property
    def is_array(self) -> bool:
        return self.kind in RANKS

    def __get__(self, record: Any, owner: type) -> Any:
        if record is None:
            return self
        array = record._kept.get(self.name)  # the common case first: a run reads some twenty arrays
        if array is not None:
            return array
        if self.is_whole:
            return record.table.item(self.index)
        return record.reals[self.index] if self.is_real else record._array(self)

    def __set__(self, record: Any, value: Any) -> None:
        if self.is_real:
            record.reals[self.index] = value
        elif self.is_whole:
            record.table[self.index] = value
        else:
            raise AttributeError(f"{type(record).__name__}.{self.name} is given when the record is made")


class Record:
    """Base class; a subclass annotates its fields, of kinds int, float, bool, Address, Floats, Matrix, Cube, Ints,
    ShortInts, ShortFloats, another Record or Rows[another]. `class Tally(Record, mutable=True)` may be written by
    compiled code, numbers only.

    Fields are set by keyword. Other arrays are allocated, zero, in their declared shapes.
    """

    fields: ClassVar[dict[str, Field]] = {}
    mutable: ClassVar[bool] = False
    table: np.ndarray
    reals: np.ndarray  # the table as floats
    _kept: dict[str, Any]
    _plan: _Plan
    address: int

    def __init_subclass__(cls, mutable: bool = False, **arguments: Any) -> None:
        super().__init_subclass__(**arguments)
        cls.mutable, cls.fields = mutable, dict(cls.fields)
        for name, kind in inspect.get_annotations(cls).items():
            shape = cls.__dict__.get(name)
            shape = shape if isinstance(shape, Sized) else Sized(())
            if hasattr(Record, name) or name in Record.__annotations__:
                raise TypeError(f"{cls.__name__}.{name}: a record has something else of that name")
            field = Field(name, annotation_text(kind), len(cls.fields), shape)
            if field.is_array and len(shape.lengths) != RANKS[field.kind]:
                raise TypeError(
                    f"{cls.__name__}.{name}, of kind {kind}, needs sized(...) with {RANKS[field.kind]} lengths"
                )
            cls.fields[name] = field
            setattr(cls, name, field)
        cls.names = vars(sys.modules[cls.__module__])
        cls._plans = {}

    names: ClassVar[dict[str, Any]]
    _plans: ClassVar[dict[Any, _Plan]]

    def __init__(self, **values: Any) -> None:
        cls = type(self)
        key = (*values, *[int(v) for v in values.values() if isinstance(v, int | np.integer)])
        plan = cls._plans.get(key)
        if plan is None:
            if len(cls._plans) >= MOST_PLANS:
                cls._plans.clear()
            plan = cls._plans[key] = _Plan(cls, values)
        table, reals = self._with_memory(plan, plan.table.copy(), kept := {})
        if plan.whole:
            table[plan.whole_at] = [values[name] for name in plan.whole]
        if plan.real:
            reals[plan.real_at] = [values[name] for name in plan.real]
        for field in plan.given:
            value = kept[field.name] = values[field.name]
            table[field.index] = address_of(_checked(field, value, plan.shapes) if field.is_array else value.table)

    def again(self: R, **values: Any) -> R:
        """A record with the same numbers and arrays of its own, zero. Arrays that were passed are shared, but for
        `values`, of the same shapes."""
        copied, fields, plan = object.__new__(type(self)), type(self).fields, self._plan
        copied._with_memory(
            plan, self.table.copy(), {field.name: self._kept[field.name] for field in plan.given} | values
        )
        for name, value in values.items():
            copied.table[fields[name].index] = address_of(value if isinstance(value, np.ndarray) else value.table)
        return copied

    def _with_memory(self, plan: _Plan, table: np.ndarray, kept: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
        """Use this table, with new memory for the record's own arrays; returns as `_at`."""
        self._kept, self._plan = kept, plan
        if plan.memory:
            memory = kept[""] = np.zeros(plan.memory)
            table[plan.own] = plan.offsets + address_of(memory)
        return self._at(table)

    def __reduce_ex__(self, protocol: Any) -> Any:
        raise TypeError(f"a {type(self).__name__} is no data: it holds addresses in memory, which a copy would share")

    def _at(self, table: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Use this table; returns it, and the same memory as floats."""
        self.table, self.reals, self.address = table, table.view(np.float64), address_of(table)
        return table, self.reals

    def clear(self) -> None:
        """Set every array that the record allocated to 0."""
        if self._plan.memory:
            self._kept[""].fill(0.0)

    def lend(self, name: str, array: np.ndarray, address: int = 0) -> None:
        """Replace an array field by this array, at this address; the caller sets the fields that declare its shape."""
        self._kept[name] = array
        self.table[type(self).fields[name].index] = address or address_of(array)

    def _array(self, field: Field) -> Any:
        """An array of the record's own memory; the numpy object is made when it is first read."""
        start, shape = self._plan.shapes[field.name]
        memory = self._kept[""][start:]
        part = (memory if field.type is DOUBLE else memory.view(field.type))[: math.prod(shape)].reshape(shape)
        self._kept[field.name] = part
        return part

    def as_numbers(self) -> Any:
        """A copy of the fields of a mutable record, read at once, in a quarter of the time of one by one."""
        return self._plan.named._make(self._plan.layout.unpack_from(self.table.data))

    @classmethod
    def _over(cls, row: np.ndarray, source: Any) -> Any:
        """The same record with its table in other memory."""
        record = object.__new__(cls)
        record._kept, record._plan = source._kept, source._plan
        record._at(row)
        return record


class _Plan:
    """The layout of a record of a class with these names and sizes."""

    def __init__(self, cls: type[Record], values: dict[str, Any]) -> None:
        for name in values:
            if name not in cls.fields:
                raise TypeError(f"{cls.__name__} has no field {name!r}")
        arrays = [f for f in cls.fields.values() if f.is_array]
        self.shapes: dict[str, tuple[int, tuple[int, ...]]] = {}  # beginning in the record's own memory, and shape
        self.table, self.memory = np.zeros(len(cls.fields), dtype=np.int64), 0
        own: list[Field] = []
        for f in arrays:
            shape = tuple(int(eval(length, cls.names, values)) for length in f.lengths)
            part, start = f.sized.of, self.memory
            if part:
                start = self.shapes[part][0] + int(eval(f.sized.at, cls.names, values))
            self.shapes[f.name] = (start, shape)
            if f.name not in values:
                own.append(f)
                self.memory += 0 if part else -(-math.prod(shape) * f.type.itemsize // 8)
        self.own = np.array([f.index for f in own], dtype=np.intp)
        self.offsets = np.array([8 * self.shapes[f.name][0] for f in own], dtype=np.int64)
        self.layout = struct.Struct("".join("d" if f.is_real else "q" for f in cls.fields.values()))
        self.named: Any = namedtuple(cls.__name__, cls.fields if cls.mutable else ())  # type: ignore[misc]
        fields = [cls.fields[name] for name in values]
        self.given = [f for f in fields if f.kind not in NUMBERS]
        whole = [f for f in fields if f.kind in NUMBERS and f.kind != "float"]
        real = [f for f in fields if f.kind == "float"]
        self.whole, self.whole_at = [f.name for f in whole], [f.index for f in whole]
        self.real, self.real_at = [f.name for f in real], [f.index for f in real]


def _checked(field: Field, array: np.ndarray, shapes: dict[str, tuple[int, tuple[int, ...]]]) -> np.ndarray:
    """The array, if compiled code can read it; else TypeError or ValueError."""
    shape = shapes[field.name][1]
    if array.shape != shape:
        raise TypeError(f"{field.name} has shape {array.shape}, declared is {shape}")
    if array.dtype != field.type or not array.flags.c_contiguous:
        raise TypeError(f"{field.name} needs a contiguous array of {field.kind}")
    return array
