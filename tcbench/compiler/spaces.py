"""Symbols that stand for whole arrays: one of the positions, elements or links of a network for all of them.

A formula that is written for arrays does the same with every entry, so it is enough to run it on one. Here it is run on
two at once, two representatives of each space: where a formula mixes them, or does different things with them, it is
not the same for all entries, and is refused. (A sum over all entries adds the two, and is known by that.)
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from . import special, symbols
from .sentences import Space, mixed_up, space_of
from .symbols import Symbol, array, const, intern, is_const

REPRESENTATIVES = 2


class Map(NamedTuple):
    """For each entry of `source` one of `target`: column `column` of the network's table `name`."""

    name: str
    column: int
    source: str
    target: str


Path = tuple[Map, ...]


class Count(int):
    """A number of entries as a formula sees it: of the representatives where arrays are made, of all in arithmetic."""

    symbol: Symbol


def variable(name: str, space: str) -> Any:
    """The two representatives of a fresh array, as an array."""
    pair = [Symbol("var", (), f"{name}.{k}") for k in range(REPRESENTATIVES)]
    for k, x in enumerate(pair):
        x.space, x.twin = space_of(space, k), pair[1 - k]
    return array(pair)


def twin(x: Symbol) -> Symbol:
    """What the other representative has in place of x."""
    from .derivatives import rebuild, topological

    if x.twin is None:
        for node in topological([x]):
            if node.twin is None:
                args = tuple(a.twin for a in node.args)
                same = all(a is b for a, b in zip(args, node.args, strict=True))
                node.twin = node if same else rebuild(node.op, args, node.value)
    assert x.twin is not None
    return x.twin


def alike(x: Symbol, y: Symbol) -> bool:
    """Are these what the two representatives have in one place? Tried on random numbers: the graphs of equal formulas
    may differ in the order of operations."""
    spaces = (x.space, y.space)
    if spaces != (None, None) and (None in spaces or x.space.name != y.space.name or x.space.which == y.space.which):  # type: ignore[union-attr]
        return False
    first, second = _sample(x), _sample(y)
    return abs(first - second) <= 1e-9 * (abs(first) + abs(second))


def _sample(output: Symbol) -> float:
    """The value of a node where both representatives of each variable have the same random value."""
    from .derivatives import topological

    if output.sample is None:
        for node in topological([output]):
            if node.sample is None:
                node.sample = _sampled(node, [a.sample for a in node.args])  # type: ignore[misc]
    assert output.sample is not None
    return output.sample


def _sampled(node: Symbol, args: Sequence[float]) -> float:
    if not node.args:
        if node.op == "const":
            return float(node.value)
        first = min(node.number, node.twin.number) if node.twin is not None else node.number
        return _random("variable", node.value if node.op == "count" else first)
    if node.op == "gather":  # some function of what is gathered and from where
        return sum(_random("gather", i, *node.value) * x for i, x in enumerate(args))
    if node.op == "scatter":
        return sum(_random("scatter", m) * x for x, m in zip(args, node.value, strict=True))
    if node.op == "over_all":
        return _random("over_all", *node.value) * args[0]
    return float(INTERPRETED[node.op](*args))


def _random(*key: Any) -> float:
    """A number between 1/2 and 3/2 that belongs to the key."""
    return 0.5 + zlib.crc32(repr(key).encode()) / 2.0**32


def _safe(function: Any, largest: float = 50.0) -> Any:
    return lambda x: function(max(-largest, min(largest, x)))


def _within(x: float) -> float:
    """Between -1 and 1."""
    return x / (1.0 + abs(x))


INTERPRETED: dict[str, Any] = {  # some function in place of each, with a value everywhere
    "add": lambda a, b: a + b, "sub": lambda a, b: a - b, "mul": lambda a, b: a * b, "neg": lambda a: -a,
    "recip": lambda a: 1.0 / a if a else 1e300, "mark": lambda a: a, "max": max, "min": min,
    "guard": lambda a, b: a + 0.0 * b, "abs": abs, "sin": _safe(math.sin, 1e15), "cos": _safe(math.cos, 1e15),
    "tan": _safe(math.tan, 1e15), "tanh": math.tanh, "atan": math.atan, "atan2": math.atan2, "hypot": math.hypot,
    "asin": lambda a: math.asin(_within(a)), "acos": lambda a: math.acos(_within(a)),
    "sqrt": lambda a: math.sqrt(abs(a)), "log": lambda a: math.log(abs(a) + 1e-300),
    "pow": lambda a, b: INTERPRETED["exp"](b * math.log(abs(a) + 1e-300)), "sinh": _safe(math.sinh),
    "cosh": _safe(math.cosh), "exp": _safe(math.exp), "expm1": _safe(math.expm1),
    "log1p": lambda a: math.log(abs(1.0 + a) + 1e-300),
    "phi": _safe(special.phi), "dphi": _safe(special.dphi), "sinc": _safe(special.sinc, 1e15),
    "dsinc": _safe(special.dsinc, 1e15),
    "lam": lambda a: math.log(abs(1.0 + a) + 1e-300) / a if a else 1.0,
    "dlam": lambda a: (1.0 / (1.0 + a + 1e-9) - math.log(abs(1.0 + a) + 1e-300) / (a or 1e-9)) / (a or 1e-9),
    "phi_slope": lambda k, a: special.phi_slope(k, max(-50.0, min(50.0, a))),
    "lam_slope": lambda k, a: special.lam_slope(k, abs(a)),
    "sinc_slope": lambda k, a: special.sinc_slope(k, max(-1e15, min(1e15, a))),
    "atan_slope": special.atan_slope, "atan_bend": special.atan_bend,
}  # fmt: skip


