"""What a step of consistent collocation computes: the numbers of the method, a system's formulas, and both on vectors.

See `step` for the equations. The kernels on vectors treat all nodes, or eight quadrature points, at once.
"""

from __future__ import annotations

from functools import cache, reduce
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcbench.compiler import derivatives as trace
from tcbench.compiler.array_states import entries
from tcbench.compiler.kernels import WIDTH, Kernel, constant_part, kernel
from tcbench.compiler.language import PLAIN
from tcbench.errors import TcbenchError
from tcbench.reference.collocation import gauss_nodes, tableau
from tcbench.reference.precision import LONG
from tcbench.systems.momenta import lengthening, restored_momenta
from tcbench.systems.system import System

# points of the quadratures, whole numbers of vectors: the coarsest that keeps the energy is taken
POINTS = (8, 16, 32, 64)
MOST_ELEMENTS = 32  # of a network traced as a whole: then on vectors and mended, ten times as fast after a few seconds
ON_VECTORS = 2  # of them: steps that need more are too long for the iteration
Floats = NDArray[np.float64]


class Coefficients(NamedTuple):
    """The numbers of k-stage Gauss collocation with projection; see `step`."""

    nodes: Floats  # (k,)
    barycentric: Floats  # (k,) weights of the nodes in Lagrange's second form
    at_start: Floats  # (k,) Lagrange polynomials at 0
    at_end: Floats  # (k,) and at 1
    A: Floats  # (k, k)
    A_squared: Floats  # (k, k)
    b: Floats  # (k,)
    pairs: int  # of eigenvalues of A; one that is real counts as a pair
    eigen_re: Floats  # (pairs,) one of each
    eigen_im: Floats
    into_re: Floats  # (pairs, k) a vector's parts along their eigenvectors
    into_im: Floats
    back_re: Floats  # (k, pairs) the real vector of such parts
    back_im: Floats
    Ahats: Floats  # (levels, M, k): integrals of the Lagrange polynomials from 0 to the quadrature points
    Ws: Floats  # (levels, k, M)


@cache
def coefficients(k: int) -> Coefficients:
    """Computed in extended precision, rounded once."""
    method = tableau("gauss", k)
    nodes, b = method.c, method.b
    # integrals of polynomials of degree k - 1 over [0, x], exactly
    inner, inner_weights = gauss_nodes(k)

    def lagrange(x: Any) -> Any:
        factors = np.ones((len(x), k), LONG)
        for j in range(k):
            for l in range(k):
                if l != j:
                    factors[:, j] *= (x - nodes[l]) / (nodes[j] - nodes[l])
        return factors

    Ahats, Ws = np.zeros((len(POINTS), POINTS[-1], k)), np.zeros((len(POINTS), k, POINTS[-1]))
    for level, m in enumerate(POINTS):
        xi, omega = gauss_nodes(m)
        Ahats[level, :m] = np.array([x * (inner_weights @ lagrange(x * inner)) for x in xi], dtype=float)
        Ws[level, :, :m] = (omega[:, None] * lagrange(xi) / b).T.astype(float)
    barycentric = np.array([1 / np.prod([nodes[j] - nodes[l] for l in range(k) if l != j]) for j in range(k)])
    zero, one = lagrange(np.array([0, 1], LONG)).astype(float)
    eigen, into, back = eigenvectors(method.A.astype(float))
    return Coefficients(
        nodes.astype(float), barycentric.astype(float), zero, one, method.A.astype(float),
        (method.A @ method.A).astype(float), b.astype(float), len(eigen),
        *(np.ascontiguousarray(x) for parts in (eigen, into, back) for x in (parts.real, parts.imag)), Ahats, Ws,
    )  # fmt: skip


def eigenvectors(A: Floats) -> tuple[Any, Any, Any]:
    """(z, Y, X), one of each pair of conjugates: A x = sum over them of the real part of X z (Y x), x real."""
    z, X = np.linalg.eig(A)
    Y = np.linalg.inv(X)
    kept = np.flatnonzero(z.imag >= 0.0)
    return z[kept], Y[kept], X[:, kept] * np.where(z[kept].imag > 0.0, 2.0, 1.0)


class Formulas(NamedTuple):
    """What a step computes with a system's functions; see `step`."""

    kernels: list[Kernel]  # start, motion, slopes, forces, mending
    matrix: Kernel | None  # of the conduction: see conduction.py
    setup: Kernel  # for what depends on the constants only; its results stand behind them
    places: dict[Any, int]  # where each of both stands; empty where the formulas have no form on vectors
    table: Any  # of the trace, for those that go on from it


