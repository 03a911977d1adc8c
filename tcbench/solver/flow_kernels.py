"""From a residual formula to the kernels of one implicit flow.

The author's formula r(z0, z1, h, system) is run once on symbols. Then, exactly and automatically:
- unknowns are increments d = z1 - z0; rows that say "does not move" are dropped;
- rows that give an unknown explicitly, or linearly with coefficients fixed during Newton, are eliminated
  (for the pendulum q1 - q0 = h p_mid/m goes: six unknowns are left);
- what does not change during Newton is hoisted into a prologue;
- the Jacobian is differentiated from the graph and factorised on it, so its zeros cost nothing.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..compiler import derivatives as trace
from ..compiler.derivatives import Symbol, const
from ..compiler.elimination import ZERO_PIVOT, factorise
from ..compiler.formula_hash import formula_hash
from ..compiler.kernels import constant_part, fixed_values, kernel, placed
from ..compiler.normal_rows import normalised
from ..errors import TraceError, shown
from ..integrator import Flow, Residual
from ..systems import constrained
from ..systems.element_system import ElementSystem
from ..systems.state import State
from ..systems.system import System
from .first_values import measured_by, near_start, plain_start, sizes_of
from .foresight import foreseen
from .formula import called, checked_rows, further, has_roots, numbered
from .kernels_of_flow import FlowKernels, constants
from .linear_algebra import STEEPEST
from .reduction import Reduction, reduce

if TYPE_CHECKING:
    from .pattern import Pattern

UNROLLED = 24  # unknowns up to which the elimination is unrolled; beyond, Newton works on a sparse matrix


def build(flow: Flow, system: System) -> FlowKernels:
    """Trace, reduce, differentiate and print one flow; nothing is compiled yet."""
    symbolic = system.symbolic  # its symbols come first, whoever made them
    if callable(flow.chosen):
        flow = replace(flow, chosen=flow.chosen(symbolic))
    by_loops = system.large and not (system.multipliers and flow.of_step)  # which holds constraints one by one
    with foreseen(system, 1 + flow.stages, by_loops=by_loops):
        if by_loops:
            from .array_flow import flow_of

            return flow_of(flow, formula_hash(flow.residual), system.by_arrays)(system.mesh)
        with trace.tracing():
            return _build(flow, symbolic)


def _build(flow: Flow, system: System) -> FlowKernels:
    sym, n = system.symbolic, system.size
    h, z0 = trace.variable("h"), trace.variables("z", n)
    d = trace.variables("d", n * (1 + flow.stages))
    y0 = sym.in_variables(flow.variables, z0)
    start = trace.variables("start", n * (flow.memory or 2))
    pulls = sym.multipliers and not flow.of_step
    view = constrained.pulled(sym, _multipliers(sym, y0)) if pulls else sym
    numbers = dict(zip(flow.numbers, trace.variables("number", len(flow.numbers)), strict=True))
    more = [*further(flow, sym, z0, h, start.reshape(-1, n)), *([numbers] if numbers else [])]
    given, equations = traced(flow, view, y0, d, h, more)
    unseen = not flow.stages
    rows, impulses = normalised(given, d, h), list[Symbol]()
    if pulls:
        rows, impulses = constrained.closed(sym, view, y0, list(d), h, rows, flow.residual.__name__)
        rows = _by_own_slope(rows, list(d), impulses, h)
        unseen = False
    unseen = unseen and not numbers
    last = [*impulses, *numbers.values()]
    reduction = reduce([*rows, *equations], [*d, *last], unseen=unseen)
    _last(reduction, last)
    pattern, slopes = _ordered(reduction) if len(reduction.unknowns) > UNROLLED else (None, [])
    x = reduction.unknowns
    increments = np.array(reduction.increments(d), dtype=object)
    y1 = y0 + increments[:n]
    dz = increments[:n]
    if flow.variables != "entropy":
        ds = sym.entropy_increments(flow.variables, y0, y1)
        dz = np.concatenate([dz[: -len(ds)], ds])
    place = {s: i for i, s in enumerate(d)}
    place |= {s: len(d) + i for i, s in enumerate(last)}
    where = [place[s] for s in x]
    positive = list(y1.theta) if flow.variables == "temperature" else []
    sizes = sizes_of(sym, y0, z0, flow.variables)
    own = dict(zip(impulses, _sizes_of_impulses(rows, d, impulses, h, sizes), strict=True))
    own |= dict.fromkeys(numbers.values(), const(1.0))
    if pattern is None:
        moved = reduction.moved()
        scales = [own[s] if s in own else trace.reciprocal(sizes[place[s] % n]) for s in (*x, *moved)]
        parts = _dense_parts(reduction, moved, positive, h, scales)
        guess = near_start(where, sym, z0, h, flow.variables)
    else:
        scaled = {s: trace.reciprocal(sizes[i % n]) for i, s in enumerate(d)} | own
        scaled = measured_by(reduction, scaled)
        parts = _sparse_parts(reduction, slopes, positive, h, [scaled[s] for s in x])
        guess = [const(0.0)] * len(x)
    fixed = [*plain_start(reduction).values(), *guess, *parts.scales]
    moving = [*parts.iterate, *parts.polish, *parts.full, *dz]
    hoisted = fixed_values(moving, [*x, *parts.stored], moving)
    opening = [*fixed, *hoisted, *sym.observe(z0)]
    # of an explicit flow the step size is constant as well; where Newton works, continuation varies it
    behind = placed("b", start, system.n_constant_values)
    first: list[Symbol] = list(start[n:]) if flow.of_step else []  # the state at the start of the run is constant, too
    varying = start[: len(start) - len(first)]
    fixed_constants = constant_part(opening, [*z0, *varying, *([h] if x else [])])
    known = {h: "b[0]", **system.constant_symbols()}
    prologue_inputs = placed("a", z0) | known | behind | placed("out", fixed_constants, len(opening))
    reads = placed("a", hoisted, len(fixed)) | placed("b", x)
    stored = placed("out", parts.stored, len(parts.iterate))
    opened = kernel(prologue_inputs, opening)
    return FlowKernels(
        setup=kernel({**known, **{s: behind[s] for s in first}}, fixed_constants),
        prologue=opened if pattern else kernel(prologue_inputs, [*fixed, *hoisted]),
        opening=opened,
        iterate=kernel(reads, [*parts.iterate, *parts.stored.values()]),
        polish=kernel(reads | stored, parts.polish),
        finish=kernel(reads, list(dz)),
        full=kernel(reads, parts.full),
        n_unknowns=len(x),
        n_eliminated=len(parts.moved),
        n_positive=len(positive),
        foresees=pattern is None
        and not isinstance(sym, ElementSystem),  # theirs have a nearer guess than the last roots: `near_start`
        steep=has_roots(reduction.rows),
        pattern=pattern,
        constrained=bool(impulses),
        mends=flow.chosen != (),
        way=f"sparse: {len(x)} unknowns" if pattern else f"unrolled: {len(x)} unknowns" if x else "explicit",
    )


def _multipliers(sym: System, y0: Any) -> list[Any]:
    return constrained.symbols_like(constrained.conditions(sym, y0), "lam")


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


def _last(reduction: Reduction, unknowns: list[Symbol]) -> None:
    """Their pivots are there once what they move is eliminated."""
    if not unknowns:
        return
    place = {x.number: i for i, x in enumerate(unknowns)}
    pairs = list(zip(reduction.rows, reduction.unknowns, strict=True))
    pairs.sort(key=lambda pair: place.get(pair[1].number, -1))
    reduction.rows, reduction.unknowns = [r for r, _ in pairs], [x for _, x in pairs]


@dataclass
class _Parts:
    """What differs between small systems, whose elimination is unrolled, and large ones."""

    iterate: list[Symbol]
    full: list[Symbol]
    scales: list[Symbol]
    polish: list[Symbol] = field(default_factory=list)
    moved: list[Symbol] = field(default_factory=list)
    stored: dict[Symbol, Symbol] = field(default_factory=dict)


def _dense_parts(
    reduction: Reduction, moved: list[Symbol], positive: list[Symbol], h: Symbol, scales: list[Symbol]
) -> _Parts:
    x = reduction.unknowns
    jacobian = trace.jacobian(reduction.rows, x)
    factors, pivots = factorise(jacobian)
    stored, names = factors.stored()
    downhill = [trace.neg(r) for r in reduction.rows]
    correction, chord = factors.solve(downhill), stored.solve(downhill)
    slopes = trace.jacobian([reduction.eliminated[e] for e in moved], x)
    image = [list(slopes @ step) if x and moved else [] for step in (correction, chord)]
    d_dh: Any = trace.jacobian(reduction.rows, [h])[:, 0] if x else []
    corrections = [*correction, *image[0]]
    sizes = [trace.mul(abs(step), scale) for step, scale in zip(corrections, scales, strict=True)]
    finite = [*correction, _steepness(jacobian, scales)] if has_roots(reduction.rows) else correction
    iterate = [*corrections, *pivots, *positive, _size(sizes, finite)]
    iterate.append(functools.reduce(trace.minimum, [*pivots, *positive], const(np.inf)))
    chords = [trace.mul(abs(step), scale) for step, scale in zip([*chord, *image[1]], scales, strict=True)]
    polish = [*chord, *image[1], _size(chords, chord)]
    return _Parts(iterate, [*reduction.rows, *jacobian.ravel(), *d_dh], scales, polish, moved, names)


def _sparse_parts(
    reduction: Reduction, slopes: list[Symbol], positive: list[Symbol], h: Symbol, scales: list[Symbol]
) -> _Parts:
    d_dh = [row.get(0, const(0.0)) for row in trace.sparse_jacobian(reduction.rows, [h])]
    return _Parts([*reduction.rows, *slopes, *positive], d_dh, scales, [*reduction.rows, *positive])


def _ordered(reduction: Reduction) -> tuple[Pattern, list[Symbol]]:
    """A sparse Jacobian's pattern and entries; rows and unknowns are put into the order of the pattern."""
    from .pattern import Pattern  # of large systems only

    rows = trace.sparse_jacobian(reduction.rows, reduction.unknowns)
    found = [(i, j, slope) for i, row in enumerate(rows) for j, slope in row.items()]
    pattern = Pattern(len(rows), [i for i, _, _ in found], [j for _, j, _ in found])
    entries = [const(0.0)] * pattern.nnz
    for place, (_, _, slope) in zip(pattern.places, found, strict=True):
        entries[place] = slope
    if any(trace.is_const(entries[k], 0.0) for k in pattern.diagonal):
        raise TraceError(ZERO_PIVOT)
    reduction.rows = [reduction.rows[i] for i in pattern.order]
    reduction.unknowns = [reduction.unknowns[i] for i in pattern.order]
    pattern.order[:] = np.arange(pattern.n)
    return pattern, entries


