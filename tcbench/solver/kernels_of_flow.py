"""`FlowKernels`: the compiled functions of one flow, whichever way they were made."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..compiler.caches import cached_property
from ..compiler.kernels import Kernel
from ..compiler.library import evaluate, late_address
from ..systems.system import System

if TYPE_CHECKING:
    from .pattern import Pattern


@dataclass(frozen=True)
class FlowKernels:
    """Compiled form of a flow for one structure of system.

    setup((h, constants)) -> what depends on the constants only, computed once a run into the tail of w; of an explicit
        flow h counts as one of them
    prologue(z0, (h, constants)) -> w = (start[nx], guess[nx], 1/size of the unknowns[nx + ne], hoisted...)
    opening: the same, then the observables of z0; of the first flow of a step
    iterate(w, x) -> (Newton correction[nx], its image in the eliminated unknowns[ne], pivots[nx], thetas[npos],
        size of the correction, NaN where slopes are too steep for one, least of pivots and thetas, factors)
    polish(w, x) -> (correction with the factors that the last iterate left[nx], its image[ne], its size)
    finish(w, x) -> z1 - z0
    full(w, x) -> (residual[nx], Jacobian[nx * nx], d residual/dh[nx])

    Of corrections (`Flow.most`) w begins with z1 - z0 after one of them, its square and that of z0; polish(w, z1 - z0)
    is that after one more along the same slopes.

    Where the Jacobian is sparse, iterate gives (residual[nx], entries[nnz], thetas[npos]), polish (residual[nx],
    thetas[npos]), and full, which few runs need and which is compiled when it is first called, (d residual/dh[nx]);
    prologue and opening are one.
    """

    setup: Kernel
    prologue: Kernel
    opening: Kernel
    iterate: Kernel
    polish: Kernel
    finish: Kernel
    full: Kernel
    n_unknowns: int
    n_eliminated: int
    n_positive: int
    n_shared: int = 0  # the last of the unknowns, of which nothing is read: what others make them is in its place
    foresees: bool = False  # see newton.foresee; of corrections compiled_loop.expect
    mends: bool = False  # it ends a step by corrections: see Flow.most
    constrained: bool = False  # has impulses among its unknowns, which need not vanish at h = 0
    steep: bool = False  # may have slopes that are not finite: see linear_algebra.STEEPEST
    pattern: Pattern | None = None  # of a sparse Jacobian
    way: str = ""  # how its steps are solved, in words

    @cached_property
    def fields(self) -> dict[str, Any]:
        """Sizes and addresses, as `CompiledFlow` names them; everything is compiled when they are first asked for."""
        found: dict[str, Any] = {
            "nx": self.n_unknowns, "ne": self.n_eliminated, "npos": self.n_positive,
            "nd": max(k.size + k.room for k in (self.iterate, self.polish)),
            "nw": self.opening.size + max(self.setup.size, self.opening.room), "prologue": self.prologue.address,
            "iterate": self.iterate.address, "polish": self.polish.address, "finish": self.finish.address,
            "nfull": max(k.size + k.room for k in (self.full, self.iterate, self.polish)), "nj": self.n_unknowns,
            "ns": 0, "n_own": 0, "nnz": 0, "krylov_steps": 0, "too_large": False,
            "foresees": self.foresees, "steep": self.steep, "constrained": self.constrained,
        }  # fmt: skip
        p = self.pattern
        if p is None:
            return found | {"full": self.full.address}
        found |= {"nj": 0, "ns": p.n, "nnz": p.nnz, "nd": 2 * p.n + self.n_positive, "factorise": p.factorise}
        found |= {"first": p.first, "columns": p.columns, "diagonal": p.diagonal, "order": p.order}
        found |= {"n_own": p.n - self.n_shared, "krylov_steps": p.krylov_steps, "too_large": p.too_large}
        return found | {"full": late_address(self.full)}

    @property
    def linear(self) -> Kernel:
        """(w, x) -> residual, Jacobian (entries of a sparse one), and more."""
        return self.iterate if self.pattern else self.full

    def prepared(self, z: Any, c: NDArray[np.float64]) -> NDArray[np.float64]:
        """w of a step from z. c: see `constants`."""
        w = np.zeros(self.fields["nw"])
        w[self.opening.size :][: self.setup.size] = self.setup(c, c)
        evaluate(self.prologue.address, np.ascontiguousarray(z, dtype=float), c, w)
        return w


def constants(system: System, h: float, *further: Any) -> NDArray[np.float64]:
    """(h, constants, magnitudes, what the flow reads beside them): what kernels are given."""
    return np.concatenate([[h], system.constant_values[1:], *further])
