"""`GaussMethod`: the collocation of `step`, set up for a system and a number of stages."""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcbench.compiler import derivatives as trace
from tcbench.compiler.array_jacobian import Term, jacobian_terms, shared_as_unknowns
from tcbench.compiler.array_kernels import ArrayKernel, array_kernel, jacobian_kernel
from tcbench.compiler.array_mesh import Block, alone, scattered
from tcbench.compiler.array_states import entries
from tcbench.compiler.caches import cached, cached_per_system
from tcbench.compiler.kernels import Kernel
from tcbench.compiler.library import late_address
from tcbench.errors import TcbenchError
from tcbench.solver.foresight import Lending
from tcbench.solver.mending import mending_kernels
from tcbench.systems.system import System

from . import formulas
from .memory import SOLVED_TO
from .sparse import of_pattern, sparse
from .vectors import vector_kernels

Floats = NDArray[np.float64]
FINEST = 1e-14  # of the residual: round-off is near
SOLVED = 0  # see `step`
MOST_ELEMENTS = 32  # of a network traced as a whole: ten times as fast after a few seconds
MOST_VARIABLES = 300  # of a system that is traced as a whole
LATE_LINES = 500  # of a kernel: a tenth of a second of LLVM, beside which a jump at each call is nothing
NAMES = ("to_start", "to_motion", "to_slopes", "to_forces", "to_laws", "to_mend", "to_hold")  # of large systems


class GaussMethod(Lending):
    """k-stage consistent collocation on one system: fixed steps and adaptive runs. One run at a time has it."""

    def __init__(self, system: System, stages: int) -> None:
        self.loops, model = prepared(system, stages)
        self.stages, self.marches = stages, False
        self.counts = model.counts.again()
        own = {name: getattr(model, name).again() for name in ("sparse", "budget", "solve")}
        self.lend_to(model.again(counts=self.counts, c=model.c.copy(), **own), system)  # the first of c is the step

    def march(self, z: Floats, h: float, count: int) -> Floats:
        """Increments of up to `count` steps, as many as have a solution; ArithmeticError where the first has none.

        What follows on an earlier call goes on with the energy with which the first began."""
        if not self.marches:
            self.loops.begin(self.work, z)
            self.marches = True
        increments = np.empty((count, self.size))
        done = self.loops.fixed_steps(self.work, h, z, increments)
        if done == 0:
            raise ArithmeticError("the collocation equations have no solution in reach, at any part of the step")
        return increments[:done]

    def increments(self, z: Floats, h: float) -> Floats:
        """z1 - z of one step; raises ArithmeticError where none is found."""
        self.marches = False
        return self.march(z, h, 1)[0]

    @property
    def divided(self) -> bool:
        """Was the last of these steps taken in parts (`march.halving_step`)?"""
        return int(self.counts.table[0]) > 1

    def adaptive(self, z0: Floats, times: Floats, tolerance: float) -> tuple[Floats, dict[str, int]]:
        """States at `times`, and what they cost."""
        self.begin(z0, times)
        self.work.clear()
        found = self.loops.run(self.work, *held(self.stages, tolerance))
        return self.ended(found == SOLVED, self.work.budget), self.cost()

    def cost(self) -> dict[str, int]:
        """What the last adaptive run took."""
        steps, rejected, iterations, *_ = self.counts.table.tolist()
        return {"steps": steps, "rejected": rejected, "newton_iterations": iterations}


@cache
def held(k: int, tolerance: float) -> tuple[float, float]:
    """Defect and residual of adaptive steps of k stages. The end of a step is superconvergent (order 2k), its
    polynomial is not (order k + 1): the defect is held at the power of the tolerance that belongs to its error."""
    return tolerance ** ((k + 1) / (2 * k)), max(FINEST, SOLVED_TO * tolerance)


@cached_per_system
def prepared(system: System, k: int) -> tuple[Any, Any]:
    """What the methods of all runs share: compiled functions, and a record that each makes `again`."""
    from .march import LOOPS  # LLVM is loaded when something runs, not when plugins are listed
    from .memory import Budget, Counts, Solve, Work

    numbers = formulas.coefficients(k)
    n_factors = numbers.pairs + 1
    whole = system.multipliers or 0 < getattr(system, "n_elements", 0) <= MOST_ELEMENTS
    found = of_arrays(system, n_factors) if system.large and not whole else of_numbers(system, k, n_factors)
    own = {"counts": Counts(), "budget": Budget(), "solve": Solve(), "least_energy": system.energy_magnitude}
    own["constrained"] = bool(system.multipliers)
    return LOOPS, Work(k=k, m=system.size, numbers=numbers, rows=1, n_factors=n_factors, **own, **found)


def address_of(kernel: Kernel) -> int:
    """Address of a kernel; a long one is compiled when it is first called: many runs of tc_auto never do."""
    return late_address(kernel) if kernel.text.count("\n") > LATE_LINES else kernel.address


