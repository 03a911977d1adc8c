"""The equations of a flow: the author's formula on symbols, numbers or arrays, and what is left of them for Newton."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..compiler import derivatives as trace
from ..compiler.array_states import Blocks, entries, fitted, refilled
from ..compiler.array_symbols import ArraySymbol
from ..compiler.arrays import NUMBER, variable
from ..compiler.derivatives import Symbol, const
from ..compiler.normal_rows import normalised
from ..errors import TraceError, shown
from ..integrator import Flow
from ..systems import constrained
from .first_values import sizes_of
from .formula import called, checked_rows, further, numbered
from .reduction import Reduction, reduce, reduce_arrays

MOVED = 2  # place of what corrections have moved among the states that a formula is given beside z0 and z1


def states_of(flow: Flow) -> int:
    """How many these are, of a one-step method."""
    return MOVED + (flow.most > 1)


@dataclass
class Equations:
    """What is solved in a step of length h from z0, and what is made of the unknowns.

    start : states at the start of step and run, and what corrections have moved; or slopes of earlier steps. d :
    increments, those of stages behind. dz : increments of the state. again : those after one more correction along the
    same slopes, of `Flow.most`. foresees : does what is made of d read what was moved? positive : temperatures among
    the unknowns. inverse_sizes : 1/size of each increment, impulse and number.
    """

    h: Symbol
    z0: Any
    start: list[Any]
    d: list[Symbol]
    reduction: Reduction
    impulses: list[Symbol]
    numbers: list[Symbol]
    dz: Any
    again: list[Symbol]
    foresees: bool
    positive: list[Symbol]
    inverse_sizes: dict[Symbol, Symbol]


def equations_of(flow: Flow, system: Any) -> Equations:
    """Run the author's formula once, for a system with symbols for constants or one that stands for all of its kind."""

    def unknowns(name: str) -> Any:
        return system.fresh_state(name) if system.by_array else trace.variables(name, system.size)

    h, z0 = trace.variable("h"), unknowns("z")
    steps = [unknowns(f"d{k}") for k in range(1 + flow.stages)]
    y0 = system.in_variables(flow.variables, z0)
    start = [unknowns(f"start{k}") for k in range(flow.memory or states_of(flow))]
    d, view, impulses = entries(*steps), system, list[Symbol]()
    pulls = system.multipliers and not flow.of_step
    if pulls:
        view = constrained.pulled(system, constrained.symbols_like(constrained.conditions(system, y0), "lam"))
    numbers = {name: variable("number", NUMBER) for name in flow.numbers}
    more = [*further(flow, system, z0, h, start), *([numbers] if numbers else [])]
    found, equations = _rows(flow, view, y0, h, steps, more)
    rows, again, foresees = checked_rows(flow, found, d), list[Symbol](), False
    if flow.most > 1:
        reads = trace.depends_on(rows, entries(start[MOVED]))
        foresees = any(row.number in reads for row in rows)
        ends = [trace.sub(x, row) for x, row in zip(d, rows, strict=True)]
        once, again = (trace.substitute(ends, dict.fromkeys(x, const(0.0))) for x in (d, entries(start[MOVED])))
        rows = [trace.sub(x, end) for x, end in zip(d, once, strict=True)]
    rows = normalised(rows, d, h)
    sizes = sizes_of(system, y0, z0, flow.variables)
    if system.by_array and any(row.space not in (NUMBER, s.space) for row, s in zip(rows, d, strict=True)):
        raise trace.refused(
            f"the rows of the residual {flow.residual.__name__!r} are in another order than "
            f"{', '.join(system.variables)}",
            "Give them in that of the state",
        )
    if pulls:
        rows, impulses = constrained.closed(system, view, y0, d, h, rows, flow.residual.__name__)
    inverse = dict(zip(d, map(trace.reciprocal, sizes * len(steps)), strict=True))
    inverse |= dict.fromkeys([*impulses, *numbers.values()], const(1.0))
    last = [*impulses, *numbers.values()]
    if system.by_array:
        reduction = reduce_arrays([*rows, *equations], [*d, *last], h)
    else:
        if impulses:
            rows = _by_own_slope(rows, d, impulses, h)
            inverse |= zip(impulses, _sizes_of_impulses(rows, d, impulses, h, sizes), strict=True)
        reduction = reduce([*rows, *equations], [*d, *last], unseen=not (flow.stages or last))
    dy = refilled(y0, reduction.increments(d)[: len(sizes)])
    y1 = y0 + dy
    dz = dy
    if flow.variables != "entropy":
        ds = entries(system.entropy_increments(flow.variables, y0, y1))
        dz = refilled(dy, [*entries(dy)[: -len(ds)], *ds])
    positive = entries(y1.theta) if flow.variables == "temperature" else []
    return Equations(h, z0, start, d, reduction, impulses, [*numbers.values()], dz, again, foresees, positive, inverse)


