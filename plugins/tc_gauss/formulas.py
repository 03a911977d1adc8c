"""Coefficients of the collocation, the kernels of a system of elements for it, and kernels on vectors of eight numbers.

The equations are in `step`. A vector holds one variable at all k nodes, or at eight quadrature points.
"""

from __future__ import annotations

import itertools
from functools import cache, reduce
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcbench.compiler import derivatives as trace
from tcbench.compiler.array_mesh import Block, alone
from tcbench.compiler.array_states import entries
from tcbench.compiler.kernels import WIDTH, Kernel, constant_part, kernel, placed
from tcbench.compiler.language import PLAIN
from tcbench.compiler.machine import load
from tcbench.compiler.vector_kernels import Lanes, can_express
from tcbench.errors import TcbenchError
from tcbench.reference.quadrature import gauss, integrals, lagrange
from tcbench.systems.momenta import lengthening, restored_momenta
from tcbench.systems.system import System

from .memory import POINTS, Numbers

MOST_ELEMENTS = 32  # of a network traced as a whole: then on vectors and mended, ten times as fast after a few seconds
ON_VECTORS = 2  # of them: steps that need more are too long for the iteration
Floats = NDArray[np.float64]


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
        barycentric=barycentric.astype(float), A=A.astype(float), A_squared=(A @ A).astype(float),
        b=b.astype(float), Ahats=Ahats, Ws=Ws, **parts,
    )  # fmt: skip


def eigenvectors(A: Floats) -> tuple[Any, Any, Any]:
    """(z, Y, X), one of each pair of conjugates: A x = sum over them of the real part of X z (Y x), x real."""
    z, X = np.linalg.eig(A)
    Y = np.linalg.inv(X)
    kept = np.flatnonzero(z.imag >= 0.0)
    return z[kept], Y[kept], X[:, kept] * np.where(z[kept].imag > 0.0, 2.0, 1.0)


class Formulas(NamedTuple):
    """What a step computes with a system's functions; see `step`."""

    kernels: list[Kernel]
    setup: Kernel  # for what depends on the constants only
    places: dict[Any, int]  # where the constants stand, and behind them its results
    bodies: list[tuple[list[Any], list[Any]]]  # inputs and values of the kernels
    pattern: Any  # which entries its matrix has, (n, n)
    table: Any  # of the trace, for those that go on from it
    n_kinks: int = 0  # numbers behind all that `start` gives: see `kinks_of`

    @classmethod
    def of(cls, system: Any, bodies: list[Any], table: Any, matrix: Any = None, fixed: Any = ()) -> Formulas:
        """Of a structure, from inputs and values; last of the kernels is that of the matrix, whose entries, with other
        signs, it gives row by row. fixed: results of `setup` that stand before those of these."""
        pattern = np.empty((0, 0), bool)
        if matrix is not None:
            pattern = np.array([[not trace.is_const(trace.lifted(x), 0.0) for x in row] for row in matrix])
            bodies = [*bodies, (bodies[0][0], [-x for x in matrix[pattern]])]
        bodies = [(inputs, list(map(trace.lifted, values))) for inputs, values in bodies]
        hoisted = constant_part([x for _, row in bodies for x in row], [x for inputs, _ in bodies for x in inputs])
        constants, first = system.constant_symbols(), system.n_constant_values + len(fixed)
        known = constants | placed("b", hoisted, first)
        made = [kernel(placed("a", inputs) | known, row) for inputs, row in bodies]
        places = {x: int(text[2:-1]) for x, text in known.items()}  # of 'b[3]'
        return cls(made, kernel(constants, [*fixed, *hoisted]), places, bodies, pattern, table)


@cache
def formulas(symbolic: System) -> Formulas:
    """The formulas of a system of elements, traced from its functions: start, motion, slopes, forces, mending and, of
    more than two elements that are not many, the matrix of the conduction (see conduction.py).

    symbolic: one object for all systems of one structure, as `System.symbolic` gives it; so below.
    """
    with trace.tracing() as table:
        z = trace.variables("z", symbolic.size)
        bodies = [*((entries(*x), entries(*y)) for x, y in iterated(symbolic)), _mending(symbolic, z)]
        kinks = kinks_of(entries(symbolic.vector_field(z)), [*z])
        bodies.insert(0, ([*z], [*_start(symbolic, z), *kinks]))
        some = 2 < symbolic.n_elements <= MOST_ELEMENTS
        made = Formulas.of(symbolic, bodies, table, _conduction_matrix(symbolic, z) if some else None)
        return made._replace(n_kinks=len(kinks))