def of_numbers(system: System, k: int, n_factors: int) -> dict[str, Any]:
    """The fields of a record for a system whose formulas are written out."""
    size = system.size
    if size > MOST_VARIABLES:
        raise TcbenchError(
            f"tc_gauss solves for all variables at once, by formulas that are written out: {size} are too many for it "
            f"(at most {MOST_VARIABLES}). Declare its spaces (docs/add-system.md), or take tc_monolithic."
        )
    made = formulas.formulas(system.symbolic)
    carried, projected = map(len, made.bodies[2])
    on_vectors = vector_kernels(system.symbolic, k)
    n_lanes = size if on_vectors["to_factor"] else 0
    c = np.concatenate([system.constant_values, made.setup(system.constant_values, system.constant_values)])
    return {
        "sparse": of_pattern(made.pattern, n_factors), "c": c, "n_constants": len(c), "n_kinks": made.n_kinks,
        "n_jumping": made.n_jumping, "n_lanes": n_lanes, "n_own": len(made.own) if n_lanes else 0,
        "acts": np.isin(np.arange(n_lanes), made.own).astype(float),
        "n_nodes": 2 * size + projected, "n_carried": carried, "n_slopes": projected,
        "n_ends": made.kernels[0].size, "n_laws": made.kernels[5].size, "n_mended": made.kernels[6].size,
        **dict(zip((*NAMES[:4], "to_matrix", *NAMES[4:]), map(address_of, made.kernels), strict=True)),
        **on_vectors,
    }  # fmt: skip


# large systems, traced on arrays --------------------------------------------------------------------------------------


class ArrayFormulas(NamedTuple):
    """Of a kind of system, whatever its size."""

    kernels: list[ArrayKernel]  # by NAMES
    carried: list[Block]
    projected: list[Block]
    kinks: list[Block]
    jumping: list[Block]
    matrix: ArrayKernel
    unknowns: list[Block]  # of the matrix: those of a state, then shared numbers
    terms: list[tuple[int, Term]]  # its entries: of which row


@cached
def array_formulas(net: Any) -> ArrayFormulas:
    """Those of all systems of one kind, by their `by_arrays`."""
    with trace.tracing():
        z, K = net.fresh_state("z"), net.fresh_state("K")
        parts = formulas.parts_of(net, z, K)
        y, start, motion, slopes, means = formulas.lists_of(parts)
        at_node, carried, projected = [*net.blocks(K), *net.blocks(z)], alone(y), alone(means)
        kinks, jumping = formulas.kinks_of(entries(net.vector_field(z)), entries(z))
        kinks, jumping = formulas.kink_blocks(kinks), alone(jumping)
        bodies = [
            (net.blocks(z), [*net.blocks(formulas.started(net, z)), *alone(start, y), *kinks]),
            (at_node, alone(motion, y)),
            (carried, alone(slopes, means)),
            ([*at_node, *projected], net.blocks(formulas.rates_of(net, z, parts))),
        ]
        made = [array_kernel({"a": inputs, "b": net.constant_blocks()}, outputs) for inputs, outputs in bodies]
        return ArrayFormulas(
            [*made, *mending_kernels(net)[:3]], carried, projected, kinks, jumping, *_matrix(net, z, K)
        )


def _matrix(net: Any, z: Any, K: Any) -> tuple[ArrayKernel, list[Block], list[tuple[int, Term]]]:
    """The Jacobian of K - field(z), and of the rows of what all entries of an array read: see `sparse`."""
    rows = [trace.sub(k, trace.lifted(f)) for k, f in zip(entries(K), entries(net.vector_field(z)), strict=True)]
    rows, unknowns, shared = shared_as_unknowns(rows, entries(z))
    found = [(i, term, slope) for i, row in enumerate(jacobian_terms(rows, unknowns)) for term, slope in row.items()]
    slopes = trace.substitute([slope for _, _, slope in found], shared)
    terms = [(term, slope) for (_, term, _), slope in zip(found, slopes, strict=True)]
    made = jacobian_kernel({"a": net.blocks(z), "b": net.constant_blocks()}, [], terms, [])
    return made, [*net.blocks(z), *alone(list(shared))], [(i, term) for i, term, _ in found]


def of_arrays(system: System, n_factors: int) -> dict[str, Any]:
    """The same for a large system, by loops over its spaces; with the record of its sparse matrix."""
    made, mesh, size = array_formulas(system.by_arrays), system.mesh, system.size
    kernels = dict(zip(NAMES, (x.kernel(mesh) for x in made.kernels), strict=True))
    there = scattered(mesh, made.unknowns, made.terms)
    matrix, places = sparse(size, there.rows, there.columns, mesh.offsets(made.unknowns)[-1], n_factors)
    entries_at = there.places(places, matrix.n_values)
    to_matrix = made.matrix.kernel(mesh.with_entries(matrix.n_values), entries_at, extra=1)
    blocks = made.carried, made.projected, made.kinks, made.jumping
    carried, projected, kinks, jumping = (mesh.offsets(x)[-1] for x in blocks)
    return {
        "large": True, "sparse": matrix, "n_kinks": kinks, "n_jumping": jumping, "n_lanes": 0, "n_own": 0,
        "n_constants": len(system.constant_values), "c": system.constant_values, "to_matrix": late_address(to_matrix),
        "n_nodes": 2 * size + projected, "n_carried": carried, "n_slopes": projected,
        "n_ends": kernels["to_start"].size, "n_laws": kernels["to_laws"].size, "n_mended": kernels["to_mend"].size,
        **{name: late_address(x) for name, x in kernels.items()},
    }  # fmt: skip
