"""The formulas of a step (see `step`) of any system: the cut of its energy and its entropy, and what its rates read.

E = F(y(z)) with y at most quadratic, which are carried as polynomials of their own; so is S. For springs the y are the
strain measures, and the projected slopes are stresses and temperatures. Slopes that are constant, as of a kinetic
energy, are not projected, and y on which no slope depends are not carried.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcbench.compiler import derivatives as trace
from tcbench.compiler.array_mesh import Block, alone
from tcbench.compiler.array_states import entries, refilled
from tcbench.compiler.arrays import variable
from tcbench.compiler.caches import cached
from tcbench.compiler.cut import Cut
from tcbench.compiler.derivatives import Symbol, lifted
from tcbench.compiler.flat import flat_away
from tcbench.compiler.kernels import Kernel, constant_part, kernel, placed
from tcbench.compiler.language import PLAIN
from tcbench.reference.quadrature import gauss, integrals, lagrange
from tcbench.solver.mending import by_variable, mending_kernels
from tcbench.systems.constrained import reduced
from tcbench.systems.system import System

from .lanes import can_express
from .memory import POINTS, Numbers
from .sparse import with_fill

Floats = NDArray[np.float64]
MOST_ON_VECTORS, MOST_PRODUCTS = 128, 1400  # variables, and products of an elimination: more take seconds to compile
UNDER_CONSTRAINTS = 16  # the same of systems with constraints, whose rates are long: of 22 or 28 numbers they take 5 s


@cache
def coefficients(k: int) -> Numbers:
    """The numbers of k-stage Gauss collocation with projection; computed in extended precision, rounded once."""
    nodes, b = gauss(k)
    A = integrals(nodes, nodes)
    Ahats, Ws = np.zeros((len(POINTS), POINTS[-1], k)), np.zeros((len(POINTS), k, POINTS[-1]))
    for level, m in enumerate(POINTS):
        xi, omega = gauss(m)
        Ahats[level, :m] = integrals(nodes, xi).astype(float)
        Ws[level, :, :m] = (omega[:, None] * lagrange(nodes, xi) / b).T.astype(float)
    barycentric = np.array([1 / np.prod([nodes[j] - nodes[l] for l in range(k) if l != j]) for j in range(k)])
    zero, one = lagrange(nodes, [0, 1]).astype(float)
    eigen, into, back = eigenvectors(A.astype(float))
    complexes = {"eigen": eigen, "into": into, "back": back}
    parts = {f"{name}_re": np.ascontiguousarray(x.real) for name, x in complexes.items()}
    parts |= {f"{name}_im": np.ascontiguousarray(x.imag) for name, x in complexes.items()}
    return Numbers(
        k=k, pairs=len(eigen), largest=abs(eigen).max(), nodes=nodes.astype(float), at_start=zero, at_end=one,
        barycentric=barycentric.astype(float), A=A.astype(float), b=b.astype(float), Ahats=Ahats, Ws=Ws, **parts,
    )  # fmt: skip


def eigenvectors(A: Floats) -> tuple[Any, Any, Any]:
    """(z, Y, X), one of each pair of conjugates: A x = sum over them of the real part of X z (Y x), x real."""
    z, X = np.linalg.eig(A)
    Y = np.linalg.inv(X)
    kept = np.flatnonzero(z.imag >= 0.0)
    return z[kept], Y[kept], X[:, kept] * np.where(z[kept].imag > 0.0, 2.0, 1.0)


class Formulas(NamedTuple):
    """What a step computes with a system's functions; see `step`."""

    kernels: list[Kernel]  # start, motion, slopes, forces, matrix; laws, mend, hold
    setup: Kernel  # for what depends on the constants only
    places: dict[Any, int]  # where the constants stand, and behind them its results
    bodies: list[tuple[list[Any], list[Any]]]  # inputs and values of the first kernels
    pattern: Any  # which entries the Jacobian has, (n, n); its kernel gives them row by row, with other signs
    driven: list[int]  # variables whose rates read none of their own and no projected slope, as positions
    own: list[int]  # of the others those that act back on themselves, as entropies that conduct: see `vectors`
    slopes: dict[tuple[int, int], int]  # where `start` has the entries of their matrix, by their places among them
    on_vectors: bool
    table: Any  # of the trace, for those that go on from it
    n_kinks: int  # numbers behind all that `start` gives: see `kinks_of`
    n_jumping: int  # the first ones of these, where rates have kinks


