"""Arithmetic and logic of the restricted Python as LLVM code. See `translator`.

It is Python's: // and % round down, int/int is a float, and/or/if take one way only. It differs in what floats do at
their limits: 1/0 is infinite, as in numpy, and products may be fused with sums.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import numpy as np

from . import ops, short_vectors
from .values import BOOL, FLOAT, INT, NOTHING, Several, TranslationError, Value, constant, say

WHOLE = {ast.Add: "add", ast.Sub: "sub", ast.Mult: "mul"}
REAL: dict[type, str] = {ast.Add: "fadd", ast.Sub: "fsub", ast.Mult: "fmul", ast.Div: "fdiv"}
COMPARISONS: dict[type, tuple[str, str]] = {
    ast.Lt: ("slt", "olt"), ast.LtE: ("sle", "ole"), ast.Gt: ("sgt", "ogt"), ast.GtE: ("sge", "oge"),
    ast.Eq: ("eq", "oeq"), ast.NotEq: ("ne", "une"),
}  # fmt: skip
OF_C = [row for row in ops.OPERATIONS.values() if hasattr(math, row.name)]
INTRINSICS: dict[Any, str] = {
    f: f"llvm.{row.name}.f64"
    for row in OF_C if row.intrinsic for f in (getattr(math, row.name), getattr(np, row.name), row.value)
}  # fmt: skip
LIBRARY: dict[Any, str] = {  # of C, with one argument or two
    f: row.name for row in OF_C if not row.intrinsic for f in (getattr(math, row.name), row.value)
}


@cache
def handler(kind: str) -> str:
    """Name of the method for nodes of this kind."""
    return f"_{kind.lower()}"


class Arithmetic:
    """The part of `Body` that emits code for arithmetic and logic at the end of its text."""

    module: Any  # translator.Module: declares the functions that are called
    function: Any  # translator.Function that is translated
    names: Mapping[str, Any]  # globals of the function
    lines: list[str]
    values: dict[str, Value]  # names that are assigned once
    cells: dict[str, Value]  # names that are assigned again: kind, addresses
    assigned: dict[str, int]  # number of assignments to each local name
    definite: set[str]  # local names that every way to this place has assigned
    block: str
    refusal: Callable[[ast.AST, str], TranslationError]  # the error that names the line of a node
    count = 0

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
        method: Callable[[ast.expr], Value] | None = getattr(self, handler(type(node).__name__), None)
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
        """The number converted as Python does: bool to int, int to float; a refusal otherwise."""
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
        """The kind of the result of an operation on numbers of these kinds."""
        if not all(k in (INT, FLOAT, BOOL) for k in kinds):
            raise self.refusal(node, f"{' and '.join(map(say, kinds))} have no common kind")
        return kinds[0] if len(set(kinds)) == 1 else FLOAT if FLOAT in kinds else INT

    def common(self, node: ast.AST, values: list[Value]) -> tuple[str, list[str]]:
        kind = self.common_kind(node, [v.kind for v in values])
        return kind, [self.convert(node, v, kind) for v in values]

    def _constant(self, node: ast.Constant) -> Value:
        return self.literal(node, node.value)

    def literal(self, node: ast.AST, value: Any) -> Value:
        if isinstance(value, bool | np.bool_):
            return Value(BOOL, ("true" if value else "false",))
        if isinstance(value, int | np.integer):
            return Value(INT, (str(int(value)),))
        if isinstance(value, float | np.floating):
            return Value(FLOAT, (constant(float(value)),))
        raise self.refusal(node, f"{value!r} is no number: what is more is passed as an argument")

    def machine_call(self, name: str, *args: str) -> str:
        self.module.declare(name, len(args))
        return self.emit(f"call double @{name}({', '.join(f'double {a}' for a in args)})")

    def _unaryop(self, node: ast.UnaryOp) -> Value:
        if isinstance(node.op, ast.Not):
            return Value(BOOL, (self.emit(f"xor i1 {self.truth(node.operand)}, true"),))
        kind, code = self.number(node.operand)
        if not isinstance(node.op, ast.USub) or kind == BOOL:
            raise self.refusal(node, "of operations with one operand, - of a number and not are translated")
        if isinstance(node.operand, ast.Constant):
            return self.literal(node, -node.operand.value)  # type: ignore[operator]
        return Value(kind, (self.emit(f"sub i64 0, {code}" if kind == INT else f"fneg {kind} {code}"),))

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
        width = 0
        if left.kind == FLOAT and right.kind == FLOAT:  # nearly all of them
            kind, x, y = FLOAT, self.part(left), self.part(right)
        elif width := short_vectors.width_of(left.kind) or short_vectors.width_of(right.kind):
            kind, (x, y) = short_vectors.common(self, node, width, [left, right])
        else:
            kind, (x, y) = self.common(node, [left, right])
        if kind == BOOL or (kind == INT and isinstance(operation, ast.Div)):
            kind = FLOAT if isinstance(operation, ast.Div) else INT
            x, y = self.convert(node, left, kind), self.convert(node, right, kind)
        how = type(operation)
        if kind != INT and how in REAL:  # of doubles and of vectors alike
            return Value(kind, (self.emit(f"{REAL[how]} {self.function.fused} {kind} {x}, {y}"),))
        if kind == INT and how in WHOLE:
            return Value(kind, (self.emit(f"{WHOLE[how]} nsw i64 {x}, {y}"),))
        if width:
            raise self.refusal(node, "of vectors, +, -, * and / are translated")
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
            return Value(FLOAT, (self.emit(f"fmul {self.function.fused} double {x}, {x}"),))
        _, y = self.number(node.right, FLOAT)
        return Value(FLOAT, (self.machine_call("llvm.pow.f64", x, y),))

    def _compare(self, node: ast.Compare) -> Value:
        if len(node.ops) != 1:
            raise self.refusal(node, "a chain of comparisons: write them one by one, with and")
        operation, other = node.ops[0], node.comparators[0]
        if isinstance(operation, ast.In | ast.NotIn) and isinstance(other, ast.Tuple):
            left, matches = self.value(node.left), "false"
            for x in other.elts:
                matches = self.emit(f"or i1 {matches}, {self.compared(node, ast.Eq, left, self.value(x))}")
            return Value(BOOL, (matches if isinstance(operation, ast.In) else self.emit(f"xor i1 {matches}, true"),))
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
        """and, or: later operands are evaluated only where they matter."""
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

    def _extreme(self, node: ast.Call, beyond: str) -> Value:
        """min or max as in Python: the first operand, unless a later one is beyond it."""
        kind, (best, *others) = self.common(node, [self.value(x) for x in node.args])
        code = f"fcmp o{beyond} double" if kind == FLOAT else f"icmp s{beyond} {kind}"
        for other in others:
            test = self.emit(f"{code} {other}, {best}")
            best = self.emit(f"select i1 {test}, {kind} {other}, {kind} {best}")
        return Value(kind, (best,))
