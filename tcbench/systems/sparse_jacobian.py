"""Derivatives of a system's formulas as sparse matrices, for SciPy's Radau and BDF and for multipliers."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from ..compiler import derivatives as trace
from ..compiler.array_jacobian import jacobian_terms
from ..compiler.array_kernels import jacobian_kernel
from ..compiler.array_mesh import Block, scattered
from ..compiler.array_states import entries
from ..compiler.arrays import variable
from ..compiler.kernels import Kernel, kernel, placed
from .system import System

Formula = Callable[..., Any]  # of a system and states


def sparse_jacobian(system: System) -> Callable[[Any], Any]:
    """J(z) -> scipy.sparse.csr_matrix, shape (n, n), of a state z (n,); exact, traced once a structure."""
    return sparse_slopes(system, vector_field)


def vector_field(system: Any, z: Any) -> Any:
    return system.vector_field(z)


def sparse_slopes(system: System, formula: Formula, states: int = 1) -> Callable[..., Any]:
    """d formula(system, z, ...)/d(the last of so many states) -> scipy.sparse.csr_matrix, shape (values, n)."""
    from scipy.sparse import csr_matrix

    entries_of, rows, columns, m = _entries(system.symbolic, formula, states)
    n = system.size
    key, places = np.unique(rows * n + columns, return_inverse=True)
    first = np.searchsorted(key, np.arange(m + 1) * n)
    index = key % n

    def slopes(*arguments: Any) -> Any:
        at = np.concatenate(arguments).astype(float)
        values = entries_of(at, system.constant_values)[: len(places)]
        return csr_matrix((np.bincount(places, values, len(key)), index, first), shape=(m, n))

    return slopes


@cache
def _entries(symbolic: Any, formula: Formula, states: int) -> tuple[Kernel, Any, Any, int]:
    """The kernel of the entries, their rows and columns, and the number of values."""
    if symbolic.large and not (formula is vector_field and symbolic.multipliers):
        return _by_arrays(symbolic, formula, states)
    with trace.tracing():
        arguments = [trace.variables(f"z{k}", symbolic.size) for k in range(states)]
        values = list(map(trace.lifted, entries(formula(symbolic, *map(symbolic.state, arguments)))))
        sparse_rows = trace.sparse_jacobian(values, list(arguments[-1]))
        terms = [(i, j, slope) for i, row in enumerate(sparse_rows) for j, slope in row.items()]
        inputs = placed("a", np.concatenate(arguments)) | symbolic.constant_symbols()
        slopes_kernel = kernel(inputs, [slope for _, _, slope in terms])
    rows, columns = (np.array([term[k] for term in terms], np.int64) for k in range(2))
    return slopes_kernel, rows, columns, len(values)


def _by_arrays(symbolic: Any, formula: Formula, states: int) -> tuple[Kernel, Any, Any, int]:
    """`_entries` of a large system, in loops."""
    net, mesh = symbolic.by_arrays, symbolic.mesh
    with trace.tracing():
        arguments = [net.fresh_state(f"z{k}") for k in range(states)]
        x, blocks = entries(arguments[-1]), net.blocks(arguments[-1])
        values = net.blocks(formula(net, *arguments))
        ours = [Block(b.space, tuple(variable("row", b.space) for _ in b.symbols)) for b in values]
        # minus a variable, so that each entry has a row of its own also where all rates are one number
        rows = [trace.sub(trace.lifted(f), trace.lifted(row)) for b, own in zip(values, ours, strict=True)
                for f, row in zip(b.symbols, own.symbols, strict=True)]  # fmt: skip
        slopes = jacobian_terms(rows, x)
        flat = [(i + len(x), term, slope) for i, row in enumerate(slopes) for term, slope in row.items()]
        inputs = {"a": net.blocks([*arguments]), "b": net.constant_blocks()}
        loops = jacobian_kernel(inputs, [], [(term, slope) for _, term, slope in flat], [])
    pattern = scattered(mesh, [*blocks, *ours], [(i, term) for i, term, _ in flat])
    count, n = len(pattern.rows), mesh.offsets(blocks)[-1]
    places = pattern.places(np.arange(count), count)
    kernel_ = loops.kernel(mesh.with_entries(count), places, extra=1)
    return kernel_, pattern.rows - n, pattern.columns, mesh.offsets(ours)[-1]