_EXPLICIT: dict[tuple[Residual, tuple[Any, ...], str | None], FlowKernels] = {}


def apply_explicit(formula: Residual, system: System, start: Any, end: Any, first: Any = None) -> Any:
    """What an explicit flow of the whole step (of_step=True) adds to `end`, by its compiled formula; shape (n,).

    start, first : the states at which the step and the run began; without the latter they are one.
    TraceError for a formula that is implicit, or reads the step's length, which is not given here.
    """
    key = (formula, system.structure, formula_hash(formula))
    states = [end, start, start if first is None else first]
    if key[-1] is None or key not in _EXPLICIT:
        kernels = build(Flow(formula, of_step=True), system)
        name = getattr(formula, "__name__", "formula")
        if kernels.n_unknowns:
            raise TraceError(
                f"apply_explicit: {name!r} is implicit, and {kernels.n_unknowns} unknowns are left to solve for. Write "
                "the new state as a formula of the old ones, z1 - z0 - ..., or give a method flows=."
            )
        found, longer = (_applied(kernels, system, h, *states) for h in (0.0, 1.0))
        if not np.array_equal(found, longer, equal_nan=True):
            raise TraceError(
                f"apply_explicit: {name!r} reads the step's length h, which is not known here. Leave h out of the "
                "formula, or give a method flows=."
            )
        _EXPLICIT[key] = kernels
    return _applied(_EXPLICIT[key], system, 0.0, *states)


