"""d(vector field)/dz of a large system as a sparse matrix: for implicit solvers of others (SciPy's Radau and BDF)."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from ..compiler import derivatives as trace
from ..compiler import spaces
from ..compiler.kernels import Kernel
from ..compiler.rolled import rolled
from ..compiler.sentences import MixedSpaces
from ..compiler.space_kernels import Mesh, Slot, space_kernel
from .network import Network, blocks, state_slots
from .system import System
from .traced import FEW


def sparse_jacobian(system: System) -> Callable[[Any], Any]:
    """J(z) -> scipy.sparse.csr_matrix, shape (n, n), of a state z (n,); exact, traced once a structure."""
    from scipy.sparse import csr_matrix

    kernel, rows, columns = _entries(system.symbolic)
    n = system.size
    key, places = np.unique(rows * n + columns, return_inverse=True)
    first = np.searchsorted(key, np.arange(n + 1) * n)
    index = key % n

    def jacobian(z: Any) -> Any:
        values = kernel(np.ascontiguousarray(z, dtype=float), system.constant_values)[: len(places)]
        return csr_matrix((np.bincount(places, values, len(key)), index, first), shape=(n, n))

    return jacobian


@cache
def _entries(symbolic: Any) -> tuple[Kernel, Any, Any]:
    """The kernel of the entries, and their rows and columns."""
    if isinstance(symbolic, Network) and symbolic.size > FEW:
        try:
            return _by_spaces(symbolic)
        except MixedSpaces:
            pass
    with trace.tracing():
        z = trace.variables("z", symbolic.size)
        found = trace.sparse_jacobian(list(symbolic.vector_field(z)), list(z))
        entries = [(i, j, slope) for i, row in enumerate(found) for j, slope in row.items()]
        inputs = {x: f"a[{i}]" for i, x in enumerate(z)} | symbolic.constant_symbols()
        kernel = rolled(inputs, [slope for _, _, slope in entries])
    return kernel, *(np.array([entry[k] for entry in entries], np.int64) for k in range(2))  # type: ignore[return-value]


def _by_spaces(network: Network) -> tuple[Kernel, Any, Any]:
    net, mesh = network.by_spaces, network.mesh
    with trace.tracing():
        z = net.fresh_state("z")
        x = list(z[:: spaces.REPRESENTATIVES])
        terms = spaces.jacobian_terms(blocks(list(net.vector_field(z))), x)
        flat = [(i, term, slope) for i, row in enumerate(terms) for term, slope in row.items()]
        inputs = {"a": state_slots(z), "b": net.constant_slots()}
        made = space_kernel(inputs, [Slot("entries", None)], [(term, slope) for _, term, slope in flat], terms_at=0)
    n, offsets, which = network.n_positions, (0, network.n_positions, 2 * network.n_positions), {}
    for k, symbol in enumerate(x):
        which[symbol.number] = k
    rows, columns, places, count = [], [], [], 0
    for i, term, _ in flat:
        r, c = (mesh.along(path) if path else np.arange(mesh.sizes[term.over]) for path in (term.rows, term.columns))
        k = which[term.unknown.number]
        free = (r < n if i < 2 else True) & (c < n if k < 2 else True) & np.ones(len(r), bool)
        place = np.full(len(r), -1, np.int64)
        place[free] = count + np.arange(free.sum())
        count += int(free.sum())
        rows.append(offsets[i] + r[free])
        columns.append(offsets[k] + c[free])
        places.append(place)
    behind = [np.where(place < 0, count, place) for place in places]  # fixed coordinates are no columns
    sized = Mesh({**mesh.sizes, "entries": count}, mesh.maps)
    return made.kernel(sized, behind, extra=1), np.concatenate(rows), np.concatenate(columns)
