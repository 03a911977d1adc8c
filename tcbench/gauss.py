"""`GaussMethod`: the collocation of `collocate`, set up for a system and a number of stages."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import gauss_kernels as kernels
from .emit import WIDTH
from .system import System

Floats = NDArray[np.float64]


def work(c: Floats, inverse_mass: Floats, n: int, e: int, numbers: kernels.Coefficients, ends: int) -> Any:
    """The arrays of a step (`collocate.Work`), in the layout that the kernels on vectors have."""
    from .collocate import Work

    k, m, points = len(numbers.nodes), n + e, int(numbers.points[-1])
    place = kernels.given(n, e, k)
    given, found = np.zeros(place.scale.stop), np.zeros(WIDTH * (2 * m + n) + 1)
    mu = given[place.decay.start : place.mu.stop]
    by_node = found[:-1].reshape(-1, WIDTH).T
    return Work(
        c=c, inverse_mass=inverse_mass, given=given, found=found,
        U=by_node[:, :m], N=by_node[:, m : 2 * m], V=by_node[:, 2 * m :],
        rates=found[WIDTH * m : -1], state0=given[: place.s.stop],
        room=given[place.blocks.start : place.mu.stop],
        blocks=given[place.blocks].reshape(-1, k, WIDTH).transpose(0, 2, 1), mu=mu,
        modes=given[place.mu.start : place.right.stop], middle=np.zeros(m),
        left=given[place.left].reshape(-1, n), right=given[place.right].reshape(-1, n),
        u=given[place.u], v=given[place.v], scale=given[place.scale],
        ratio=np.zeros(1), sums=np.zeros(n + 3 * m), start=np.zeros(ends), end=np.zeros(ends), seen=np.zeros(2),
        at_nodes=np.zeros((k, 2 * n + 2 * e)), drift=np.zeros((k, 2 * e)),
        at_points=np.zeros((points, 2 * e)), slopes=np.zeros((points, 2 * e)),
        FG=np.zeros(m), rho=np.zeros((len(mu), k)), block=np.zeros((k, k)),
        J=np.zeros((k * m, k * m)), rhs=np.zeros(k * m), base=np.zeros(k * m),
        x0=np.zeros(2 * e), dz=np.zeros(n + m), z1=np.zeros(n + m),
    )  # fmt: skip


class GaussMethod:
    """k-stage consistent collocation on one system: fixed steps and adaptive runs. Not thread-safe."""

    def __init__(self, system: System, stages: int) -> None:
        from . import collocate, collocate_march  # numba is imported when something runs, not when plugins are listed

        self.loops, self.codes = collocate_march, collocate
        kernels.STRUCTURES.setdefault(system.structure, system)
        scalar, setup, _ = kernels.kernels(system.structure)
        n, e, k = system.n_positions, system.n_elements, stages
        self.size, self.numbers = system.size, kernels.coefficients(k)
        addresses = [*(x.address for x in scalar), *kernels.on_vectors(system.structure, k)]
        self.plan = np.array([*addresses, n, e, k, len(self.numbers.points)], dtype=np.int64)
        self.counts = np.zeros(collocate.COUNTS_SIZE, dtype=np.int64)
        c0 = system.constant_values
        inverse_mass = 1.0 / (np.asarray(system.inertia(), dtype=float) * np.ones(n))
        self.work = work(np.concatenate([c0, setup(c0, c0)]), inverse_mass, n, e, self.numbers, scalar[0].size)
        self.buffers = np.zeros(self.size), np.zeros(self.size), np.zeros(self.size)

    def increments(self, z: Floats, h: float) -> Floats:
        """z1 - z of one step; raises ArithmeticError where none is found."""
        total, carry, here = self.buffers
        code = self.loops.fixed_step(self.plan, self.numbers, self.work, h, z, total, carry, here, self.counts)
        if code != self.codes.SOLVED:
            raise ArithmeticError("the collocation equations have no solution in reach, at any part of the step")
        return total

    def adaptive(self, z0: Floats, times: Floats, tolerance: float) -> tuple[Floats, dict[str, int]]:
        """States at `times`, and what they cost. The end of a step is superconvergent (order 2k), its polynomial is not
        (order k + 1): the defect is held at the power of the tolerance that belongs to an error of its size."""
        k = len(self.numbers.nodes)
        states = np.empty((len(times), self.size))
        z, carry, _ = self.buffers
        z[:], carry[:] = z0, 0.0
        self.counts[:] = 0
        exponent = (k + 1) / (2 * k)
        code = self.loops.adaptive(
            self.plan, self.numbers, self.work, times, tolerance**exponent, states, z, carry, self.counts
        )
        if code != self.codes.SOLVED:
            raise ArithmeticError("the step became too short")
        return states, {
            "steps": int(self.counts[self.codes.STEPS]),
            "newton_iterations": int(self.counts[self.codes.ITERATIONS]),
            "rejected": int(self.counts[self.codes.REJECTED_STEPS]),
        }
