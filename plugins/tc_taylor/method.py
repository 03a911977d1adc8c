"""`TaylorMethod`: series, mending and march, set up for a system and an order."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcbench import System, TcbenchError
from tcbench.compiler.kernels import Kernel, kernel

from .mending import mending_kernels, start_kernel
from .recurrences import series_kernels

Floats = NDArray[np.float64]
MOST_ELEMENTS = 32  # beyond, the straight-line code of a series takes more than ten seconds to compile
_KERNELS: dict[Any, tuple[Kernel, ...]] = {}


class TaylorMethod:
    """Taylor steps of one order on one system: fixed ones and adaptive runs. Not thread-safe."""

    def __init__(self, system: System, order: int) -> None:
        from .march import LOOPS, Counts, Work  # LLVM is loaded when something runs, not when plugins are listed

        if system.n_elements > MOST_ELEMENTS:
            raise TcbenchError(
                f"tc_taylor writes its series out: {system.n_elements} elements are too many for it "
                f"(at most {MOST_ELEMENTS}). Take tc_gauss or tc_monolithic."
            )
        self.loops, self.system, self.size = LOOPS, system, system.size
        series, polynomial, mend, hold, setup, start = kernels(system, order)
        back, _ = system.kernel("entropy_variables")
        given = np.concatenate([system.constant_values, setup(system.constant_values, system.constant_values)])
        self.counts = Counts()
        self.reached: Floats | None = None  # where the last march ended
        self.work = Work(
            size=system.size, order=order, n_given=len(given), to_start=start.address,
            n_target=system.size + 2 + len(system.invariant_names), to_series=series.address,
            to_state=polynomial.address, to_mend=mend.address, to_hold=hold.address, to_entropies=back.address,
            counts=self.counts, given=given,
        )  # fmt: skip

    def adaptive(self, z0: Floats, times: Floats, tolerance: float) -> tuple[Floats, dict[str, int]]:
        """States at `times`, shape (len(times), n), and their cost; ArithmeticError where steps become too short."""
        states = np.empty((len(times), self.size))
        self.reached = None
        done = self.loops.adaptive_steps(self.work, z0, times, tolerance, states)
        if done < len(times):
            raise ArithmeticError(f"the step became too short before t = {times[done]:g}")
        return states, self.cost()

    def cost(self) -> dict[str, int]:
        """What the last run took."""
        steps, rejected, _ = self.counts.table.tolist()
        return {"steps": steps, "rejected": rejected}

    def march(self, z: Floats, h: float, count: int) -> Floats:
        """States after up to `count` steps of length h, as many as succeed; ArithmeticError where none does.

        From where the last march ended it goes on: a run keeps the invariants of its own start, not of each part's.
        """
        states = np.empty((count, self.size))
        if self.reached is None or not np.array_equal(z, self.reached):
            self.loops.begin(self.work, z)
        done = self.loops.fixed_steps(self.work, h, states)
        self.reached = states[done - 1] if done == count else None
        if done == 0:
            raise ArithmeticError("the series gives no admissible state after this step")
        return states[:done]


def kernels(system: System, order: int) -> tuple[Kernel, ...]:
    """(series, polynomial, mend, hold, setup, start), once for each structure of system."""
    key = (system.structure, order)
    if key not in _KERNELS:
        mend, hold, fixed = mending_kernels(system)
        series, polynomial, more = series_kernels(system, order, len(system.constant_values) + len(fixed))
        setup = kernel(system.constant_symbols(), [*fixed, *more])
        _KERNELS[key] = series, polynomial, mend, hold, setup, start_kernel(system)
    return _KERNELS[key]
