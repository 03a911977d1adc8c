"""Kernels on vectors of eight numbers: all nodes, quadrature points or eigenvalues of A side by side.

Positions, which are driven by others, need no iterate of their own, and only variables that act back on themselves are
solved for (`formulas.Formulas`): elimination is written out for the entries of their Jacobian that are not always 0,
without pivoting (see `sparse`). What does not converge so is left to the loops of `step` and the whole Jacobian.
"""

from __future__ import annotations

from functools import cache, reduce
from typing import Any

import numpy as np

from tcbench.compiler import derivatives as trace
from tcbench.compiler.caches import cached
from tcbench.compiler.kernels import WIDTH, Kernel
from tcbench.systems.system import System

from .formulas import Formulas, coefficients, formulas
from .lanes import Lanes
from .memory import ON_VECTORS, POINTS
from .sparse import with_fill

KERNELS = ("to_factor", "to_damp", "to_iterate", "to_iterate_finer", "to_extrapolate", "to_close")
Complex = tuple[Any, Any]


@cached
def vector_kernels(symbolic: System, k: int) -> dict[str, int]:
    """Addresses of the kernels by their names in `memory.Work`; zeros where the formulas have no such form."""
    made = formulas(symbolic)
    if not made.on_vectors:
        return dict.fromkeys(KERNELS, 0)
    at = Factors(made)
    with trace.tracing(made.table):
        kernels = [factors(made, at, k), damping(made, at, k)]
        kernels += [iteration(made, at, k, level) for level in range(ON_VECTORS)]
    kernels += [extrapolation(k, symbolic.size), closing(k, symbolic.size)]
    return {name: made.address for name, made in zip(KERNELS, kernels, strict=True)}


class Factors:
    """Where the factors of the own variables' matrix stand; by columns, real and imaginary parts as vectors."""

    def __init__(self, made: Formulas) -> None:
        self.own, self.size = made.own, len(made.own)
        self.there = with_fill(made.pattern[np.ix_(made.own, made.own)])

    def place(self, i: int, j: int) -> int:
        return 2 * WIDTH * (j * self.size + i)

    def below(self, j: int) -> list[int]:
        return [i for i in range(j + 1, self.size) if self.there[i, j]]

    def above(self, j: int) -> list[int]:
        return [i for i in range(j) if self.there[i, j]]


def times(lanes: Any, x: Complex, y: Complex) -> Complex:
    (a, b), (c, d) = x, y
    return lanes.sub(lanes.mul(a, c), lanes.mul(b, d)), lanes.add(lanes.mul(a, d), lanes.mul(b, c))


def less(lanes: Any, x: Complex, y: Complex) -> Complex:
    return lanes.sub(x[0], y[0]), lanes.sub(x[1], y[1])


def shared(lanes: Any, made: Formulas) -> dict[Any, str]:
    """The text for each constant of the formulas: a number of `b`, the same in all lanes."""
    return {x: lanes.number(lanes.b, i) for x, i in made.places.items()}


def factors(made: Formulas, at: Factors, k: int) -> Kernel:
    """a: what `start` gives; b: h; out: LU factors, with the reciprocals of the pivots, of I - h w J for one eigenvalue
    w of A of each pair and, in one lane more, of I - h J, which damps defects."""
    lanes, known = Lanes(), coefficients(k)
    h, slopes = lanes.number(lanes.b, 0), {key: lanes.number(lanes.a, place) for key, place in made.slopes.items()}
    parts = [lanes.mul(h, lanes.constant([*x, last])) for x, last in ((known.eigen_re, 1.0), (known.eigen_im, 0.0))]
    one, none = lanes.constant(1.0), lanes.constant(0.0)
    entry: dict[tuple[int, int], Complex] = {}
    for i, j in np.argwhere(at.there).tolist():
        real, imag = (one if i == j else none), none
        if (i, j) in slopes:
            real, imag = (
                lanes.sub(x, lanes.mul(part, slopes[i, j])) for x, part in zip((real, imag), parts, strict=True)
            )
        entry[i, j] = real, imag
    for m in range(at.size):
        p, q = entry[m, m]
        scale = lanes.divide(one, lanes.add(lanes.mul(p, p), lanes.mul(q, q)))
        entry[m, m] = lanes.mul(p, scale), lanes.sub(none, lanes.mul(q, scale))
        for i in at.below(m):
            entry[i, m] = times(lanes, entry[i, m], entry[m, m])
            for j in range(m + 1, at.size):
                if at.there[m, j]:
                    entry[i, j] = less(lanes, entry[i, j], times(lanes, entry[i, m], entry[m, j]))
    for (i, j), value in entry.items():
        for part, number in enumerate(value):
            lanes.store(number, at.place(i, j) + part * WIDTH)
    return lanes.kernel()