@cache
def formulas(symbolic: System) -> Formulas:
    """The formulas of a system of elements, traced from its functions.

    symbolic: one object for all systems of one structure, as `System.symbolic` gives it; so below.
    """
    with trace.tracing() as table:
        return whole_formulas(symbolic, symbolic.constant_symbols())._replace(table=table)


def whole_formulas(system: Any, constant_symbols: dict[Any, str]) -> Formulas:
    from tcbench.compiler.vector_kernels import can_express

    h = trace.variable("h")
    constants = {h: "b[0]"} | constant_symbols
    z = trace.variables("z", system.size)
    bodies = [*((entries(*x), entries(*y)) for x, y in iterated(system)), _mending(system, z)]
    bodies.insert(0, (list(z), _start(system, z)))
    some = 2 < system.n_elements <= MOST_ELEMENTS
    if some:
        bodies.append((list(z), _conduction_matrix(system, z)))
    values = [[x if isinstance(x, trace.Symbol) else trace.const(float(x)) for x in body[1]] for body in bodies]
    fixed = constant_part([x for row in values for x in row], [h, *(x for body in bodies for x in body[0])])
    places = {x: int(text[2:-1]) for x, text in constants.items()}  # of 'b[3]'; constants that are 0 have no symbol
    places |= {x: system.n_constant_values + i for i, x in enumerate(fixed)}
    known = {x: f"b[{i}]" for x, i in places.items()}
    made = [
        kernel({x: f"a[{i}]" for i, x in enumerate(unknown)} | known, row)
        for (unknown, _), row in zip(bodies, values, strict=True)
    ]
    on_vectors = all(map(can_express, values[1:4]))
    matrix = made.pop() if some else None
    return Formulas(made, matrix, kernel(constants, fixed), places if on_vectors else {}, None)


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


class Given(NamedTuple):
    """Where `iteration` finds what it reads; n positions, e elements.

    The conduction is stiff: a matrix of rank one in N'(U), u v^T x hA. Its block (I - lambda hA)^-1 hA, lambda = v . u,
    stands by columns.
    """

    q: slice
    p: slice
    pi: slice
    s: slice
    block: slice
    u: slice
    v: slice
    scale: slice  # of forces and of entropies in a residual


def given(n: int, e: int, k: int) -> Given:
    ends = np.cumsum([0, n, n, e, e, k * WIDTH, e, e, 2]).tolist()
    return Given(*map(slice, ends[:-1], ends[1:]))


@cache
def iteration(symbolic: System, k: int, level: int) -> str:
    """`step.rates` and `correct` with one of the quadratures, on vectors: LLVM code of kernel(a, b, out).

    a: as `Given` has it.  b: h, constants.  out: U, which is corrected in place, N and V, a row of WIDTH nodes for each
    variable; then the square of the scaled residual / h, NaN if a shape or temperature is not positive.
    """
    known = formulas(symbolic)
    with trace.tracing(known.table):
        return _iteration(symbolic, known.places, k, level)