def _rows(flow: Flow, system: Any, y0: Any, h: Symbol, steps: Sequence[Any], more: Sequence[Any]) -> Any:
    """The rows of the author's formula, those of stages behind, and the equations of further numbers."""
    y1, *stages = (y0 + d for d in steps)  # with the names that y0 has
    found, equations = numbered(flow, called(flow, [y0, y1, h, system, *([stages] if stages else []), *more]))
    told = f"{f' and there are {len(stages)} stages' if stages else ''}, so it must return"
    return (_of_arrays if system.by_array else _of_numbers)(flow, system, found, steps, told), equations


def _of_numbers(flow: Flow, system: Any, found: Any, steps: Sequence[Any], told: str) -> list[Symbol]:
    result, wanted = np.asarray(found, dtype=object), len(entries(*steps))
    if result.size != wanted:
        missing = result.shape == () and result.item() is None
        given = "nothing (is `return` missing?)" if missing else f"{result.size} numbers"
        raise TraceError(
            f"The residual {flow.residual.__name__!r} returned {given}; a state of {system.name!r} "
            f"has {system.size}{told} {wanted}."
        )
    rows = []
    for r in result.ravel():
        try:
            rows.append(r if isinstance(r, Symbol) else const(float(r)))
        except (TypeError, ValueError):
            raise TraceError(
                f"The residual {flow.residual.__name__!r} returned {shown(r)} among its numbers, which is none."
            ) from None
    return rows


def _of_arrays(flow: Flow, system: Any, found: Any, steps: Sequence[Any], told: str) -> list[Symbol]:
    blocks = found.blocks if isinstance(found, Blocks) else [found]
    wanted = [block for d in steps for block in d.blocks]
    if len(blocks) != len(wanted):
        raise TraceError(
            f"The residual {flow.residual.__name__!r} returned {len(blocks)} arrays; a state of {system.name!r} has "
            f"{len(steps[0].blocks)} ({', '.join(system.variables)}){told} {len(wanted)}."
        )
    if sorted(map(_kind, blocks)) == sorted(map(_kind, wanted)):  # in whatever order
        return list(map(trace.lifted, entries(*blocks)))
    name = f"the residual {flow.residual.__name__!r}"
    return [x for block, like in zip(blocks, wanted, strict=True) for x in entries(fitted(block, like, name))]


def _kind(block: Any) -> tuple[str, int]:
    return block.space if isinstance(block, ArraySymbol) else NUMBER, len(entries(block))


def _at_rest(x: Sequence[Symbol], unknowns: Sequence[Symbol], h: Symbol) -> list[Symbol]:
    return trace.substitute(list(x), {**dict.fromkeys(unknowns, const(0.0)), h: const(0.0)})


def _by_own_slope(rows: list[Symbol], d: list[Symbol], impulses: list[Symbol], h: Symbol) -> list[Symbol]:
    """The multipliers' rows over their slopes at z1 = z0, so that small pivots are suspicious there, too."""
    found = list(rows)
    for k, impulse in enumerate(impulses):
        (slopes,) = trace.sparse_jacobian([rows[len(d) + k]], [impulse])
        (slope,) = _at_rest([slopes.get(0, const(0.0))], [*d, *impulses], h)
        if trace.is_const(slope, 0.0):
            raise TraceError("A constraint feels no force of its multiplier: is it of what has no inertia?")
        found[len(d) + k] = trace.mul(rows[len(d) + k], trace.reciprocal(slope))
    return found


def _sizes_of_impulses(
    rows: list[Symbol], d: Any, impulses: list[Symbol], h: Symbol, sizes: list[Symbol]
) -> list[Symbol]:
    """1/size of each: of what moves with it, by whichever is the strictest."""
    found = [const(0.0)] * len(impulses)
    for i, row in enumerate(trace.sparse_jacobian(rows[: len(sizes)], impulses) if impulses else []):
        for k, slope in row.items():
            (still,) = _at_rest([slope], [*d, *impulses], h)
            found[k] = trace.maximum(found[k], trace.mul(abs(still), trace.reciprocal(sizes[i])))
    return [trace.maximum(x, const(1e-100)) for x in found]
