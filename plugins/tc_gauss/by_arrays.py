"""Kernels of the collocation for large systems, as loops over their spaces, and its sparse Jacobian."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from tcbench.compiler import derivatives as trace
from tcbench.compiler.array_jacobian import Term, jacobian_terms, shared_as_unknowns
from tcbench.compiler.array_kernels import ArrayKernel, array_kernel, jacobian_kernel
from tcbench.compiler.array_mesh import Block, Mesh, scattered
from tcbench.compiler.array_states import entries
from tcbench.compiler.arrays import NUMBER
from tcbench.compiler.once import once
from tcbench.solver.mending import array_mending_kernels
from tcbench.systems.system import System

from .any_system import parts_of, rates_of, started
from .sparse import sparse

NAMES = ("to_start", "to_motion", "to_slopes", "to_forces", "to_laws", "to_mend", "to_hold")


class ArrayFormulas(NamedTuple):
    """Of a kind of system, whatever its size."""

    kernels: list[ArrayKernel]  # by NAMES
    carried: list[Block]
    projected: list[Block]
    matrix: ArrayKernel
    unknowns: list[Block]  # of the matrix: those of a state, then shared numbers
    terms: list[tuple[int, Term]]  # its entries: of which row


@once
def array_formulas(net: Any) -> ArrayFormulas:
    """Those of all systems of one kind, by their `by_arrays`."""
    with trace.tracing():
        z, K = net.fresh_state("z"), net.fresh_state("K")
        parts = parts_of(net, z, K)
        of_state, of_rate = net.blocks(z), net.blocks(K)
        carried = [Block(y.space, (y,)) for p in parts for y in p.y]
        means = [Block(x.space, (x,)) for p in parts for x in p.means]
        motion = [Block(y.space, (x,)) for p in parts for y, x in zip(p.y, p.motion, strict=True)]
        start = [Block(y.space, (x,)) for p in parts for y, x in zip(p.y, p.start, strict=True)]
        slopes = [Block(m.space, (x,)) for p in parts for m, x in zip(p.means, p.slopes, strict=True)]
        constants = [Block(NUMBER, (None,)), *net.constant_blocks()]
        bodies = [
            (of_state, [*net.blocks(started(net, z)), *start]),
            ([*of_rate, *of_state], motion),
            (carried, slopes),
            ([*of_rate, *of_state, *means], net.blocks(rates_of(net, z, parts))),
        ]
        made = [array_kernel({"a": inputs, "b": constants}, outputs) for inputs, outputs in bodies]
        return ArrayFormulas([*made, *array_mending_kernels(net)], carried, means, *_matrix(net, z, K, constants))


def _matrix(
    net: Any, z: Any, K: Any, constants: list[Block]
) -> tuple[ArrayKernel, list[Block], list[tuple[int, Term]]]:
    """The Jacobian of K - field(z), and of the rows of what all entries of an array read: see `sparse`."""
    rows = [trace.sub(k, trace.lifted(f)) for k, f in zip(entries(K), entries(net.vector_field(z)), strict=True)]
    rows, unknowns, shared = shared_as_unknowns(rows, entries(z))
    found = [(i, term, slope) for i, row in enumerate(jacobian_terms(rows, unknowns)) for term, slope in row.items()]
    slopes = trace.substitute([slope for _, _, slope in found], shared)
    terms = [(term, slope) for (_, term, _), slope in zip(found, slopes, strict=True)]
    made = jacobian_kernel({"a": net.blocks(z), "b": constants}, [], terms, [])
    blocks = [*net.blocks(z), *(Block(NUMBER, (x,)) for x in shared)]
    return made, blocks, [(i, term) for i, term, _ in found]


def fields(system: System, n_factors: int) -> dict[str, Any]:
    """The fields of a record for a large system."""
    made, mesh, size = array_formulas(system.by_arrays), system.mesh, system.size
    kernels = dict(zip(NAMES, (x.kernel(mesh) for x in made.kernels), strict=True))
    matrix, to_matrix = _sparse(made, mesh, size, n_factors)
    carried, projected = (mesh.offsets(blocks)[-1] for blocks in (made.carried, made.projected))
    return {
        "general": True, "large": True, **dict.fromkeys(("n", "n_newton", "n_lanes", "n_positive"), 0),
        **dict.fromkeys(("e", "m", "n_matrix"), size), "sparse": matrix,
        "n_constants": len(system.constant_values), "to_matrix": to_matrix, "n_ends": kernels["to_start"].size,
        "n_nodes": 2 * size + projected, "n_carried": carried, "n_slopes": projected,
        "n_laws": kernels["to_laws"].size, "n_mended": kernels["to_mend"].size, "c": system.constant_values,
        **{name: x.address for name, x in kernels.items()},
    }  # fmt: skip


def _sparse(made: ArrayFormulas, mesh: Mesh, size: int, n_factors: int) -> tuple[Any, int]:
    rows, columns, lengths = scattered(mesh, made.unknowns, made.terms)
    free = rows >= 0
    n = mesh.offsets(made.unknowns)[-1]
    found, places = sparse(size, rows[free], columns[free], n, n_factors)
    where = np.full(len(rows), found.n_values)  # what is fixed writes behind everything
    where[free] = places
    kernel = made.matrix.kernel(mesh.with_entries(found.n_values), np.split(where, np.cumsum(lengths)[:-1]), extra=1)
    return found, kernel.address
