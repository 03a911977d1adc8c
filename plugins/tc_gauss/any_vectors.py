"""The iteration of any_system.py on vectors of eight: all nodes, quadrature points or eigenvalues of A side by side.

Three kernels: LU factors of I - h z J for one eigenvalue z of each pair and, in one lane more, of I - h J, which damps
defects; an iteration of simplified Newton with them; and the damping. Elimination is written out for the entries of J
that are not always 0, without pivoting, as `conduction` has it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tcbench.compiler import derivatives as trace
from tcbench.compiler.kernels import WIDTH
from tcbench.compiler.language import PLAIN
from tcbench.compiler.machine import load
from tcbench.compiler.once import once
from tcbench.compiler.vector_kernels import Lanes, can_express
from tcbench.systems.system import System

from .any_system import any_formulas
from .formulas import ON_VECTORS, coefficients, integrated, projected
from .sparse import with_fill

MOST = 16  # variables: the code of more takes seconds to compile
KERNELS = ("to_factor", "to_damp", "to_iterate", "to_iterate_finer")
Complex = tuple[Any, Any]


@once
def vector_kernels(symbolic: System, k: int) -> dict[str, int]:
    """Addresses of the kernels by their names in `memory.Work`; zeros where the formulas have no such form."""
    made, _ = any_formulas(symbolic)
    values = [x for _, row in made.bodies[1:4] for x in row]
    if PLAIN or symbolic.size > MOST or not can_express(values):
        return dict.fromkeys(KERNELS, 0)
    with trace.tracing(made.table):
        texts = [factors(made.pattern, k), damping(made.pattern, k)]
        texts += [iteration(made, symbolic.size, k, level) for level in range(ON_VECTORS)]
    return {name: load(text, str) for name, text in zip(KERNELS, texts, strict=True)}


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


def times(lanes: Any, x: Complex, y: Complex) -> Complex:
    (a, b), (c, d) = x, y
    return lanes.sub(lanes.mul(a, c), lanes.mul(b, d)), lanes.add(lanes.mul(a, d), lanes.mul(b, c))


def less(lanes: Any, x: Complex, y: Complex) -> Complex:
    return lanes.sub(x[0], y[0]), lanes.sub(x[1], y[1])


def factors(pattern: Any, k: int) -> str:
    """a: -J as `Formulas` has it; b: h; out: the factors, with the reciprocals of the pivots."""
    lanes, known, at = Lanes(), coefficients(k), Factors(pattern)
    size, values = at.size, pattern.cumsum().reshape(pattern.shape) - 1
    h = lanes.number(lanes.b, 0)
    parts = [lanes.mul(h, lanes.constant([*x, last])) for x, last in ((known.eigen_re, 1.0), (known.eigen_im, 0.0))]
    one, none = lanes.constant(1.0), lanes.constant(0.0)
    entry: dict[tuple[int, int], Complex] = {}
    for i, j in np.argwhere(at.there).tolist():
        real, imag = (one if i == j else none), none
        if pattern[i, j]:
            slope = lanes.number(lanes.a, values[i, j])
            real, imag = (lanes.add(x, lanes.mul(part, slope)) for x, part in zip((real, imag), parts, strict=True))
        entry[i, j] = real, imag
    for m in range(size):
        p, q = entry[m, m]
        scale = lanes.divide(one, lanes.add(lanes.mul(p, p), lanes.mul(q, q)))
        entry[m, m] = lanes.mul(p, scale), lanes.sub(none, lanes.mul(q, scale))
        for i in at.below(m):
            entry[i, m] = times(lanes, entry[i, m], entry[m, m])
            for j in range(m + 1, size):
                if at.there[m, j]:
                    entry[i, j] = less(lanes, entry[i, j], times(lanes, entry[i, m], entry[m, j]))
    for (i, j), value in entry.items():
        for part, number in enumerate(value):
            lanes.store(number, at.place(i, j) + part * WIDTH)
    return lanes.text()


def damping(pattern: Any, k: int) -> str:
    """(I - hJ)^-1 of the rows of `out`, in place. a: the factors."""
    lanes, at, lane = Lanes(), Factors(pattern), coefficients(k).pairs
    size = at.size
    x = [lanes.row(lanes.out, WIDTH * i) for i in range(size)]
    for j in range(size):
        for i in at.below(j):
            x[i] = lanes.sub(x[i], lanes.mul(lanes.number(lanes.a, at.place(i, j) + lane), x[j]))
    for j in reversed(range(size)):
        x[j] = lanes.mul(lanes.number(lanes.a, at.place(j, j) + lane), x[j])
        for i in at.above(j):
            x[i] = lanes.sub(x[i], lanes.mul(lanes.number(lanes.a, at.place(i, j) + lane), x[j]))
    for i in range(size):
        lanes.store(x[i], WIDTH * i)
    return lanes.text()


def solved(lanes: Any, at: Factors, first: int, x: list[Complex]) -> list[Complex]:
    """By the factors, which stand in `a` from `first` on."""

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


def iteration(made: Any, size: int, k: int, level: int) -> str:
    """`any_system.rates` and `corrected` with one of the quadratures.

    a: z, weights of a residual, what is carried of z, the factors; b: h, constants; out: U, which is corrected in
    place, N, a row of WIDTH nodes for each variable; then the weighed size of the correction, NaN if it is.
    """
    lanes, known = Lanes(), coefficients(k)
    _, (inputs, motion), (y, slopes), (all_inputs, rates), _ = made.bodies
    carried = 2 * size

    def numbers(pointer: Any, first: int, count: int) -> list[Any]:
        return [lanes.number(pointer, first + i) for i in range(count)]

    z, weights, y0 = numbers(lanes.a, 0, size), numbers(lanes.a, size, size), numbers(lanes.a, carried, len(y))
    h, shared = lanes.number(lanes.b, 0), {x: lanes.number(lanes.b, i) for x, i in made.places.items()}

    old = [lanes.row(lanes.out, WIDTH * i) for i in range(size)]
    at_nodes = [integrated(lanes, h, z[i], known.A, numbers(lanes.out, WIDTH * i, k)) for i in range(size)]
    at = shared | dict(zip(inputs, [*old, *at_nodes], strict=True))
    drift = [[lanes.lane(x, l) for l in range(k)] for x in lanes.graph(at, motion)]
    means, _ = projected(lanes, k, level, shared, list(zip(y, y0, drift, strict=True)), slopes)
    at |= dict(zip(all_inputs[2 * size :], means, strict=True))
    new = lanes.graph(at, rates)
    change = [[lanes.lane(lanes.sub(x, y), l) for l in range(k)] for x, y in zip(new, old, strict=True)]
    parts = [tuple(lanes.combine(into.T, x) for into in (known.into_re, known.into_im)) for x in change]
    parts = solved(lanes, Factors(made.pattern), carried + len(y), parts)
    back, sizes = [*known.back_re.T, *(-known.back_im.T)], []
    for i, part in enumerate(parts):
        step = lanes.combine(back, [lanes.lane(x, j) for x in part for j in range(known.pairs)])
        sizes.append(lanes.first(k, lanes.mul(weights[i], lanes.size(step))))
        lanes.store(lanes.add(old[i], step), WIDTH * i)
        lanes.store(new[i], WIDTH * (size + i))
    lanes.store(lanes.largest(sizes), 2 * WIDTH * size)
    return lanes.text()