def across(op: str, a: Symbol, b: Symbol) -> Symbol:
    """a + b (or max, min) of symbols of two spaces: over all entries, if they are the two representatives."""
    for x, y in ((a, b), (b, a)):
        if x.space is not None and x.space.which == 0 and alike(x, y):
            return over_all(op, x)
        if x.op == op:
            for rest, part in (x.args, x.args[::-1]):
                if rest.space is None and part.space is not None and alike(part, y):
                    return symbols.rebuilt_pair(op, rest, over_all(op, part if part.space.which == 0 else y))
    raise symbols.mixed(a, b)


def over_all(op: str, x: Symbol, space: str = "") -> Symbol:
    """The sum, maximum or minimum over all entries; of a number (space: of what) so many times it."""
    if x.space is None:
        return symbols.mul(count(space), x) if op == "add" else x
    first = x if x.space.which == 0 else twin(x)
    found = intern("over_all", (first,), (op, x.space.name), space=None)
    found.twin = found
    return found


def count(space: str) -> Symbol:
    """How many entries a space has."""
    return intern("count", (), space)


def gather(x: Symbol, path: Path, anchor: Symbol | None = None) -> Symbol:
    """x at path's end, for each entry at its beginning; at fixed places the anchor's, without one 0."""
    if is_const(x) and anchor is None:
        return x
    if not path:
        return x
    if x.op == "gather" and anchor is None and len(x.args) == 1:
        return gather(x.args[0], (*path, *x.value))
    if x.space is None and anchor is None and path[-1].target != "position":
        return x
    if x.space is None or x.space.name != path[-1].target:
        raise mixed_up(f"an array of {path[-1].target}s is needed, not {_said(x)}")
    args = (x,) if anchor is None else (x, anchor)
    return intern("gather", args, path, space=space_of(path[0].source, x.space.which))


def scatter(terms: Sequence[tuple[Symbol, Map]]) -> Symbol:
    """For each entry of the maps' target the sum of the terms that lead there."""
    kept = [(x, m) for x, m in terms if not is_const(x, 0.0)]
    if not kept:
        return const(0.0)
    (which,) = {x.space.which for x, _ in kept if x.space is not None} or {0}
    if any(x.space is None for x, _ in kept):
        raise mixed_up("what is summed at the ends of elements or links depends on none of them")
    value = tuple(m for _, m in kept)
    return intern("scatter", tuple(x for x, _ in kept), value, space=space_of(value[0].target, which))


def rebuilt(op: str, args: Sequence[Any], value: Any) -> Symbol:
    """A gather, scatter or sum over all with other arguments."""
    if op == "gather":
        return gather(args[0], value, *args[1:])
    if op == "scatter":
        return scatter(list(zip(args, value, strict=True)))
    return over_all(value[0], args[0], value[1])


def symmetric(pair: Sequence[Any]) -> Symbol:
    """The first of two representatives, after a look at whether the second is its twin."""
    first, second = (symbols.lifted(x) for x in pair)
    if not alike(first, second) or (first.space is not None and first.space.which):
        raise mixed_up("it does different things with different entries of an array")
    return first


def _said(x: Symbol) -> str:
    return f"one of {x.space.name}s" if x.space is not None else "a number"


def along(outputs: Sequence[Symbol], directions: Mapping[Symbol, Symbol]) -> list[Symbol]:
    """Derivatives of the outputs along the directions that some variables move in."""
    from .derivatives import partials, topological

    zero = const(0.0)
    tangent = {x.number: t for x, t in directions.items()}
    for node in topological(outputs):
        if node.number in tangent:
            continue
        parts = [tangent.get(a.number, zero) for a in node.args]
        if all(is_const(t, 0.0) for t in parts):
            continue
        if node.op == "mark":
            tangent[node.number] = parts[0]
        elif node.op == "gather":
            tangent[node.number] = gather(parts[0], node.value)
        elif node.op == "scatter":
            tangent[node.number] = scatter(list(zip(parts, node.value, strict=True)))
        elif node.op == "over_all":
            if node.value[0] != "add":
                raise mixed_up("the largest of all has no derivative")
            tangent[node.number] = over_all("add", parts[0], node.value[1])
        else:
            total = zero
            for part, partial in zip(parts, partials(node), strict=True):
                if not is_const(part, 0.0):
                    total = symbols.add(total, symbols.mul(partial, part))
            tangent[node.number] = total
    return [tangent.get(x.number, zero) for x in outputs]


