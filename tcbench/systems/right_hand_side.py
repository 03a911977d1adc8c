"""The vector field f of dz/dt = f(z) and its Jacobian as functions for ODE solvers: compiled, with little Python.

SciPy and SUNDIALS call back into Python; what they call here is one compiled kernel on arrays that exist already (0.8
microseconds a call, of which the arithmetic is 0.1). Taylor methods need the formulas themselves: `expressions`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ..compiler.caches import cached_property
from ..compiler.derivatives import INFINITE
from ..compiler.ops import NAMED, completed
from ..errors import TcbenchError
from .constrained import MOST_REDUCED
from .system import System


class Field:
    """dz/dt = rate(t, z) and its exact Jacobian, as functions of (t, z); `evaluations` counts calls of the rate."""

    def __init__(self, system: System) -> None:
        from ..compiler.library import evaluate  # LLVM is loaded when something runs, not when plugins are listed

        self._evaluate: Callable[..., None] = evaluate
        n = system.size
        self.system, self.size, self.c = system, n, system.constant_values
        self.evaluations = 0
        self._rate = np.empty(n)
        if system.multipliers and n > MOST_REDUCED:  # by sparse solves, in numbers
            from .multipliers import Multipliers

            self.rate_address, self._evaluate = 0, Multipliers(system).evaluated
        else:
            self.rate_address = system.kernel("vector_field")[0].address

    def shared(self, t: float, z: Any) -> Any:
        """The rate, shape (n,), in one array that every call overwrites: for solvers that copy it."""
        self.evaluations += 1
        self._evaluate(self.rate_address, z, self.c, self._rate)
        return self._rate

    def rate(self, t: float, z: Any) -> Any:
        """The rate in a new array, shape (n,); ArithmeticError where it is not finite at the first call."""
        self.evaluations += 1
        out = np.empty(self.size)
        self._evaluate(self.rate_address, z, self.c, out)
        if self.evaluations == 1 and not (abs(out) < INFINITE).all():  # explicit solvers would look for a step for ever
            raise ArithmeticError("the rates of the system are not finite at the start")
        return out

    def into(self, t: float, z: Any, out: Any) -> None:
        """Write the rate into `out`, shape (n,)."""
        self.evaluations += 1
        self._evaluate(self.rate_address, z, self.c, out)

    def rows(self, z: Any) -> Any:
        """The rates of several states at once, shape (m, n)."""
        self.evaluations += len(z)
        return self.system.vector_field(z)

    def jacobian(self, t: float, z: Any) -> Any:
        """d rate/dz, shape (n, n), in one array that every call overwrites; of a large system in a new one."""
        if self.system.large:
            return self._sparse(z).toarray()
        address, matrix, flat = self._jacobian
        self._evaluate(address, z, self.c, flat)
        return matrix

    @cached_property
    def _sparse(self) -> Callable[[Any], Any]:
        from .sparse_jacobian import sparse_jacobian

        return sparse_jacobian(self.system)

    @cached_property
    def _jacobian(self) -> tuple[int, Any, Any]:
        """The address of the kernel, its result (n, n) and a flat view of that."""
        matrix = np.empty((self.size, self.size))
        return self.system.kernel("jacobian")[0].address, matrix, matrix.reshape(-1)


def expressions(
    system: System, variables: Sequence[Any], constants: Sequence[Any], functions: Mapping[str, Any]
) -> list[Any]:
    """The rates of a system, n objects, in the arithmetic of other objects such as heyoka's expressions.

    variables : n of them. constants : laid out as `System.constant_values`. functions : exp, log, sqrt, ... by name.
    TcbenchError where the formulas need a function that is not there.
    """
    text, (size,) = system.formula("vector_field")
    out: dict[int, Any] = {}
    as_python(text, functions)(list(variables), list(constants), out)
    return [out[i] for i in range(size)]


def as_python(text: str, functions: Mapping[str, Any]) -> Callable[..., None]:
    """kernel(state, constants, out) from the text of a `System.formula`, with these functions and those that can be
    written in them; TcbenchError where one is missing."""
    namespace: dict[str, Any] = completed(functions)
    missing = sorted(set(NAMED.findall(text)) - {"kernel", *namespace})
    if missing:
        raise TcbenchError(
            f"The system's formulas use {', '.join(missing)}, which this method's arithmetic does not have; it has "
            f"{', '.join(sorted(functions))}. Write the formulas with these, or take another method."
        )
    exec(compile(text, "<formula>", "exec"), namespace)
    kernel: Callable[..., None] = namespace["kernel"]
    return kernel
