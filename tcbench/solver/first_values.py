"""Newton's initial guess, and the sizes by which its corrections are scaled: formulas in the state z0 before a step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiler import derivatives as trace
from ..compiler.array_jacobian import jacobian_terms
from ..compiler.array_kernels import ArrayKernel, array_kernel
from ..compiler.array_mesh import Block
from ..compiler.array_states import entries
from ..compiler.arrays import NUMBER
from ..compiler.derivatives import Symbol, array, const
from ..compiler.kernels import Kernel, kernel
from ..compiler.library import ROWS
from ..compiler.once import once
from ..systems.element_system import ElementSystem
from ..systems.scenario import Scenario
from ..systems.state import fixed
from ..systems.system import System
from .elimination import factorise
from .mending import round_off
from .reduction import Reduction

TINY = 1e-100  # beside a kinetic energy that may be zero
SMALL = 2.0**-12  # beside 1: what moves a variable no farther is in another unit


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


def least_sizes(scenario: Scenario) -> NDArray[np.float64]:
    """By what the increments of each variable are measured at least: 1, or, where units make it small, how far the
    energy at hand moves it."""
    if "least" not in scenario._cache:
        model, z0 = scenario.model, scenario.z0
        least = _moved(model, z0, scenario.exergy_at_start)
        if least.min() < 1.0:  # is the energy small, or next to rest?
            terms = terms_of_energy(model.by_arrays if model.large else model.symbolic)
            measure = terms.kernel(model.mesh) if isinstance(terms, ArrayKernel) else terms
            size = float(measure(np.array(z0), model.constant_values)[0])
            least = _moved(model, z0, max(size, scenario.exergy_at_start))
        scenario._cache["least"] = fixed(least)
    found: NDArray[np.float64] = scenario._cache["least"]
    return found


@once
def terms_of_energy(system: Any) -> Kernel | ArrayKernel:
    """How large they are at a state, of all systems of one structure or kind."""
    with trace.tracing():
        if system.by_array:
            z = system.fresh_state("z")
            inputs = {"a": system.blocks(z), "b": [Block(NUMBER, (None,)), *system.constant_blocks()]}
            return array_kernel(inputs, [Block(NUMBER, (round_off(system.energy(z), entries(z), False),))])
        x = trace.variables("x", system.size)
        size = round_off(trace.lifted(system.energy(system.state(x))), list(x), False)
        return kernel({s: f"a[{i}]" for i, s in enumerate(x)} | system.constant_symbols(), [size])


def _moved(model: System, z0: NDArray[np.float64], energy: float) -> NDArray[np.float64]:
    """How far so much energy moves each variable; 1 where that is not small."""
    least, moves = np.ones(len(model.variables)), _ways(tuple((a, b) for a, b, _ in model.layout.values()))
    observe, n_observables = model.observer
    seen = np.empty((1 + 2 * len(least), n_observables))  # of z0 and of both ways of each variable, at once
    while energy > 0.0:
        steps = least[:, None] * moves
        ROWS.evaluate_rows(
            observe.address, np.concatenate([z0[None], z0 + steps, z0 - steps]), model.constant_values, seen
        )
        changes = abs(seen[1:, :2] - seen[0, :2]) * (1.0, model.reference_temperature)
        far = (changes > energy).any(axis=1).reshape(2, -1).any(axis=0) & (least > TINY)  # NaN, beyond an edge, may be
        if not far.any():
            break
        least[far] /= 32.0
    return np.where(least < 1.0, SMALL * least, 1.0)


@cache
def _ways(places: tuple[tuple[int, int], ...]) -> NDArray[np.float64]:
    """A small move of each variable, which stand at these places: shape (variables, size of z)."""
    at = np.arange(places[-1][1])
    return fixed(np.array([np.where((at >= a) & (at < b), SMALL * np.cos(1.7 * at + 0.4), 0.0) for a, b in places]))


def sizes_of(system: Any, y0: Any, z0: Any, variables: str, least: Sequence[Symbol]) -> list[Symbol]:
    """By what each increment is measured, as the system says; of temperatures theta, of energies theta times that of an
    entropy. least: of each variable, see `least_sizes`."""
    sizes = [trace.lifted(x) for x in entries(*system.sizes(z0, least))]
    if variables == "temperature":
        theta = entries(y0.theta)
        sizes[-len(theta) :] = theta
    if variables == "energy":
        theta = entries(system.temperatures(z0))
        sizes[-len(theta) :] = [a * b for a, b in zip(theta, sizes[-len(theta) :], strict=True)]
    return sizes
