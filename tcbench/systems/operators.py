"""Matrices applied without being formed: L and d(shape)/dq. A product costs as many operations as they have entries."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiler.symbols import Symbol, array, const, is_const


class Operator(np.lib.mixins.NDArrayOperatorsMixin):
    """A matrix that is applied without being made; as an array (for all but @) it is dense.

    shape : of the matrix. Subclasses give `times(x)` = matrix @ x, `before(x)` = x @ matrix for x (n,), and `dense()`.
    """

    shape: tuple[int, int]

    def times(self, x: Any) -> Any:
        raise NotImplementedError

    def before(self, x: Any) -> Any:
        raise NotImplementedError

    def dense(self) -> NDArray[Any]:
        raise NotImplementedError

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return self.dense().astype(dtype) if dtype else self.dense()

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        if ufunc is np.matmul and method == "__call__" and len(inputs) == 2:
            left, right = inputs
            if isinstance(left, Operator) and np.ndim(right) == 1:
                return left.times(right)
            if isinstance(right, Operator) and np.ndim(left) == 1:
                return right.before(left)
        return getattr(ufunc, method)(*(x.dense() if isinstance(x, Operator) else x for x in inputs), **options)

    def __getitem__(self, index: Any) -> Any:
        return self.dense()[index]

    def __len__(self) -> int:
        return self.shape[0]

    @property
    def T(self) -> NDArray[Any]:
        return self.dense().T


class Poisson(Operator):
    """The canonical matrix on (q, p), zero on s; shape (2 n + m, 2 n + m) for n positions and m elements."""

    def __init__(self, n_positions: int, n_elements: int) -> None:
        self.n, self.m = n_positions, n_elements
        self.shape = (2 * n_positions + n_elements, 2 * n_positions + n_elements)

    def times(self, x: Any) -> Any:
        x, n = np.asanyarray(x), self.n
        if x.shape != (self.shape[0],):
            raise ValueError(f"L has shape {self.shape} and is applied to shape {x.shape}")
        still = array([const(0.0)] * self.m) if x.dtype == object else np.zeros(self.m)
        found = np.concatenate([x[n : 2 * n], -x[:n], still]).view(type(x))
        found.__array_finalize__(x)  # a state stays one
        return found

    def before(self, x: Any) -> Any:
        return self.times(-np.asarray(x))  # L is skew

    def dense(self) -> NDArray[np.float64]:
        n, matrix = self.n, np.zeros(self.shape)
        matrix[:n, n : 2 * n] = np.eye(n)
        matrix[n : 2 * n, :n] = -np.eye(n)
        return matrix


class SparseRows(Operator):
    """A matrix of symbols, given by its rows: column -> entry."""

    def __init__(self, rows: Sequence[Mapping[int, Symbol]], columns: int) -> None:
        self.rows, self.shape = rows, (len(rows), columns)

    def times(self, x: Any) -> Any:
        zero = const(0.0)
        return array(sum((row[j] * x[j] for j in sorted(row)), zero) for row in self.rows)

    def before(self, x: Any) -> Any:
        zero, terms = const(0.0), [[] for _ in range(self.shape[1])]  # type: ignore[var-annotated]
        for i, row in enumerate(self.rows):
            for j, entry in row.items():
                terms[j].append((i, entry))
        return array(sum((x[i] * entry for i, entry in column), zero) for column in terms)

    def dense(self) -> NDArray[np.object_]:
        found = np.full(self.shape, const(0.0), dtype=object)
        for i, row in enumerate(self.rows):
            for j, entry in row.items():
                found[i, j] = entry
        return found


def projected(matrix: Any, x: Any, kernel: Any) -> Any:
    """Q A Q^T x with Q^T kernel = 0: skew or positive as A is, and exactly orthogonal to the kernel."""
    matrix = np.asarray(matrix, dtype=object)
    if not any(isinstance(entry, Symbol) or entry != 0 for entry in matrix.ravel()):
        return array([const(0.0)] * len(kernel))
    if all(is_const(entry, 0.0) if isinstance(entry, Symbol) else entry == 0 for entry in kernel):  # S is constant
        product: Any = matrix @ x
        return product
    size = kernel @ kernel
    y = matrix @ (x - kernel * ((kernel @ x) / size))
    return y - kernel * ((kernel @ y) / size)
