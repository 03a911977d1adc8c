"""What an `ElementSystem` that is declared over spaces derives on arrays: d(shape)/dq, and rates of temperatures."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..compiler import chain_rule
from ..compiler import derivatives as trace
from ..compiler.array_states import entries, refilled
from ..compiler.array_symbols import ArraySymbol
from ..compiler.arrays import variable


def temperature_field(system: Any, y: Any) -> Any:
    """d(q, p, theta)/dt, by the chain rule from the vector field."""
    z, here = system.fresh_state("z"), system.entropy_variables(y)
    outputs = system.temperature_variables(z)
    moved = trace.along(entries(outputs), dict(zip(entries(z), entries(system.vector_field(here)), strict=True)))
    return refilled(outputs, trace.substitute(moved, dict(zip(entries(z), entries(here), strict=True))))


class ArraySlope:
    """d(shape)/dq at q, as an operator: forward on rates of positions, backward on stresses."""

    __array_ufunc__ = None

    def __init__(self, shape: Callable[[Any], Any], variables: Any, q: Any) -> None:
        self.q_, self.q, self.shape = variables, q, shape(variables)

    def __matmul__(self, x: Any) -> Any:
        """Rates of the shapes from rates of the positions."""
        moved = ArraySymbol(self.q_.space, variable("rate", self.q_.space))
        found = trace.along(entries(self.shape), dict(zip(entries(self.q_), entries(moved), strict=True)))
        at = trace.substitute(found, dict(zip(entries(self.q_, moved), entries(self.q, x), strict=True)))
        return refilled(self.shape, at)

    def __rmatmul__(self, x: Any) -> Any:
        """Forces at the positions from stresses."""
        held = ArraySymbol(self.shape.space, variable("stress", self.shape.space))
        work = trace.lifted((held * self.shape).sum())
        found = chain_rule.gradient(work, entries(self.q_))
        at = trace.substitute(found, dict(zip(entries(self.q_, held), entries(self.q, x), strict=True)))
        return refilled(self.q_, at)
