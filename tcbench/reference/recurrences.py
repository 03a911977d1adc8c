"""The recurrences of Taylor coefficients for every operation of a tape, in double-doubles, eight series at once.

z = x y:  z_k = sum x_j y_(k-j).    z = x/y:  y_0 z_k = x_k - sum' y_j z_(k-j).    z = e^x:  k z_k = sum j x_j z_(k-j).
Sources: Moore (1966); Jorba and Zou (2005), section 3.
"""

from __future__ import annotations

from collections.abc import Callable

from ..compiler.language import Eight, Floats, Ints, exact, put, row, two_product
from .double_double import add, atan, cos_sin, div, eight, exp, log, mul, signs, sizes, sqrt, two_sum
from .tape import CODE, LANES, PAIR

(ADD, ADD_STATIC, SUB, NEG, MUL, SQUARE, SCALE, DIV, RECIP, SQRT, EXP, LOG, SLOPE, COS_SIN, ATAN, ABS) = (
    CODE[name] for name in ("add", "add_static", "sub", "neg", "mul", "square", "scale", "div", "recip", "sqrt", "exp",
                            "log", "slope", "cos_sin", "atan", "abs")
)  # fmt: skip
Operation = Callable[..., tuple[Eight, Eight]]


@exact
def keep(w: Floats, at: int, h: Eight, l: Eight) -> None:
    put(w, at, h)
    put(w, at + LANES, l)


@exact
def product(w: Floats, a: int, b: int, s: Eight, e: Eight) -> tuple[Eight, Eight]:
    """s + e + the product of the coefficients at a and b, as a double-double."""
    x, y = row(w, a, 8), row(w, b, 8)
    p, r = two_product(x, y)
    r = r + (x * row(w, b + LANES, 8) + row(w, a + LANES, 8) * y)
    s, q = two_sum(s, p)
    return s, e + (q + r)


@exact
def products(w: Floats, a: int, b: int, count: int) -> tuple[Eight, Eight]:
    """The sum of `count` products w[a + i] w[b - i] of coefficients, as a double-double."""
    s, e, t, f = eight(0.0), eight(0.0), eight(0.0), eight(0.0)
    pairs = count // 2
    for i in range(pairs):
        at = 2 * PAIR * i
        s, e = product(w, a + at, b - at, s, e)
        t, f = product(w, a + at + PAIR, b - at - PAIR, t, f)
    if 2 * pairs < count:
        s, e = product(w, a + 2 * PAIR * pairs, b - 2 * PAIR * pairs, s, e)
    return add(s, e, t, f)


@exact
def high_products(w: Floats, a: int, b: int, count: int) -> tuple[Eight, Eight]:
    """`products` of high parts; the low part is 0."""
    s, t = eight(0.0), eight(0.0)
    fours = count // 4
    for i in range(fours):
        x, y = a + 4 * PAIR * i, b - 4 * PAIR * i
        s = s + (row(w, x, 8) * row(w, y, 8) + row(w, x + PAIR, 8) * row(w, y - PAIR, 8))
        x, y = x + 2 * PAIR, y - 2 * PAIR
        t = t + (row(w, x, 8) * row(w, y, 8) + row(w, x + PAIR, 8) * row(w, y - PAIR, 8))
    for i in range(4 * fours, count):
        s = s + row(w, a + PAIR * i, 8) * row(w, b - PAIR * i, 8)
    return s + t, eight(0.0)


@exact
def high_add(x: Eight, xl: Eight, y: Eight, yl: Eight) -> tuple[Eight, Eight]:
    return x + y, eight(0.0)


@exact
def high_mul(x: Eight, xl: Eight, y: Eight, yl: Eight) -> tuple[Eight, Eight]:
    return x * y, eight(0.0)


