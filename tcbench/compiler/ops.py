"""Elementary operations of formulas, one row each, from which all the rest follows.

To add a function write a row and its tests: formulas can then call it (`building_blocks.function`), it is
differentiated, compiled and solved for its argument, has a divided difference and a Taylor series, and peers get it.
Slopes and divided differences are formulas in symbols (`symbols.Symbol`), which divide by no difference.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

from . import special
from .language import of_c

# TINY is added to what may be 0 under a root or in a denominator: then 0 x infinity is 0, and no derivative underflows.
# An infinite slope is 1e180 or more, so that 0 times it, as in v sqrt(|v|) at rest, is 0; its square, and a comparison
# with INFINITE, show that it is infinite.
TINY, TINIER, INFINITE = 1e-60, 1e-240, 1e150
COMPOSED = "composed"  # a divided difference: that of the formula `same`
Rule = Callable[..., Any]


@dataclass(frozen=True)
class Operation:
    """An operation y = f(x), or y = f(x, z); all but +, -, *, /, abs, sqrt and hypot are dimensionless.

    name       : in graphs and in the text of kernels, as in C.
    value      : function of numbers, in the restricted Python or of C; None for arithmetic.
    slopes     : (y, x, ...) -> derivatives by each argument; None where there are none.
    numpy      : name of numpy's function, and of the method, that formulas call; "" for none.
    difference : (a, b, d) -> (f(b) - f(a))/d, d = b - a, exact at any d; COMPOSED; or None: it is refused. Of two
        arguments (a, b, d, a', b', d') -> slopes by both, whose products with d and d' add up to the difference.
    inverse    : y -> x.
    same       : its formula in other functions, for arithmetic that lacks it: series, complex numbers, peers.
    positive   : number of first arguments that make the result positive where they are; -1: it need not be.
    rooted     : the value may be finite where the slope is not.
    arguments  : their number.
    with_slope : the operation that is its derivative, computed together with it.
    intrinsic  : LLVM has it.
    """

    name: str
    value: Rule | None
    slopes: Rule | None
    numpy: str = ""
    difference: Rule | str | None = None
    inverse: Rule | None = None
    same: str = ""
    positive: int = -1
    rooted: bool = False
    arguments: int = 1
    with_slope: str = ""
    intrinsic: bool = False


def _power_slopes(y: Any, x: Any, exponent: Any) -> tuple[Any, Any]:
    fixed = exponent.value if exponent.op == "const" else None
    if fixed is not None and fixed > 1.0:  # the slope is finite at 0
        by_base = exponent * x ** (exponent - 1.0)
    elif x.positive or (fixed is not None and fixed < 0.0):
        by_base = exponent * y / x
    elif fixed is not None:
        by_base = exponent * (y + TINY) / (x + TINIER)
    else:  # exponents 0, 1, 2, ...: at 0 the slope may be any
        by_base = exponent * x.make("pow", x + TINIER, exponent - 1.0)
    return by_base, 0.0 if fixed is not None else y * x.log()


def _atan2_slopes(angle: Any, y: Any, x: Any) -> tuple[Any, Any]:
    inverse = 1.0 / (x * x + y * y)
    return x * inverse, -(y * inverse)


def _hypot_slopes(y: Any, a: Any, b: Any) -> tuple[Any, Any]:
    inverse = 1.0 / (y + TINIER)  # at 0 as of abs
    return a * inverse, b * inverse


def _atan_slope_slopes(y: Any, a: Any, d: Any) -> tuple[Any, Any]:
    """d/da of (atan(a + d) - atan(a))/d is -(a + b)/((1 + a^2)(1 + b^2)), b = a + d."""
    b = a + d
    return -((a + b) / ((1.0 + a * a) * (1.0 + b * b))), a.make("atan_bend", a, d)


def _tanh_slope_slopes(y: Any, a: Any, d: Any) -> tuple[Any, Any]:
    top = (a + d).tanh()
    return -(y * (a.tanh() + top)), y * (a.make("langevin", d) - top)


def _abs_slope_slopes(y: Any, a: Any, d: Any) -> tuple[Any, Any]:
    """Of (a + b)/(|a| + |b|), b = a + d."""
    b = a + d
    size = abs(a) + abs(b)
    below = 1.0 / (size * size + TINY)
    by_a, by_b = ((size - (a + b) * a.make("abs_slope", x, 0.0)) * below for x in (a, b))
    return by_a + by_b, by_b


def _next_slope(name: str) -> Rule:
    return lambda y, order, x: (0.0, x.make(name, order + 1.0, x))


def _sinhc(x: Any) -> Any:
    """sinh(x)/x."""
    return 0.5 * (x.make("phi", x) + x.make("phi", -x))


def exp_slope(start: Any, end: Any, d: Any) -> Any:
    """(exp(b) - exp(a))/d by start = exp(a), end = exp(b) and d = b - a: start phi(d); end phi(-d) where d is so large
    that start may be 0 and phi(d) infinite."""
    return d.make("unless_far", start, end, d) * d.make("phi", d.make("unless_far", d, -d, d))


def _turned(rate: Rule, ratio: Rule) -> Rule:
    """sin b - sin a = 2 cos((a + b)/2) sin((b - a)/2); so the cosine, and with `_sinhc` the hyperbolic ones."""
    return lambda a, b, d: rate(0.5 * (a + b)) * ratio(0.5 * d)


def _lengthened(a: Any, b: Any, d: Any, a2: Any, b2: Any, d2: Any) -> tuple[Any, Any]:
    scale = 1.0 / (a.hypot(a2) + b.hypot(b2))
    return (a + b) * scale, (a2 + b2) * scale


def _turn(y: Any, y1: Any, dy: Any, x: Any, x1: Any, dx: Any) -> tuple[Any, Any]:
    """The angle from (x, y) to (x1, y1) is 2 atan(c/m), c and m - r r1 being their products: less than half a turn,
    also across the cut where arctan2 jumps."""
    m = x.hypot(y) * x1.hypot(y1) + x * x1 + y * y1
    scale = y.make("atan_slope", 0.0, (x * dy - y * dx) / m) / m
    return (x + x1) * scale, -((y + y1) * scale)


def _sinc(x: Any) -> Any:
    return x.make("sinc", x)


def _elementary(name: str, slopes: Rule, numpy: str = "", **rest: Any) -> Operation:
    """A function of C with one argument or two."""
    return Operation(name, of_c(name), slopes, numpy or name, **rest)


def _special(name: str, slopes: Rule | None, with_slope: str = "") -> Operation:
    """A function of `special`, for divided differences."""
    return Operation(name, getattr(special, name), slopes, with_slope=with_slope)


_ROWS = (
    Operation("add", None, lambda y, a, b: (1.0, 1.0), positive=2, arguments=2),
    Operation("sub", None, lambda y, a, b: (1.0, -1.0), arguments=2),
    Operation("neg", None, lambda y, x: (-1.0,), inverse=lambda y: -y),
    Operation("mul", None, lambda y, a, b: (b, a), positive=2, arguments=2),
    Operation("recip", None, lambda y, x: (-(y * y),), inverse=lambda y: 1.0 / y, positive=1),
    Operation("mark", None, lambda y, x: (1.0,), inverse=lambda y: y, positive=1),
    Operation("abs", abs, lambda y, x: (x / (y + TINY),), "fabs",  # at 0 the mean of both sides
              lambda a, b, d: a.make("abs_slope", a, d), rooted=True),
    _elementary("sqrt", lambda y, x: (0.5 / (y if x.positive else y + TINIER),), intrinsic=True, rooted=True,
                positive=1, difference=lambda a, b, d: 1.0 / (a.sqrt() + b.sqrt()), inverse=lambda y: y * y),
    _elementary("exp", lambda y, x: (y,), intrinsic=True, positive=0, inverse=lambda y: y.log(),
                difference=lambda a, b, d: a.exp() * a.make("phi", d)),
    _elementary("log", lambda y, x: (1.0 / x,), intrinsic=True, inverse=lambda y: y.exp(),
                difference=lambda a, b, d: 1.0 / a * a.make("lam", d / a)),
    _elementary("expm1", lambda y, x: (y + 1.0,), same="exp(x) - 1.0", difference=COMPOSED,
                inverse=lambda y: y.log1p()),
    _elementary("log1p", lambda y, x: (1.0 / (x + 1.0),), same="log(1.0 + x)", difference=COMPOSED,
                inverse=lambda y: y.expm1()),
    _elementary("sin", lambda y, x: (x.cos(),), intrinsic=True, difference=_turned(lambda x: x.cos(), _sinc)),
    _elementary("cos", lambda y, x: (-x.sin(),), intrinsic=True, difference=_turned(lambda x: -x.sin(), _sinc)),
    _elementary("tan", lambda y, x: (1.0 + y * y,), same="sin(x) / cos(x)",
                difference=lambda a, b, d: a.make("sinc", d) / (a.cos() * b.cos())),
    _elementary("sinh", lambda y, x: (x.cosh(),), same="(exp(x) - exp(-x)) * 0.5",
                difference=_turned(lambda x: x.cosh(), _sinhc), inverse=lambda y: (y + (y * y + 1.0).sqrt()).log()),
    _elementary("cosh", lambda y, x: (x.sinh(),), same="(exp(x) + exp(-x)) * 0.5", positive=0,
                difference=_turned(lambda x: x.sinh(), _sinhc)),
    _elementary("tanh", lambda y, x: (1.0 - y * y,), same="(exp(x + x) - 1.0) / (exp(x + x) + 1.0)",
                difference=lambda a, b, d: a.make("tanh_slope", a, d)),
    _elementary("atan", lambda y, x: (1.0 / (1.0 + x * x),), "arctan", rooted=True,
                difference=lambda a, b, d: a.make("atan_slope", a, d)),
    _elementary("asin", lambda y, x: (1.0 / ((1.0 - x) * (1.0 + x)).sqrt(),), "arcsin", rooted=True,
                difference=COMPOSED, same="atan(x / sqrt((1.0 - x) * (1.0 + x)))"),
    _elementary("acos", lambda y, x: (-1.0 / ((1.0 - x) * (1.0 + x)).sqrt(),), "arccos", rooted=True,
                difference=COMPOSED, same="2.0 * atan(sqrt((1.0 - x) / (1.0 + x)))"),
    _elementary("atan2", _atan2_slopes, "arctan2", rooted=True, arguments=2, difference=_turn,
                same="2.0 * atan(x / (sqrt(x * x + z * z) + z))"),  # not on the cut x = 0 > z
    _elementary("hypot", _hypot_slopes, rooted=True, arguments=2, same="sqrt(x * x + z * z)", difference=_lengthened),
    _elementary("pow", _power_slopes, "power", rooted=True, arguments=2, positive=1, same="exp(z * log(x))"),
    _special("phi", lambda y, x: (x.make("dphi", x),), with_slope="dphi"),
    _special("unless_far", lambda y, x, z, d: (*(d.make("unless_far", i, 1.0 - i, d) for i in (1.0, 0.0)), 0.0)),
    _special("lam", lambda y, x: (x.make("dlam", x),), with_slope="dlam"),
    _special("sinc", lambda y, x: (x.make("dsinc", x),), with_slope="dsinc"),
    _special("dphi", lambda y, x: (x.make("phi_slope", 2.0, x),)),
    _special("dlam", lambda y, x: (x.make("lam_slope", 2.0, x),)),
    _special("dsinc", lambda y, x: (x.make("sinc_slope", 2.0, x),)),
    *(_special(name, _next_slope(name)) for name in ("phi_slope", "lam_slope", "sinc_slope")),
    _special("atan_slope", _atan_slope_slopes),
    _special("tanh_slope", _tanh_slope_slopes),
    _special("abs_slope", _abs_slope_slopes),
    _special("atan_bend", None),
    _special("langevin", None),
)  # fmt: skip
OPERATIONS: dict[str, Operation] = {row.name: row for row in _ROWS}
NAMED = re.compile(r"\b([a-z_]\w*)\(")  # functions that a text calls


def partials(name: str, y: Any, *x: Any) -> tuple[Any, ...]:
    """Derivatives of y = f(x, ...) by each argument; () where there are none. Constant ones are floats."""
    slopes = OPERATIONS[name].slopes if name in OPERATIONS else None
    return () if slopes is None else tuple(slopes(y, *x))


def by_numpy(name: str) -> Operation | None:
    """The operation of a function, or method, of numpy's name; None for others."""
    rows = (row for row in OPERATIONS.values() if name and row.numpy == name)
    return next(rows, None)


def functions() -> dict[str, Rule]:
    """The functions of numbers that formulas call, by the names of C."""
    return {row.name: row.value for row in OPERATIONS.values() if row.value is not None and row.numpy}


def values() -> dict[str, Rule]:
    """All functions that the text of a kernel may call, by name."""
    return {row.name: row.value for row in OPERATIONS.values() if row.value is not None}


def as_methods() -> dict[str, Rule]:
    """The functions for objects that have methods of numpy's names."""
    return {row.name: _method(row.numpy) for row in OPERATIONS.values() if row.numpy} | {"pow": pow}


def _method(name: str) -> Rule:
    return lambda x, *others: getattr(x, name)(*others)


@cache
def _compiled(same: str) -> Any:
    return compile(same, "<same>", "eval")


def evaluated(same: str, rules: Mapping[str, Rule], x: Any, z: Any = None) -> Any:
    """The formula `same` of an operation at x (and z), with these functions."""
    return eval(_compiled(same), dict(rules), {"x": x, "z": z})


def completed(rules: Mapping[str, Rule]) -> dict[str, Rule]:
    """These functions, and others that can be composed of them."""
    completed_rules = dict(rules)
    for row in OPERATIONS.values():
        if row.same and row.name not in completed_rules and completed_rules.keys() >= set(NAMED.findall(row.same)):
            completed_rules[row.name] = partial(evaluated, row.same, completed_rules)
    return completed_rules


def rewritten(text: str, available: Collection[str]) -> str:
    """The text of a kernel in which functions that are not available are replaced by formulas of others."""
    for row in reversed(OPERATIONS.values()):
        if row.same and row.name not in available:
            call = re.compile(rf"\b{row.name}\(([^(),]+|\([^()]*\))(?:, ([^(),]+|\([^()]*\)))?\)")
            text = call.sub(partial(_replaced, row.same), text)
    return text


def _replaced(same: str, call: re.Match[str]) -> str:
    """The formula of a call, with its arguments, in brackets."""
    return "(" + re.sub(r"\b[xz]\b", lambda letter: f"({call[1 if letter[0] == 'x' else 2]})", same) + ")"


def formulas_may_call() -> str:
    """The names of numpy's functions, for sentences."""
    return ", ".join("abs" if x == "abs" else OPERATIONS[x].numpy for x in functions() if x != "pow")