def damping(made: Formulas, at: Factors, k: int) -> Kernel:
    """A kernel that applies (I - hJ)^-1 to the rows of `out` that belong to own variables, in place. a: the
    factors."""
    lanes, lane = Lanes(), coefficients(k).pairs
    x = [lanes.row(lanes.out, WIDTH * i) for i in at.own]
    for j in range(at.size):
        for i in at.below(j):
            x[i] = lanes.sub(x[i], lanes.mul(lanes.number(lanes.a, at.place(i, j) + lane), x[j]))
    for j in reversed(range(at.size)):
        x[j] = lanes.mul(lanes.number(lanes.a, at.place(j, j) + lane), x[j])
        for i in at.above(j):
            x[i] = lanes.sub(x[i], lanes.mul(lanes.number(lanes.a, at.place(i, j) + lane), x[j]))
    for i, value in zip(at.own, x, strict=True):
        lanes.store(value, WIDTH * i)
    return lanes.kernel()


def solved(lanes: Any, at: Factors, first: int, x: list[Complex]) -> list[Complex]:
    """The solution of (I - h w J) x = what x is now, for all eigenvalues w at once. The factors stand in `a` from
    `first` on."""

    def factor(i: int, j: int) -> Complex:
        place = first + at.place(i, j)
        return lanes.row(lanes.a, place), lanes.row(lanes.a, place + WIDTH)

    for j in range(at.size):
        for i in at.below(j):
            x[i] = less(lanes, x[i], times(lanes, factor(i, j), x[j]))
    for j in reversed(range(at.size)):
        x[j] = times(lanes, factor(j, j), x[j])
        for i in at.above(j):
            x[i] = less(lanes, x[i], times(lanes, factor(i, j), x[j]))
    return x


def integrated(lanes: Any, h: Any, start: Any, weights: Any, rates: Any) -> Any:
    return lanes.add(start, lanes.mul(h, lanes.combine(weights.T, rates)))


def projected(lanes: Any, k: int, level: int, here: Any, carried: Any, slopes: list[Any]) -> list[Any]:
    """The projections of the slopes at the nodes.

    here: what stands for constants; carried: the variables of the slopes with their starts and their rates at nodes.
    """
    known, h, columns = coefficients(k), lanes.number(lanes.b, 0), []
    values: list[list[Any]] = [[] for _ in slopes]
    for first in range(0, POINTS[level] if slopes else 0, WIDTH):
        rows = known.Ahats[level, first : first + WIDTH]
        at_points = {x: integrated(lanes, h, start, rows, rates) for x, start, rates in carried}
        for found, value in zip(values, lanes.graph(here | at_points, slopes), strict=True):
            found += [lanes.lane(value, g) for g in range(WIDTH)]
        columns += list(known.Ws[level, :, first : first + WIDTH].T)
    return [lanes.combine(columns, x) for x in values]


