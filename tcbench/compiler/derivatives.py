"""Operations on traced formulas: exact derivatives, substitution, order of evaluation.

Nodes and constructors of `symbols` are re-exported: `trace.variable`, `trace.jacobian`, ...
"""

from __future__ import annotations

import operator
from collections import Counter
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import TraceError
from . import arrays, ops
from .ops import INFINITE, TINY
from .symbols import (
    Symbol,
    add,
    array,
    as_symbol,
    const,
    intern,
    is_const,
    lifted,
    make,
    mul,
    neg,
    positive,
    power,
    reciprocal,
    sub,
    tracing,
    variable,
    variables,
)
from .trace_errors import refused

# operations that numpy lacks --------------------------------------------------------------------------------------


def maximum(a: Symbol, b: Symbol) -> Symbol:
    """max(a, b), which has no derivative and drops NaN; `guarded` keeps it."""
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


def mark(x: Symbol) -> Symbol:
    """x as an intermediate through which derivatives are accumulated. This saves operations where all of an element
    depends on many positions through one strain measure."""
    return x if x.op in ("const", "var", "mark") else intern("mark", (x,))


# derivatives ----------------------------------------------------------------------------------------------------------


def partials(node: Symbol) -> tuple[Symbol, ...]:
    """The derivatives of a node by its arguments; TraceError where an operation has none."""
    slopes = ops.partials(node.op, node, *node.args)
    if not slopes:
        raise refused(f"the operation {node.op!r} has no derivative here")
    return tuple(map(lifted, slopes))


def topological(outputs: Iterable[Symbol], excluded: Container[int] = ()) -> list[Symbol]:
    """The nodes that the outputs need, arguments before users; not those beneath `excluded` ones (by number)."""
    seen: dict[int, Symbol] = {}
    stack = list(outputs)
    while stack:
        node = stack.pop()
        if node.number not in seen:
            seen[node.number] = node
            if node.number not in excluded:
                stack.extend(node.args)
    return [seen[number] for number in sorted(seen)]


def jacobian(outputs: Sequence[Symbol], inputs: Sequence[Symbol]) -> NDArray[np.object_]:
    """Exact derivatives; object array, shape (len(outputs), len(inputs))."""
    result = np.full((len(outputs), len(inputs)), const(0.0), dtype=object)
    for i, row in enumerate(sparse_jacobian(outputs, inputs)):
        for j, slope in row.items():
            result[i, j] = slope
    return result


def sparse_jacobian(outputs: Sequence[Symbol], inputs: Sequence[Symbol]) -> list[dict[int, Symbol]]:
    """Exact derivatives of numbers: for each output a row, position of the input -> slope, without zeros."""
    place = {x.number: j for j, x in enumerate(inputs)}
    rows = jacobian_terms([lifted(x) for x in outputs], inputs)
    return [{place[term.unknown.number]: slope for term, slope in row.items()} for row in rows]


class Term(NamedTuple):
    """Entries of a Jacobian: for each entry i of `over` a slope in row rows(i) and column columns(i)."""

    over: str
    rows: arrays.Path
    columns: arrays.Path
    unknown: Symbol


Terms = dict[Term, Symbol]


WIDE = 6  # terms from which on a value with several readers, as a strain of many corners, is differentiated once


class ManyPairs(Exception):
    """A Jacobian has more terms over pairs of entries than asked for."""


def jacobian_terms(outputs: Sequence[Symbol], unknowns: Sequence[Symbol], most: float = np.inf) -> list[Terms]:
    """The terms of each output, which add up where they share an entry. ManyPairs for more than `most` over pairs.

    Marked values, arguments of curved functions with several terms, and values with WIDE terms and several readers are
    differentiated once; their slopes are inserted at the end: all coordinates of an element act through one length.
    """
    tangents: dict[int, Terms] = {x.number: _identity(x) for x in unknowns}
    seeds: dict[int, Terms] = {}
    nodes = topological(outputs)
    curved = {node.args[0].number for node in nodes if node.space and bends(node)}
    readers = Counter(a.number for node in nodes for a in dict.fromkeys(node.args))
    for node in nodes:
        if node.number in tangents or not any(tangents.get(a.number) for a in node.args):
            continue
        slopes: Terms = {}
        inner = [tangents.get(a.number, {}) for a in node.args]
        if node.op == "mark":
            slopes = inner[0]
        elif node.op in arrays.LINEAR:
            for k, terms in enumerate(inner):
                for term, slope in terms.items():
                    _add(slopes, *_through(node, k, term, slope))
        else:
            for a, terms, partial in zip(node.args, inner, partials(node), strict=True):
                for each in terms.items():
                    term, slope = _read_by(node.space, a, *each)
                    _add(slopes, term, mul(arrays.take(partial, term.rows), slope))
        wide = len(slopes) >= WIDE and readers[node.number] > 1 and bool(node.space) and node.op not in arrays.LINEAR
        if wide or node.op == "mark" or (node.number in curved and len(slopes) > 1):
            seeds[node.number], slopes = slopes, _identity(node)
        tangents[node.number] = slopes
        if most < np.inf:
            _check_pairs(slopes, most)
    rows = []
    for x in outputs:
        rows.append(_expanded(tangents.get(x.number, {}), seeds, most))
    return rows


