"""Building blocks of formulas: quotients that would be 0/0 where two states are equal, without the division.

    from tcbench.building_blocks import divided_difference

    slope = divided_difference(lambda s: np.exp(s / c), s0, s1)  # (exp(s1/c) - exp(s0/c))/(s1 - s0), also at s1 = s0

All take numbers, symbols (in a formula that is traced) and arrays of either, entry by entry; all are dimensionless.
They are accurate to round-off at any increment, zero included, and so are the derivatives that tcbench takes of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from .compiler.array_states import each, entries, is_array
from .compiler.array_symbols import ArraySymbol
from .compiler.arrays import variable
from .compiler.derivatives import Symbol, array, lifted, refused, topological, variables
from .compiler.divided_differences import RULES, ZERO, Corners, rectangle, symmetrised_slopes
from .compiler.ops import OPERATIONS, TINY, functions
from .compiler.symbols import make
from .errors import TraceError, unknown_name

SHAPES = "It has the arrays themselves, and gives one value for each entry"

__all__ = ["directional", "divided_difference", "divided_differences", "function", "log1p_ratio", "phi"]


def phi(x: Any) -> Any:
    """(exp(x) - 1)/x, which is 1 at x = 0: exp(b) - exp(a) = exp(a) phi(b - a) (b - a)."""
    return _each(partial(make, "phi"), x)


def log1p_ratio(x: Any) -> Any:
    """log(1 + x)/x, which is 1 at x = 0: log(b) - log(a) = log1p_ratio((b - a)/a) (b - a)/a. x > -1."""
    return _each(partial(make, "lam"), x)


def function(name: str) -> Callable[..., Any]:
    """A function that numpy lacks, by the name of its row of `tcbench.compiler.ops`: for numbers, symbols and arrays of
    either, entry by entry. UnknownNameError where there is none.
    """
    if name not in functions():
        raise unknown_name("function", name, functions())
    row = OPERATIONS[name]

    def of_entry(*x: Any) -> Any:
        method = getattr(x[0], row.numpy, None)
        return row.value(*x) if method is None else method(*x[1:])  # type: ignore[misc]

    entrywise = np.frompyfunc(of_entry, row.arguments, 1)

    def of(*x: Any) -> Any:
        values = entrywise(*x)
        numbers = isinstance(values, np.ndarray) and all(np.asarray(a).dtype != object for a in x)
        return values.astype(float) if numbers else values

    of.__name__ = name
    return of


def divided_difference(function: Callable[[Any], Any], a: Any, b: Any) -> Any:
    """(function(b) - function(a))/(b - a), and the derivative where b = a; of the shape of a and b.

    function : of one variable, by +, -, *, /, **, abs, sqrt, exp, log, expm1, log1p, sin, cos, tan, arcsin, arccos,
        arctan, arctan2, sinh, cosh, tanh, hypot, where, maximum, minimum, clip and sign (TraceError names another
        operation).
    """

    def slope(a: Any, b: Any) -> tuple[Any]:
        x = _mapped(lambda a, step: rectangle(a, step, ZERO, ZERO)[0], a, b - a)
        return (_mapped(lambda corner: corner.pi_at_s0, _by_rules(function, x)),)

    (slopes,) = _of_symbols(slope, a, b)
    return slopes


def divided_differences(function: Callable[[Any, Any], Any], a: Any, b: Any) -> tuple[Any, Any]:
    """The two slopes (D1, D2) of function(x, y) from a = (x0, y0) to b = (x1, y1), with

        D1 (x1 - x0) + D2 (y1 - y0) = function(x1, y1) - function(x0, y0):

    each is the mean of the divided differences along the two opposite edges of the rectangle, Romero (2009), (31)-(32).
    x and y may be arrays, which are passed on: entry i of the result must depend on entry i of x and y
    alone, as in `system.element_energy`. Operations as in `divided_difference`.
    """

    def slopes(x0: Any, x1: Any, y0: Any, y1: Any) -> tuple[Any, ...]:
        edges = x0, x1 - x0, y0, y1 - y0
        x, y = (_mapped(lambda *edge, i=i: rectangle(*edge)[i], *edges) for i in range(2))
        corners = _by_rules(function, x, y)
        return tuple(_mapped(lambda corner, i=i: symmetrised_slopes(corner)[i], corners) for i in range(2))

    (x0, y0), (x1, y1) = a, b
    first, second = _of_symbols(slopes, x0, x1, y0, y1)
    return first, second


def directional(gradient: Any, step: Any, exact: Any, weights: Any = 1.0, axis: int = 0) -> Any:
    """The nearest gradient whose product with the step is that of `exact`: Gonzalez (1996).

    gradient + (exact - gradient) . step / (w step . step) w step, and the gradient itself where the step is 0. With the
    gradient at the midpoint this is Gonzalez's discrete gradient: second order, symmetric.

    gradient, step : of one shape.
    exact : slopes whose product with the step is the difference of the function, such as
        `system.discrete_gradient(z0, z1)`; the difference of two energies would lose its digits as the step shrinks.
    weights : w > 0 of the entries, where they have different units. axis : along which products are summed.
    """
    if not is_array(gradient, step, exact):
        gradient, step, exact = (np.asarray(part) for part in (gradient, step, exact))
    missing, length = ((exact - gradient) * step).sum(axis=axis), (weights * step * step).sum(axis=axis) + TINY
    share = missing / length
    if np.ndim(share):
        share = share[:, None] if is_array(share) else np.expand_dims(share, axis)
    return gradient + share * (weights * step)


def _by_rules(function: Callable[..., Any], *corners: Any) -> Any:
    try:
        result = function(*corners)
        if not is_array(*corners):
            entry, shape = (() if isinstance(x, Corners) else np.shape(x) for x in (corners[0], result))
            if shape not in (entry, ()):
                problem = f"a divided difference is taken of a function that gives shape {shape} of shape {entry}"
                raise refused(problem, SHAPES)
        elif np.ndim(result) and not is_array(result):
            raise refused("a divided difference is taken of a function that gives numbers of an array", SHAPES)
        return _mapped(lambda corner, value: corner.lifted(value), corners[0], result)  # a constant has slopes, too
    except TypeError as error:  # numpy hides the TraceError that names the operation
        if isinstance(error.__cause__, TraceError):
            raise error.__cause__ from None
        raise refused(f"a divided difference is taken of a function that cannot take it: {error}", SHAPES) from None


def _mapped(rule: Callable[..., Any], *arguments: Any) -> Any:
    """The rule on every entry of arrays of symbols, or on symbols."""
    return each(rule, *arguments) if is_array(*arguments) else np.frompyfunc(rule, len(arguments), 1)(*arguments)


def _each(rule: Callable[..., Symbol], x: Any) -> Any:
    """The rule applied to every entry; a number for a number."""
    (values,) = _of_symbols(lambda x: (_mapped(rule, x),), x, alike=True)
    return values


def _of_symbols(rule: Callable[..., tuple[Any, ...]], *arguments: Any, alike: bool = False) -> tuple[Any, ...]:
    """The results of a rule on symbols; numbers where all arguments are. alike : it treats entries alike."""
    if is_array(*arguments):
        return rule(*arguments)
    arrays = np.broadcast_arrays(*(np.asarray(a, dtype=object) for a in arguments))
    shape, items = arrays[0].shape, [x for a in arrays for x in a.flat]
    if any(isinstance(x, Corners) for x in items):
        raise refused("a building block stands in what a divided difference is taken of, and has no rule there", RULES)
    if any(isinstance(x, Symbol) for x in items):
        return rule(*(array(map(lifted, a.flat)).reshape(shape)[()] for a in arrays))
    numbers = np.array(items, dtype=float).reshape(len(arrays), *shape)
    # a rule that treats entries alike takes an array without a length, which has one axis
    table = _by_one_formula(rule, numbers) if alike or len(shape) < 2 else None
    table = _by_entries(rule, numbers) if table is None else table
    return tuple(of_each.reshape(shape)[()] for of_each in table.T)


def _by_one_formula(rule: Callable[..., tuple[Any, ...]], numbers: np.ndarray) -> np.ndarray | None:
    """The results (entries, results) of the rule, traced once for all; None where it does not treat entries alike."""
    x = [variable("x", "entry") for _ in numbers]
    try:
        outputs = entries(*rule(*(ArraySymbol("entry", y) for y in x)))
    except Exception:  # of any kind: the formula of each entry is asked for, or the sentence that refuses it
        return None
    return _evaluated(x, outputs, numbers.reshape(len(x), -1).T)


def _by_entries(rule: Callable[..., tuple[Any, ...]], numbers: np.ndarray) -> np.ndarray:
    """The results (entries, results), traced entry by entry; formulas that differ in constants share a kernel."""
    x = variables("x", numbers.size).reshape(numbers.shape)
    outputs = np.array([np.ravel(side) for side in rule(*x)]).T
    rows, table, forms = numbers.reshape(len(x), -1).T, np.empty(outputs.shape), dict[Any, list[Any]]()
    for i, own in enumerate(x.reshape(len(x), -1).T):
        form, constants = _form(list(own), list(outputs[i]))
        forms.setdefault(form, []).append((i, own, constants))
    for alike in forms.values():
        i, own, constants = alike[0]
        values = [[*rows[i], *(x.value for x in constants)] for i, _, constants in alike]
        table[[i for i, *_ in alike]] = _evaluated([*own, *constants], outputs[i], np.array(values))
    return table


def _form(x: Sequence[Symbol], outputs: Sequence[Symbol]) -> tuple[Any, list[Symbol]]:
    """The formulas in x without their constants, as a key; and the constants."""
    place, constants, form = {y.number: k for k, y in enumerate(x)}, dict[Symbol, int](), list[Any]()

    def code(node: Symbol) -> int:
        return ~constants.setdefault(node, len(constants)) if node.op == "const" else place[node.number]

    for node in topological(outputs, frozenset(place)):
        if node.number not in place and node.op != "const":
            form.append((node.op, node.value, *map(code, node.args)))
            place[node.number] = len(place)
    return (*form, *map(code, outputs)), list(constants)


def _evaluated(x: Sequence[Symbol], outputs: Sequence[Symbol], rows: np.ndarray) -> np.ndarray:
    """The outputs (rows, outputs) at each row (x,) of numbers."""
    from .compiler.kernels import kernel, placed

    evaluate = kernel(placed("a", x), list(outputs))
    rows = np.ascontiguousarray(rows)
    return np.array([evaluate(row, row) for row in rows]).reshape(len(rows), len(outputs))