@cached
def formulas(symbolic: System) -> Formulas:
    """The formulas of all systems of one structure, of which `System.symbolic` is one; made once."""
    with trace.tracing() as table:
        *mending, fixed = mending_kernels(symbolic)
        z, K = (symbolic.state(trace.variables(name, symbolic.size)) for name in "zK")
        parts = parts_of(symbolic, z, K)
        y, start, motion, slopes, means = lists_of(parts)
        forces, field = rates_of(symbolic, z, parts), list(map(lifted, symbolic.vector_field(z)))
        (kinks, jumping), matrix = kinks_of(field, [*z]), trace.jacobian(field, list(z))
        pattern = np.array([[not trace.is_const(lifted(x), 0.0) for x in row] for row in matrix])
        free = set(range(symbolic.size)) - depending(list(forces), [*K, *means])
        driven, own = structure(pattern, sorted(free))
        there = pattern[np.ix_(own, own)]
        written = [list(map(lifted, x)) for x in (motion, slopes, list(forces))]
        on_vectors = (
            not PLAIN
            and symbolic.size <= (UNDER_CONSTRAINTS if symbolic.multipliers else MOST_ON_VECTORS)
            and products(with_fill(there)) <= MOST_PRODUCTS
            and can_express([x for row in written for x in row])
        )
        ends = [*entries(*started(symbolic, z)), *start]
        where = {(i, j): len(ends) + l for l, (i, j) in enumerate(np.argwhere(there).tolist())} if on_vectors else {}
        bodies: list[tuple[list[Any], list[Any]]] = [
            ([*z], [*ends, *(matrix[own[i], own[j]] for i, j in where), *kinks]),
            ([*K, *z], motion),
            (y, slopes),
            ([*K, *z, *means], list(forces)),
            ([*z], [-x for x in matrix[pattern]]),
        ]
        bodies = [(inputs, list(map(lifted, values))) for inputs, values in bodies]
        hoisted = constant_part([x for _, row in bodies for x in row], [x for inputs, _ in bodies for x in inputs])
        constants, first = symbolic.constant_symbols(), symbolic.n_constant_values + len(fixed)
        known = constants | placed("b", hoisted, first)
        kernels = [kernel(placed("a", inputs) | known, row) for inputs, row in bodies]
        places = {x: int(text[2:-1]) for x, text in known.items()}  # of 'b[3]'
        setup, kernels = kernel(constants, [*fixed, *hoisted]), [*kernels, *mending]
        structural = (pattern, driven, own, where, on_vectors)
        return Formulas(kernels, setup, places, bodies, *structural, table, len(kinks), len(jumping))


def depending(values: list[Any], on: list[Any]) -> set[int]:
    """Indices of those values that depend on any number of `on`."""
    moving = trace.depends_on(list(map(lifted, values)), on)
    return {i for i, x in enumerate(values) if lifted(x).number in moving}


def products(there: Any) -> int:
    """How many products an elimination takes whose factors have these entries; `there` is boolean, shape (n, n)."""
    return sum(int(there[j + 1 :, j].sum()) * int(there[j, j:].sum()) for j in range(len(there)))


def structure(pattern: Any, free: Sequence[int]) -> tuple[list[int], list[int]]:
    """The driven and the own variables of a system (see `Formulas`) whose Jacobian has such entries.

    pattern: shape (n, n). free: the rates that read no projected slope.
    """
    from scipy.sparse.csgraph import connected_components

    driven: list[int] = []
    for i in free:
        if not (pattern[i, [*driven, i]].any() or pattern[driven, i].any()):
            driven.append(i)
    rest = np.setdiff1d(np.arange(len(pattern)), driven)
    among = pattern[np.ix_(rest, rest)]
    _, component = connected_components(among, connection="strong")
    several = np.bincount(component, minlength=1)[component] > 1 if len(rest) else np.zeros(0, bool)
    return driven, rest[several | among.diagonal()].tolist()


