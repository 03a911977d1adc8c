"""What a step of consistent collocation computes: the numbers of the method, a system's formulas, and sums on vectors.

See `any_system` for the equations. The kernels on vectors treat all nodes, or eight quadrature points, at once.
"""

from __future__ import annotations

from functools import cache, reduce
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcbench.compiler import derivatives as trace
from tcbench.compiler.kernels import WIDTH, Kernel, constant_part, kernel
from tcbench.compiler.language import PLAIN
from tcbench.reference.collocation import gauss_nodes, tableau
from tcbench.reference.precision import LONG

from .memory import POINTS, Numbers

ON_VECTORS = 2  # of them: steps that need more are too long for the iteration
Floats = NDArray[np.float64]


@cache
def coefficients(k: int) -> Numbers:
    """The numbers of k-stage Gauss collocation with projection; computed in extended precision, rounded once."""
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
    complexes = {"eigen": eigen, "into": into, "back": back}
    parts = {f"{name}_re": np.ascontiguousarray(x.real) for name, x in complexes.items()}
    parts |= {f"{name}_im": np.ascontiguousarray(x.imag) for name, x in complexes.items()}
    return Numbers(
        k=k, pairs=len(eigen), largest=abs(eigen).max(), nodes=nodes.astype(float), at_start=zero, at_end=one,
        barycentric=barycentric.astype(float), A=method.A.astype(float),
        b=b.astype(float), Ahats=Ahats, Ws=Ws, **parts,
    )  # fmt: skip


def eigenvectors(A: Floats) -> tuple[Any, Any, Any]:
    """(z, Y, X), one of each pair of conjugates: A x = sum over them of the real part of X z (Y x), x real."""
    z, X = np.linalg.eig(A)
    Y = np.linalg.inv(X)
    kept = np.flatnonzero(z.imag >= 0.0)
    return z[kept], Y[kept], X[:, kept] * np.where(z[kept].imag > 0.0, 2.0, 1.0)


class Formulas(NamedTuple):
    """What a step computes with a system's functions; see `any_system`."""

    kernels: list[Kernel]
    setup: Kernel  # for what depends on the constants only
    places: dict[Any, int]  # where the constants stand, and behind them its results
    bodies: list[tuple[list[Any], list[Any]]]  # inputs and values of the kernels
    patterns: list[Any]  # which entries each matrix has, (n, n)
    table: Any  # of the trace, for those that go on from it
    order: list[int]  # of the variables of a state: positions, others, last the block
    n: int  # how many are positions,
    n_block: int  # and how many the block
    groups: list[int]  # of which array of the state each but a position is: sizes are those of arrays, however turned

    @classmethod
    def of(
        cls,
        system: Any,
        bodies: list[Any],
        table: Any,
        fixed: Any,
        patterns: Any,
        split: tuple[list[int], int, int, list[int]],
    ) -> Formulas:
        """Of a structure, from inputs and values. fixed: results of `setup` that stand before those of these; split:
        the last four."""
        bodies = [(inputs, list(map(trace.lifted, values))) for inputs, values in bodies]
        hoisted = constant_part([x for _, row in bodies for x in row], [x for inputs, _ in bodies for x in inputs])
        constants, first = system.constant_symbols(), system.n_constant_values + len(fixed)
        known = constants | {x: f"b[{first + i}]" for i, x in enumerate(hoisted)}
        made = [kernel({x: f"a[{i}]" for i, x in enumerate(inputs)} | known, row) for inputs, row in bodies]
        places = {x: int(text[2:-1]) for x, text in known.items()}  # of 'b[3]'
        setup = kernel(constants, [*fixed, *hoisted])
        return cls(made, setup, places, bodies, patterns, table, *split)


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


def closing(k: int, n: int, m: int, order: Any) -> str:
    """The end of a step: sums over the nodes. a: N, V; b: h; out: dz, in the order of a state, then N at 0 and at 1."""
    from tcbench.compiler.vector_kernels import Lanes

    lanes, coefficient = Lanes(), coefficients(k)
    rows = [lanes.first(k, lanes.row(lanes.a, WIDTH * i)) for i in range(m + n)]
    h = lanes.number(lanes.b, 0)
    pad = [0.0] * (WIDTH - k)
    b = lanes.mul(h, lanes.constant([*coefficient.b, *pad]))
    sides = [lanes.constant([*side, *pad]) for side in (coefficient.at_start, coefficient.at_end)]
    for i, row in zip(order, [*rows[m:], *rows[:m]], strict=True):
        lanes.store(lanes.sum(lanes.mul(b, row)), i)
    for i, value in enumerate([lanes.mul(side, x) for side in sides for x in rows[:m]]):
        lanes.store(lanes.sum(value), n + m + i)
    return lanes.text()


@cache
def sums_on_vectors(k: int, order: tuple[int, ...], n: int) -> list[int]:
    """Addresses of the last two of them, which ask nothing of the system but how its state is ordered."""
    if PLAIN:
        return [0, 0]
    from tcbench.compiler.machine import load

    m = len(order) - n
    return [load(t, str) for t in (extrapolation(k, m), closing(k, n, m, order))]
