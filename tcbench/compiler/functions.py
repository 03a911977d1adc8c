"""Functions of symbols beside numpy's own: powers (by products, by roots, or by the exponentials and logarithms that
they are made of), extremes, guards, and what divided differences are made of."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import reduce
from typing import Any

from .symbols import Symbol, add, const, intern, is_const, lifted, make, mul, reciprocal

MOST_FACTORS = 64  # of a power that is written as products


def power(base: Symbol, exponent: Any) -> Symbol:
    """base ** exponent: whole numbers up to 64 by products, which take any base, and their halves by a root; another
    power of a product with an exponential in it as one exponential: (exp(s) / v)^c is exp(c (s - log v))."""
    exponent = lifted(exponent)
    wanted = exponent.value if is_const(exponent) else math.inf
    if wanted > 0 and 2 * wanted <= MOST_FACTORS and wanted % 1 == 0.5:
        return mul(make("sqrt", base), power(base, wanted - 0.5))
    if not abs(wanted) <= MOST_FACTORS or wanted != int(wanted):
        logarithm = _logarithm(base) if math.isfinite(wanted) and wanted % 1 else None  # of a root the base is positive
        return make("pow", base, exponent) if logarithm is None else mul(exponent, logarithm).exp()
    result, square, n = const(1.0), base, abs(int(wanted))
    while n:
        if n & 1:
            result = mul(result, square)
        square, n = mul(square, square), n >> 1
    return result if wanted >= 0 else reciprocal(result)


def _logarithm(product: Symbol) -> Symbol | None:
    """Of a product with exponentials in it, which is positive where the rest is; None of another."""
    factors, exponents, rest = [product], list[Symbol](), list[Symbol]()
    while factors:
        x = factors.pop()
        if x.op == "mul":
            factors += x.args
        else:
            (exponents if x.op == "exp" else rest).append(x)
    if not exponents:
        return None
    found: Symbol = reduce(add, (x.args[0] for x in exponents))
    if not rest:
        return found
    whole: Symbol = reduce(mul, rest)
    logarithm: Symbol = -whole.args[0].log() if whole.op == "recip" else whole.log()
    return add(found, logarithm)


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
