"""d(vector field)/dz of a large system as a sparse matrix: for implicit solvers of others (SciPy's Radau and BDF)."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from ..compiler import derivatives as trace
from ..compiler.array_jacobian import jacobian_terms
from ..compiler.array_kernels import jacobian_kernel
from ..compiler.array_mesh import scattered
from ..compiler.array_states import entries
from ..compiler.kernels import Kernel, kernel, placed
from .system import System


def sparse_jacobian(system: System) -> Callable[[Any], Any]:
    """J(z) -> scipy.sparse.csr_matrix, shape (n, n), of a state z (n,); exact, traced once a structure."""
    from scipy.sparse import csr_matrix

    entries_of, rows, columns = _entries(system.symbolic)
    n = system.size
    key, places = np.unique(rows * n + columns, return_inverse=True)
    first = np.searchsorted(key, np.arange(n + 1) * n)
    index = key % n

    def jacobian(z: Any) -> Any:
        values = entries_of(np.ascontiguousarray(z, dtype=float), system.constant_values)[: len(places)]
        return csr_matrix((np.bincount(places, values, len(key)), index, first), shape=(n, n))

    return jacobian


@cache
def _entries(symbolic: Any) -> tuple[Kernel, Any, Any]:
    """The kernel of the entries, and their rows and columns."""
    if symbolic.large and not symbolic.multipliers:
        return _by_arrays(symbolic)
    with trace.tracing():
        z = trace.variables("z", symbolic.size)
        found = trace.sparse_jacobian(list(symbolic.vector_field(z)), list(z))
        terms = [(i, j, slope) for i, row in enumerate(found) for j, slope in row.items()]
        made = kernel(placed("a", z) | symbolic.constant_symbols(), [slope for _, _, slope in terms])
    return made, *(np.array([term[k] for term in terms], np.int64) for k in range(2))  # type: ignore[return-value]


def _by_arrays(symbolic: Any) -> tuple[Kernel, Any, Any]:
    """As of any system, in loops."""
    net, mesh = symbolic.by_arrays, symbolic.mesh
    with trace.tracing():
        z = net.fresh_state("z")
        x, blocks = entries(z), net.blocks(z)
        # less an array, so that each entry has a row also where all have one number for their rate
        rates = zip(entries(net.vector_field(z)), entries(net.fresh_state("rate")), strict=True)
        found = jacobian_terms([trace.sub(trace.lifted(f), rate) for f, rate in rates], x)
        flat = [(i, term, slope) for i, row in enumerate(found) for term, slope in row.items()]
        inputs = {"a": blocks, "b": net.constant_blocks()}
        made = jacobian_kernel(inputs, [], [(term, slope) for _, term, slope in flat], [])
    there = scattered(mesh, blocks, [(i, term) for i, term, _ in flat])
    count = len(there.rows)
    places = there.places(np.arange(count), count)
    return made.kernel(mesh.with_entries(count), places, extra=1), there.rows, there.columns
