"""The kernels of a flow on a system that is declared over spaces, from a formula that is traced on arrays.

As `flow_kernels`, with arrays in the place of numbers, and nothing that depends on a size but where the entries are.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..compiler import derivatives as trace
from ..compiler.array_jacobian import Term, jacobian_terms, shared_as_unknowns
from ..compiler.array_kernels import array_kernel, jacobian_kernel
from ..compiler.array_mesh import Block, Mesh, Shorts, alone, scattered
from ..compiler.array_states import entries, refilled
from ..compiler.caches import cached
from ..compiler.derivatives import Symbol, const
from ..compiler.elimination import ZERO_PIVOT
from ..compiler.kernels import fixed_values, kernel
from ..errors import TraceError
from ..integrator import Flow
from .equations import equations_of
from .first_values import measured_by, plain_start
from .foresight import jacobian_fits
from .formula import has_roots
from .kernels_of_flow import FlowKernels
from .mending import product
from .pattern import Pattern

Made = Callable[[Mesh], FlowKernels]  # the kernels of a flow for a system of this mesh


def _pattern(
    mesh: Mesh, unknowns: Sequence[Block], terms: Sequence[tuple[int, Term]], positive: int
) -> tuple[Pattern, list[Shorts]]:
    """Of the Jacobian; and for each term where its entries are. terms: each with the number of its row."""
    if not terms:
        raise TraceError(ZERO_PIVOT)
    n = mesh.offsets(unknowns)[-1]
    jacobian_fits(n, sum(mesh.size(term.over) for _, term in terms if not term.over.startswith("pairs ")))
    entries = scattered(mesh, unknowns, terms)
    pattern = Pattern(n, entries.rows, entries.columns)
    met = np.zeros(pattern.nnz, bool)
    met[pattern.places] = True
    if not met[pattern.diagonal].all():
        raise TraceError(ZERO_PIVOT)
    return pattern, entries.places(pattern.places, pattern.nnz + positive)


def array_flow(flow: Flow, system: Any) -> Made:
    """Trace, reduce and differentiate one flow; system: one that stands for all of its kind, of any size."""
    with trace.tracing():
        return _array_flow(flow, system)


def _array_flow(flow: Flow, net: Any) -> Made:
    eq = equations_of(flow, net)
    h, z0, reduction, dz, positive = eq.h, eq.z0, eq.reduction, eq.dz, eq.positive
    x = reduction.unknowns
    residual, unknowns, shared = shared_as_unknowns(reduction.rows, x)
    terms = jacobian_terms(residual, unknowns)
    flat = [(i, term, slope) for i, row in enumerate(terms) for term, slope in row.items()]
    d_dh = trace.along(residual, {h: const(1.0)})
    sizes = measured_by(reduction, eq.inverse_sizes)
    began = plain_start(reduction)
    began |= dict(zip(shared, trace.substitute(list(shared.values()), began), strict=True))
    # Newton's matrix has rows for shared numbers, which are what the other unknowns make them: as if it had none
    outputs = trace.substitute([*residual, *(slope for _, _, slope in flat), *d_dh], shared)
    residual, d_dh = outputs[: len(unknowns)], outputs[-len(d_dh) :]
    flat = [(i, term, slope) for (i, term, _), slope in zip(flat, outputs[len(unknowns) :], strict=False)]
    scaled = [sizes[s] if s in sizes else _of_size(began[s]) for s in unknowns]
    fixed = [*(began[s] for s in unknowns), *[const(0.0)] * len(unknowns), *scaled]
    moving = [*residual, *(slope for _, _, slope in flat), *d_dh, *positive, *(eq.again or entries(dz))]
    # what is only read elsewhere is read there by whoever needs it: kept it would be written and read once more
    varying = eq.d if eq.again else unknowns
    hoisted = dict.fromkeys(v.args[0] if v.op == "take" else v for v in fixed_values(moving, varying, moving))
    kept = alone(list(hoisted))
    inputs = {
        "a": net.blocks(z0),
        "b": [*net.constant_blocks(h), *net.blocks(eq.start)],
    }
    opening = alone(fixed, unknowns * 3)
    before, warm, increments, found = alone(residual, unknowns), alone(positive), alone(unknowns), net.blocks(dz)
    if eq.again:
        opening = [*found, *alone([product(net, dz, dz), product(net, z0, z0)])]
        before, increments, found = net.blocks(refilled(dz, eq.again)), net.blocks(refilled(dz, eq.d)), []
    reads = {"a": [*(Block(b.space, (None,) * len(b.symbols)) for b in opening), *kept], "b": increments}
    opened = array_kernel(inputs, [*opening, *kept, *net.blocks(net.observe(z0))], behind=True)
    iterate = jacobian_kernel(reads, before, [(term, slope) for _, term, slope in flat], warm, behind=True)
    polish = array_kernel(reads, before + warm, behind=True)
    finish, full = array_kernel(reads, found), array_kernel(reads, alone(d_dh, unknowns))
    steep, constrained_ = has_roots(residual), bool(eq.impulses)
    blocks, entries_of = alone(unknowns), [(i, term) for i, term, _ in flat]
    warm_spaces, shared_spaces = [v.space for v in positive], [x.space for x in shared]

    def kernels(mesh: Mesh) -> FlowKernels:
        n, n_positive, empty = mesh.offsets(blocks)[-1], sum(map(mesh.size, warm_spaces)), kernel({}, [])
        pattern, places = _pattern(mesh, blocks, entries_of, n_positive) if n else (None, [])
        opening = opened.kernel(mesh)
        return FlowKernels(
            setup=empty, prologue=opening, opening=opening,
            iterate=iterate.kernel(mesh.with_entries(pattern.nnz if pattern else 0), places, extra=1),
            polish=polish.kernel(mesh), finish=finish.kernel(mesh), full=full.kernel(mesh),
            n_unknowns=n, n_eliminated=0, n_positive=n_positive, n_shared=sum(map(mesh.size, shared_spaces)),
            pattern=pattern, steep=steep, constrained=constrained_, foresees=eq.foresees,
            mends=bool(eq.again) and flow.chosen != (),
            way=(f"sparse: {n} unknowns" if n else "explicit") + ", in loops over the elements",
        )  # fmt: skip

    return kernels


def _of_size(value: Symbol) -> Symbol:
    return trace.reciprocal(trace.maximum(const(1.0), abs(value)))


def flow_of(formula: Flow, hashed: str | None, kind: Any) -> Made:
    """One of a formula with this hash, for all systems of a kind; None: it has none."""
    return array_flow(formula, kind) if hashed is None else _flow_of(formula, hashed, kind)


@cached
def _flow_of(formula: Flow, hashed: str, kind: Any) -> Made:
    return array_flow(formula, kind)