def _iteration(system: Any, places: dict[Any, int], k: int, level: int) -> str:
    from tcbench.compiler.vector_kernels import Lanes

    n, e, coefficient = system.n_positions, system.n_elements, coefficients(k)
    m, lanes, place = n + e, Lanes(), given(n, e, k)

    def numbers(x: slice) -> list[Any]:
        return [lanes.number(lanes.a, i) for i in range(x.start, x.stop)]

    q0, p0, pi0, s0, u, v, scale = map(numbers, (*place[:4], place.u, place.v, place.scale))
    h = lanes.number(lanes.b, 0)
    U = [[lanes.number(lanes.out, WIDTH * i + l) for l in range(k)] for i in range(m)]
    old = [lanes.row(lanes.out, WIDTH * i) for i in range(m)]
    shared = {x: lanes.number(lanes.b, i) for x, i in places.items()}

    def integrated(start: Any, weights: Any, slopes: Any) -> Any:
        return lanes.add(start, lanes.mul(h, lanes.combine(weights.T, slopes)))

    # nodes: velocities, positions, the rates of the shapes
    at = dict(shared)
    q, w = trace.variables("q", n), trace.variables("v", n)
    per_mass = lanes.graph(at, [1.0 / x for x in system.inertia() * np.ones(n)])
    for i in range(n):
        at[w[i]] = lanes.mul(per_mass[i], integrated(p0[i], coefficient.A, U[i]))
        twice = lanes.mul(h, lanes.combine(coefficient.A_squared.T, U[i]))
        start = lanes.add(lanes.mul(p0[i], lanes.constant(coefficient.nodes)), twice)
        at[q[i]] = lanes.add(q0[i], lanes.mul(h, lanes.mul(per_mass[i], start)))
    pull = system.shape_gradient(q)
    drift = [[lanes.lane(x, l) for l in range(k)] for x in lanes.graph(at, list(pull @ w))]
    # quadrature points: stress and temperature, and their means at the nodes
    pi, s = trace.variables("pi", e), trace.variables("s", e)
    slopes = [x for part in system.element_slopes(pi, s) for x in part]
    Ahat, W, points = coefficient.Ahats[level], coefficient.Ws[level], POINTS[level]
    positive, columns = [], []
    values: list[list[Any]] = [[] for _ in slopes]
    zero, nan = lanes.constant(0.0), lanes.constant(np.nan)
    for first in range(0, points, WIDTH):
        point, rows = dict(shared), Ahat[first : first + WIDTH]
        for i in range(e):
            point[pi[i]] = integrated(pi0[i], rows, drift[i])
            point[s[i]] = integrated(s0[i], rows, U[n + i])
            positive.append(lanes.select(">", point[pi[i]], zero, zero, nan))
        for found, value in zip(values, lanes.graph(point, slopes), strict=True):
            found += [lanes.lane(value, g) for g in range(WIDTH)]
        columns += list(W[:, first : first + WIDTH].T)
    means = [lanes.combine(columns, x) for x in values]
    sigma, theta = trace.variables("sigma", e), trace.variables("theta", e)
    at |= dict(zip([*sigma, *theta], means, strict=True))
    positive += [lanes.select(">", x, zero, zero, nan) for x in means[e:]]
    new = lanes.graph(at, [*(-(sigma @ pull)), *system.conduction(theta)])
    # the correction, with the conduction solved for
    change = [lanes.sub(x, y) for x, y in zip(new, old, strict=True)]
    rho = reduce(lanes.add, [lanes.mul(x, y) for x, y in zip(v, change[n:], strict=True)])
    columns = [lanes.row(lanes.a, place.block.start + WIDTH * l) for l in range(k)]
    stiff = lanes.combine(columns, [lanes.lane(rho, l) for l in range(k)])
    step = [*change[:n], *(lanes.add(x, lanes.mul(y, stiff)) for x, y in zip(change[n:], u, strict=True))]
    scaled = [lanes.mul(x, scale[i >= n]) for i, x in enumerate(change)]
    squares = [lanes.mul(x, x) for x in scaled]
    sizes = [lanes.first(k, x) for x in (reduce(lanes.add, squares[:n]), *squares[n:])]
    for i in range(m):
        lanes.store(lanes.add(old[i], step[i]), WIDTH * i)
        lanes.store(new[i], WIDTH * (m + i))
    for i in range(n):
        lanes.store(at[w[i]], WIDTH * (2 * m + i))
    lanes.store(lanes.largest([*sizes, *positive]), WIDTH * (2 * m + n))
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


def _conduction_matrix(system: Any, z: Any) -> list[Any]:
    """d conduction/ds at a state, by columns."""
    rate = system.vector_field(z)[2 * system.n_positions :]
    return list(trace.jacobian(list(rate), list(system.state(z).s)).T.ravel())


def noise_of(system: Any, z: Any, energy: Any) -> Any:
    """Some rounding errors of each element's heat, of the work that it holds, of the motion, of positions under their
    forces and of the total."""
    state = system.state(z)
    pi, theta, force = system.shape(state.q), system.temperatures(z), system.state(system.vector_field(z)).p
    held = np.sum(abs(system.element_slopes(pi, state.s)[0] * pi))
    placed = np.sum(abs(force * state.q))
    heat = np.sum(theta * system.entropy_scale())
    return 2.0**-51 * (heat + held + state.p @ (state.p / system.inertia()) + placed + abs(energy) + 1.0)


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
    from tcbench.compiler.vector_kernels import Lanes

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
    from tcbench.compiler.vector_kernels import Lanes

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
    from tcbench.compiler.vector_kernels import Lanes

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
    """Addresses of the kernels on vectors; zeros where the system's formulas have no such form."""
    if PLAIN or not formulas(symbolic).places:
        return [0] * (ON_VECTORS + 3)
    from tcbench.compiler.machine import load

    n, e = symbolic.n_positions, symbolic.n_elements
    iterations = [iteration(symbolic, k, level) for level in range(ON_VECTORS)]
    return [*(load(t, str) for t in (*iterations, stiff_block(k))), *sums_on_vectors(k, n, e)]


@cache
def sums_on_vectors(k: int, n: int, e: int) -> list[int]:
    """Addresses of the last two of them, which ask nothing of the system."""
    if PLAIN:
        return [0, 0]
    from tcbench.compiler.machine import load

    return [load(t, str) for t in (extrapolation(k, n + e), closing(k, n, e))]
