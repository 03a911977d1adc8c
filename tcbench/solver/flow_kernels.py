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
from ..compiler.array_states import entries
from ..compiler.derivatives import Symbol, const
from ..compiler.elimination import ZERO_PIVOT, factorise
from ..compiler.formula_hash import formula_hash
from ..compiler.kernels import constant_part, fixed_values, kernel, placed
from ..errors import TraceError
from ..integrator import Flow
from ..systems.element_system import ElementSystem
from ..systems.system import System
from .equations import equations_of
from .first_values import measured_by, near_start, plain_start
from .foresight import foreseen
from .formula import has_roots
from .kernels_of_flow import FlowKernels, constants
from .linear_algebra import STEEPEST
from .mending import product
from .reduction import Reduction

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


def _build(flow: Flow, sym: System) -> FlowKernels:
    eq = equations_of(flow, sym)
    h, n, reduction, start = eq.h, sym.size, eq.reduction, entries(*eq.start)
    last = [*eq.impulses, *eq.numbers]
    _last(reduction, last)
    pattern, slopes = _ordered(reduction) if len(reduction.unknowns) > UNROLLED else (None, [])
    x, dz, positive = reduction.unknowns, entries(eq.dz), eq.positive
    if pattern is None:
        moved = reduction.moved()
        scales = [eq.inverse_sizes[s] for s in (*x, *moved)]
        parts = _dense_parts(reduction, moved, positive, h, scales)
        place = {s: i for i, s in enumerate([*eq.d, *last])}
        guess = near_start([place[s] for s in x], sym, eq.z0, h, flow.variables)
    else:
        scaled = measured_by(reduction, eq.inverse_sizes)
        parts = _sparse_parts(reduction, slopes, positive, h, [scaled[s] for s in x])
        guess = [const(0.0)] * len(x)
    fixed = [*plain_start(reduction).values(), *guess, *parts.scales]
    if eq.again:
        parts.polish, dz, fixed = eq.again, [], [*dz, product(sym, eq.dz, eq.dz), product(sym, eq.z0, eq.z0)]
    moving = [*parts.iterate, *parts.polish, *parts.full, *dz]
    hoisted = fixed_values(moving, [*x, *parts.stored, *(eq.d if eq.again else [])], moving)
    opening = [*fixed, *hoisted, *sym.observe(eq.z0)]
    # of an explicit flow the step size is constant as well; where Newton works, continuation varies it
    behind = placed("b", start, sym.n_constant_values)
    first: list[Symbol] = list(start[n : 2 * n]) if flow.of_step else []  # that of the run is constant, too
    varying = start[:n] + start[2 * n :] if flow.of_step else start
    fixed_constants = constant_part(opening, [*entries(eq.z0), *varying, *([h] if x else [])])
    known = {h: "b[0]", **sym.constant_symbols()}
    prologue_inputs = placed("a", entries(eq.z0)) | known | behind | placed("out", fixed_constants, len(opening))
    reads = placed("a", hoisted, len(fixed)) | placed("b", x)
    stored = placed("out", parts.stored, len(parts.iterate))
    opened = kernel(prologue_inputs, opening)
    return FlowKernels(
        setup=kernel({**known, **{s: behind[s] for s in first}}, fixed_constants),
        prologue=opened if pattern else kernel(prologue_inputs, [*fixed, *hoisted]),
        opening=opened,
        iterate=kernel(reads, [*parts.iterate, *parts.stored.values()]),
        polish=kernel(reads | (placed("b", eq.d) if eq.again else stored), parts.polish),
        finish=kernel(reads, dz),
        full=kernel(reads, parts.full),
        n_unknowns=len(x),
        n_eliminated=len(parts.moved),
        n_positive=len(positive),
        # systems of elements have a nearer guess than the last roots: `near_start`
        foresees=eq.foresees if eq.again else pattern is None and not isinstance(sym, ElementSystem),
        steep=has_roots(reduction.rows),
        pattern=pattern,
        constrained=bool(eq.impulses),
        mends=bool(eq.again) and flow.chosen != (),
        way=f"sparse: {len(x)} unknowns" if pattern else f"unrolled: {len(x)} unknowns" if x else "explicit",
    )


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


_CORRECTIONS: dict[tuple[Flow, tuple[Any, ...], str | None], FlowKernels] = {}


def correction(flow: Flow, system: System, start: Any, end: Any, first: Any) -> Any:
    """What one correction (`Flow.most`) adds to `end`, by the compiled formula; shape (n,).

    start, first : the states at which the step and the run began.
    """
    key = (flow, system.structure, formula_hash(flow.residual))
    kernels = _CORRECTIONS.get(key) or build(flow, system)
    if key[-1] is not None:
        _CORRECTIONS[key] = kernels
    return kernels.prepared(end, constants(system, 0.0, start, first, np.zeros(len(end))))[: len(end)]


def _size(sizes: Sequence[Symbol], terms: Sequence[Symbol]) -> Symbol:
    """max of the sizes, NaN if any term is not finite."""
    return trace.guarded(functools.reduce(trace.maximum, sizes, const(0.0)), terms)


def _steepness(jacobian: NDArray[np.object_], scales: Sequence[Symbol]) -> Symbol:
    """A number that is infinite where a slope, in units of the unknowns, is too steep: see `STEEPEST`."""
    s = np.array(scales[: len(jacobian)], dtype=object)
    squares = (trace.mul(slope, slope) for slope in (jacobian * (s[:, None] / s)).ravel())
    return trace.mul(const(np.finfo(float).max / STEEPEST**2), functools.reduce(trace.add, squares, const(0.0)))
