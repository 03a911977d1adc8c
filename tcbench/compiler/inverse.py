"""Solves f(x) = y symbolically for a variable x that occurs once in f, by inverting one operation after the other."""

from __future__ import annotations

from . import ops
from .derivatives import Symbol, depends_on, refused

WHY = (
    "A formula is solved for a variable that stands in it once, under +, -, *, /, "
    f"{', '.join(row.numpy for row in ops.OPERATIONS.values() if row.inverse and row.numpy)} "
    "and powers with another exponent than 2; methods in entropies (tc_monolithic) take every energy"
)


def solved(f: Symbol, x: Symbol, y: Symbol) -> Symbol:
    """The x at which f(x) is y; TraceError where x stands in f several times, or under what has no inverse."""
    moving = depends_on([f], [x])
    while f is not x:
        held = [a for a in f.args if a.number in moving]
        if len(held) != 1:
            raise refused("an energy cannot be solved for its entropy, which it does not hold just once", WHY)
        (inner,) = held
        others = [a for a in f.args if a is not inner]
        y, f = _inverted(f, inner, others, y), inner
    return y


def _inverted(node: Symbol, inner: Symbol, others: list[Symbol], y: Symbol) -> Symbol:
    """The value of `inner` for which that of `node` is y."""
    if inverse := ops.OPERATIONS[node.op].inverse:
        inverted: Symbol = inverse(y)
        return inverted
    if others and node.op in ("add", "sub", "mul", "pow"):
        (other,) = others
        first = node.args[0] is inner
        if node.op == "add":
            return y - other
        if node.op == "sub":
            return y + other if first else other - y
        if node.op == "mul":
            return y / other
        return y ** (1.0 / other) if first else y.log() / other.log()
    raise refused(f"an energy cannot be solved for its entropy: {node.op!r} cannot be undone", WHY)