def iteration(made: Formulas, at: Factors, k: int, level: int) -> Kernel:
    """`step.rates` and `corrected` with one of the quadratures.

    a: z, weights of a residual, what is carried of z, the factors; b: h, constants; out: U, which is corrected in
    place, N, a row of WIDTH nodes for each variable; then the weighed size of the correction, NaN if it is.
    """
    lanes, known, size = Lanes(), coefficients(k), len(made.pattern)
    _, (inputs, motion), (y, slopes), (all_inputs, rates), _ = made.bodies
    rest = [i for i in range(size) if i not in made.driven]

    def numbers(pointer: Any, first: int, count: int) -> list[Any]:
        return [lanes.number(pointer, first + i) for i in range(count)]

    z, weights, y0 = numbers(lanes.a, 0, size), numbers(lanes.a, size, size), numbers(lanes.a, 2 * size, len(y))
    h, here = lanes.number(lanes.b, 0), shared(lanes, made)
    old = {i: lanes.row(lanes.out, WIDTH * i) for i in rest}
    K, node = inputs[:size], inputs[size:]
    now = here | {K[i]: x for i, x in old.items()}
    now |= {node[i]: integrated(lanes, h, z[i], known.A, numbers(lanes.out, WIDTH * i, k)) for i in rest}
    moved = dict(zip(made.driven, lanes.graph(now, [rates[i] for i in made.driven]), strict=True))
    for i, x in moved.items():
        now[K[i]] = x
        now[node[i]] = integrated(lanes, h, z[i], known.A, [lanes.lane(x, l) for l in range(k)])
    drift = [[lanes.lane(x, l) for l in range(k)] for x in lanes.graph(now, motion)]
    means = projected(lanes, k, level, here, list(zip(y, y0, drift, strict=True)), slopes)
    now |= dict(zip(all_inputs[2 * size :], means, strict=True))
    new = dict(zip(rest, lanes.graph(now, [rates[i] for i in rest]), strict=True))
    change = {i: lanes.sub(new[i], old[i]) for i in rest}
    parts: list[Any] = []
    for i in made.own:
        by_node = [lanes.lane(change[i], l) for l in range(k)]
        parts.append(tuple(lanes.combine(into.T, by_node) for into in (known.into_re, known.into_im)))
    back = [*known.back_re.T, *(-known.back_im.T)]
    for i, part in zip(made.own, solved(lanes, at, 2 * size + len(y), parts), strict=True):
        change[i] = lanes.combine(back, [lanes.lane(x, j) for x in part for j in range(known.pairs)])
    sizes = [lanes.first(k, lanes.mul(weights[i], lanes.size(x))) for i, x in change.items()]
    for i in rest:
        lanes.store(lanes.add(old[i], change[i]) if i in made.own else new[i], WIDTH * i)
    for i, x in (new | moved).items():
        lanes.store(x, WIDTH * (size + i))
    for i, x in moved.items():
        lanes.store(x, WIDTH * i)
    lanes.store_number(lanes.largest(sizes or [lanes.constant(0.0)]), 2 * WIDTH * size)
    return lanes.kernel()


@cache
def extrapolation(k: int, m: int) -> Kernel:
    """`step.extrapolate`. a: this step over the last; out: U, N, of m variables each."""
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
    return lanes.kernel()


@cache
def closing(k: int, m: int) -> Kernel:
    """The end of a step: sums over the nodes. a: N; b: h; out: dz, then N at 0 and N at 1, of m variables each."""
    lanes, coefficient = Lanes(), coefficients(k)
    rows = [lanes.first(k, lanes.row(lanes.a, WIDTH * i)) for i in range(m)]
    pad = [0.0] * (WIDTH - k)
    b = lanes.mul(lanes.number(lanes.b, 0), lanes.constant([*coefficient.b, *pad]))
    sides = [lanes.constant([*side, *pad]) for side in (coefficient.at_start, coefficient.at_end)]
    for i, value in enumerate(lanes.mul(side, x) for side in (b, *sides) for x in rows):
        lanes.store_number(lanes.sum(value), i)
    return lanes.kernel()
