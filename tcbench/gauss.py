"""`GaussMethod`: the collocation of `collocate`, set up for a system and a number of stages."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import trace
from .collocation import LONG, _gauss_nodes, tableau
from .emit import Kernel, constant_part, kernel
from .system import System

EXTRA = (5, 10, 20, 40)  # quadratures have k + 5, k + 10, ... points
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Coefficients:
    """The numbers of k-stage Gauss collocation with projection; see `collocate`."""

    nodes: Floats  # (k,)
    barycentric: Floats  # (k,) weights of the nodes in Lagrange's second form
    at_start: Floats  # (k,) Lagrange polynomials at 0
    at_end: Floats  # (k,) and at 1
    A: Floats  # (k, k)
    b: Floats  # (k,)
    Ahats: Floats  # (levels, M, k): integrals of the Lagrange polynomials from 0 to the quadrature points
    Ws: Floats  # (levels, k, M)
    points: NDArray[np.int64]  # (levels,)


@cache
def coefficients(k: int) -> Coefficients:
    """Computed in extended precision, rounded once."""
    method = tableau("gauss", k)
    nodes, b = method.c, method.b
    # integrals of polynomials of degree k - 1 over [0, x], exactly
    inner, inner_weights = _gauss_nodes(k)

    def lagrange(x: Any) -> Any:
        factors = np.ones((len(x), k), LONG)
        for j in range(k):
            for l in range(k):
                if l != j:
                    factors[:, j] *= (x - nodes[l]) / (nodes[j] - nodes[l])
        return factors

    points = [k + extra for extra in EXTRA]
    Ahats, Ws = np.zeros((len(EXTRA), points[-1], k)), np.zeros((len(EXTRA), k, points[-1]))
    for level, m in enumerate(points):
        xi, omega = _gauss_nodes(m)
        Ahats[level, :m] = np.array([x * (inner_weights @ lagrange(x * inner)) for x in xi], dtype=float)
        Ws[level, :, :m] = (omega[:, None] * lagrange(xi) / b).T.astype(float)
    barycentric = np.array([1 / np.prod([nodes[j] - nodes[l] for l in range(k) if l != j]) for j in range(k)])
    zero, one = lagrange(np.array([0, 1], LONG)).astype(float)
    return Coefficients(
        nodes.astype(float), barycentric.astype(float), zero, one, method.A.astype(float), b.astype(float), Ahats, Ws,
        np.array(points),
    )  # fmt: skip


@cache
def _kernels(structure: tuple, k: int) -> list[Kernel]:
    """(start, motion, slopes, forces, whole) of a system, traced from its five functions; see `collocate.rates`.

    The last kernel computes what depends on the constants only; its results stand behind them.
    """
    system = _STRUCTURES[structure].symbolic
    n, e = system.n_positions, system.n_elements
    h = trace.variable("h")
    constants = {h: "b[0]"} | _STRUCTURES[structure].constant_symbols()
    z = trace.variables("z", system.size)
    v, q = trace.variables("v", n), trace.variables("q", n)
    pi, s = trace.variables("pi", e), trace.variables("s", e)
    sigma, theta = trace.variables("sigma", e), trace.variables("theta", e)
    stress, temperature = system._element_slopes(pi, s)
    bodies: list[tuple[list[Any], list[Any], int]] = [  # unknowns, values, where the unknowns stand
        (list(z), _start(system, z), 0),
        ([*v, *q], list(system._shape_gradient(q) @ v), 0),
        ([*pi, *s], [*stress, *temperature], 0),
        ([*q, *sigma, *theta], [*(-(sigma @ system._shape_gradient(q))), *system.conduction(theta)], n),
        (*_whole(system, k, h), 0),
    ]
    values = [[x if isinstance(x, trace.Symbol) else trace.const(float(x)) for x in body[1]] for body in bodies]
    fixed = constant_part([x for row in values for x in row], [h, *(x for body in bodies for x in body[0])])
    known = constants | {x: f"b[{len(constants) + i}]" for i, x in enumerate(fixed)}
    made = [
        kernel({x: f"a[{first + i}]" for i, x in enumerate(unknown)} | known, row)
        for (unknown, _, first), row in zip(bodies, values, strict=True)
    ]
    return [*made, kernel(constants, fixed)]


def _whole(system: Any, k: int, h: Any) -> tuple[list[Any], list[Any]]:
    """`collocate.rates` and `correct` with the coarsest quadrature as one formula.

    (U, q0, p0, pi0, s0, T, u, v, scale) -> (N, V, corrected U, scaled residual / h, least theta)
    """
    n, e, a = system.n_positions, system.n_elements, coefficients(k)
    U = trace.variables("U", k * (n + e)).reshape(k, n + e)
    q0, p0, x0 = trace.variables("q", n), trace.variables("p", n), trace.variables("x", 2 * e)
    T, scale = trace.variables("T", k * k).reshape(k, k), trace.variables("scale", 2)
    u_v = trace.variables("uv", 2 * e)
    per_mass = 1.0 / (system.inertia() * np.ones(n))

    def integrated(start: Any, weights: Any, slopes: Any) -> list[Any]:
        return [start + h * sum(w * f for w, f in zip(row, slopes, strict=True)) for row in weights]

    v = [p * per_mass for p in integrated(p0, a.A, U[:, :n])]
    pull = [system._shape_gradient(q) for q in integrated(q0, a.A, v)]
    drift = [np.concatenate([g @ w, u[n:]]) for g, w, u in zip(pull, v, U, strict=True)]
    points = integrated(x0, a.Ahats[0][: a.points[0]], drift)
    slopes = [np.concatenate(system._element_slopes(x[:e], x[e:])) for x in points]
    means = [sum(w * y for w, y in zip(row, slopes, strict=False)) for row in a.Ws[0]]
    rates = [np.concatenate([-(y[:e] @ g), system.conduction(y[e:])]) for y, g in zip(means, pull, strict=True)]
    least = reduce(trace.minimum, [theta for y in means for theta in y[e:]])
    force = [(new - old)[:n] for new, old in zip(rates, U, strict=True)]
    heat = [(new - old)[n:] for new, old in zip(rates, U, strict=True)]
    stiff = T @ np.array([u_v[e:] @ x for x in heat])
    heat = [x + y * u_v[:e] for x, y in zip(heat, stiff, strict=True)]
    moved = [x for r, y, u in zip(rates, heat, U, strict=True) for x in (*r[:n], *(u[n:] + y))]
    parts = [*(abs(x) * scale[0] for f in force for x in f), *(abs(x) * scale[1] for f in heat for x in f)]
    size = trace.guarded(reduce(trace.maximum, parts), parts)
    inputs = [*U.ravel(), *q0, *p0, *x0, *T.ravel(), *u_v, *scale]
    return inputs, [*np.concatenate(rates), *np.concatenate(v), *moved, size, least]


def _start(system: Any, z: Any) -> list[Any]:
    """(F, G, pi, E, round-off of E, decay, u, v): the rates at a state, and the stiff part of the conduction.

    d conduction/ds is nearly u v^T with theta . u = 0, since theta . conduction = 0 for all s: for two elements u is
    known, and v is a row of the derivative. With other numbers of elements nothing is treated as stiff.
    """
    n, e, state = system.n_positions, system.n_elements, system.state(z)
    rate, theta = system.vector_field(z)[n:], system.temperatures(z)
    energy = system.energy(z)
    # some rounding errors of each element's heat and of the total
    noise = 2.0**-51 * (sum(theta * (np.ones(e) * system.entropy_scale())) + abs(energy) + 1.0)
    u = v = [0.0] * e
    if e == 2:
        slope = trace.jacobian(list(rate[n:]), list(state.s))
        u, v = [1.0, -theta[0] / theta[1]], list(slope[0])
    decay = sum(a * b for a, b in zip(u, v, strict=True))
    return [*rate, *system.shape(state.q), energy, noise, decay, *u, *v]


_STRUCTURES: dict[tuple, System] = {}


class GaussMethod:
    """k-stage consistent collocation on one system: fixed steps and adaptive runs. Not thread-safe."""

    def __init__(self, system: System, stages: int) -> None:
        from . import collocate, collocate_march  # numba is imported when something runs, not when plugins are listed

        self.loops, self.codes = collocate_march, collocate
        _STRUCTURES.setdefault(system.structure, system)
        *kernels, setup = _kernels(system.structure, stages)
        n, e, k = system.n_positions, system.n_elements, stages
        c0 = system.constant_values
        self.size, self.c = system.size, np.concatenate([c0, setup(c0, c0)])
        self.plan = np.array([*(x.address for x in kernels), n, e, k, len(EXTRA), k + EXTRA[0]], dtype=np.int64)
        self.inverse_mass = 1.0 / np.asarray(system.inertia(), dtype=float)
        self.numbers = coefficients(k)
        self.counts = np.zeros(collocate.COUNTS_SIZE, dtype=np.int64)
        m, unknowns = int(self.numbers.points[-1]), k * (n + e)
        first_T = unknowns + 2 * n + 2 * e
        given, found = np.zeros(first_T + k * k + 2 * e + 2), np.zeros(2 * unknowns + k * n + 2)
        T = given[first_T : first_T + k * k].reshape(k, k)
        U, N = given[:unknowns].reshape(k, -1), found[:unknowns].reshape(k, -1)
        V = found[unknowns : unknowns + k * n].reshape(k, -1)
        moved = found[unknowns + k * n : -2].reshape(k, -1)
        first = kernels[0].size
        self.ends = np.zeros(first), np.zeros(first), np.zeros(3)  # start, end, scale
        self.stages = (
            given, found, U, N, V, np.zeros((k, 2 * n + 2 * e)), np.zeros((k, 2 * e)),
            np.zeros((m, 2 * e)), np.zeros((m, 2 * e)), T, np.zeros(k), np.zeros((k, k)), moved,
            np.zeros((unknowns, unknowns)), np.zeros(unknowns), np.zeros(unknowns), np.zeros(2 * e),
            np.zeros(self.size), np.zeros(self.size),
        )  # fmt: skip
        self.buffers = np.zeros(self.size), np.zeros(self.size), np.zeros(self.size)

    def increments(self, z: Floats, h: float) -> Floats:
        """z1 - z of one step; raises ArithmeticError where none is found."""
        a = self.numbers
        total, carry, here = self.buffers
        code = self.loops.fixed_step(
            self.plan,
            self.c,
            h,
            z,
            total,
            carry,
            here,
            *self.ends,
            self.inverse_mass,
            a.A,
            a.b,
            a.Ahats,
            a.Ws,
            a.points,
            *self.stages,
            self.counts,
        )
        if code != self.codes.SOLVED:
            raise ArithmeticError("the collocation equations have no solution in reach, at any part of the step")
        return total

    def adaptive(self, z0: Floats, times: Floats, tolerance: float) -> tuple[Floats, dict[str, int]]:
        """States at `times`, and what they cost. The end of a step is superconvergent (order 2k), its polynomial is not
        (order k + 1): the defect is held at the power of the tolerance that belongs to an error of its size."""
        a, k = self.numbers, len(self.numbers.nodes)
        states = np.empty((len(times), self.size))
        z, carry, _ = self.buffers
        z[:], carry[:] = z0, 0.0
        self.counts[:] = 0
        code = self.loops.adaptive(
            self.plan,
            self.c,
            times,
            tolerance ** ((k + 1) / (2 * k)),
            states,
            z,
            carry,
            *self.ends,
            self.inverse_mass,
            a.nodes,
            a.barycentric,
            a.at_start,
            a.at_end,
            a.A,
            a.b,
            a.Ahats,
            a.Ws,
            a.points,
            *self.stages,
            self.counts,
        )
        if code != self.codes.SOLVED:
            raise ArithmeticError("the step became too short")
        return states, {
            "steps": int(self.counts[self.codes.STEPS]),
            "newton_iterations": int(self.counts[self.codes.ITERATIONS]),
            "rejected": int(self.counts[self.codes.REJECTED_STEPS]),
        }
