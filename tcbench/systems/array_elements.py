"""What an `ElementSystem` that is declared over spaces derives on arrays: slopes of element energies and of strains."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..compiler import chain_rule
from ..compiler import derivatives as trace
from ..compiler.array_states import entries, refilled
from ..compiler.array_symbols import ArraySymbol
from ..compiler.arrays import LINEAR, variable
from .refusals import refuse_coupled


def element_slopes(system: Any, pi: Any, s: Any) -> tuple[Any, Any]:
    """(de/dpi, de/ds) at these strain measures and entropies; TraceError where an energy sees another element."""
    pi_, s_ = system.fresh("pi", "element"), system.fresh("s", "element")
    own = entries(pi_, s_)
    energies = entries(system.element_energy(pi_, s_))
    moving = trace.depends_on(energies, own)
    if len(energies) != 1 or any(x.op in LINEAR and x.number in moving for x in trace.topological(energies)):
        raise refuse_coupled(system)
    (row,) = trace.sparse_jacobian(energies, own)
    slopes = [row.get(k, trace.const(0.0)) for k in range(2)]
    found = trace.substitute(slopes, dict(zip(own, entries(pi, s), strict=True)))
    return refilled(pi_, found[:1]), refilled(pi_, found[1:])


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
