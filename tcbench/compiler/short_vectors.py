"""Short vectors in the text of kernels: a few numbers on which arithmetic is done at once.

`vector`, `row`, `pick` and `put` of `language` make them, read them, mix their lanes and store them; +, -, * and / of
two vectors, or of a vector and a number, act lane by lane. LLVM maps them to what the processor has.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

from . import language
from .values import FLOAT, INT, NOTHING, Array, Several, Value, constant, say
from .vector_functions import VectorFunctions

if TYPE_CHECKING:
    from .arithmetic import Arithmetic
    from .expressions import Expressions


WRITTEN, OF_VECTORS = ("llvm.exp.f64", "llvm.log.f64"), ("llvm.sqrt.f64", "llvm.fabs.f64")


def kind_of_width(width: int) -> str:
    return f"<{width} x {FLOAT}>"


@cache
def width_of(kind: Any) -> int:
    """The number of lanes of a vector of this kind; 0 for other kinds."""
    match = re.match(r"<(\d+) x", kind) if isinstance(kind, str) else None
    return int(match[1]) if match else 0


def _everywhere(body: Arithmetic, width: int, number: str) -> str:
    """The vector with this number in every lane."""
    kind = kind_of_width(width)
    if not number.startswith("%"):
        return f"<{', '.join([f'{FLOAT} {number}'] * width)}>"
    first = body.emit(f"insertelement {kind} poison, {FLOAT} {number}, i64 0")
    return body.emit(f"shufflevector {kind} {first}, {kind} poison, <{width} x i32> zeroinitializer")


def common(body: Arithmetic, node: ast.AST, width: int, values: Sequence[Value]) -> tuple[str, list[str]]:
    """Values as vectors of this width; numbers are repeated in every lane."""
    codes = []
    for value in values:
        if width_of(value.kind) not in (0, width):
            raise body.refusal(node, f"{' and '.join(say(v.kind) for v in values)} have no common kind")
        wide = width_of(value.kind) == width
        codes.append(body.part(value) if wide else _everywhere(body, width, body.convert(node, value, FLOAT)))
    return kind_of_width(width), codes


def lane(body: Expressions, node: ast.Subscript, owner: Value) -> Value:
    """vector[i], i a constant."""
    i = node.slice.value if isinstance(node.slice, ast.Constant) else None
    if not isinstance(i, int) or i not in range(width_of(owner.kind)):
        raise body.refusal(node, f"{say(owner.kind)} has no such lane")
    return Value(FLOAT, (body.emit(f"extractelement {owner.kind} {body.part(owner)}, i64 {i}"),))


def _vector(body: Expressions, node: ast.Call) -> Value:
    numbers = [body.number(x, FLOAT)[1] for x in node.args]
    kind = kind_of_width(len(numbers))
    lane_values = [number if not number.startswith("%") else constant(0.0) for number in numbers]
    code = f"<{', '.join(f'{FLOAT} {number}' for number in lane_values)}>"
    for i, number in enumerate(numbers):
        if number.startswith("%"):
            code = body.emit(f"insertelement {kind} {code}, {FLOAT} {number}, i64 {i}")
    return Value(kind, (code,))


def _place(body: Expressions, node: ast.Call, array: ast.expr, start: ast.expr) -> str:
    owner = body.value(array)
    if not isinstance(owner.kind, Array) or owner.kind.rank != 1 or owner.kind.item != FLOAT:
        raise body.refusal(node, f"{say(owner.kind)} has no row of numbers")
    return body.offset(owner, body.number(start, INT)[1])


def _row(body: Expressions, node: ast.Call) -> Value:
    array, start, count = node.args
    if not isinstance(count, ast.Constant) or not isinstance(count.value, int):
        raise body.refusal(node, "the length of a vector is a constant")
    kind = kind_of_width(count.value)
    return Value(kind, (body.emit(f"load {kind}, ptr {_place(body, node, array, start)}, align 8"),))


def _put(body: Expressions, node: ast.Call) -> Value:
    array, start, lane_value = node.args
    value = body.value(lane_value)
    if not width_of(value.kind):
        raise body.refusal(node, f"{say(value.kind)} stands where a vector is needed")
    at = _place(body, node, array, start)
    body.lines.append(f"  store {value.kind} {body.part(value)}, ptr {at}, align 8")
    return Value(NOTHING, ())


def _pick(body: Expressions, node: ast.Call) -> Value:
    first, second = (body.value(x) for x in node.args[:2])
    lanes = [x.value for x in node.args[2:] if isinstance(x, ast.Constant) and isinstance(x.value, int)]
    width = width_of(first.kind)
    valid = len(lanes) == len(node.args) - 2 and all(x in range(2 * width) for x in lanes)
    if not width or second.kind != first.kind or not valid:
        raise body.refusal(node, "pick(x, y, lanes...) takes two vectors of one length and which of their lanes")
    mask = f"<{len(lanes)} x i32> <{', '.join(f'i32 {x}' for x in lanes)}>"
    code = f"shufflevector {first.kind} {body.part(first)}, {first.kind} {body.part(second)}, {mask}"
    return Value(kind_of_width(len(lanes)), (body.emit(code),))


def _two_product(body: Expressions, node: ast.Call) -> Value:
    """`language.two_product` by fused multiply-add, to the last bit; C has it where the processor has not."""
    values = [body.value(x) for x in node.args]
    kind = next((x.kind for x in values if width_of(x.kind)), FLOAT)
    x, y = (body.part(v) if v.kind == kind else body.convert(node, v, kind) for v in values)
    fma = f"llvm.fma.{f'v{width_of(kind)}f64' if width_of(kind) else 'f64'}"
    body.module.external.add(f"declare {kind} @{fma}({kind}, {kind}, {kind})")
    product = body.emit(f"fmul {kind} {x}, {y}")
    minus = body.emit(f"fneg {kind} {product}")
    rest = body.emit(f"call {kind} @{fma}({kind} {x}, {kind} {y}, {kind} {minus})")
    return Value(Several((kind, kind)), (product, rest))


def elementary(body: Arithmetic, name: str, kind: Any, values: Sequence[str]) -> Value:
    """A function of C on vectors: some for all lanes at once, others lane by lane."""
    width = width_of(kind)
    if name in WRITTEN:
        return Value(kind, (getattr(VectorFunctions(body.emit, width), name.split(".")[1])(*values),))
    if name in OF_VECTORS:
        full = f"{name.rpartition('.')[0]}.v{width}f64"
        body.module.external.add(f"declare {kind} @{full}({kind})")
        return Value(kind, (body.emit(f"call {kind} @{full}({kind} {values[0]})"),))
    code = "poison"
    for i in range(width):
        lanes = [body.emit(f"extractelement {kind} {x}, i64 {i}") for x in values]
        code = body.emit(f"insertelement {kind} {code}, {FLOAT} {body.machine_call(name, *lanes)}, i64 {i}")
    return Value(kind, (code,))


CALLS: dict[Any, Callable[[Expressions, ast.Call], Value]] = {
    language.vector: _vector, language.row: _row, language.put: _put, language.pick: _pick,
    language.two_product: _two_product,
}  # fmt: skip
