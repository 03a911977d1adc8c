"""Expressions of the restricted Python as LLVM code. See `translator`, which has the statements and functions.

A value is a kind and its parts: one LLVM value for a number, a record or rows of records; pointer and lengths for an
array; one for each entry of a tuple. Arithmetic is Python's: // and % round down, int/int is a float, and/or/if take
one way only. It differs in what floats do at their limits: 1/0 is infinite, as in numpy, and products may be fused with
sums.
"""

from __future__ import annotations

import ast
import builtins
from collections.abc import Mapping
from typing import Any

import numpy as np

from . import language
from .records import Field
from .values import (
    ARITHMETIC,
    BOOL,
    COMPARISONS,
    FLOAT,
    FUSED,
    INT,
    INTRINSICS,
    LIBRARY,
    NOTHING,
    Array,
    RowsOf,
    Several,
    TranslationError,
    Value,
    constant,
    machine_kinds,
    say,
)


class Expressions:
    """What `Body` needs to evaluate an expression at the place where its text ends."""

    module: Any  # of translator: declares what is called
    names: Mapping[str, Any]  # globals of the function
    lines: list[str]
    values: dict[str, Value]  # names that are assigned once
    cells: dict[str, Value]  # names that are assigned again: kind, addresses
    assigned: dict[str, int]  # how often each local name is
    known: set[str]  # local names that are set on every way that leads here
    block: str
    count = 0

    def refusal(self, node: ast.AST, why: str) -> TranslationError:
        raise NotImplementedError

    def emit(self, code: str) -> str:
        self.count += 1
        name = f"%.{self.count}"
        self.lines.append(f"  {name} = {code}")
        return name

    def start_block(self, label: str) -> None:
        self.lines.append(f"{label}:")
        self.block = label

    def label(self, what: str) -> str:
        self.count += 1
        return f".{what}{self.count}"

    def value(self, node: ast.expr) -> Value:
        method = getattr(self, f"_{type(node).__name__.lower()}", None)
        if method is None:
            raise self.refusal(node, "this kind of expression is not translated")
        return method(node)

    def part(self, value: Value, i: int = 0) -> str:
        part = value.parts[i]
        return part if isinstance(part, str) else part()

    def number(self, node: ast.expr, kind: str = "") -> tuple[str, str]:
        """(kind, LLVM value) of a number; converted where a kind is asked for."""
        value = self.value(node)
        if not isinstance(value.kind, str) or value.kind == NOTHING:
            raise self.refusal(node, "a number is needed here")
        return (kind, self.convert(node, value, kind)) if kind else (value.kind, self.part(value))

    def convert(self, node: ast.AST, value: Value, kind: str) -> str:
        """The number as another kind, where Python would take it as that: bool as int, int as float."""
        code = self.part(value)
        if value.kind == kind:
            return code
        if value.kind == BOOL and kind in (INT, FLOAT):
            return self.emit(f"zext i1 {code} to i64" if kind == INT else f"uitofp i1 {code} to double")
        if value.kind == INT and kind == FLOAT:
            digits = code.lstrip("-").isdigit()
            return constant(float(code)) if digits else self.emit(f"sitofp i64 {code} to double")
        raise self.refusal(node, f"{say(value.kind)} stands where {say(kind)} is needed")

    def common_kind(self, node: ast.AST, kinds: list[Any]) -> str:
        """The kind that numbers of these kinds become in an operation of both."""
        if not all(k in (INT, FLOAT, BOOL) for k in kinds):
            raise self.refusal(node, f"{' and '.join(map(say, kinds))} have no common kind")
        return kinds[0] if len(set(kinds)) == 1 else FLOAT if FLOAT in kinds else INT

    def common(self, node: ast.AST, values: list[Value]) -> tuple[str, list[str]]:
        kind = self.common_kind(node, [v.kind for v in values])
        return kind, [self.convert(node, v, kind) for v in values]

    # names and constants --------------------------------------------------------------------------------------------

    def _constant(self, node: ast.Constant) -> Value:
        return self.literal(node, node.value)

    def literal(self, node: ast.AST, value: Any) -> Value:
        if isinstance(value, bool | np.bool_):
            return Value(BOOL, ("true" if value else "false",))
        if isinstance(value, int | np.integer):
            return Value(INT, (str(int(value)),))
        if isinstance(value, float | np.floating):
            return Value(FLOAT, (constant(float(value)),))
        raise self.refusal(node, f"{value!r} is no number")

    def _name(self, node: ast.Name) -> Value:
        name = node.id
        if name not in self.assigned:
            return self.literal(node, self.outside(node))
        if name not in self.known:
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
            return getattr(self.outside(node.value), node.attr)
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
        if field.kind in ("int", "Kernel", "bool"):
            number = self.emit(f"load i64, ptr {place}{fixed}")
            return (
                Value(BOOL, (self.emit(f"icmp ne i64 {number}, 0"),)) if field.kind == "bool" else Value(INT, (number,))
            )
        kind = self.module.kind_of(field.kind, owner.kind.names)
        pointer = self.emit(f"load ptr, ptr {place}{fixed}")
        if not isinstance(kind, Array):
            return Value(kind, (pointer,))
        lengths = tuple((lambda tree=tree: self.length(owner, tree)) for tree in field.trees)
        return Value(kind, (pointer, *lengths))

    def length(self, owner: Value, tree: ast.expr) -> str:
        """A length of an array field, from the fields that its declaration names."""
        if isinstance(tree, ast.BinOp):
            left, right = self.length(owner, tree.left), self.length(owner, tree.right)
            return self.emit(f"{ARITHMETIC[type(tree.op)][0]} nsw i64 {left}, {right}")
        if isinstance(tree, ast.Constant):
            return str(tree.value)
        assert isinstance(tree, ast.Name)
        fields = owner.kind.fields
        return self.part(self.field(owner, fields[tree.id])) if tree.id in fields else str(owner.kind.names[tree.id])

    # arithmetic -----------------------------------------------------------------------------------------------------

    def _unaryop(self, node: ast.UnaryOp) -> Value:
        if isinstance(node.op, ast.Not):
            return Value(BOOL, (self.emit(f"xor i1 {self.truth(node.operand)}, true"),))
        kind, code = self.number(node.operand)
        if not isinstance(node.op, ast.USub) or kind == BOOL:
            raise self.refusal(node, "of operations with one operand, - of a number and not are translated")
        if isinstance(node.operand, ast.Constant):
            return self.literal(node, -node.operand.value)  # type: ignore[operator]
        return Value(kind, (self.emit(f"sub i64 0, {code}" if kind == INT else f"fneg double {code}"),))

    def truth(self, node: ast.expr) -> str:
        value = self.value(node)
        if value.kind != BOOL:
            raise self.refusal(node, f"{say(value.kind)} stands where a bool is needed: compare it with something")
        return self.part(value)

    def _binop(self, node: ast.BinOp) -> Value:
        if isinstance(node.op, ast.Pow):
            return self._power(node)
        return self.binary(node, node.op, self.value(node.left), self.value(node.right))

    def binary(self, node: ast.AST, operation: ast.operator, left: Value, right: Value) -> Value:
        kind, (x, y) = self.common(node, [left, right])
        if kind == BOOL or (kind == INT and isinstance(operation, ast.Div)):
            kind = FLOAT if isinstance(operation, ast.Div) else INT
            x, y = self.convert(node, left, kind), self.convert(node, right, kind)
        if isinstance(operation, ast.Div):
            return Value(FLOAT, (self.emit(f"fdiv {FUSED} double {x}, {y}"),))
        if type(operation) in ARITHMETIC:
            whole, real = ARITHMETIC[type(operation)]
            code = f"{whole} nsw i64 {x}, {y}" if kind == INT else f"{real} {FUSED} double {x}, {y}"
            return Value(kind, (self.emit(code),))
        if isinstance(operation, ast.Mod | ast.FloorDiv):
            if kind == INT:
                return Value(INT, (self._floor(x, y)[isinstance(operation, ast.Mod)],))
            if isinstance(operation, ast.Mod):
                return Value(FLOAT, (self._float_remainder(x, y),))
        raise self.refusal(node, "this operation is not translated")

    def _floor(self, x: str, y: str) -> tuple[str, str]:
        """Quotient and remainder, rounded down as Python does; of a division by 0, which Python refuses, by 1."""
        if not y.isdigit() or y == "0":
            y = self.emit(f"select i1 {self.emit(f'icmp eq i64 {y}, 0')}, i64 1, i64 {y}")
        quotient, rest = self.emit(f"sdiv i64 {x}, {y}"), self.emit(f"srem i64 {x}, {y}")
        signs = self.emit(f"icmp slt i64 {self.emit(f'xor i64 {rest}, {y}')}, 0")
        below = self.emit(f"and i1 {signs}, {self.emit(f'icmp ne i64 {rest}, 0')}")
        down, up = self.emit(f"sub i64 {quotient}, 1"), self.emit(f"add i64 {rest}, {y}")
        return tuple(self.emit(f"select i1 {below}, i64 {a}, i64 {b}") for a, b in ((down, quotient), (up, rest)))  # type: ignore[return-value]

    def _float_remainder(self, x: str, y: str) -> str:
        rest = self.emit(f"frem double {x}, {y}")
        signs = [self.emit(f"fcmp olt double {z}, 0.0") for z in (rest, y)]
        nonzero = self.emit(f"fcmp one double {rest}, 0.0")
        other = self.emit(f"and i1 {self.emit(f'xor i1 {signs[0]}, {signs[1]}')}, {nonzero}")
        return self.emit(f"select i1 {other}, double {self.emit(f'fadd double {rest}, {y}')}, double {rest}")

    def _power(self, node: ast.BinOp) -> Value:
        _, x = self.number(node.left, FLOAT)
        if isinstance(node.right, ast.Constant) and node.right.value == 2:
            return Value(FLOAT, (self.emit(f"fmul {FUSED} double {x}, {x}"),))
        _, y = self.number(node.right, FLOAT)
        return Value(FLOAT, (self.machine_call("llvm.pow.f64", x, y),))

    def _compare(self, node: ast.Compare) -> Value:
        if len(node.ops) != 1:
            raise self.refusal(node, "a chain of comparisons: write them one by one, with and")
        operation, other = node.ops[0], node.comparators[0]
        if isinstance(operation, ast.In | ast.NotIn) and isinstance(other, ast.Tuple):
            left, found = self.value(node.left), "false"
            for x in other.elts:
                found = self.emit(f"or i1 {found}, {self.compared(node, ast.Eq, left, self.value(x))}")
            return Value(BOOL, (found if isinstance(operation, ast.In) else self.emit(f"xor i1 {found}, true"),))
        if type(operation) not in COMPARISONS:
            raise self.refusal(node, "this comparison is not translated")
        return Value(BOOL, (self.compared(node, type(operation), self.value(node.left), self.value(other)),))

    def compared(self, node: ast.AST, operation: type, left: Value, right: Value) -> str:
        kind, (x, y) = self.common(node, [left, right])
        whole, real = COMPARISONS[operation]
        if kind == BOOL and whole not in ("eq", "ne"):
            raise self.refusal(node, "an order of bools is not translated")
        return self.emit(f"fcmp {real} double {x}, {y}" if kind == FLOAT else f"icmp {whole} {kind} {x}, {y}")

    def _boolop(self, node: ast.BoolOp) -> Value:
        """and, or: what follows is evaluated only where it matters."""
        over, ways = self.label("over"), []
        for x in node.values[:-1]:
            test, more = self.truth(x), self.label("more")
            first, second = (more, over) if isinstance(node.op, ast.And) else (over, more)
            self.lines.append(f"  br i1 {test}, label %{first}, label %{second}")
            ways.append(f"[ {'false' if isinstance(node.op, ast.And) else 'true'}, %{self.block} ]")
            self.start_block(more)
        ways.append(f"[ {self.truth(node.values[-1])}, %{self.block} ]")
        self.lines.append(f"  br label %{over}")
        self.start_block(over)
        return Value(BOOL, (self.emit(f"phi i1 {', '.join(ways)}"),))

    def _ifexp(self, node: ast.IfExp) -> Value:
        """x if test else y, of numbers: a branch that LLVM turns into a selection where that is cheaper."""
        test, (yes, no, join) = self.truth(node.test), [self.label(x) for x in ("yes", "no", "join")]
        self.lines.append(f"  br i1 {test}, label %{yes}, label %{no}")
        self.start_block(yes)
        first, first_block, end_of_first = self.value(node.body), self.block, len(self.lines)
        self.start_block(no)
        second = self.value(node.orelse)
        kind = self.common_kind(node, [first.kind, second.kind])
        ways = [f"[ {self.convert(node, second, kind)}, %{self.block} ]"]
        rest = [*self.lines[end_of_first:], f"  br label %{join}"]
        del self.lines[end_of_first:]
        ways.append(f"[ {self.convert(node, first, kind)}, %{first_block} ]")
        self.lines += [f"  br label %{join}", *rest]
        self.start_block(join)
        return Value(kind, (self.emit(f"phi {kind} {', '.join(ways)}"),))

    def _tuple(self, node: ast.Tuple) -> Value:
        values = [self.number(x) for x in node.elts]
        return Value(Several(tuple(kind for kind, _ in values)), tuple(code for _, code in values))

    # arrays ---------------------------------------------------------------------------------------------------------

    def _subscript(self, node: ast.Subscript) -> Value:
        if isinstance(node.value, ast.Call) and isinstance(node.slice, ast.Constant):  # one of a function's results
            results, which = self.value(node.value), int(node.slice.value)  # type: ignore[arg-type]
            if not isinstance(results.kind, Several) or which not in range(len(results.parts)):
                raise self.refusal(node, f"{say(results.kind)} has no such entry")
            return Value(results.kind.kinds[which], (results.parts[which],))
        place = self.place(node)
        if isinstance(place.kind, str):
            return Value(place.kind, (self.emit(f"load {place.kind}, ptr {self.part(place)}, align 8"),))
        return place

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
            return Value(kind.item, (at,))
        return Value(Array(kind.rank - len(listed), kind.item), (at, *owner.parts[1 + len(listed) :]))

    def _index(self, node: ast.expr, owner: Value, axis: int) -> str:
        if isinstance(node, ast.Slice):
            raise self.refusal(node, "a slice of one axis among several is not translated")
        _, code = self.number(node, INT)
        return self.emit(f"add nsw i64 {self.part(owner, 1 + axis)}, {code}") if code.startswith("-") else code

    def offset(self, owner: Value, offset: str) -> str:
        if offset == "0":
            return self.part(owner)
        return self.emit(f"getelementptr {owner.kind.item}, ptr {self.part(owner)}, i64 {offset}")

    def _slice(self, node: ast.Subscript, owner: Value, cut: ast.Slice) -> Value:
        if owner.kind.rank != 1 or cut.step is not None:
            raise self.refusal(node, "only slices [start:stop] of an array with one axis are translated")
        start = self.number(cut.lower, INT)[1] if cut.lower else "0"
        stop = self.number(cut.upper, INT)[1] if cut.upper else self.part(owner, 1)
        return Value(owner.kind, (self.offset(owner, start), self.emit(f"sub nsw i64 {stop}, {start}")))

    # calls ----------------------------------------------------------------------------------------------------------

    def machine_call(self, name: str, *args: str) -> str:
        self.module.declare(name, len(args))
        return self.emit(f"call double @{name}({', '.join(f'double {a}' for a in args)})")

    def _call(self, node: ast.Call) -> Value:
        if self.is_local(node.func):
            raise self.refusal(node, "only functions that a module defines can be called")
        function = self.outside(node.func)
        if function in (min, max):
            return self._extreme(node, "gt" if function is max else "lt")
        if function is abs:
            kind, x = self.number(node.args[0])
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
            _, x = self.number(node.args[0], FLOAT)
            return Value(FLOAT, (self.machine_call(INTRINSICS.get(function) or LIBRARY[function], x),))
        if function is language.call:
            return self._kernel_call(node)
        return self._function_call(node, function)

    def _extreme(self, node: ast.Call, beyond: str) -> Value:
        """As in Python: the first, unless a later one is beyond it."""
        kind, (best, *others) = self.common(node, [self.value(x) for x in node.args])
        code = f"fcmp o{beyond} double" if kind == FLOAT else f"icmp s{beyond} {kind}"
        for other in others:
            test = self.emit(f"{code} {other}, {best}")
            best = self.emit(f"select i1 {test}, {kind} {other}, {kind} {best}")
        return Value(kind, (best,))

    def _kernel_call(self, node: ast.Call) -> Value:
        address, *arrays = [self.value(x) for x in node.args]
        if address.kind != INT or len(arrays) != 3 or not all(isinstance(a.kind, Array) for a in arrays):
            raise self.refusal(node, "call(kernel, a, b, out) takes an address and three arrays")
        pointer = self.emit(f"inttoptr i64 {self.part(address)} to ptr")
        self.lines.append(f"  call void {pointer}({', '.join(f'ptr {self.part(a)}' for a in arrays)})")
        return Value(NOTHING, ())

    def _function_call(self, node: ast.Call, function: Any) -> Value:
        if not callable(function) or not hasattr(function, "__code__"):
            raise self.refusal(node, f"{ast.unparse(node.func)!r} is not translated")
        callee = self.module.function(function)
        given = dict(zip(callee.arguments, node.args, strict=False)) | {k.arg: k.value for k in node.keywords}
        if set(given) != set(callee.arguments) or len(node.args) + len(node.keywords) != len(callee.arguments):
            raise self.refusal(node, f"{callee.title} takes {', '.join(callee.arguments) or 'nothing'}")
        passed: dict[str, list[str]] = {}
        for name, argument in given.items():  # in the order in which Python evaluates them
            value, kind = self.value(argument), callee.arguments[name]
            if isinstance(kind, str):
                passed[name] = [self.convert(argument, value, kind)]
            elif value.kind != kind:
                raise self.refusal(argument, f"{say(value.kind)} stands where {callee.title} takes {say(kind)}")
            else:
                passed[name] = [self.part(value, i) for i in range(len(value.parts))]
        parts = [f"{m} {p}" for name, kind in callee.arguments.items()
                 for m, p in zip(machine_kinds(kind), passed[name], strict=True)]  # fmt: skip
        code = f"call {callee.result_code} {callee.name}({', '.join(parts)})"
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
