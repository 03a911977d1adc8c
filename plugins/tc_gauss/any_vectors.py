"""The iteration of `step` on vectors: all nodes, all points of a quadrature, all eigenvalues of A side by side.

Three kernels. One takes the matrix of a correction apart: LU factors of I - h z J for one eigenvalue z of each pair
and, in one lane more, of I - h J, which damps defects; written out for the entries of J that are not always 0, without
pivoting, as `stiffness` has it. Of one or two variables, as of two springs that conduct, it is the inverse. Another is
an iteration with that, and the third the defect at both ends.
"""

from __future__ import annotations

from functools import partial, reduce
from typing import Any

import numpy as np

from tcbench.compiler import derivatives as trace
from tcbench.compiler.kernels import WIDTH
from tcbench.compiler.language import PLAIN
from tcbench.compiler.once import once
from tcbench.systems.system import System

from .formulas import coefficients, integrated, projected
from .sparse import with_fill

MOST = 16  # variables of the block: the code of more takes seconds to compile
WRITTEN_OUT = 2  # up to so many it is an inverse, for all nodes; factors take fewer operations, but one after another
MOST_OPERATIONS = 6000  # in the formulas: the code of more takes seconds to compile
ITERATIONS = ("to_iterate", "to_iterate_finer")


@once
def vector_kernels(symbolic: System, k: int) -> dict[str, int]:
    """Addresses of the kernels by their names in `memory.Work`; zeros where the formulas have no such form."""
    from tcbench.compiler.vector_kernels import can_express

    from .any_system import any_formulas

    made, _ = any_formulas(symbolic)
    found = dict.fromkeys(["to_factor", "to_defect", *ITERATIONS], 0)
    values = [x for _, row in made.bodies[1:5] for x in row]
    if PLAIN or not can_express(values) or len(trace.topological(values)) > MOST_OPERATIONS:
        return found
    from tcbench.compiler.machine import load

    with trace.tracing(made.table):
        if 0 < made.n_block <= MOST:
            written = inverse if made.n_block <= WRITTEN_OUT else factors
            found["to_factor"] = load(written(made.patterns[0], k), str)
            found["to_defect"] = load(defect(made, k), str)
        for level, name in enumerate(ITERATIONS):
            found[name] = load(iteration(made, k, level, found["to_factor"] != 0), str)
    return found


Complex = tuple[Any, Any]


def times(lanes: Any, x: Complex, y: Complex) -> Complex:
    (a, b), (c, d) = x, y
    return lanes.sub(lanes.mul(a, c), lanes.mul(b, d)), lanes.add(lanes.mul(a, d), lanes.mul(b, c))


def less(lanes: Any, x: Complex, y: Complex) -> Complex:
    return lanes.sub(x[0], y[0]), lanes.sub(x[1], y[1])


class Factors:
    """Where the factors of a matrix with such entries stand; by columns, real and imaginary parts as vectors."""

    def __init__(self, pattern: Any) -> None:
        self.size, self.there = len(pattern), with_fill(pattern)

    def place(self, i: int, j: int) -> int:
        return 2 * WIDTH * (j * self.size + i)

    def below(self, j: int) -> list[int]:
        return [i for i in range(j + 1, self.size) if self.there[i, j]]

    def above(self, j: int) -> list[int]:
        return [i for i in range(j) if self.there[i, j]]


def shifted(lanes: Any, pattern: Any, k: int) -> tuple[Complex, dict[tuple[int, int], Any]]:
    """h times the eigenvalues of A, one of each pair, and h itself in one lane more; and the entries of -J."""
    known, h = coefficients(k), lanes.number(lanes.b, 0)
    hz = tuple(lanes.mul(h, lanes.constant([*x, last])) for x, last in ((known.eigen_re, 1.0), (known.eigen_im, 0.0)))
    return hz, {key: lanes.number(lanes.a, i) for i, key in enumerate(zip(*np.nonzero(pattern), strict=True))}


