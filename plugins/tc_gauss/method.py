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
from tcbench.compiler.once import once, once_a_system
from tcbench.errors import TcbenchError
from tcbench.solver.foresight import Lending
from tcbench.solver.mending import mending_kernels
from tcbench.systems.system import System

from . import formulas
from .any_system import any_formulas, lists_of, parts_of, rates_of, started
from .any_vectors import vector_kernels
from .sparse import of_pattern, sparse

Floats = NDArray[np.float64]
SOLVED_TO = 0.01  # of the tolerance: residual of the collocation equations in adaptive runs
FINEST = 1e-14  # of the residual: round-off is near
SOLVED = 0  # see `step`
MOST_NEWTON = 500  # unknowns of Newton's dense matrices; larger systems take a step that needs it in halves
MOST_VARIABLES = 300  # of a system without elements
VECTOR_KERNELS = ("to_iterate", "to_iterate_finer", "to_block", "to_extrapolate", "to_close")
NAMES = ("to_start", "to_motion", "to_slopes", "to_forces", "to_laws", "to_mend", "to_hold")  # of large systems


class GaussMethod(Lending):
    """k-stage consistent collocation on one system: fixed steps and adaptive runs. One run at a time has it."""

    def __init__(self, system: System, stages: int) -> None:
        self.loops, model = prepared(system, stages)
        self.stages, self.marches = stages, False
        self.counts = model.counts.again()
        own = {"sparse": model.sparse.again(), "c": model.c.copy()}  # the first of c is the step
        self.lend_to(model.again(counts=self.counts, **own), system)

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

    def adaptive(self, z0: Floats, times: Floats, tolerance: float) -> tuple[Floats, dict[str, int]]:
        """States at `times`, and what they cost."""
        self.begin(z0, times)
        self.work.clear()
        found = self.loops.run(self.work, *held(self.stages, tolerance))
        if self.looks.begun or found != SOLVED:
            self.looks.end()
        if found != SOLVED:
            raise ArithmeticError("the step became too short")
        return self.states.copy(), self.cost()

    def cost(self) -> dict[str, int]:
        """What the last adaptive run took."""
        steps, rejected, iterations, *_ = self.counts.table.tolist()
        return {"steps": steps, "rejected": rejected, "newton_iterations": iterations}


@cache
def held(k: int, tolerance: float) -> tuple[float, float]:
    """Defect and residual of adaptive steps of k stages. The end of a step is superconvergent (order 2k), its
    polynomial is not (order k + 1): the defect is held at the power of the tolerance that belongs to its error."""
    return tolerance ** ((k + 1) / (2 * k)), max(FINEST, SOLVED_TO * tolerance)


@once_a_system
def prepared(system: System, k: int) -> tuple[Any, Any]:
    """What the methods of all runs share: compiled functions, and a record that each makes `again`."""
    from .march import LOOPS  # LLVM is loaded when something runs, not when plugins are listed
    from .memory import Counts, Work

    numbers = formulas.coefficients(k)
    n_factors = numbers.pairs + 1
    by_elements = system.defines("element_energy")
    whole = system.multipliers or (by_elements and system.n_elements <= formulas.MOST_ELEMENTS)
    if system.large and not whole:
        found = of_arrays(system, n_factors)
    else:
        pattern, found = (of_elements if by_elements else of_any_system)(system, k)
        found["sparse"] = of_pattern(pattern, n_factors)
    least = dict(zip(("least_p", "least_s"), system.least[1:3] if by_elements else (1.0, 1.0), strict=True))
    least["least_energy"] = system.least_energy
    return LOOPS, Work(k=k, numbers=numbers, counts=Counts(), rows=1, n_factors=n_factors, **least, **found)


def of_elements(system: System, k: int) -> tuple[Any, dict[str, Any]]:
    """The pattern of the matrix, and the fields of a record, for springs and their like."""
    symbolic = system.symbolic
    made = formulas.formulas(symbolic)
    scalar, matrix = made.kernels[:5], made.kernels[5:]
    names = ("to_start", "to_motion", "to_slopes", "to_forces", "to_mend", "to_matrix", *VECTOR_KERNELS)
    addresses = [*(x.address for x in scalar), matrix[0].address if matrix else 0, *formulas.on_vectors(symbolic, k)]
    n, e = symbolic.n_positions, symbolic.n_elements
    return made.pattern, {
        "n": n, "e": e, "m": n + e, "n_matrix": e if matrix else 0, **constants(system, made),
        "inverse_mass": 1.0 / (np.asarray(system.inertia(), dtype=float) * np.ones(n)),
        "n_lanes": 0, "n_kinks": made.n_kinks, "n_newton": k * (n + e) if k * (n + e) <= MOST_NEWTON else 0,
        "n_ends": scalar[0].size,
        "n_nodes": 2 * (n + e), "n_carried": 2 * e, "n_slopes": 2 * e, "n_positive": e, "n_mended": scalar[-1].size,
        "n_laws": n + e + 1 + scalar[-1].size, **dict(zip(names, addresses, strict=True)),
    }  # fmt: skip