@exact
def begin(ops: Ints, count: int, w: Floats) -> None:
    """Compute coefficient 0 of every result, and the values of constants."""
    for i in range(count):
        op, at, a, b, own = ops[5 * i], ops[5 * i + 1], ops[5 * i + 2], ops[5 * i + 3], ops[5 * i + 4]
        xh, xl, yh, yl = row(w, a, 8), row(w, a + LANES, 8), row(w, b, 8), row(w, b + LANES, 8)
        h, l, rh, rl = eight(0.0), eight(0.0), eight(0.0), eight(0.0)
        if op in (ADD, ADD_STATIC):
            h, l = add(xh, xl, yh, yl)
        elif op == SUB:
            h, l = add(xh, xl, -yh, -yl)
        elif op == NEG:
            h, l = -xh, -xl
        elif op in (MUL, SCALE):
            h, l = mul(xh, xl, yh, yl)
        elif op == SQUARE:
            h, l = mul(xh, xl, xh, xl)
        elif op == DIV:
            rh, rl = div(eight(1.0), eight(0.0), yh, yl)
            h, l = mul(xh, xl, rh, rl)
        elif op == RECIP:
            h, l = div(eight(1.0), eight(0.0), xh, xl)
        elif op == SQRT:
            h, l = sqrt(xh, xl)
            rh, rl = div(eight(0.5), eight(0.0), h, l)
        elif op == EXP:
            h, l = exp(xh, xl)
        elif op == LOG:
            h, l = log(xh, xl)
            rh, rl = div(eight(1.0), eight(0.0), xh, xl)
        elif op == ATAN:
            h, l = atan(xh, xl)
            rh, rl = div(eight(1.0), eight(0.0), yh, yl)
        elif op == ABS:
            rh = signs(xh)
            h, l = sizes(xh), rh * xl
        elif op == COS_SIN:
            h, l, rh, rl = cos_sin(xh, xl)
            keep(w, at + (own - at) // 2, rh, rl)
        keep(w, at, h, l)
        if op in (DIV, SQRT, LOG, ATAN, ABS):
            keep(w, own, rh, rl)


def order_by(products: Operation, add: Operation, mul: Operation) -> Callable[..., None]:
    """The recurrences of one order, in the arithmetic of these operations."""

    @exact
    def times(w: Floats, at: int, h: Eight, l: Eight) -> tuple[Eight, Eight]:
        """The product with the coefficient at a place."""
        return mul(h, l, row(w, at, 8), row(w, at + LANES, 8))

    @exact
    def plus(w: Floats, at: int, h: Eight, l: Eight) -> tuple[Eight, Eight]:
        return add(h, l, row(w, at, 8), row(w, at + LANES, 8))

    @exact
    def squares(w: Floats, y: int, k: int, first: int) -> tuple[Eight, Eight]:
        """Coefficient k of the square of y; first = 1 leaves out the two products with coefficient k itself."""
        half = (k + 1) // 2
        h, l = products(w, y + PAIR * first, y + PAIR * (k - first), half - first)
        h, l = h + h, l + l
        if k % 2 == 0:
            yh, yl = row(w, y + PAIR * half, 8), row(w, y + PAIR * half + LANES, 8)
            yh, yl = mul(yh, yl, yh, yl)
            h, l = add(h, l, yh, yl)
        return h, l

    @exact
    def order(ops: Ints, count: int, w: Floats, k: int, inverse: int) -> None:
        """Compute coefficient k > 0 of every result. inverse : the place of 1/k."""
        to, before = PAIR * k, PAIR * (k - 1)
        for i in range(count):
            op, at, a, b, own = ops[5 * i], ops[5 * i + 1], ops[5 * i + 2], ops[5 * i + 3], ops[5 * i + 4]
            xh, xl = row(w, a + to, 8), row(w, a + to + LANES, 8)
            h, l = xh, xl
            if op == ADD:
                h, l = plus(w, b + to, xh, xl)
            elif op == SUB:
                h, l = plus(w, b + to, -xh, -xl)
                h, l = -h, -l
            elif op == NEG:
                h, l = -xh, -xl
            elif op == SCALE:
                h, l = times(w, b, xh, xl)
            elif op == ABS:  # at 0 the sign is that of the first coefficient
                sign = row(w, own, 8)
                sign = sign + (1.0 - sign * sign) * signs(xh)
                keep(w, own, sign, eight(0.0))
                h, l = sign * xh, sign * xl
            elif op == SLOPE:
                h, l = mul(xh, xl, eight(float(k)), eight(0.0))
            elif op == MUL:
                h, l = products(w, a, b + to, k + 1)
            elif op == SQUARE:
                h, l = squares(w, a, k, 0)
            elif op == SQRT:
                h, l = squares(w, at, k, 1)
                h, l = add(xh, xl, -h, -l)
                h, l = times(w, own, h, l)
            elif op == DIV:
                h, l = products(w, b + PAIR, at + before, k)
                h, l = add(xh, xl, -h, -l)
                h, l = times(w, own, h, l)
            elif op == RECIP:
                h, l = products(w, a + PAIR, at + before, k)
                h, l = times(w, at, -h, -l)
            elif op == EXP:
                h, l = products(w, b + PAIR, at + before, k)
                h, l = times(w, inverse, h, l)
            elif op in (LOG, ATAN):  # d z' = x', with d = x of a logarithm
                slope, d = at + (own - at) // 2, a if op == LOG else b
                h, l = products(w, slope + PAIR, d + before, k - 1)
                sh, sl = mul(xh, xl, eight(float(k)), eight(0.0))
                h, l = add(sh, sl, -h, -l)
                h, l = times(w, own, h, l)
                keep(w, slope + to, h, l)
                h, l = times(w, inverse, h, l)
            elif op == COS_SIN:
                sine = at + (own - at) // 2
                h, l = products(w, b + PAIR, at + before, k)
                h, l = times(w, inverse, h, l)
                keep(w, sine + to, h, l)
                h, l = products(w, b + PAIR, sine + before, k)
                h, l = times(w, inverse, -h, -l)
            keep(w, at + to, h, l)

    return order


wide_order = order_by(products, add, mul)  # with all digits
high_order = order_by(high_products, high_add, high_mul)  # high parts alone