def factors(pattern: Any, k: int) -> str:
    """a: -J, its entries as `Formulas` has them; b: h; out: the factors, with the reciprocals of the pivots."""
    from tcbench.compiler.vector_kernels import Lanes

    lanes, at = Lanes(), Factors(pattern)
    hz, values = shifted(lanes, pattern, k)
    one, none = lanes.constant(1.0), lanes.constant(0.0)
    entry: dict[tuple[int, int], Complex] = {}
    for i, j in np.argwhere(at.there).tolist():
        real, imag = (lanes.mul(x, values[i, j]) for x in hz) if pattern[i, j] else (none, none)
        entry[i, j] = lanes.add(one, real) if i == j else real, imag
    for m in range(at.size):
        entry[m, m] = reciprocal(lanes, entry[m, m])
        for i in at.below(m):
            entry[i, m] = times(lanes, entry[i, m], entry[m, m])
            for j in range(m + 1, at.size):
                if at.there[m, j]:
                    entry[i, j] = less(lanes, entry[i, j], times(lanes, entry[i, m], entry[m, j]))
    for (i, j), value in entry.items():
        for part, number in enumerate(value):
            lanes.store(number, at.place(i, j) + part * WIDTH)
    return lanes.text()


def solved(at: Factors, x: list[Any], factor: Any, product: Any, difference: Any) -> list[Any]:
    """By the factors, `factor(i, j)`, with this arithmetic."""
    for j in range(at.size):
        for i in at.below(j):
            x[i] = difference(x[i], product(factor(i, j), x[j]))
    for j in reversed(range(at.size)):
        x[j] = product(factor(j, j), x[j])
        for i in at.above(j):
            x[i] = difference(x[i], product(factor(i, j), x[j]))
    return x


def inverse(pattern: Any, k: int) -> str:
    """Of one or two variables, a: -J; b: h; out: (I - hA x J)^-1, of each pair of variables by columns of WIDTH nodes,
    then (I - hJ)^-1."""
    from tcbench.compiler.vector_kernels import Lanes

    lanes, size = Lanes(), len(pattern)
    hz, entries = shifted(lanes, pattern, k)
    damped, lane = WIDTH * size * size * k, coefficients(k).pairs
    # f + g times the adjugate of -J, which asks for two inversions less, and half the columns
    (f, g), adjugate = of_two(lanes, hz, entries)
    of_f, of_g = columns(lanes, k, f), columns(lanes, k, g)
    for place, (i, j) in enumerate(np.ndindex(size, size)):
        for l in range(k):
            value = lanes.mul(of_g[l], adjugate[i, j])
            lanes.store(lanes.add(of_f[l], value) if i == j else value, WIDTH * (place * k + l))
        value = lanes.mul(g[0], adjugate[i, j])
        lanes.store(lanes.one(lanes.add(f[0], value) if i == j else value, lane), damped + place)
    return lanes.text()


def reciprocal(lanes: Any, x: Complex) -> Complex:
    p, q = x
    scale = lanes.divide(lanes.constant(1.0), lanes.add(lanes.mul(p, p), lanes.mul(q, q)))
    return lanes.mul(p, scale), lanes.mul(q, lanes.sub(lanes.constant(0.0), scale))


def of_two(lanes: Any, hz: Complex, entries: Any) -> tuple[tuple[Complex, Complex], dict[tuple[int, int], Any]]:
    """(f, g) and the adjugate with (I - hzJ)^-1 = f + g adjugate(-J), of two variables; of one the other is 0."""
    zero = lanes.constant(0.0)
    a, b, c, d = (entries.get((i, j), zero) for i in range(2) for j in range(2))
    minor = lanes.sub(lanes.mul(a, d), lanes.mul(b, c))
    whole = times(lanes, hz, (lanes.add(lanes.add(a, d), lanes.mul(hz[0], minor)), lanes.mul(hz[1], minor)))
    f = reciprocal(lanes, (lanes.add(lanes.constant(1.0), whole[0]), whole[1]))
    adjugate = {(0, 0): d, (0, 1): lanes.sub(zero, b), (1, 0): lanes.sub(zero, c), (1, 1): a}
    return (f, times(lanes, f, hz)), adjugate


def columns(lanes: Any, k: int, found: Complex) -> list[Any]:
    """Of the real matrix with these values for the eigenvectors of A."""
    known, pad = coefficients(k), [0.0] * (WIDTH - k)
    split = [lanes.lane(x, j) for x in found for j in range(known.pairs)]
    back, into = known.back_re + 1j * known.back_im, known.into_re + 1j * known.into_im
    parts = [back * into[:, l] for l in range(k)]
    return [lanes.combine([[*x, *pad] for x in (*part.real.T, *(-part.imag.T))], split) for part in parts]