def of_any_system(system: System, k: int) -> tuple[Any, dict[str, Any]]:
    """The same for any system, all of whose variables stand in the place of entropies."""
    size = system.size
    if size > MOST_VARIABLES:
        raise TcbenchError(
            f"tc_gauss solves for all variables at once, by formulas that are written out: {size} are too many for it "
            f"(at most {MOST_VARIABLES}). Declare its spaces (docs/add-system.md), or take tc_monolithic."
        )
    made, (laws, mend, hold) = any_formulas(system.symbolic)
    carried, projected = map(len, made.bodies[2])
    names = ("to_start", "to_motion", "to_slopes", "to_forces", "to_matrix", "to_laws", "to_mend", "to_hold")
    addresses = [x.address for x in (*made.kernels, laws, mend, hold)]
    on_vectors = vector_kernels(system.symbolic, k)
    return made.pattern, {
        "general": True, **dict.fromkeys(("n", "n_newton", "n_positive"), 0), **on_vectors, "n_kinks": made.n_kinks,
        "n_lanes": size if on_vectors["to_factor"] else 0,
        **dict.fromkeys(("e", "m", "n_matrix"), size), **constants(system, made),
        "n_ends": made.kernels[0].size, "n_nodes": 2 * size + projected, "n_carried": carried,
        "n_slopes": projected, "n_laws": laws.size, "n_mended": mend.size,
        **dict(zip(names, addresses, strict=True)),
        **dict(zip(VECTOR_KERNELS[3:], formulas.sums_on_vectors(k, 0, size), strict=True)),
    }  # fmt: skip


def constants(system: System, made: Any) -> dict[str, Any]:
    """The system's, and what its formulas make of them."""
    c = np.concatenate([system.constant_values, made.setup(system.constant_values, system.constant_values)])
    return {"c": c, "n_constants": len(c)}


# large systems, traced on arrays --------------------------------------------------------------------------------------


class ArrayFormulas(NamedTuple):
    """Of a kind of system, whatever its size."""

    kernels: list[ArrayKernel]  # by NAMES
    carried: list[Block]
    projected: list[Block]
    kinks: list[Block]
    matrix: ArrayKernel
    unknowns: list[Block]  # of the matrix: those of a state, then shared numbers
    terms: list[tuple[int, Term]]  # its entries: of which row


@once
def array_formulas(net: Any) -> ArrayFormulas:
    """Those of all systems of one kind, by their `by_arrays`."""
    with trace.tracing():
        z, K = net.fresh_state("z"), net.fresh_state("K")
        parts = parts_of(net, z, K)
        y, start, motion, slopes, means = lists_of(parts)
        at_node, carried, projected = [*net.blocks(K), *net.blocks(z)], alone(y), alone(means)
        kinks = formulas.kink_blocks(formulas.kinks_of(entries(net.vector_field(z)), entries(z)))
        bodies = [
            (net.blocks(z), [*net.blocks(started(net, z)), *alone(start, y), *kinks]),
            (at_node, alone(motion, y)),
            (carried, alone(slopes, means)),
            ([*at_node, *projected], net.blocks(rates_of(net, z, parts))),
        ]
        made = [array_kernel({"a": inputs, "b": net.constant_blocks()}, outputs) for inputs, outputs in bodies]
        return ArrayFormulas([*made, *mending_kernels(net)[:3]], carried, projected, kinks, *_matrix(net, z, K))


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
    to_matrix = made.matrix.kernel(mesh.with_entries(matrix.n_values), entries_at, extra=1).address
    carried, projected, kinks = (mesh.offsets(blocks)[-1] for blocks in (made.carried, made.projected, made.kinks))
    return {
        "general": True, "large": True, **dict.fromkeys(("n", "n_newton", "n_lanes", "n_positive"), 0),
        **dict.fromkeys(("e", "m", "n_matrix"), size), "sparse": matrix, "n_kinks": kinks,
        "n_constants": len(system.constant_values), "to_matrix": to_matrix, "n_ends": kernels["to_start"].size,
        "n_nodes": 2 * size + projected, "n_carried": carried, "n_slopes": projected,
        "n_laws": kernels["to_laws"].size, "n_mended": kernels["to_mend"].size, "c": system.constant_values,
        **{name: x.address for name, x in kernels.items()},
    }  # fmt: skip
