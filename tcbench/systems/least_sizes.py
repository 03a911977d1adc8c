"""By what the numbers of a system are measured at least, in runs that begin somewhere: `LeastSizes`, under `System`."""

from __future__ import annotations

from functools import reduce
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from ..compiler import derivatives as trace
from ..compiler.array_states import entries, refilled
from ..compiler.arrays import total
from ..compiler.caches import cached_property
from .least import measured
from .over_spaces import OverSpaces
from .state import blocks_of, fixed
from .traced import OF_LAWS

if TYPE_CHECKING:
    from .system import System


class LeastSizes(OverSpaces):
    """A system that knows where its runs begin, and by what their numbers are measured at least."""

    begins: NDArray[np.float64] | None = None  # of an instance: z of the scenario that it belongs to
    horizon: float = np.inf  # and its time

    def begin(self, z0: NDArray[np.float64], horizon: float = np.inf) -> None:
        """Runs of it begin here and take so long, as a scenario knows."""
        for name in ("least", "least_sizes", "least_each", "unit_sizes", "constant_values"):
            self.__dict__.pop(name, None)
        self.__dict__["begins"], self.__dict__["horizon"] = z0, horizon

    @property
    def least_energy(self) -> Any:
        """By what energies are measured at least."""
        return self.least[-2]

    @property
    def least_entropy(self) -> Any:
        """By what entropies are measured at least."""
        return self.least[-1]

    @cached_property
    def least(self) -> Any:
        """By what each variable, energy and entropy are measured at least; see systems/least.py."""
        return self.least_sizes[0]

    @cached_property
    def least_sizes(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The same, shape (n_variables + 2,), and those of energy, entropy and invariants, shape (2 + n_invariants,); 1
        for all where no run is known to begin."""
        return measured(cast("System", self), self.begins, self.horizon)

    def least_of(self, z: Any) -> Any:
        """For each number of a state the least size of its variable."""
        blocks = zip(self.least, blocks_of(cast("System", self), z), strict=False)
        return refilled(z, [size for size, block in blocks for _ in entries(block)])

    def absolute(self, tolerance: float) -> Any:
        """An absolute tolerance for a solver: for each number of a state in units that need one of their own."""
        return tolerance if self.unit_sizes is None else tolerance * self.unit_sizes

    @cached_property
    def unit_sizes(self) -> NDArray[np.float64] | None:
        """`least_each`, for solvers that have one scale for all numbers; None where all are 1, and nothing to scale."""
        return None if np.all(self.least_each == 1.0) else self.least_each

    @cached_property
    def least_each(self) -> NDArray[np.float64]:
        """For each number of a state the least size of its variable, shape (size,)."""
        return fixed(np.repeat(self.least[:-OF_LAWS], [int(np.prod(shape)) for shape in self.variables.values()]))

    def sizes(self, z: Any) -> list[Any]:
        """What increments are measured by, variable by variable, entry by entry: its largest entry, or `least`."""
        blocks = []
        for block, at_least in zip(blocks_of(cast("System", self), z), self.least, strict=False):
            largest = (total("max", abs(x), x.space) for x in entries(block))
            blocks.append(refilled(block, [reduce(trace.maximum, largest, at_least)] * len(entries(block))))
        return blocks