def kinks_of(rates: list[Any], variables: list[Any]) -> list[Any]:
    """What changes its sign where these rates have a kink, numbers that they have the size of and their like; then how
    fast each of them changes."""
    nodes = trace.topological(list(map(trace.lifted, rates)))
    found = [x.args[0] if x.op == "abs" else x.args[0] - x.args[1] for x in nodes if x.op in ("abs", "max", "min")]
    found = [x for x in dict.fromkeys(found) if trace.depends_on([x], variables)]
    return [*found, *trace.along(found, dict(zip(variables, map(trace.lifted, rates), strict=True)))]


def kink_blocks(kinks: list[Any]) -> list[Block]:
    """The same of arrays over spaces: each over the space of what changes its sign, as its slope may be one for all."""
    return alone(kinks, kinks[: len(kinks) // 2] * 2)


def iterated(system: Any) -> list[tuple[list[Any], list[Any]]]:
    """Arrays in and out of what an iteration asks for: rates of the shapes, slopes of the elements, rates."""
    v, q = (system.fresh(name, "position") for name in "vq")
    pi, s, sigma, theta = (system.fresh(name, "element") for name in ("pi", "s", "sigma", "theta"))
    stress, temperature = system.element_slopes(pi, s)
    return [
        ([v, q], [system.shape_gradient(q) @ v]),
        ([pi, s], [stress, temperature]),
        ([v, q, sigma, theta], [-(sigma @ system.shape_gradient(q)), system.conduction(theta)]),
    ]


def projected(lanes: Any, k: int, level: int, shared: Any, carried: Any, slopes: list[Any]) -> tuple[Any, list[Any]]:
    """The projections of the slopes at the nodes, on vectors; and what is carried at the points of the quadrature.

    shared: what stands for constants; carried: the variables of the slopes with their starts and their rates at nodes.
    """
    known, h, columns, points = coefficients(k), lanes.number(lanes.b, 0), [], []
    values: list[list[Any]] = [[] for _ in slopes]
    for first in range(0, POINTS[level] if slopes else 0, WIDTH):
        rows = known.Ahats[level, first : first + WIDTH]
        here = {x: integrated(lanes, h, start, rows, rates) for x, start, rates in carried}
        points.append(list(here.values()))
        for found, value in zip(values, lanes.graph(shared | here, slopes), strict=True):
            found += [lanes.lane(value, g) for g in range(WIDTH)]
        columns += list(known.Ws[level, :, first : first + WIDTH].T)
    return [lanes.combine(columns, x) for x in values], points


def integrated(lanes: Any, h: Any, start: Any, weights: Any, rates: Any) -> Any:
    return lanes.add(start, lanes.mul(h, lanes.combine(weights.T, rates)))


@cache
def iteration(symbolic: System, k: int, level: int) -> str:
    """`step.rates` and `correct` with one of the quadratures, on vectors: LLVM code of kernel(a, b, out).

    a: as `memory.Work.given` has it.  b: h, constants.  out: U, which is corrected in place, N and V, a row of WIDTH
    nodes for each variable; then the square of the scaled residual / h, NaN if a shape or temperature is not positive.
    """
    known = formulas(symbolic)
    with trace.tracing(known.table):
        return _iteration(symbolic, known, k, level)


def _iteration(system: Any, made: Formulas, k: int, level: int) -> str:
    n, e, coefficient = system.n_positions, system.n_elements, coefficients(k)
    m, lanes = n + e, Lanes()
    motion, slopes, forces = made.bodies[1:4]
    ends = np.cumsum([0, n, n, 2 * e, k * WIDTH, e, e, 2]).tolist()
    *state, block, left, right, sizes = (range(*x) for x in itertools.pairwise(ends))
    q0, p0, x0, u, v, scale = ([lanes.number(lanes.a, i) for i in x] for x in (*state, left, right, sizes))
    h = lanes.number(lanes.b, 0)
    U = [[lanes.number(lanes.out, WIDTH * i + l) for l in range(k)] for i in range(m)]
    old = [lanes.row(lanes.out, WIDTH * i) for i in range(m)]
    shared = {x: lanes.number(lanes.b, i) for x, i in made.places.items()}
    # nodes: velocities, positions, the rates of the shapes
    per_mass = lanes.graph(shared, [1.0 / x for x in system.inertia() * np.ones(n)])
    moving, q = [], []
    for i in range(n):
        moving.append(lanes.mul(per_mass[i], integrated(lanes, h, p0[i], coefficient.A, U[i])))
        twice = lanes.mul(h, lanes.combine(coefficient.A_squared.T, U[i]))
        start = lanes.add(lanes.mul(p0[i], lanes.constant(coefficient.nodes)), twice)
        q.append(lanes.add(q0[i], lanes.mul(h, lanes.mul(per_mass[i], start))))
    at = shared | dict(zip(motion[0], [*moving, *q], strict=True))
    drift = [[lanes.lane(x, l) for l in range(k)] for x in lanes.graph(at, motion[1])]
    # quadrature points: stress and temperature, and their means at the nodes
    carried = list(zip(slopes[0], x0, [*drift, *U[n:]], strict=True))
    means, points = projected(lanes, k, level, shared, carried, slopes[1])
    zero, nan = lanes.constant(0.0), lanes.constant(np.nan)
    least = reduce(lanes.smaller, [*(x for here in points for x in here[:e]), *means[e:]])
    positive = lanes.select(">", least, zero, zero, nan)  # one that is not a number shows in the residual
    new = lanes.graph(at | dict(zip(forces[0][2 * n :], means, strict=True)), forces[1])
    # the correction, with the conduction solved for
    change = [lanes.sub(x, y) for x, y in zip(new, old, strict=True)]
    rho = reduce(lanes.add, [lanes.mul(x, y) for x, y in zip(v, change[n:], strict=True)])
    columns = [lanes.row(lanes.a, first) for first in block[::WIDTH]]
    stiff = lanes.combine(columns, [lanes.lane(rho, l) for l in range(k)])
    step = [*change[:n], *(lanes.add(x, lanes.mul(y, stiff)) for x, y in zip(change[n:], u, strict=True))]
    scaled = [lanes.mul(x, scale[i >= n]) for i, x in enumerate(change)]
    squares = [lanes.mul(x, x) for x in scaled]
    sizes = [lanes.first(k, x) for x in (reduce(lanes.add, squares[:n]), *squares[n:])]
    for i in range(m):
        lanes.store(lanes.add(old[i], step[i]), WIDTH * i)
        lanes.store(new[i], WIDTH * (m + i))
    for i in range(n):
        lanes.store(moving[i], WIDTH * (2 * m + i))
    lanes.store(lanes.largest([*sizes, positive]), WIDTH * (2 * m + n))
    return lanes.text()


def _start(system: Any, z: Any) -> list[Any]:
    """(F, G, pi, E, round-off of E, decay, u, v): the rates at a state, and the stiff part of the conduction.

    d conduction/ds is nearly u v^T with theta . u = 0, since theta . conduction = 0 for all s: for two elements u is
    known, and v is a row of the derivative. With more of them see `_conduction_matrix`.
    """
    n, e, state = system.n_positions, system.n_elements, system.state(z)
    rate, theta = system.vector_field(z)[n:], system.temperatures(z)
    energy = system.energy(z)
    noise = noise_of(system, z, energy)
    u = v = [0.0] * e
    if e == 2:
        slope = trace.jacobian(list(rate[n:]), list(state.s))
        u, v = [1.0, -theta[0] / theta[1]], list(slope[0])
    decay = sum(a * b for a, b in zip(u, v, strict=True))
    return [*rate, *system.shape(state.q), energy, noise, decay, *u, *v]


def _conduction_matrix(system: Any, z: Any) -> Any:
    """d conduction/ds at a state."""
    rate = system.vector_field(z)[2 * system.n_positions :]
    return trace.jacobian(list(rate), list(system.state(z).s))


def noise_of(system: Any, z: Any, energy: Any) -> Any:
    """Some rounding errors of each element's heat, of the work that it holds, of the motion, of positions under their
    forces and of the total."""
    state = system.state(z)
    pi, theta, force = system.shape(state.q), system.temperatures(z), system.state(system.vector_field(z)).p
    held = np.sum(abs(system.element_slopes(pi, state.s)[0] * pi))
    placed = np.sum(abs(force * state.q))
    heat = np.sum(theta * system.entropy_scale())
    moving = state.p @ (state.p / system.inertia())
    return 2.0**-51 * (heat + held + moving + placed + abs(energy) + system.least_energy)


def _mending(system: Any, z: Any) -> tuple[list[Any], list[Any]]:
    """Inputs: (z, its energy, the right energy and invariants); values: (change of p that makes them right, the energy
    that this moves as a part of the kinetic energy that is free to change, the invariants of z). See `step`."""
    n, state = system.n_positions, system.state(z)
    here = system.invariants(state.q, state.p)
    energies, wanted = trace.variables("E", 2), trace.variables("J", len(here))
    inputs = [*z, *energies, *wanted]
    try:
        p, free = restored_momenta(state, system, dict(zip(here, wanted, strict=True)))
    except TcbenchError:  # not linear in the momenta
        return inputs, [*[0.0] * n, np.inf, *here.values()]
    turned = p - state.p
    missing = energies[1] - energies[0] - sum(turned * (turned + 2.0 * state.p) / system.inertia()) / 2
    x = missing / (sum(free * free / system.inertia()) / 2)
    return inputs, [*(turned + lengthening(free, x)), x, *here.values()]


def stiff_block(k: int) -> str:
    """`step.stiff_block` on vectors. a: h, lambda; out: the block.

    The block is a function of A; its eigenvalues are h z/(1 - lambda h z), where z are those of A.
    """
    lanes = Lanes()
    z, Y, X = eigenvectors(coefficients(k).A)
    h, decay = lanes.number(lanes.a, 0), lanes.number(lanes.a, 1)
    x, y, size = (lanes.constant(v) for v in (z.real, z.imag, np.abs(z) ** 2))
    m = lanes.mul(h, decay)
    real, imag = lanes.sub(lanes.constant(1.0), lanes.mul(m, x)), lanes.mul(m, y)
    scale = lanes.divide(h, lanes.add(lanes.mul(real, real), lanes.mul(imag, imag)))
    parts = lanes.mul(scale, lanes.sub(x, lanes.mul(m, size))), lanes.mul(scale, y)
    factors = [lanes.lane(part, i) for part in parts for i in range(len(z))]
    for j in range(k):
        column = X * Y[:, j]
        weights = [*column.real.T, *(-column.imag.T)]
        lanes.store(lanes.combine([[*w, *[0.0] * (WIDTH - k)] for w in weights], factors), WIDTH * j)
    return lanes.text()


def extrapolation(k: int, m: int) -> str:
    """`step.extrapolate` on vectors. a: this step over the last; out: U, N, of m variables each."""
    lanes, coefficient = Lanes(), coefficients(k)
    x = lanes.add(lanes.constant(1.0), lanes.mul(lanes.number(lanes.a, 0), lanes.constant(coefficient.nodes)))
    weights = [
        lanes.divide(lanes.constant(w), lanes.sub(x, lanes.constant(c)))
        for w, c in zip(coefficient.barycentric, coefficient.nodes, strict=True)
    ]
    inverse = lanes.divide(lanes.constant(1.0), reduce(lanes.add, weights))
    weights = [lanes.mul(w, inverse) for w in weights]
    for i in range(m):
        last = [lanes.number(lanes.out, WIDTH * (m + i) + l) for l in range(k)]
        lanes.store(lanes.combine(weights, last), WIDTH * i)
    return lanes.text()


def closing(k: int, n: int, e: int) -> str:
    """The end of a step: sums over the nodes. a: N, V; b: h; out: dz (2n + e), then N at 0 and N at 1 (n + e each)."""
    lanes, coefficient, m = Lanes(), coefficients(k), n + e
    rows = [lanes.first(k, lanes.row(lanes.a, WIDTH * i)) for i in range(m + n)]
    h = lanes.number(lanes.b, 0)
    pad = [0.0] * (WIDTH - k)
    b = lanes.mul(h, lanes.constant([*coefficient.b, *pad]))
    sides = [lanes.constant([*side, *pad]) for side in (coefficient.at_start, coefficient.at_end)]
    sums = [
        *(lanes.mul(b, x) for x in [*rows[m:], *rows[:m]]),
        *(lanes.mul(side, x) for side in sides for x in rows[:m]),
    ]
    for i, value in enumerate(sums):
        lanes.store(lanes.sum(value), i)
    return lanes.text()


@cache
def on_vectors(symbolic: System, k: int) -> list[int]:
    """Addresses of the kernels on vectors; zeros where the system's iterations have no such form."""
    if PLAIN:
        return [0] * (ON_VECTORS + 3)
    some = can_express([x for _, row in formulas(symbolic).bodies[1:4] for x in row])
    iterations = [load(iteration(symbolic, k, level), str) if some else 0 for level in range(ON_VECTORS)]
    return [*iterations, load(stiff_block(k), str), *sums_on_vectors(k, symbolic.n_positions, symbolic.n_elements)]


@cache
def sums_on_vectors(k: int, n: int, e: int) -> list[int]:
    """Addresses of the last two of them, which ask nothing of the system."""
    if PLAIN:
        return [0, 0]
    return [load(t, str) for t in (extrapolation(k, n + e), closing(k, n, e))]