def bends(node: Symbol) -> bool:
    """Is the node a curved function of one value, a power, or marked?"""
    return node.op in ("pow", "mark") or (node.op in ops.OPERATIONS and node.op != "neg" and len(node.args) == 1)


def _check_pairs(terms: Terms, most: float) -> None:
    if sum(term.over.startswith("pairs ") for term in terms) > most:
        raise ManyPairs


def _identity(x: Symbol) -> Terms:
    return {Term(x.space, (), (), x): const(1.0)}


def _all(space: str) -> arrays.Map:
    """The map to the one number that all entries read, or add to."""
    return arrays.Map("all", 0, space, arrays.NUMBER)


def _into(k: int, space: str) -> arrays.Map:
    """The map from the k-th of joined arrays to the joined space "a+b"."""
    return arrays.Map("into", k, space.split("+")[k], space)


def _out_of(k: int, space: str) -> arrays.Map:
    """The map back from the joined space; entries of other arrays lead nowhere."""
    return arrays.Map("out of", k, space, space.split("+")[k])


def _add(terms: Terms, term: Term, slope: Symbol) -> None:
    terms[term] = add(terms[term], slope) if term in terms else slope


def _through(node: Symbol, k: int, term: Term, slope: Symbol) -> tuple[Term, Symbol]:
    """A term of argument k of an operation of `LINEAR` as a term of the node."""
    match node.op:
        case "collect":
            term, slope = _read_by(node.value[k][0].source, node.args[k], term, slope)
            return term._replace(rows=(*term.rows, *node.value[k])), slope
        case "total" if node.value[0] == "add":
            return term._replace(rows=(*term.rows, _all(node.value[1]))), slope
        case "take":
            return _met(node.value, term, slope)
        case "join":
            term, slope = _read_by(node.value.split("+")[k], node.args[k], term, slope)
            return term._replace(rows=(*term.rows, _into(k, node.value))), slope
        case "part":
            return term._replace(rows=(*term.rows, _out_of(*node.value))), slope
    raise TraceError(arrays.NO_SLOPE)


def _read_by(space: str, x: Symbol, term: Term, slope: Symbol) -> tuple[Term, Symbol]:
    """A term of x as read by entries of a space: all of them read a number."""
    return _met((_all(space),), term, slope) if x.space == arrays.NUMBER and space != arrays.NUMBER else (term, slope)


def _met(path: arrays.Path, term: Term, slope: Symbol) -> tuple[Term, Symbol]:
    """A term at the end of a path. Where a sum stands there, entries meet all terms of their sum: a space of pairs."""
    rows = term.rows
    while rows and rows[-1].name == "into":  # joined arrays: back through the numbers of the table
        path, rows = (*path, _out_of(rows[-1].column, rows[-1].target)), rows[:-1]
    if not rows:
        return Term(path[0].source, (), (*path, *term.columns), term.unknown), arrays.take(slope, path)
    pairs = f"pairs of {path} and {rows}"
    one, other = (arrays.Map(("pairs", path, rows, k), 0, pairs, s) for k, s in enumerate((path[0].source, term.over)))
    return Term(pairs, (one,), (other, *term.columns), term.unknown), arrays.take(slope, (other,))


def _expanded(terms: Terms, seeds: Mapping[int, Terms], most: float = np.inf) -> Terms:
    """Terms in which the seeds, the last one first, are replaced by their own terms."""
    terms = dict(terms)
    while pending := [term for term in terms if term.unknown.number in seeds]:
        if most < np.inf:
            _check_pairs(terms, most)
        last = max(pending, key=lambda term: term.unknown.number)
        outer = terms.pop(last)
        for term, slope in seeds[last.unknown.number].items():
            if not last.columns:
                _add(terms, Term(term.over, (*term.rows, *last.rows), term.columns, term.unknown),
                     mul(arrays.take(outer, term.rows), slope))  # fmt: skip
                continue
            met, moved = _met(last.columns, term, slope)
            _add(terms, met._replace(rows=(*met.rows, *last.rows)), mul(arrays.take(outer, met.rows), moved))
    return {term: slope for term, slope in terms.items() if not is_const(slope, 0.0)}


