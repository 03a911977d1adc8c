"""Arrays in graphs: one symbol for an array that has an entry for each of a space, the nodes or springs of a system.

Each component of such an array is one node of the graph, whatever the number of entries: elementwise arithmetic is that
of numbers, and four operations lead from one space to another,

    take(x, path)      x at the path's end, for each entry at its beginning        x[self.ends]
    collect(terms)     for each entry the sum of the terms whose path leads there  self.ends.sums(x)
    total(x)           the sum (maximum, minimum) over all entries                 x.sum()
    join(x, y), part   entries of several spaces, one after the other              np.concatenate([x, y])[self.ends]

take and collect are each other's transposes, and so are total and the broadcast of a number, and join and part.
`array_symbols` shows them to formulas.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from ..errors import TraceError
from . import symbols
from .symbols import Symbol, const, intern, is_const

NUMBER = ""  # the space of a number
LINEAR = ("take", "collect", "total", "join", "part")
NO_SLOPE = "The largest or smallest of all has no derivative."


class Map(NamedTuple):
    """A map from entries of `source` to entries of `target`: column `column` of the table `name`."""

    name: Any
    column: int
    source: str
    target: str


Path = tuple[Map, ...]


def variable(name: str, space: str) -> Symbol:
    """A new variable over a space."""
    x = symbols.variable(name)
    x.space = space
    return x


def take(x: Symbol, path: Path) -> Symbol:
    if not path or x.space == NUMBER:
        return x
    if x.op == "take":
        return take(x.args[0], (*path, *x.value))
    return intern("take", (x,), path, space=path[0].source)


def collect(terms: Sequence[tuple[Symbol, Path]]) -> Symbol:
    kept = [(x, path) for x, path in terms if not is_const(x, 0.0)]
    if not kept:
        return const(0.0)
    paths = tuple(path for _, path in kept)
    return intern("collect", tuple(x for x, _ in kept), paths, space=paths[0][-1].target)


def total(op: str, x: Symbol, space: str) -> Symbol:
    """The sum ("add"), maximum or minimum of x over all entries of a space."""
    if space == NUMBER or (x.space == NUMBER and op != "add"):
        return x
    if x.space == NUMBER:
        return symbols.mul(count(space), x)
    return intern("total", (x,), (op, space), space=NUMBER)


def count(space: str) -> Symbol:
    """The number of entries of a space."""
    return intern("count", (), space)


def join(parts: Sequence[Symbol], space: str) -> Symbol:
    """The entries of several arrays, one after the other; space: "a+b"."""
    first = parts[0]
    if first.op == "const" and all(x is first for x in parts):
        return first
    return intern("join", tuple(parts), space, space=space)


def part(x: Symbol, k: int, space: str) -> Symbol:
    """The k-th of arrays joined over the space "a+b"; x itself where nothing is joined."""
    if x.op == "join":
        return x.args[k]
    return x if x.space == NUMBER or "+" not in space else intern("part", (x,), (k, space), space=space.split("+")[k])


def rebuilt(op: str, args: Sequence[Any], value: Any) -> Symbol:
    """An operation of `LINEAR` on other arguments."""
    match op:
        case "collect":
            return collect(list(zip(args, value, strict=True)))
        case "total":
            return total(value[0], args[0], value[1])
        case "take":
            return take(args[0], value)
        case "join":
            return join(args, value)
    return part(args[0], *value)


def space_of(op: str, value: Any) -> str:
    """Over which space one of these operations is."""
    match op:
        case "collect":
            return str(value[0][-1].target)
        case "take":
            return str(value[0].source)
        case "part":
            return str(value[1].split("+")[value[0]])
    return NUMBER if op == "total" else str(value)


def reader(node: Symbol, k: int) -> str:
    """The space whose entries read argument k of an operation."""
    if node.op == "join":
        return str(node.value.split("+")[k])
    return str(node.value[k][0].source) if node.op == "collect" else node.space


def transposed(node: Symbol, y: Symbol) -> tuple[Symbol, ...]:
    """The transpose of an operation of `LINEAR`: the covectors of its arguments from the covector y of its value."""
    match node.op:
        case "take":
            return (collect([(y, node.value)]),)
        case "collect":
            return tuple(take(y, path) for path in node.value)
        case "total" if node.value[0] == "add":
            return (y,)
        case "join":
            return tuple(part(y, k, node.value) for k in range(len(node.args)))
        case "part":
            k, space = node.value
            return (join([y if i == k else const(0.0) for i in range(len(space.split("+")))], space),)
    raise TraceError(NO_SLOPE)
