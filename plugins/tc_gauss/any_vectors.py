"""The iteration of `step` on vectors: all nodes, all points of a quadrature, all eigenvalues of A side by side.

Two kernels. One inverts the matrix of a correction, of a block of few: I - h z J for one eigenvalue z of
each pair and, in one lane more, I - h J, which damps defects; written out for the entries of J that are not always 0,
without pivoting, as `stiffness` has it. The other is an iteration, which multiplies by that.
"""

from __future__ import annotations

from functools import reduce
from typing import Any

import numpy as np

from tcbench.compiler import derivatives as trace
from tcbench.compiler.kernels import WIDTH
from tcbench.compiler.language import PLAIN
from tcbench.compiler.once import once
from tcbench.systems.system import System

from .formulas import coefficients, integrated, projected

MOST = 8  # variables of the block: their matrix, written out, grows as the square
MOST_OPERATIONS = 6000  # in the formulas: the code of more takes seconds to compile
ITERATIONS = ("to_iterate", "to_iterate_finer")


@once
def vector_kernels(symbolic: System, k: int) -> dict[str, int]:
    """Addresses of the kernels by their names in `memory.Work`; zeros where the formulas have no such form."""
    from tcbench.compiler.vector_kernels import can_express

    from .any_system import any_formulas

    made, _ = any_formulas(symbolic)
    found = dict.fromkeys(["to_factor", *ITERATIONS], 0)
    values = [x for _, row in made.bodies[1:5] for x in row]
    if PLAIN or not can_express(values) or len(trace.topological(values)) > MOST_OPERATIONS:
        return found
    from tcbench.compiler.machine import load

    with trace.tracing(made.table):
        if 0 < made.n_block <= MOST:
            found["to_factor"] = load(inverse(made.patterns[0], k), str)
        for level, name in enumerate(ITERATIONS):
            found[name] = load(iteration(made, k, level, found["to_factor"] != 0), str)
    return found


Complex = tuple[Any, Any]


def times(lanes: Any, x: Complex, y: Complex) -> Complex:
    (a, b), (c, d) = x, y
    return lanes.sub(lanes.mul(a, c), lanes.mul(b, d)), lanes.add(lanes.mul(a, d), lanes.mul(b, c))


def less(lanes: Any, x: Complex, y: Complex) -> Complex:
    return lanes.sub(x[0], y[0]), lanes.sub(x[1], y[1])


def inverse(pattern: Any, k: int) -> str:
    """a: -J, its entries as `Formulas` has them; b: h; out: (I - hA x J)^-1, of each pair of variables by columns of
    WIDTH nodes, then (I - hJ)^-1."""
    from tcbench.compiler.vector_kernels import Lanes

    lanes, known, size = Lanes(), coefficients(k), len(pattern)
    h, none = lanes.number(lanes.b, 0), (lanes.constant(0.0), lanes.constant(0.0))
    hz = tuple(lanes.mul(h, lanes.constant([*x, last])) for x, last in ((known.eigen_re, 1.0), (known.eigen_im, 0.0)))
    entries = {key: lanes.number(lanes.a, i) for i, key in enumerate(zip(*np.nonzero(pattern), strict=True))}
    damped, at = WIDTH * size * size * k, [(i, j) for i in range(size) for j in range(size)]
    if size == 2:  # f + g times the adjugate of -J, which asks for two inversions less, and half the columns
        (f, g), adjugate = of_two(lanes, hz, entries)
        of_f, of_g = columns(lanes, k, f), columns(lanes, k, g)
        for place, (i, j) in enumerate(at):
            for l in range(k):
                value = lanes.mul(of_g[l], adjugate[i, j])
                lanes.store(lanes.add(of_f[l], value) if i == j else value, WIDTH * (place * k + l))
            value = lanes.mul(g[0], adjugate[i, j])
            lanes.store(lanes.one(lanes.add(f[0], value) if i == j else value, known.pairs), damped + place)
        return lanes.text()
    rows = by_elimination(lanes, hz, entries, size)
    for place, (i, j) in enumerate(at):
        found = rows[i].get(size + j, none)
        for l, column in enumerate(columns(lanes, k, found)):
            lanes.store(column, WIDTH * (place * k + l))
        lanes.store(lanes.one(found[0], known.pairs), damped + place)
    return lanes.text()


def reciprocal(lanes: Any, x: Complex) -> Complex:
    p, q = x
    scale = lanes.divide(lanes.constant(1.0), lanes.add(lanes.mul(p, p), lanes.mul(q, q)))
    return lanes.mul(p, scale), lanes.mul(q, lanes.sub(lanes.constant(0.0), scale))