def corrections(lanes: Any, pattern: Any, k: int, change: list[list[Any]]) -> list[Any]:
    """(I - hA x J)^-1 of what N and U differ by, its lanes by variables; what that is made of stands first in `a`."""
    known, size = coefficients(k), len(pattern)
    if size <= WRITTEN_OUT:
        rows = [[lanes.row(lanes.a, WIDTH * (k * size * i + l)) for l in range(k * size)] for i in range(size)]
        each = [[row[k * j : k * (j + 1)] for j in range(size)] for row in rows]
        return [reduce(lanes.add, map(lanes.combine, row, change)) for row in each]
    at = Factors(pattern)
    parts = [tuple(lanes.combine(into.T, x) for into in (known.into_re, known.into_im)) for x in change]

    def factor(i: int, j: int) -> Complex:
        return lanes.row(lanes.a, at.place(i, j)), lanes.row(lanes.a, at.place(i, j) + WIDTH)

    found = solved(at, parts, factor, partial(times, lanes), partial(less, lanes))
    back = [*known.back_re.T, *(-known.back_im.T)]
    return [lanes.combine(back, [lanes.lane(x, j) for x in part for j in range(known.pairs)]) for part in found]


def damped(lanes: Any, pattern: Any, k: int, defects: list[Any]) -> list[Any]:
    """(I - hJ)^-1 of them, by the same."""
    size, lane = len(pattern), coefficients(k).pairs
    if size <= WRITTEN_OUT:
        first = WIDTH * k * size * size
        rows = [[lanes.number(lanes.a, first + size * i + j) for j in range(size)] for i in range(size)]
        return [lanes.combine(row, defects) for row in rows]
    at = Factors(pattern)
    return solved(at, defects, lambda i, j: lanes.number(lanes.a, at.place(i, j) + lane), lanes.mul, lanes.sub)


def room(size: int, k: int) -> int:
    """Numbers that `inverse` or `factors` give."""
    return (WIDTH * k + 1) * size * size if size <= WRITTEN_OUT else 2 * WIDTH * size * size


def positions(lanes: Any, made: Any, k: int, shared: Any, z: list[Any], U: list[Any], split: list[Any]) -> list[Any]:
    """At the nodes. Where their rates are linear they are integrated twice from U, beside these and not after them."""
    (inputs, moving), known, n, h = made.bodies[4], coefficients(k), made.n, lanes.number(lanes.b, 0)
    others = inputs[len(z) + n :]
    start = lanes.graph(shared | dict(zip(others, z[n:], strict=True)), moving)
    found = []
    for i, row in enumerate(trace.sparse_jacobian(moving, others)):
        if set(others).intersection(trace.topological(list(row.values()))):
            found.append(integrated(lanes, h, z[i], known.A, split[i]))
            continue
        mean = lanes.mul(start[i], lanes.constant(known.nodes))
        for j, slope in zip(row, lanes.graph(dict(shared), list(row.values())), strict=True):
            twice = lanes.combine((known.A @ known.A).T, U[j])
            mean = lanes.add(mean, lanes.mul(lanes.mul(h, slope), twice))
        found.append(lanes.add(z[i], lanes.mul(h, mean)))
    return found