def along(outputs: Sequence[Symbol], directions: Mapping[Symbol, Symbol]) -> list[Symbol]:
    """Derivatives of the outputs along the directions of some variables: forward mode."""
    zero = const(0.0)
    tangent = {x.number: t for x, t in directions.items()}
    for node in topological(outputs):
        parts = [tangent.get(a.number, zero) for a in node.args]
        if node.number in tangent or all(is_const(t, 0.0) for t in parts):
            continue
        if node.op == "mark":
            tangent[node.number] = parts[0]
        elif node.op in arrays.LINEAR:
            if node.op == "total" and node.value[0] != "add":
                raise TraceError(arrays.NO_SLOPE)
            tangent[node.number] = arrays.rebuilt(node.op, parts, node.value)
        else:
            rate = zero
            for part, partial in zip(parts, partials(node), strict=True):
                if not is_const(part, 0.0):
                    rate = add(rate, mul(partial, part))
            tangent[node.number] = rate
    return [tangent.get(x.number, zero) for x in outputs]


def accumulate(tangent: dict[int, Symbol], factor: Symbol, inner: Mapping[int, Symbol]) -> None:
    """tangent += factor * inner."""
    for number, t in inner.items():
        term = mul(factor, t)
        tangent[number] = add(tangent[number], term) if number in tangent else term


def topological_beyond(outputs: Iterable[Symbol], excluded: Mapping[int, Any]) -> list[Symbol]:
    """`topological` without the excluded nodes themselves."""
    return [node for node in topological(outputs, excluded) if node.number not in excluded]


class Substitution:
    """Replaces nodes in one formula after the other and simplifies; shared parts are rebuilt once."""

    def __init__(self, replacement: Mapping[Symbol, Symbol]) -> None:
        self.new: dict[int, Symbol] = {node.number: by for node, by in replacement.items()}

    def __call__(self, output: Symbol) -> Symbol:
        return self.all([output])[0]

    def all(self, outputs: Sequence[Symbol]) -> list[Symbol]:
        """Each of the outputs."""
        new = self.new
        for node in topological_beyond(outputs, new):
            args = tuple([new[a.number] for a in node.args])
            same = all(map(operator.is_, args, node.args))
            new[node.number] = node if same else rebuild(node.op, args, node.value)
        return [new[x.number] for x in outputs]


def substitute(outputs: Sequence[Symbol], replacement: Mapping[Symbol, Symbol]) -> list[Symbol]:
    """The outputs with some nodes replaced, simplified again."""
    return Substitution(replacement).all(outputs)


def rebuild(op: str, args: tuple[Any, ...], value: Any = None) -> Any:
    """The node `op(*args)` by the simplifying constructors. value : its data, such as a path, beside its arguments."""
    if value is not None:
        return arrays.rebuilt(op, args, value)
    constructors: dict[str, Any] = {
        "add": add, "sub": sub, "mul": mul, "neg": neg, "recip": reciprocal,
        "mark": mark, "max": maximum, "min": minimum, "pow": power,
    }  # fmt: skip
    if not all(isinstance(x, Symbol) for x in args):  # complex numbers: by their own arithmetic
        unary = {"neg": operator.neg, "recip": lambda x: 1.0 / x, "mark": lambda x: x}
        binary = {"add": operator.add, "sub": operator.sub, "mul": operator.mul, "pow": operator.pow}
        chosen: Any = unary.get(op) or binary.get(op)
        if chosen is None:
            return operator.methodcaller(ops.OPERATIONS[op].numpy, *args[1:])(args[0])
        return chosen(*args)
    if op == "guard":
        return intern(op, args)
    return constructors[op](*args) if op in constructors else make(op, *args)


def depends_on(outputs: Iterable[Symbol], inputs: Iterable[Symbol]) -> set[int]:
    """Numbers of the nodes under `outputs` that depend on any of `inputs`."""
    result = {x.number for x in inputs}
    for node in topological(outputs):
        if any(a.number in result for a in node.args):
            result.add(node.number)
    return result
