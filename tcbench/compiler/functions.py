"""Functions of symbols beside numpy's own: extremes, guards, and what divided differences are made of."""

from __future__ import annotations

from collections.abc import Iterable

from .symbols import Symbol, add, const, intern, is_const


def maximum(a: Symbol, b: Symbol) -> Symbol:
    """max(a, b); has no derivative, and drops a NaN: `guarded` keeps it."""
    return intern("max", (a, b))


def minimum(a: Symbol, b: Symbol) -> Symbol:
    """min(a, b); as `maximum`."""
    return intern("min", (a, b))


def guarded(value: Symbol, terms: Iterable[Symbol]) -> Symbol:
    """The value, or NaN if any of the terms is not finite."""
    total = const(0.0)
    for term in terms:
        total = add(total, term)
    return intern("guard", (value, total))


def phi(x: Symbol) -> Symbol:
    """expm1(x)/x, 1 at 0: the divided difference of exp, dimensionless."""
    return const(1.0) if is_const(x, 0.0) else intern("phi", (x,))


def lam(x: Symbol) -> Symbol:
    """log1p(x)/x, 1 at 0: the divided difference of log, dimensionless."""
    return const(1.0) if is_const(x, 0.0) else intern("lam", (x,))


def sinc(x: Symbol) -> Symbol:
    """sin(x)/x, 1 at 0: what the divided differences of sin and cos are made of."""
    return const(1.0) if is_const(x, 0.0) else intern("sinc", (x,))


def mark(x: Symbol) -> Symbol:
    """The same value, as an intermediate through which derivatives are accumulated (it saves operations, e.g. when
    everything in an element depends on all positions through one strain measure)."""
    return x if x.op in ("const", "var", "mark") else intern("mark", (x,))
