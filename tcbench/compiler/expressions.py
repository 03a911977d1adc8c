"""Expressions of the restricted Python as LLVM code. See `translator`, which has the statements and functions.

A value is a kind and its parts: one LLVM value for a number, a record or rows of records; pointer and lengths for an
array; one for each entry of a tuple.
"""

from __future__ import annotations

import ast
import builtins
from functools import cache
from types import FunctionType
from typing import Any

from . import language, short_vectors
from .arithmetic import INTRINSICS, LIBRARY, WHOLE, Arithmetic
from .records import Field
from .values import (
    BOOL,
    FLOAT,
    IN_MEMORY,
    INT,
    NOTHING,
    SHORT_INT,
    Array,
    RowsOf,
    Several,
    TranslationError,
    Value,
    kind_of,
    machine_kinds,
    say,
)


@cache
def _trees(lengths: tuple[str, ...]) -> tuple[ast.expr, ...]:
    return tuple(ast.parse(length, mode="eval").body for length in lengths)


class Expressions(Arithmetic):
    """The part of `Body` that emits code for names, fields, items and calls."""

    # names and constants --------------------------------------------------------------------------------------------

    def _name(self, node: ast.Name) -> Value:
        name = node.id
        if name not in self.assigned:
            value = self.outside(node)
            if value is self.module.numbers and value is not None:
                at = self.emit(f"load ptr, ptr {self.module.table()}, !invariant.load !0")
                return Value(Array(1, SHORT_INT, sized=False, fixed=True), (at,))
            return self.literal(node, value)
        if name not in self.definite:
            raise self.refusal(node, f"{name!r} is not set on every way that leads here")
        if name in self.values:
            return self.values[name]
        cell = self.cells[name]
        kinds = machine_kinds(cell.kind)
        loads = [self.emit(f"load {kind}, ptr {at}") for kind, at in zip(kinds, cell.parts, strict=True)]
        return Value(cell.kind, tuple(loads))

    def is_local(self, node: ast.expr) -> bool:
        while isinstance(node, ast.Attribute | ast.Subscript):
            node = node.value
        return not isinstance(node, ast.Name) or node.id in self.assigned

    def outside(self, node: ast.expr) -> Any:
        """The object that a global name, or an attribute of one, stands for."""
        if isinstance(node, ast.Attribute):
            owner = self.outside(node.value)
            return getattr(owner, node.attr)
        assert isinstance(node, ast.Name)
        if node.id in self.names:
            return self.names[node.id]
        if not hasattr(builtins, node.id):
            raise self.refusal(node, f"{node.id!r} is not known")
        return getattr(builtins, node.id)

    def _attribute(self, node: ast.Attribute) -> Value:
        if not self.is_local(node):
            return self.literal(node, self.outside(node))
        owner = self.value(node.value)
        fields = owner.kind.fields if isinstance(owner.kind, type) else {}  # type: ignore[attr-defined]
        if node.attr not in fields:
            raise self.refusal(node, f"{say(owner.kind)} has no field {node.attr!r}")
        return self.field(owner, fields[node.attr])

    def field_place(self, owner: Value, field: Field) -> str:
        record = self.part(owner)
        return record if field.index == 0 else self.emit(f"getelementptr i64, ptr {record}, i64 {field.index}")

    def field(self, owner: Value, field: Field) -> Value:
        place = self.field_place(owner, field)
        fixed = "" if owner.kind.mutable and field.kind in ("int", "float", "bool") else ", !invariant.load !0"
        if field.kind == "float":
            return Value(FLOAT, (self.emit(f"load double, ptr {place}{fixed}"),))
        if field.kind in ("int", "Address", "bool"):
            number = self.emit(f"load i64, ptr {place}{fixed}")
            return (
                Value(BOOL, (self.emit(f"icmp ne i64 {number}, 0"),)) if field.kind == "bool" else Value(INT, (number,))
            )
        kind = kind_of(field.kind, owner.kind.names)
        if kind is None:
            raise TranslationError(f"{owner.kind.__name__}.{field.name}: its kind {field.kind!r} is not known there.")
        pointer = self.emit(f"load ptr, ptr {place}{fixed}")
        if not isinstance(kind, Array):
            return Value(kind, (pointer,))
        lengths = tuple((lambda tree=tree: self.length(owner, tree)) for tree in _trees(field.lengths))
        return Value(kind, (pointer, *lengths))

    def length(self, owner: Value, tree: ast.expr) -> str:
        """A length of an array field, from the fields that its declaration names."""
        if isinstance(tree, ast.BinOp):
            left, right = self.length(owner, tree.left), self.length(owner, tree.right)
            return self.emit(f"{WHOLE[type(tree.op)]} nsw i64 {left}, {right}")
        if isinstance(tree, ast.Constant):
            return str(tree.value)
        assert isinstance(tree, ast.Name)
        fields = owner.kind.fields
        return self.part(self.field(owner, fields[tree.id])) if tree.id in fields else str(owner.kind.names[tree.id])

    # arrays ---------------------------------------------------------------------------------------------------------

    def _subscript(self, node: ast.Subscript) -> Value:
        if isinstance(node.value, ast.Call) and isinstance(node.slice, ast.Constant):  # one of a function's results
            results, which = self.value(node.value), int(node.slice.value)  # type: ignore[arg-type]
            if not isinstance(results.kind, Several) or which not in range(len(results.parts)):
                raise self.refusal(node, f"{say(results.kind)} has no such entry")
            return Value(results.kind.kinds[which], (results.parts[which],))
        if isinstance(node.value, ast.Name) and short_vectors.width_of((owner := self.value(node.value)).kind):
            return short_vectors.lane(self, node, owner)
        place = self.place(node)
        return self.loaded(place) if isinstance(place.kind, str) else place

    def loaded(self, place: Value) -> Value:
        """The number at a place."""
        fixed = ", !invariant.load !0" if place.fixed else ""
        kind, widens, _ = IN_MEMORY.get(place.kind, (place.kind, "", ""))
        code = self.emit(f"load {place.kind}, ptr {self.part(place)}, align {4 if widens else 8}{fixed}")
        return Value(kind, (self.emit(f"{widens} {place.kind} {code} to {kind}") if widens else code,))

    def place(self, node: ast.Subscript) -> Value:
        """Kind and address of an item; of fewer indices than axes, the part of the array; of rows, the record."""
        owner, indices = self.value(node.value), node.slice
        if isinstance(owner.kind, RowsOf):
            width = len(owner.kind.record.fields)
            offset = self.emit(f"mul nsw i64 {self.number(indices, INT)[1]}, {width}")
            return Value(owner.kind.record, (self.emit(f"getelementptr i64, ptr {self.part(owner)}, i64 {offset}"),))
        if not isinstance(owner.kind, Array):
            raise self.refusal(node, f"{say(owner.kind)} has no items")
        if isinstance(indices, ast.Slice):
            return self._slice(node, owner, indices)
        listed = indices.elts if isinstance(indices, ast.Tuple) else [indices]
        kind = owner.kind
        if len(listed) > kind.rank:
            raise self.refusal(node, f"{say(kind)} has no {len(listed)} indices")
        offset = self._index(listed[0], owner, 0)
        for axis in range(1, kind.rank):
            if offset != "0":
                offset = self.emit(f"mul nsw i64 {offset}, {self.part(owner, 1 + axis)}")
            if axis < len(listed):
                offset = self.emit(f"add nsw i64 {offset}, {self._index(listed[axis], owner, axis)}")
        at = self.offset(owner, offset)
        if len(listed) == kind.rank:
            return Value(kind.item, (at,), kind.fixed)
        return Value(Array(kind.rank - len(listed), kind.item), (at, *owner.parts[1 + len(listed) :]))

    def _index(self, node: ast.expr, owner: Value, axis: int) -> str:
        if isinstance(node, ast.Slice):
            raise self.refusal(node, "a slice of one axis among several is not translated")
        _, code = self.number(node, INT)
        if code.startswith("-"):
            return self.emit(f"add nsw i64 {self.part(owner, 1 + axis)}, {code}")
        first = node
        while isinstance(first, ast.BinOp):
            first = first.left
        if isinstance(first, ast.UnaryOp) and isinstance(first.op, ast.USub):  # other indices are not checked, as in C
            raise self.refusal(node, "an index that counts from the end is a number: write len(x) - 1 - i, not -1 - i")
        return code

    def offset(self, owner: Value, offset: str) -> str:
        if offset == "0":
            return self.part(owner)
        return self.emit(f"getelementptr {owner.kind.item}, ptr {self.part(owner)}, i64 {offset}")

    def _slice(self, node: ast.Subscript, owner: Value, cut: ast.Slice) -> Value:
        if owner.kind.rank != 1 or cut.step is not None:
            raise self.refusal(node, "only slices [start:stop] of an array with one axis are translated")
        start = self._index(cut.lower, owner, 0) if cut.lower else "0"
        stop = self._index(cut.upper, owner, 0) if cut.upper else self.part(owner, 1)
        return Value(owner.kind, (self.offset(owner, start), self.emit(f"sub nsw i64 {stop}, {start}")))

    # calls ----------------------------------------------------------------------------------------------------------

    def _call(self, node: ast.Call) -> Value:
        if self.is_local(node.func):
            raise self.refusal(node, "only functions that a module defines can be called")
        function = self.outside(node.func)
        if function in (min, max):
            return self._extreme(node, "gt" if function is max else "lt")
        if function is abs:
            if short_vectors.width_of((value := self.value(node.args[0])).kind):
                return short_vectors.elementary(self, "llvm.fabs.f64", value.kind, [self.part(value)])
            kind, x = value.kind, self.part(value)
            if kind == FLOAT:
                return Value(FLOAT, (self.machine_call("llvm.fabs.f64", x),))
            negative, minus = self.emit(f"icmp slt i64 {x}, 0"), self.emit(f"sub i64 0, {x}")
            return Value(INT, (self.emit(f"select i1 {negative}, i64 {minus}, i64 {x}"),))
        if function is len:
            array = self.value(node.args[0])
            if not isinstance(array.kind, Array) or not array.kind.sized:
                raise self.refusal(node, f"the length of {say(array.kind)} is not known here")
            return Value(INT, (self.part(array, 1),))
        if function in (int, float):
            kind, x = self.number(node.args[0])
            if function is int and kind == FLOAT:
                return Value(INT, (self.emit(f"fptosi double {x} to i64"),))
            target = INT if function is int else FLOAT
            return Value(target, (self.convert(node, Value(kind, (x,)), target),))
        if function in INTRINSICS or function in LIBRARY:
            name, values = INTRINSICS.get(function) or LIBRARY[function], [self.value(x) for x in node.args]
            if width := max(short_vectors.width_of(x.kind) for x in values):
                return short_vectors.elementary(self, name, *short_vectors.common(self, node, width, values))
            return Value(FLOAT, (self.machine_call(name, *(self.convert(node, x, FLOAT) for x in values)),))
        if function is language.bits:
            return Value(INT, (self.emit(f"bitcast double {self.number(node.args[0], FLOAT)[1]} to i64"),))
        if function is language.from_bits:
            return Value(FLOAT, (self.emit(f"bitcast i64 {self.number(node.args[0], INT)[1]} to double"),))
        if function in short_vectors.CALLS:
            return short_vectors.CALLS[function](self, node)
        if function is language.call:
            return self._kernel_call(node)
        if function is language.scratch:
            self.module.external.add("declare noalias ptr @malloc(i64)")
            size = self.emit(f"mul nsw i64 {self.number(node.args[0], INT)[1]}, 8")
            return Value(Array(sized=False), (self.emit(f"call ptr @malloc(i64 {size})"),))
        if function is language.release:
            self.module.external.add("declare void @free(ptr)")
            self.lines.append(f"  call void @free(ptr {self.part(self.value(node.args[0]))})")
            return Value(NOTHING, ())
        return self._function_call(node, function)

    def _kernel_call(self, node: ast.Call) -> Value:
        address, *arrays = [self.value(x) for x in node.args]
        if address.kind != INT or len(arrays) != 3 or not all(isinstance(a.kind, Array) for a in arrays):
            raise self.refusal(node, "call(kernel, a, b, out) takes an address and three arrays")
        pointer = self.emit(f"inttoptr i64 {self.part(address)} to ptr")
        self.lines.append(f"  call void {pointer}({', '.join(f'ptr {self.part(a)}' for a in arrays)})")
        return Value(NOTHING, ())

    def _function_call(self, node: ast.Call, function: Any) -> Value:
        if not isinstance(function, FunctionType):
            raise self.refusal(node, f"{ast.unparse(node.func)!r} is not translated")
        callee = self.module.function(function)
        arguments = dict(zip(callee.arguments, node.args, strict=False)) | {k.arg: k.value for k in node.keywords}
        if set(arguments) != set(callee.arguments) or len(node.args) + len(node.keywords) != len(callee.arguments):
            raise self.refusal(node, f"{callee.title} takes {', '.join(callee.arguments) or 'nothing'}")
        passed: dict[str, list[str]] = {}
        for name, argument in arguments.items():  # in the order in which Python evaluates them
            value, kind = self.value(argument), callee.arguments[name]
            if isinstance(kind, str):
                passed[name] = [self.convert(argument, value, kind)]
            elif value.kind != kind:
                raise self.refusal(argument, f"{say(value.kind)} stands where {callee.title} takes {say(kind)}")
            else:
                passed[name] = [self.part(value, i) for i in range(len(value.parts))]
        parts = [f"{m} {p}" for name, kind in callee.arguments.items()
                 for m, p in zip(machine_kinds(kind), passed[name], strict=True)]  # fmt: skip
        at = self.emit(f"load ptr, ptr {callee.name}") if callee.late else callee.name
        code = f"call {callee.result_code} {at}({', '.join(parts)})"
        if callee.result == NOTHING:
            self.lines.append(f"  {code}")
            return Value(NOTHING, ())
        result = self.emit(code)
        if isinstance(callee.result, str):
            return Value(callee.result, (result,))
        n = len(callee.result.kinds)
        return Value(
            callee.result, tuple(self.emit(f"extractvalue {callee.result_code} {result}, {i}") for i in range(n))
        )
