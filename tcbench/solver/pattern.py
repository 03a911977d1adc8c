"""Sparsity pattern of a Jacobian: reordering to a small bandwidth, compressed rows, direct solver (LAPACK, SuperLU)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiler.caches import cached_property
from ..compiler.language import Ints
from ..compiler.library import callback

DENSE = 100  # rows up to which LAPACK on the whole matrix takes less time than SuperLU: a tenth of it, of 50 rows
BORDER = 4  # rows that see most others, from which on they are eliminated by themselves
KRYLOV_STEPS, A_BAND = 30, 0.2  # iterations before a matrix is factorised: at least, and for each number of its width
MORE = 2  # times as many where it cannot be factorised
FILL = 2.6  # entries of the factors of a mesh in space for each row and number of its width, and half of it in a plane
MOST_FILL = 3e8  # of them: 4 GB, and minutes for a factorisation
SHARED = 20  # times the root of their number: a row that sees more is of what all share, as a bath


class Pattern:
    """Where a square matrix of n rows has entries, in compressed rows of the reverse Cuthill-McKee order.

    order (n,): row and column k of the stored matrix is unknown order[k]; first (n + 1,), columns (nnz,),
    diagonal (n,): its compressed rows; places: of each given entry, where it is among the nnz (of equal ones the same).
    """

    def __init__(self, n: int, rows: Sequence[int] | Ints, columns: Sequence[int] | Ints) -> None:
        from scipy.sparse import coo_matrix
        from scipy.sparse.csgraph import reverse_cuthill_mckee

        self.n = n
        i = np.concatenate([np.asarray(rows, np.int64), np.arange(n)])
        j = np.concatenate([np.asarray(columns, np.int64), np.arange(n)])
        graph = coo_matrix((np.ones(len(i), np.int8), (i, j)), shape=(n, n)).tocsr()
        graph = (graph + graph.T).tocsr()
        shared = np.flatnonzero(np.diff(graph.indptr) > SHARED * np.sqrt(n))
        self.border = len(shared)
        if len(shared):  # they see most of the others: behind these, whose factors stay narrow
            own = np.setdiff1d(np.arange(n), shared)
            order = own[reverse_cuthill_mckee(graph[own][:, own].tocsr(), symmetric_mode=True)]
            self.order = np.concatenate([order, shared]).astype(np.int32)
        else:
            self.order = np.ascontiguousarray(reverse_cuthill_mckee(graph, symmetric_mode=True), dtype=np.int32)
        inverse = np.empty(n, np.int64)
        inverse[self.order] = np.arange(n)
        key, found = np.unique(inverse[i] * n + inverse[j], return_inverse=True)
        self.places = found[: len(rows)]
        self.columns = (key % n).astype(np.int32)
        self.first = np.searchsorted(key, np.arange(n + 1) * n).astype(np.int32)
        self.diagonal = found[len(rows) :][self.order].astype(np.int32)
        self.band = float((np.arange(n) - self.columns[self.first[:-1]]).mean()) if n else 0.0  # mean width

    @property
    def nnz(self) -> int:
        return len(self.columns)

    @property
    def krylov_steps(self) -> int:
        """Iterations after which it is factorised: of a mesh in space these cost less, however many, than its fill."""
        return max(KRYLOV_STEPS, int(A_BAND * self.band)) * (MORE if self.too_large else 1)

    @property
    def too_large(self) -> bool:
        """Is it too large to be factorised?"""
        return FILL * self.n * self.band > MOST_FILL

    @cached_property
    def factorise(self) -> int:
        """Address of factorise(J, right, out): J the entries, right two right-hand sides (2, n), out: two solutions
        (2, n), then the sign of the determinant (0: singular, or larger than MOST_FILL)."""
        return callback(self._factorise, (self.nnz, 2 * self.n, 2 * self.n + 1))

    def _factorise(self, J: Any, right: Any, out: Any) -> None:
        out[:] = 0.0
        if not self.too_large and np.all(np.isfinite(J)):
            (self._dense if self.n <= DENSE else self._sparse)(J, right, out)

    def _bordered(self, J: Any, right: Any, out: Any) -> bool:
        """The rows and columns that see most others, which stand last, by a Schur complement; False where the rest is
        singular by itself. Eliminated with the others they fill all the factors."""
        from scipy.linalg import lapack
        from scipy.sparse import csr_matrix
        from scipy.sparse.linalg import splu

        n, m = self.n, self.n - self.border
        whole = csr_matrix((J.copy(), self.columns, self.first), shape=(n, n))
        across, low = whole[:m, m:].toarray(), whole[m:, :m]
        try:
            factors = splu(
                whole[:m, :m].tocsc(),
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )
        except RuntimeError:
            return False
        sides = right.reshape(2, n).T
        solved = factors.solve(np.ascontiguousarray(np.column_stack([across, sides[:m]])))
        schur = whole[m:, m:].toarray() - low @ solved[:, :-2]
        if not np.all(np.isfinite(schur)):
            return False
        pivots, exchanged, singular = lapack.dgetrf(schur)
        if singular != 0:
            return False
        last = lapack.dgetrs(pivots, exchanged, sides[m:] - low @ solved[:, -2:])[0]
        found = np.concatenate([solved[:, -2:] - solved[:, :-2] @ last, last])
        out[: 2 * n] = found.T.ravel()
        turns = np.count_nonzero(exchanged != np.arange(self.border))
        sign = np.prod(np.sign(factors.U.diagonal())) * _parity(factors.perm_r) * _parity(factors.perm_c)
        out[2 * n] = sign * np.prod(np.sign(pivots.diagonal())) * (-1) ** turns
        return True

    def _dense(self, J: Any, right: Any, out: Any) -> None:
        from scipy.linalg import lapack

        n = self.n
        matrix = np.zeros((n, n))
        matrix[np.repeat(np.arange(n), np.diff(self.first)), self.columns] = J
        factors, exchanged, singular = lapack.dgetrf(matrix.T, overwrite_a=True)
        if singular == 0:
            for k in (0, n):  # OpenBLAS wakes its threads for two right-hand sides at once: 1 to 300 times as long
                out[k : k + n] = lapack.dgetrs(factors, exchanged, right[k : k + n], trans=1)[0]
            turns = np.count_nonzero(exchanged != np.arange(n))
            out[2 * n] = np.prod(np.sign(factors.diagonal())) * (-1) ** turns

    def _sparse(self, J: Any, right: Any, out: Any) -> None:
        from scipy.sparse import csc_matrix
        from scipy.sparse.linalg import splu

        n = self.n
        if self.border >= BORDER and self._bordered(J, right, out):
            return
        transposed = csc_matrix((J.copy(), self.columns, self.first), shape=(n, n))
        try:
            factors = splu(
                transposed, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
            )
        except RuntimeError:  # exactly singular
            return
        for k in range(2):
            out[k * n : (k + 1) * n] = factors.solve(right[k * n : (k + 1) * n].copy(), trans="T")
        signs = np.prod(np.sign(factors.U.diagonal()))
        out[2 * n] = signs * _parity(factors.perm_r) * _parity(factors.perm_c)


def _parity(permutation: NDArray[Any]) -> int:
    """1 for an even permutation, -1 for an odd one: each exchange, which shortens a cycle by one, turns the sign."""
    sign, to = 1, permutation.tolist()
    for first in range(len(to)):
        while to[first] != first:
            following = to[first]
            to[first], to[following] = to[following], following
            sign = -sign
    return sign