class Term(NamedTuple):
    """Entries of a Jacobian: `slope`, for each entry of `over`, in row rows(entry) and column columns(entry)."""

    over: str
    rows: Path
    columns: Path
    unknown: Symbol


def jacobian_terms(outputs: Sequence[Symbol], unknowns: Sequence[Symbol]) -> list[dict[Term, Symbol]]:
    """Exact derivatives of arrays by arrays: of each output its terms, to be summed where they fall together."""
    from .derivatives import partials, topological

    tangents: dict[int, dict[Term, Symbol]] = {x.number: _identity(x) for x in unknowns}
    seeds: dict[int, dict[Term, Symbol]] = {}
    for node in topological(outputs):
        if node.number in tangents or not any(tangents.get(a.number) for a in node.args):
            continue
        inner = [tangents.get(a.number, {}) for a in node.args]
        found: dict[Term, Symbol] = {}
        if node.op == "mark":
            seeds[node.number], found = inner[0], _identity(node)
        elif node.op == "gather":
            for term, slope in inner[0].items():
                _through(found, term, slope, node.value)
        elif node.op == "scatter":
            for terms, m in zip(inner, node.value, strict=True):
                for term, slope in terms.items():
                    _add(found, term._replace(rows=(*term.rows, m)), slope)
        elif node.op == "over_all":
            raise mixed_up("an unknown enters a sum over all")
        else:
            for terms, partial in zip(inner, partials(node) if any(inner) else (), strict=True):
                for term, slope in terms.items():
                    _add(found, term, symbols.mul(gather(partial, term.rows) if partial.space else partial, slope))
        tangents[node.number] = found
    return [_expanded(tangents.get(x.number, {}), seeds) for x in outputs]


def gradient(output: Symbol, unknown: Symbol) -> Symbol:
    """Derivative of a number by each entry of an array, where it is made of sums over entries that each see a few."""
    from .derivatives import sparse_jacobian, topological

    sums = [node for node in topological([output]) if node.op == "over_all"]
    (weights,) = sparse_jacobian([output], sums)
    terms, total = [], const(0.0)
    for k, weight in sorted(weights.items()):
        for term, slope in jacobian_terms([sums[k].args[0]], [unknown])[0].items():
            if term.rows or len(term.columns) > 1 or sums[k].value[0] != "add":
                raise mixed_up("this derivative of a sum over all is not known")
            if term.columns:
                terms.append((symbols.mul(weight, slope), term.columns[0]))
            else:
                total = symbols.add(total, symbols.mul(weight, slope))
    return symbols.add(total, scatter(terms)) if terms else total


def _identity(x: Symbol) -> dict[Term, Symbol]:
    if x.space is None:
        raise mixed_up("a number is an unknown")
    return {Term(x.space.name, (), (), x): const(1.0)}


def _add(found: dict[Term, Symbol], term: Term, slope: Symbol) -> None:
    found[term] = symbols.add(found[term], slope) if term in found else slope


def _through(found: dict[Term, Symbol], term: Term, slope: Symbol, path: Path) -> None:
    """A term of x, for gather(x, path)."""
    if term.rows:
        raise mixed_up("what is summed at the ends of elements (a force) enters an element again")
    _add(found, Term(path[0].source, (), (*path, *term.columns), term.unknown), _carried(slope, path))


def _carried(slope: Symbol, path: Path) -> Symbol:
    """A slope at the path's end; what it is at fixed places does not matter: their columns are left out."""
    return gather(slope, path) if slope.space is not None else slope


def _expanded(terms: dict[Term, Symbol], seeds: Mapping[int, dict[Term, Symbol]]) -> dict[Term, Symbol]:
    """Without marked nodes in place of unknowns, the last one first."""
    terms = dict(terms)
    while pending := [term for term in terms if term.unknown.number in seeds]:
        last = max(pending, key=lambda term: term.unknown.number)
        outer = terms.pop(last)
        for term, slope in seeds[last.unknown.number].items():
            if term.rows:
                raise mixed_up("what is summed at the ends of elements (a force) enters an element again")
            moved = _carried(slope, last.columns)
            _add(terms, Term(last.over, last.rows, (*last.columns, *term.columns), term.unknown),
                 symbols.mul(outer, moved))  # fmt: skip
    return {term: slope for term, slope in terms.items() if not is_const(slope, 0.0)}


__all__ = ["Count", "Map", "Path", "Space", "Term", "across", "along", "gather", "jacobian_terms", "over_all",
           "scatter", "symmetric", "twin", "variable"]  # fmt: skip
