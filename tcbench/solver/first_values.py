"""Newton's initial guess, and the sizes by which its corrections are scaled: formulas in the state z0 before a step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..compiler import derivatives as trace
from ..compiler.array_jacobian import jacobian_terms
from ..compiler.array_states import entries
from ..compiler.derivatives import Symbol, array, const
from ..compiler.elimination import factorise
from ..systems.element_system import ElementSystem
from ..systems.system import System
from .reduction import Reduction

TINY = 1e-100  # beside a kinetic energy that may be zero


def plain_start(reduction: Reduction) -> dict[Symbol, Symbol]:
    """Unknowns for which the eliminated increments vanish: Newton from z1 = z0.

    Newton does not see the initial value of an unknown that enters linearly (momenta, once positions are eliminated),
    so this reproduces Newton on the full set of unknowns started at z0. Unknowns equal to zero are instead
    the explicit drift q0 + h p0/m, which is nearer.
    """
    x, zero = reduction.unknowns, const(0.0)
    start = dict.fromkeys(x, zero)
    for formula, slopes in zip(reduction.eliminated.values(), _slopes(reduction), strict=True):
        ((symbol, slope), *others) = slopes or [(None, zero)]
        if symbol is not None and not others and slope.number not in trace.depends_on([slope], x):
            (offset,) = trace.substitute([formula], dict.fromkeys(x, zero))
            start[symbol] = trace.neg(trace.mul(offset, trace.reciprocal(slope)))
    return start


def measured_by(reduction: Reduction, inverse: Mapping[Symbol, Symbol]) -> dict[Symbol, Symbol]:
    """1/size of every increment: of an unknown with which an eliminated one moves, by whichever is the stricter.

    Momenta of 1e-10 are nothing beside 1, and move masses of 1e-20 as far as others. Where Newton's matrix is small
    both are corrected (`kernels_of_flow.FlowKernels`).
    """
    found, x = dict(inverse), reduction.unknowns
    for moved, slopes in zip(reduction.eliminated, _slopes(reduction), strict=True):
        for unknown, slope in slopes:
            if unknown is not None and slope.number not in trace.depends_on([slope], x):
                found[unknown] = trace.maximum(found[unknown], trace.mul(abs(slope), inverse[moved]))
    return found


def _slopes(reduction: Reduction) -> list[list[tuple[Symbol | None, Symbol]]]:
    """(unknown, slope) of all that each eliminated one is made of; no unknown where it is other entries of an array."""
    found = jacobian_terms([*reduction.eliminated.values()], reduction.unknowns)
    return [[(None if t.rows or t.columns else t.unknown, slope) for t, slope in row.items()] for row in found]


def near_start(index: Sequence[int], system: System, z0: Any, h: Symbol, variables: str) -> list[Symbol]:
    """A nearer initial value, of elements: Taylor to second order for p, s frozen, and the trapezoidal rule for s.

    Of temperatures and of energies, y, in the place of entropies likewise, with dy = dy/ds ds.

    Conduction is stiff: its explicit step overshoots, and no step at all costs Newton an iteration. Forces may be stiff
    as well: as much of their part is left out as the kinetic energy of the change of p is of that of p.
    """
    if not isinstance(system, ElementSystem):
        return [const(0.0)] * len(index)  # of the first step; then the last roots foretell the next (newton.foresee)
    n, m = system.n_positions, system.n_elements
    first = 2 * n
    moving, heated = any(n <= i < first for i in index), any(first <= i < first + m for i in index)
    known: dict[int, Symbol] = {}
    t, believed, path = trace.variable("t"), const(0.0), z0[:n]
    if moving:
        inertia = system.inertia()
        drift = h * z0[n:first] / inertia
        carried = np.concatenate([z0[:n] + t * drift, z0[n:]])
        force, change = _derivatives(system.vector_field(carried)[n:first], t, 1)
        dp = h * (force + 0.5 * change)
        kinetic = [sum(0.5 * p**2 / inertia) for p in (dp, z0[n:first])]
        believed = trace.maximum(const(0.0), 1.0 - kinetic[0] / (kinetic[1] + TINY))
        known |= {n + i: believed * x for i, x in enumerate(dp)}
        path = z0[:n] + t * (drift + t * (0.5 * h * h * force / inertia))
    if heated:
        s0 = list(z0[first:])
        theta = system.temperatures(z0)
        rate = np.array(system.conduction(theta), dtype=object)
        other, slope = variables != "entropy", array([const(1.0)] * m)
        if other:
            slope = np.diagonal(trace.jacobian(list(system.in_variables(variables, z0)[first:]), s0))
            rate = rate * slope
        A = trace.jacobian(list(rate), s0)
        matrix = [[const(float(i == j)) - 0.5 * h * A[i, j] / slope[j] for j in range(m)] for i in range(m)]
        right = h * rate
        if moving:  # temperatures change as elements stretch, too
            moved = np.concatenate([path, z0[n:]])
            warmed: Any = (
                system.in_variables(variables, moved)[first:]
                if other else system.conduction(system.temperatures(moved))
            )  # fmt: skip
            _, by_t, by_tt = _derivatives(warmed, t, 2)
            right = right + believed * (by_t + 0.5 * by_tt if other else 0.5 * h * by_t)
        known |= {first + i: g for i, g in enumerate(factorise(matrix)[0].solve(list(right)))}
    return [known.get(i, const(0.0)) for i in index]


def _derivatives(values: Sequence[Symbol], t: Symbol, order: int) -> list[Any]:
    """Of the values by t up to this order, at t = 0; the values first."""
    found = [array(values)]
    for _ in range(order):
        found.append(trace.jacobian(list(found[-1]), [t])[:, 0])
    return [array(trace.substitute(list(x), {t: const(0.0)})) for x in found]


def sizes_of(system: Any, y0: Any, z0: Any, variables: str) -> list[Symbol]:
    """By what each increment is measured, as the system says; of temperatures theta, of energies theta times that of an
    entropy."""
    sizes = [trace.lifted(x) for x in entries(*system.sizes(z0))]
    if variables == "temperature":
        theta = entries(y0.theta)
        sizes[-len(theta) :] = theta
    if variables == "energy":
        theta = entries(system.temperatures(z0))
        sizes[-len(theta) :] = [a * b for a, b in zip(theta, sizes[-len(theta) :], strict=True)]
    return sizes