def kinks_of(rates: list[Any], variables: list[Any]) -> tuple[list[Any], list[Any]]:
    """(kinks, jumping): numbers that show where these rates, one a variable, have kinks or stop being flat.

    jumping : numbers that change their sign at a kink: x of |x|, x - y of max(x, y) and min(x, y). kinks : these; then
    numbers that are positive where the rates are not flat (`Argument.edge`), at which nothing jumps; then the rate of
    change of each of both."""
    rates = list(map(lifted, rates))
    nodes = [x for x in trace.topological(rates) if x.op in ("abs", "max", "min")]
    signed = list(dict.fromkeys(x.args[0] if x.op == "abs" else x.args[0] - x.args[1] for x in nodes))
    jumping = [signed[i] for i in sorted(depending(signed, variables))]
    numbers = list(dict.fromkeys([*jumping, *(argument.edge() for argument in flat_away(rates, variables))]))
    return [*numbers, *trace.along(numbers, dict(zip(variables, rates, strict=True)))], jumping


def kink_blocks(kinks: list[Any]) -> list[Block]:
    """`kinks_of` arrays as blocks. A rate of change has the space of its number, also where it is one for all of it."""
    return alone(kinks, kinks[: len(kinks) // 2] * 2)


def parts_of(system: Any, z: Any, K: Any) -> list[Part]:
    """The cuts of the energy and of the entropy at a state z with rates K, shape (size,) each; of numbers or arrays."""
    return [Part(system.cut(name), entries(z), entries(K)) for name in ("energy", "entropy")]


def lists_of(parts: Sequence[Part]) -> Iterator[list[Any]]:
    """Five lists, each of the energy's entries and then the entropy's: y, start, motion, slopes, means (see `Part`)."""
    names = ("y", "start", "motion", "slopes", "means")
    return ([x for part in parts for x in getattr(part, name)] for name in names)


def rates_of(system: Any, z: Any, parts: Sequence[Part]) -> Any:
    """The rates at a node, shape (size,), with projected gradients in the place of grad E and grad S."""
    gradients = [system.state(refilled(z, part.gradient)) for part in parts]
    if system.multipliers:
        return reduced(system, z, *gradients)
    return system.reversible(z, *gradients) + system.irreversible(z, *gradients)


def started(system: Any, z: Any) -> list[Any]:
    """What a state begins with: rates, 1/sizes, of which a variable's numbers share one, and the energy."""
    one = 0.0 * z + 1.0
    means = [s / n for s, n in zip(*(entries(by_variable(system, x, x)) for x in (z, one)), strict=True)]
    sizes = [least + lifted(mean).sqrt() for least, mean in zip(entries(system.magnitudes_of(z)), means, strict=True)]
    return [system.vector_field(z), refilled(z, [1.0 / size for size in sizes]), lifted(system.energy(z))]


class Part:
    """The energy or the entropy: y, start (y of z), motion (their rates), slopes of F that vary, means (symbols for
    these at a node) and the gradient there."""

    def __init__(self, cut: Cut, z: Sequence[Symbol], K: Sequence[Symbol]) -> None:
        moving = depending(cut.slopes, cut.y)
        varies = [i in moving for i in range(len(cut.slopes))]
        self.slopes = [slope for slope, v in zip(cut.slopes, varies, strict=True) if v]
        needed = set(trace.topological(self.slopes))
        carried = [i for i, y in enumerate(cut.y) if y in needed]
        self.y = [cut.y[i] for i in carried]
        values, moved = cut.values(z), cut.moved(z, K)
        self.start, self.motion = ([x[i] for i in carried] for x in (values, moved))
        self.means: list[Symbol] = [variable("mean", slope.space) for slope in self.slopes]
        means = iter(self.means)
        self.gradient = cut.joined([next(means) if v else s for s, v in zip(cut.slopes, varies, strict=True)], z)