def of_two(lanes: Any, hz: Complex, entries: Any) -> tuple[tuple[Complex, Complex], dict[tuple[int, int], Any]]:
    """(f, g) and the adjugate with (I - hzJ)^-1 = f + g adjugate(-J), of two variables."""
    zero = lanes.constant(0.0)
    a, b, c, d = (entries.get((i, j), zero) for i in range(2) for j in range(2))
    minor = lanes.sub(lanes.mul(a, d), lanes.mul(b, c))
    whole = times(lanes, hz, (lanes.add(lanes.add(a, d), lanes.mul(hz[0], minor)), lanes.mul(hz[1], minor)))
    f = reciprocal(lanes, (lanes.add(lanes.constant(1.0), whole[0]), whole[1]))
    adjugate = {(0, 0): d, (0, 1): lanes.sub(zero, b), (1, 0): lanes.sub(zero, c), (1, 1): a}
    return (f, times(lanes, f, hz)), adjugate


def by_elimination(lanes: Any, hz: Complex, entries: Any, size: int) -> list[dict[int, Complex]]:
    """Each row of I - hzJ, and beside it that of I, by Gauss and Jordan: the latter are what is left."""
    one, none = lanes.constant(1.0), lanes.constant(0.0)
    rows: list[dict[int, Complex]] = [{i: (one, none), size + i: (one, none)} for i in range(size)]
    for (i, j), entry in entries.items():
        real, imag = (lanes.mul(x, entry) for x in hz)
        rows[i][j] = lanes.add(one, real) if i == j else real, imag
    for m, pivot in enumerate(rows):
        found = reciprocal(lanes, pivot.pop(m))
        rows[m] = pivot = {j: times(lanes, x, found) for j, x in pivot.items()}
        for row in (row for i, row in enumerate(rows) if i != m and m in row):
            factor = row.pop(m)
            for j, x in pivot.items():
                row[j] = less(lanes, row.get(j, (none, none)), times(lanes, factor, x))
    return rows


def columns(lanes: Any, k: int, found: Complex) -> list[Any]:
    """Of the real matrix with these values for the eigenvectors of A."""
    known, pad = coefficients(k), [0.0] * (WIDTH - k)
    split = [lanes.lane(x, j) for x in found for j in range(known.pairs)]
    back, into = known.back_re + 1j * known.back_im, known.into_re + 1j * known.into_im
    parts = [back * into[:, l] for l in range(k)]
    return [lanes.combine([[*x, *pad] for x in (*part.real.T, *(-part.imag.T))], split) for part in parts]


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
    row of WIDTH nodes for each; then the squares of the weighed sizes of the correction and of N - U, NaN if they are.
    """
    from tcbench.compiler.vector_kernels import Lanes

    lanes, known = Lanes(), coefficients(k)
    _, (_, motion), (y, slopes), (inputs, rates), (_, moving), *_ = made.bodies
    size, n, block = len(made.order), made.n, made.n_block
    m = size - n
    begun = (WIDTH * k + 1) * block * block if with_matrix else 0
    start = begun + size

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
    undamped = list(step)
    if with_matrix:
        change = [[lanes.lane(x, l) for l in range(k)] for x in step[m - block :]]
        for i in range(block):
            first = WIDTH * k * block * i
            rows = [[lanes.row(lanes.a, first + WIDTH * (k * j + l)) for l in range(k)] for j in range(block)]
            step[m - block + i] = reduce(lanes.add, map(lanes.combine, rows, change))
    sizes = [largest(lanes, k, made.groups, weights, x) for x in (step, undamped)]
    for i in range(m):
        lanes.store(lanes.add(old[i], step[i]), WIDTH * i)
        lanes.store(new[i], WIDTH * (m + i))
    for i in range(n):
        lanes.store(moved[i], WIDTH * (2 * m + i))
    for i, size in enumerate(sizes):
        lanes.store(size, WIDTH * (2 * m + n) + i)
    return lanes.text()


def largest(lanes: Any, k: int, groups: list[int], weights: list[Any], changes: list[Any]) -> Any:
    """The largest square of an array's change at a node."""
    scaled: dict[int, list[Any]] = {}
    for group, x, y in zip(groups, weights, changes, strict=True):
        scaled.setdefault(group, []).append(lanes.mul(x, y))
    squares = [reduce(lanes.add, [lanes.mul(x, x) for x in part]) for part in scaled.values()]
    return lanes.largest([lanes.first(k, x) for x in squares])
