"""From graphs to kernels: straight-line scalar Python, compiled once and cached.

Every kernel has one signature, kernel(a, b, out) on three float64 arrays, so that one generic compiled loop
can call any of them by address.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .caches import LOCK, cached_property
from .derivatives import Symbol, depends_on, topological
from .language import PLAIN, made_up_address, pick, put, release, row, scratch, vector
from .ops import OPERATIONS, values

WIDTH = 8  # doubles in a vector
ROW = 4  # doubles in a short vector of results
_BINARY = {"add": "+", "sub": "-", "mul": "*"}


def straight_line(inputs: Mapping[Symbol, str], outputs: Sequence[Symbol], in_rows: int = 0) -> str:
    """Source of the kernel that reads `inputs` (symbol -> 'a[0]') and fills out[0], out[1], ...

    in_rows : number of the first results that are stored as short vectors, for a reader that loads vectors: a processor
    stalls when it loads at once what was just stored one by one.
    """
    names: dict[int, str] = {}
    lines: list[str] = []
    # an input may itself be a formula (a hoisted value): do not look beneath it
    nodes = topological(outputs, {x.number for x in inputs})
    derivatives = derivatives_of(nodes)
    for node in nodes:
        if node in inputs:
            names[node.number] = name = f"t{len(lines)}"
            lines.append(f"{name} = {inputs[node]}")
        elif node.number not in names:
            lines += written(node, names, f"t{len(lines)}", derivatives)
    results = [names[node.number] for node in outputs]
    for i in range(0, in_rows, ROW):
        group = results[i : min(i + ROW, in_rows)]
        lines.append(f"put(out, {i}, vector({', '.join(group)}))" if len(group) > 1 else f"out[{i}] = {group[0]}")
    lines += [f"out[{i}] = {name}" for i, name in enumerate(results) if i >= in_rows]
    return text_of(lines)


def text_of(lines: Sequence[str]) -> str:
    """Source of a kernel with this body."""
    return "def kernel(a, b, out):\n" + "".join(f"    {line}\n" for line in lines or ["pass"])


def derivatives_of(nodes: Iterable[Symbol]) -> dict[int, Symbol]:
    """By the number of a value, the derivative that is computed together with it."""
    shared = {row.name: row.with_slope for row in OPERATIONS.values() if row.with_slope}
    slopes = {(x.op, x.args[0].number): x for x in nodes if x.op in shared.values()}
    pairs = ((x.number, slopes.get((shared[x.op], x.args[0].number))) for x in nodes if x.op in shared)
    return {number: slope for number, slope in pairs if slope is not None}


def written(node: Symbol, names: dict[int, str], name: str, derivatives: Mapping[int, Symbol]) -> list[str]:
    """The text of a node, one line or none; the names of its value and of its derivative go to `names`."""
    if node.op in ("const", "mark"):
        names[node.number] = literal(node) if node.op == "const" else names[node.args[0].number]
        return []
    if node.op == "var":
        raise ValueError(f"the kernel needs {node!r}, which is no input of it")
    names[node.number] = name
    if node.number in derivatives:
        names[derivatives[node.number].number] = f"d{name}"
        return [f"{name}, d{name} = {node.op}_pair({names[node.args[0].number]})"]
    if node.op == "mul":
        for x, inverse in (node.args, node.args[::-1]):
            if inverse.op == "recip" and inverse.args[0].number in names and _is_size(inverse.args[0]):
                return [f"{name} = {names[x.number]} / {names[inverse.args[0].number]}"]
    return [f"{name} = {operation(node, [names[x.number] for x in node.args])}"]


def _is_size(node: Symbol) -> bool:
    """Is the node |u|, or a sum with |u|? A quotient by it is a sign and has to be exactly 1 or -1, which u times 1/|u|
    is not always: 1 - sign(u) may be multiplied by an infinite slope."""
    return node.op == "abs" or (node.op == "add" and any(map(_is_size, node.args)))


def literal(node: Symbol) -> str:
    """A constant as text."""
    if math.isinf(node.value):
        return "inf" if node.value > 0 else "(-inf)"
    return f"({node.value!r})" if node.value < 0 else repr(node.value)


def operation(node: Symbol, args: list[str]) -> str:
    """The operation of a node on these arguments, as text."""
    if node.op in _BINARY:
        return f"{args[0]} {_BINARY[node.op]} {args[1]}"
    if node.op == "neg":
        return f"-{args[0]}"
    if node.op == "guard":
        return f"{args[0]} + ({args[1]} - {args[1]})"
    if node.op == "recip":
        return f"1.0 / {args[0]}"
    return f"{node.op}({', '.join(args)})"


def fixed_values(outputs: Sequence[Symbol], varying: Sequence[Symbol], also: Sequence[Symbol] = ()) -> list[Symbol]:
    """Nodes that do not depend on `varying` and are read by nodes that do, or are in `also`; without constants."""
    moving = depends_on(outputs, varying)
    read = [a for node in topological(outputs) if node.number in moving for a in node.args]
    return list(dict.fromkeys(x for x in [*read, *also] if x.number not in moving and x.op != "const"))


def constant_part(outputs: Sequence[Symbol], varying: Sequence[Symbol]) -> list[Symbol]:
    """Operations that do not depend on `varying`, used by some that do: computed once a run, not once a step."""
    return [x for x in fixed_values(outputs, varying) if x.op != "var"]


@dataclass(frozen=True)
class Kernel:
    """Source text of one kernel; compiled when its address is first asked for."""

    text: str
    size: int
    table: NDArray[np.int32] | None = field(default=None, compare=False)  # whole numbers that the text reads
    room: int = field(default=0, compare=False)  # doubles behind the results, for intermediate values
    seldom: bool = field(default=False, compare=False)  # called once a run: compiled fast, not optimised

    def __getstate__(self) -> dict[str, Any]:
        """Without the address, which holds in this process only."""
        return {name: value for name, value in dict(vars(self)).items() if name != "address"}

    @cached_property
    def address(self) -> int:
        """Address of the compiled code, to be passed as an integer into compiled loops."""
        return _load(self.text, self.table, self.seldom)

    def __call__(self, a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
        """Evaluate once; returns a new array, shape (size,). `a` and `b` must be contiguous."""
        from .library import evaluate

        out = np.empty(self.size + self.room)
        evaluate(self.address, a, b, out)
        return out[: self.size]


def placed(letter: str, symbols: Iterable[Symbol], first: int = 0) -> dict[Symbol, str]:
    """The places of consecutive numbers: symbol -> 'a[3]', ..."""
    return {x: f"{letter}[{first + i}]" for i, x in enumerate(symbols)}


def kernel(inputs: Mapping[Symbol, str], outputs: Sequence[Symbol], in_rows: int = 0) -> Kernel:
    return Kernel(straight_line(inputs, outputs, in_rows), len(outputs))


def of_lines(lines: Sequence[str], size: int, table: NDArray[np.int32] | None = None) -> Kernel:
    """The kernel of these lines, with `size` results."""
    return Kernel(text_of(lines), size, table)


def namespace() -> dict[str, Any]:
    """The functions that the text of a kernel may call, by name."""
    from . import special

    functions = {f.__name__: f for f in (scratch, release, vector, row, pick, put)}
    pairs = {f"{x.name}_pair": getattr(special, f"{x.name}_pair") for x in OPERATIONS.values() if x.with_slope}
    return {"inf": math.inf, **values(), **functions, **pairs}


def _load(text: str, table: NDArray[np.int32] | None, seldom: bool) -> int:
    """The address of the compiled text; a made-up one where nothing is compiled."""
    if not PLAIN:
        from .machine import load  # LLVM is imported when something is compiled, not before

        with LOCK:  # of threads that ask for the same one compiles it
            return load(text, lambda _: _code(text, table), table, by="kernel", seldom=seldom)
    scope = namespace() | {"table": table}
    exec(compile(text, "<kernel>", "exec"), scope)
    return made_up_address(scope["kernel"])


def _code(text: str, table: NDArray[np.int32] | None = None) -> str:
    """LLVM code of a kernel's text; functions of `special` become part of it."""
    from .translator import Module

    module = Module()
    if table is not None:
        module.table()
    module.kernel(text, namespace() if table is None else namespace() | {"table": table})
    return module.text()