def _applied(kernels: FlowKernels, system: System, h: float, end: Any, start: Any, first: Any) -> Any:
    """What the explicit formula of these kernels adds to `end`."""
    w = kernels.prepared(end, constants(system, h, start, first))
    return kernels.finish(w, w)


def _size(sizes: Sequence[Symbol], terms: Sequence[Symbol]) -> Symbol:
    """max of the sizes, NaN if any term is not finite."""
    return trace.guarded(functools.reduce(trace.maximum, sizes, const(0.0)), terms)


def _steepness(jacobian: NDArray[np.object_], scales: Sequence[Symbol]) -> Symbol:
    """A number that is infinite where a slope, in units of the unknowns, is too steep: see `STEEPEST`."""
    s = np.array(scales[: len(jacobian)], dtype=object)
    squares = (trace.mul(slope, slope) for slope in (jacobian * (s[:, None] / s)).ravel())
    return trace.mul(const(np.finfo(float).max / STEEPEST**2), functools.reduce(trace.add, squares, const(0.0)))


def traced(
    flow: Flow, system: System, y0: State, d: Any, h: Symbol, further: list[Any]
) -> tuple[list[Symbol], list[Symbol]]:
    """Run the author's formula on symbols; a flat list of residual rows, and the equations of further numbers."""
    n = system.size
    y1, *stages = (y0 + d[k : k + n] for k in range(0, len(d), n))  # with the names that y0 has
    found, equations = numbered(flow, called(flow, [y0, y1, h, system, *([stages] if stages else []), *further]))
    result = np.asarray(found, dtype=object)
    if result.size != len(d):
        missing = result.shape == () and result.item() is None
        given = "nothing (is `return` missing?)" if missing else f"{result.size} numbers"
        raise TraceError(
            f"The residual {flow.residual.__name__!r} returned {given}; a state of {system.name!r} "
            f"has {n}{f' and there are {len(stages)} stages' if stages else ''}, so it must return {len(d)}."
        )
    rows = []
    for r in result.ravel():
        try:
            rows.append(r if isinstance(r, Symbol) else const(float(r)))
        except (TypeError, ValueError):
            raise TraceError(
                f"The residual {flow.residual.__name__!r} returned {shown(r)} among its numbers, which is none."
            ) from None
    return checked_rows(flow, rows, list(d)), equations
