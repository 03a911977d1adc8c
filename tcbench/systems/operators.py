"""Matrices that are applied and never formed: the slope of strain measures, projected matrices of authors."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..compiler import chain_rule
from ..compiler import derivatives as trace
from ..compiler.array_states import entries, refilled

if TYPE_CHECKING:
    from .element_system import ElementSystem


class ShapeGradient:
    """d(shape)/dq at q, shape (n_elements, n_positions), on symbols: `slope @ v` are the rates of the strain measures,
    shape (n_elements,), of rates v of the positions; `stress @ slope` are forces, shape (n_positions,)."""

    __array_ufunc__ = None  # numpy leaves `@` to this class

    def __init__(self, system: ElementSystem, q: Any) -> None:
        self.system, self.q, self.variables = system, q, system.fresh("q", "position")
        self.values = system.shape(self.variables)

    def __matmul__(self, v: Any) -> Any:
        rate = self.system.fresh("rate", "position")
        rates = trace.along(list(entries(self.values)), _pairs(self.variables, rate))
        return refilled(self.values, self._here(rates, rate, v))

    def __rmatmul__(self, stress: Any) -> Any:
        held = self.system.fresh("stress", "element")
        slopes = chain_rule.gradient(trace.lifted((held * self.values).sum()), entries(self.variables))
        return refilled(self.variables, self._here(slopes, held, stress))

    def _here(self, formulas: Any, variables: Any, values: Any) -> Any:
        return trace.substitute(formulas, _pairs(self.variables, self.q) | _pairs(variables, values))


def _pairs(variables: Any, values: Any) -> dict[Any, Any]:
    return dict(zip(entries(variables), map(trace.lifted, entries(values)), strict=True))


def projected(matrix: Any, x: Any, kernel: Any) -> Any:
    """Q A Q^T x with Q^T kernel = 0: skew or positive as A (n, n) is, and exactly orthogonal to the kernel (n,)."""
    matrix = np.asarray(matrix, dtype=object)
    if not any(isinstance(entry, trace.Symbol) or entry != 0 for entry in matrix.ravel()):
        return trace.array([trace.const(0.0)] * len(kernel))
    if all(trace.is_const(trace.lifted(entry), 0.0) for entry in kernel):  # S is constant
        return matrix @ x
    size = kernel @ kernel
    y = matrix @ (x - kernel * ((kernel @ x) / size))
    return y - kernel * ((kernel @ y) / size)
