"""`GaussMethod`: the collocation of `collocate`, set up for a system and a number of stages."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcbench.systems.system import System

from . import formulas as kernels

Floats = NDArray[np.float64]
SOLVED_TO = 0.01  # of the tolerance: residual of the collocation equations in adaptive runs
FINEST = 1e-14  # of the residual: round-off is near


class GaussMethod:
    """k-stage consistent collocation on one system: fixed steps and adaptive runs. Not thread-safe."""

    def __init__(self, system: System, stages: int) -> None:
        from . import march as collocate_march
        from . import memory as memory  # numba is imported when something runs, not when plugins are listed
        from . import step as collocate

        self.loops, self.codes, self.layout = collocate_march, collocate, memory
        kernels.STRUCTURES.setdefault(system.structure, system)
        scalar, setup, _ = kernels.kernels(system.structure)
        n, e, k = system.n_positions, system.n_elements, stages
        numbers, c0 = kernels.coefficients(k), system.constant_values
        stored = {
            "c": np.concatenate([c0, setup(c0, c0)]),
            "inverse_mass": 1.0 / (np.asarray(system.inertia(), dtype=float) * np.ones(n)),
        }
        self.at = memory.layout(n, e, numbers, len(stored["c"]), scalar[0].size, scalar[-1].size - n - 1)
        self.memory = np.zeros(self.at[memory.PLACE.stop])
        for name, value in (stored | numbers._asdict()).items():
            place = getattr(memory.PLACE, name)
            self.memory[self.at[place] : self.at[place + 1]] = value.ravel()
        addresses = [*(x.address for x in scalar), *kernels.on_vectors(system.structure, k)]
        self.plan = np.array([*addresses, n, e, k], dtype=np.int64)
        self.stages, self.counts = k, np.zeros(collocate.COUNTS_SIZE, dtype=np.int64)
        self.size = system.size

    @property
    def work(self) -> Any:
        """The arrays of the last step (`gauss_memory.Work`), for a look."""
        unpack = self.layout.unpack
        return getattr(unpack, "py_func", unpack)(self.plan, self.memory, self.at)[1]

    def march(self, z: Floats, h: float, count: int) -> Floats:
        """Increments of up to `count` steps, as many as have a solution; ArithmeticError where the first has none."""
        increments = np.empty((count, self.size))
        done = self.loops.fixed_steps(self.plan, self.memory, self.at, h, z, increments, self.counts)
        if done == 0:
            raise ArithmeticError("the collocation equations have no solution in reach, at any part of the step")
        return increments[:done]

    def increments(self, z: Floats, h: float) -> Floats:
        """z1 - z of one step; raises ArithmeticError where none is found."""
        return self.march(z, h, 1)[0]

    def adaptive(self, z0: Floats, times: Floats, tolerance: float) -> tuple[Floats, dict[str, int]]:
        """States at `times`, and what they cost. The end of a step is superconvergent (order 2k), its polynomial is not
        (order k + 1): the defect is held at the power of the tolerance that belongs to an error of its size."""
        k, states = self.stages, np.empty((len(times), self.size))
        self.counts[:] = 0
        defect = tolerance ** ((k + 1) / (2 * k))
        residual = max(FINEST, SOLVED_TO * tolerance)
        code = self.loops.adaptive(self.plan, self.memory, self.at, z0, times, defect, residual, states, self.counts)
        if code != self.codes.SOLVED:
            raise ArithmeticError("the step became too short")
        return states, {
            "steps": int(self.counts[self.codes.STEPS]),
            "newton_iterations": int(self.counts[self.codes.ITERATIONS]),
            "rejected": int(self.counts[self.codes.REJECTED_STEPS]),
        }
