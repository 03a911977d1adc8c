"""`GaussMethod`: the collocation of `step`, set up for a system and a number of stages."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcbench.compiler.kernels import WIDTH
from tcbench.systems.system import System

from . import formulas

Floats = NDArray[np.float64]
SOLVED_TO = 0.01  # of the tolerance: residual of the collocation equations in adaptive runs
FINEST = 1e-14  # of the residual: round-off is near
SOLVED = 0  # see `step`
MOST_NEWTON = 500  # unknowns of Newton's dense matrices; larger systems take a step that needs it in halves
VECTOR_KERNELS = ("to_iterate", "to_iterate_finer", "to_block", "to_extrapolate", "to_close")


class GaussMethod:
    """k-stage consistent collocation on one system: fixed steps and adaptive runs. Not thread-safe."""

    def __init__(self, system: System, stages: int) -> None:
        from .march import LOOPS  # LLVM is loaded when something runs, not when plugins are listed
        from .memory import Counts, Numbers

        self.loops, self.stages, self.size = LOOPS, stages, system.size
        formulas.STRUCTURES.setdefault(system.structure, system)
        scalar, matrix, setup, *_ = formulas.formulas(system.structure)
        c0 = system.constant_values
        names = ("to_start", "to_motion", "to_slopes", "to_forces", "to_mend", *VECTOR_KERNELS)
        addresses = [*(x.address for x in scalar), *formulas.on_vectors(system.structure, stages)]
        self.counts = Counts()
        self.work = _work(
            system, stages, dict(zip(names, addresses, strict=True)), counts=self.counts,
            numbers=Numbers(k=stages, **formulas.coefficients(stages)._asdict()),
            c=np.concatenate([c0, setup(c0, c0)]), n_ends=scalar[0].size,
            to_matrix=matrix.address if matrix else 0, n_matrix=system.n_elements if matrix else 0,
            n_invariants=scalar[-1].size - system.n_positions - 1,
        )  # fmt: skip

    def march(self, z: Floats, h: float, count: int) -> Floats:
        """Increments of up to `count` steps, as many as have a solution; ArithmeticError where the first has none."""
        increments = np.empty((count, self.size))
        done = self.loops.fixed_steps(self.work, h, z, increments)
        if done == 0:
            raise ArithmeticError("the collocation equations have no solution in reach, at any part of the step")
        return increments[:done]

    def increments(self, z: Floats, h: float) -> Floats:
        """z1 - z of one step; raises ArithmeticError where none is found."""
        return self.march(z, h, 1)[0]

    def adaptive(self, z0: Floats, times: Floats, tolerance: float) -> tuple[Floats, dict[str, int]]:
        """States at `times`, and what they cost."""
        states = np.empty((len(times), self.size))
        code = self.loops.adaptive_steps(self.work, z0, times, *self.held(tolerance), states)
        if code != SOLVED:
            raise ArithmeticError("the step became too short")
        return states, self.cost()

    def cost(self) -> dict[str, int]:
        """What the last adaptive run took."""
        steps, rejected, iterations, *_ = self.counts.table.tolist()
        return {"steps": steps, "rejected": rejected, "newton_iterations": iterations}

    def held(self, tolerance: float) -> tuple[float, float]:
        """Defect and residual of adaptive steps. The end of a step is superconvergent (order 2k), its polynomial is not
        (order k + 1): the defect is held at the power of the tolerance that belongs to an error of its size."""
        k = self.stages
        return tolerance ** ((k + 1) / (2 * k)), max(FINEST, SOLVED_TO * tolerance)


def _work(system: System, k: int, addresses: dict[str, int], **fields: Any) -> Any:
    """The record of a step, with its views."""
    from .memory import Work

    n, e = system.n_positions, system.n_elements
    m, place = n + e, formulas.given(n, e, k)
    memory, found = np.zeros(place.scale.stop), np.zeros(WIDTH * (2 * m + n) + 1)
    rows = found[:-1].reshape(2 * m + n, WIDTH)
    return Work(
        n=n, e=e, k=k, m=m, n_constants=len(fields["c"]), n_given=len(memory),
        n_newton=k * m if k * m <= MOST_NEWTON else 0, n_factors=fields["numbers"].pairs + 1, **addresses, **fields,
        inverse_mass=1.0 / (np.asarray(system.inertia(), dtype=float) * np.ones(n)),
        given=memory, state0=memory[: place.block.start], block=memory[place.block],
        columns=memory[place.block].reshape(k, WIDTH), u=memory[place.u], v=memory[place.v], scale=memory[place.scale],
        found=found, U=rows[:m], N=rows[m : 2 * m], V=rows[2 * m :], rates=found[WIDTH * m : -1],
    )  # fmt: skip
