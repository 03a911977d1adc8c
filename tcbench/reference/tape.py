"""A system's equations as a tape: a list of operations on Taylor series, which `taylor` executes.

The straight-line text of the vector field runs once on `Node`s, which record operations. A quotient is one operation,
expressions of constants are computed once a scenario, and unused ones are left out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiler.symbols import operators
from ..systems.right_hand_side import as_python

LANES, PAIR = 8, 16  # scenarios side by side; doubles of one coefficient: eight high parts, eight low ones
OPERATIONS = ("add", "add_static", "sub", "neg", "mul", "square", "scale", "div", "recip", "sqrt", "exp", "log",
              "slope", "cos_sin", "atan", "abs", "second")  # fmt: skip
CODE = {name: i for i, name in enumerate(OPERATIONS)}
FIELDS = 5  # of an operation: code, place of the result, two operands, room of its own
SERIES_ROOM, NUMBER_ROOM = (
    ("log", "cos_sin", "atan"),
    ("div", "sqrt", "log", "atan", "abs"),
)  # operations with room of their own


def _lifted(node: Node, other: Any) -> Node:
    return node.tape.lifted(other)


def _quotient(a: Node, b: Node) -> Node:
    return a.tape.mul(a, a.tape.make("recip", b))


def _over_size(x: Node) -> bool:
    """Is x a multiple of 1/|u|? u/|u| has to be one quotient, a sign: u times 1/|u| loses all digits near 0."""
    while x.op == "scale":
        x = x.args[0]
    return x.op == "recip" and "abs" in (x.args[0].op, *(a.op for a in x.args[0].args))


class Node:
    """A series, or (static) a constant; behaves as a number in the text of a formula."""

    def __init__(self, tape: _Recorder, op: str, args: tuple[Node, ...] = (), value: Any = None) -> None:
        self.tape, self.op, self.args, self.value = tape, op, args, value
        self.static: bool = op == "input" or (op != "variable" and all(a.static for a in args))

    __add__, __radd__ = operators(_lifted, lambda a, b: a.tape.add(a, b))
    __sub__, __rsub__ = operators(_lifted, lambda a, b: a.tape.sub(a, b))
    __mul__, __rmul__ = operators(_lifted, lambda a, b: a.tape.mul(a, b))
    __truediv__, __rtruediv__ = operators(_lifted, _quotient)

    def __neg__(self) -> Node:
        return self.args[0] if self.op == "neg" else self.tape.make("neg", self)


class _Recorder:
    """Nodes in the order of creation; equal ones are one object."""

    def __init__(self) -> None:
        self.nodes: dict[Any, Node] = {}

    def make(self, op: str, *args: Node, value: Any = None) -> Node:
        key = (op, tuple(map(id, args)), value)
        return self.nodes.setdefault(key, Node(self, op, args, value))

    def lifted(self, x: Any) -> Node:
        return x if isinstance(x, Node) else self.make("input", value=float(x))

    def add(self, a: Node, b: Node) -> Node:
        if a.static and not b.static:
            a, b = b, a
        if b.value == 0.0:
            return a
        return self.make("add_static" if b.static and not a.static else "add", a, b)

    def sub(self, a: Node, b: Node) -> Node:
        if a is b:
            return self.lifted(0.0)
        if a.static != b.static:
            return self.add(a, -b)
        return self.make("sub", a, b)

    def mul(self, a: Node, b: Node) -> Node:
        if a.static and not b.static:
            a, b = b, a
        for x, other in ((a, b), (b, a)):
            if x.value == 1.0:
                return other
            if x.op == "recip" and not x.static and not other.static:
                return self.make("div", other, x.args[0])
            if x.op == "scale" and not other.static and _over_size(x):
                return self.mul(self.mul(other, x.args[0]), x.args[1])
        if a is b:
            return self.make("square", a)
        return self.make("scale" if b.static and not a.static else "mul", a, b)

    def cos_sin(self, x: Node) -> tuple[Node, Node]:
        both = self.make("cos_sin", x, self.make("slope", x))
        return both, self.make("second", both)

    def functions(self) -> dict[str, Callable[..., Any]]:
        """The elementary functions with a series, and |x|, which has one on either side of its kink."""
        one = self.lifted(1.0)

        def exp(x: Node) -> Node:
            return self.make("exp", x, self.make("slope", x))

        def log(x: Node) -> Node:
            return self.make("log", x)

        def sqrt(x: Node) -> Node:
            return size(x.args[0]) if x.op == "square" else self.make("sqrt", x)

        def atan(x: Node) -> Node:
            return self.make("atan", x, one + x * x)

        def size(x: Node) -> Node:
            return self.make("abs", x)

        turns = {"sin": lambda x: self.cos_sin(x)[1], "cos": lambda x: self.cos_sin(x)[0]}
        return {"abs": size, "exp": exp, "log": log, "sqrt": sqrt, "atan": atan, **turns}


@dataclass(frozen=True, eq=False)
class Tape:
    """Operations with their places in memory, which count doubles.

    size : of the memory. setup, code : operations on constants, on series; FIELDS numbers each. rates : where the rate
    of each variable stands, and whether it moves. inputs : where constants stand, and numbers: the index of a system's
    constant in `indices`, or -1 and a literal in `literals`.
    """

    size: int
    setup: NDArray[np.int64]
    code: NDArray[np.int64]
    rates: NDArray[np.int64]
    moving: NDArray[np.int64]
    inputs: NDArray[np.int64]
    indices: NDArray[np.int64]
    literals: NDArray[np.float64]

    @property
    def has_kinks(self) -> bool:
        return CODE["abs"] in self.code[::FIELDS]

    def values(self, constants: NDArray[np.float64]) -> NDArray[np.float64]:
        """The values of the inputs for these constants of the system."""
        return np.where(self.indices >= 0, np.asarray(constants)[np.maximum(self.indices, 0)], self.literals)


@lru_cache(maxsize=32)
def tape(text: str, variables: int, constants: int, order: int) -> Tape:
    """The tape of a kernel's text (`System.formula`) with `variables` variables, for series up to `order`.

    TcbenchError where it uses a function that has no series.
    """
    recorder = _Recorder()
    unknowns = [recorder.make("variable", value=("variable", i)) for i in range(variables)]
    constant_symbols = [recorder.make("input", value=("constant", i)) for i in range(constants)]
    out: dict[int, Any] = {}
    as_python(text, recorder.functions())(unknowns, constant_symbols, out)
    return _laid_out(recorder, unknowns, [recorder.lifted(out[i]) for i in range(len(out))], order)


def _laid_out(recorder: _Recorder, unknowns: Sequence[Node], outputs: Sequence[Node], order: int) -> Tape:
    needed = {id(x) for x in unknowns}
    waiting = list(outputs)
    while waiting:
        node = waiting.pop()
        if id(node) not in needed:
            needed.add(id(node))
            waiting += node.args
    series = PAIR * (order + 1)
    place: dict[int, int] = {}
    end, setup, code, inputs, values = 0, list[int](), list[int](), list[int](), list[Any]()
    for node in (x for x in recorder.nodes.values() if id(x) in needed):
        room = PAIR if node.static else series
        if node.op == "second":
            place[id(node)] = place[id(node.args[0])] + room
            continue
        at = place[id(node)] = end
        rooms = 1 + (node.op in SERIES_ROOM)
        end += rooms * room + PAIR * (node.op in NUMBER_ROOM)
        if node.op == "input":
            inputs.append(at)
            values.append(node.value)
        elif node.op != "variable":
            first, second = (*(place[id(a)] for a in node.args), 0)[:2]
            (setup if node.static else code).extend([CODE[node.op], at, first, second, at + rooms * room])
    positions = [x[1] if isinstance(x, tuple) else -1 for x in values]
    literals = [math.nan if isinstance(x, tuple) else x for x in values]

    def whole(numbers: Sequence[int]) -> NDArray[np.int64]:
        return np.array(numbers, np.int64)

    rates, moving = whole([place[id(x)] for x in outputs]), whole([not x.static for x in outputs])
    return Tape(end, whole(setup), whole(code), rates, moving, whole(inputs), whole(positions), np.array(literals))