def iteration(made: Any, k: int, level: int, with_matrix: bool) -> str:
    """`step.rates` and `step.corrected` with one of the quadratures.

    a: as `memory.Work.vectors` has it; b: h, constants; out: U, which is corrected in place, N, rates of positions, a
    row of WIDTH nodes for each; then the square of the weighed size of the correction, or of a share of N - U where
    that is larger; NaN if any is.
    """
    from tcbench.compiler.vector_kernels import Lanes

    lanes, known = Lanes(), coefficients(k)
    _, (_, motion), (y, slopes), (inputs, rates), (_, moving), *_ = made.bodies
    size, n, block = len(made.order), made.n, made.n_block
    m = size - n
    begun = room(block, k) if with_matrix else 0
    start = begun + size
    share = lanes.number(lanes.a, start + len(made.bodies[0][1]))

    def numbers(pointer: Any, first: int, count: int) -> list[Any]:
        return [lanes.number(pointer, first + i) for i in range(count)]

    z, weights = numbers(lanes.a, begun, size), numbers(lanes.a, start + m, m)
    y0 = numbers(lanes.a, start + 2 * m + 2, len(y))
    z = [z[i] for i in made.order]
    h, shared = lanes.number(lanes.b, 0), {x: lanes.number(lanes.b, i) for x, i in made.places.items()}
    old, U = [lanes.row(lanes.out, WIDTH * i) for i in range(m)], [numbers(lanes.out, WIDTH * i, k) for i in range(m)]
    K, at_nodes = inputs[:size], inputs[size : 2 * size]
    at = shared | dict(zip(K[n:], old, strict=True))
    at |= {x: integrated(lanes, h, z[n + i], known.A, U[i]) for i, x in enumerate(at_nodes[n:])}
    moved = lanes.graph(at, moving)
    at |= dict(zip(K[:n], moved, strict=True))
    split = [[lanes.lane(x, l) for l in range(k)] for x in moved]
    at |= dict(zip(at_nodes[:n], positions(lanes, made, k, shared, z, U, split), strict=True))
    by_rate = dict(zip(K, [*split, *U], strict=True))
    drift = [
        by_rate.get(f) or [lanes.lane(x, l) for l in range(k)]
        for f, x in zip(motion, lanes.graph(at, motion), strict=True)
    ]
    means, _ = projected(lanes, k, level, shared, list(zip(y, y0, drift, strict=True)), slopes)
    at |= dict(zip(inputs[2 * size :], means, strict=True))
    new = lanes.graph(at, rates)
    step = [lanes.sub(x, y) for x, y in zip(new, old, strict=True)]
    sizes: list[Any] = []
    if with_matrix:
        some = [i for i in range(m) if made.groups[i] in made.groups[m - block :]]
        sizes = squares(lanes, made.groups, {i: lanes.mul(lanes.mul(share, step[i]), weights[i]) for i in some})
        change = [[lanes.lane(x, l) for l in range(k)] for x in step[m - block :]]
        step[m - block :] = corrections(lanes, made.patterns[0], k, change)
    sizes += squares(lanes, made.groups, {i: lanes.mul(x, weights[i]) for i, x in enumerate(step)})
    for i in range(m):
        lanes.store(lanes.add(old[i], step[i]), WIDTH * i)
        lanes.store(new[i], WIDTH * (m + i))
    for i in range(n):
        lanes.store(moved[i], WIDTH * (2 * m + i))
    lanes.store(lanes.largest([lanes.first(k, x) for x in sizes]), WIDTH * (2 * m + n))
    return lanes.text()


def squares(lanes: Any, groups: list[int], weighed: dict[int, Any]) -> list[Any]:
    """Of the sizes of arrays, of which these are entries."""
    found: dict[int, Any] = {}
    for i, x in weighed.items():
        square = lanes.mul(x, x)
        found[groups[i]] = lanes.add(found[groups[i]], square) if groups[i] in found else square
    return list(found.values())


def defect(made: Any, k: int) -> str:
    """`march.largest_defect` at both ends, side by side. a: as `memory.Work.vectors` has it; b: what the first kernel
    gives at the end; out: `memory.Work.sums`, of which the last is written."""
    from tcbench.compiler.vector_kernels import Lanes

    lanes, size, block = Lanes(), len(made.order), made.n_block
    m, start = size - made.n, room(block, k) + size
    sides = [lanes.constant([float(i == j) for i in range(WIDTH)]) for j in range(2)]
    known = [[lanes.number(lanes.a, start + i), lanes.number(lanes.b, i)] for i in range(m)]
    given = [[lanes.number(lanes.out, size + i), lanes.number(lanes.out, size + m + i)] for i in range(m)]
    missed = [lanes.combine(sides, list(map(lanes.sub, *x))) for x in zip(given, known, strict=True)]
    missed[m - block :] = damped(lanes, made.patterns[0], k, missed[m - block :])
    weighed = {i: lanes.mul(x, lanes.number(lanes.a, start + m + i)) for i, x in enumerate(missed)}
    lanes.store(lanes.largest(squares(lanes, made.groups, weighed)), size + 2 * m)
    return lanes.text()
