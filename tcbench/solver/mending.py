"""Projection of a state onto the laws: the nearest one with the energy and invariants of the run, and no less entropy.

By Gauss and Newton along the gradients of energy and invariants, in variables scaled by their sizes; where the entropy
would fall, also along the part of its gradient that leaves those unchanged. For any system and after any method: as
formulas (`Along`), and as kernels that a compiled march calls until what is missed is round-off (`mended`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import reduce
from typing import Any

import numpy as np

from ..compiler import chain_rule
from ..compiler import derivatives as trace
from ..compiler.array_states import entries, refilled
from ..compiler.arrays import total
from ..compiler.caches import cached
from ..compiler.derivatives import Symbol, const
from ..compiler.language import Address, Floats, call, rare
from ..compiler.round_off import round_off
from ..systems.state import blocks_of
from ..systems.system import System

ROUND_OFF = 2.0**-51  # of what the terms of a law are: what a mended state may miss
TINY = 1e-140  # beside a square: nothing is moved along a gradient that is 0; and what a law that is 0 may miss
DEPENDENT = 1e-26  # of the square of a gradient, free of the others: what round-off leaves where they say the same
ENTROPY = 1  # its place among what is observed
# behind the state in a target: energy, the least entropy, what that and the energy may miss, and so of each invariant;
# and behind a state that was moved: its entropy, its margin
GIVEN_ENERGY, LEAST_ENTROPY, ENTROPY_MISS, ENERGY_MISS, INVARIANTS = range(5)
FOUND_ENTROPY, MARGIN = range(2)
LAWFUL, NEAR = 2.0**-48, 1e-12  # over 1 and the size of a law: what a state that has it may miss, at least and at most
SHRUNK = 0.75  # of what was missed, after a move that helped
# near an equilibrium, where little is left of the entropy's gradient, each move leaves half of the way
MOST_MOVES = 24


def laws(system: System, z: Any) -> list[Any]:
    """The values of the laws at a state: energy, each invariant, entropy; each a number in its own unit."""
    return [system.energy(z), *system.momenta(z), system.entropy(z)]


def gradients(system: System, z: Any) -> list[Any]:
    """The gradients of the laws at a state, in the order of `laws`; each as a state, shape (size,)."""
    return [system.gradient(z), *system.momenta_gradients(z), system.entropy_gradient(z)]


def positions(system: System, z: Any) -> list[Symbol]:
    """The constraints g(z), which have to be 0; [] of a system without constraints."""
    return entries(system.constraint_values(z)) if system.multipliers else []


def position_slopes(system: System, z: Any) -> list[Any]:
    """The gradients of `positions`, in its order; each as a state, shape (size,)."""
    x = system.unknowns("x")
    here = dict(zip(entries(x), map(trace.lifted, entries(z)), strict=True))
    found = (chain_rule.gradient(f, entries(x)) for f in positions(system, x))
    return [system.state(refilled(x, trace.substitute(slopes, here))) for slopes in found]


def constraints(system: System, z: Any) -> list[Symbol]:
    """The constraints g(z) and their rates dg/dt, which have to be 0; [] of a system without constraints."""
    return [*positions(system, z), *entries(system.constraint_speeds(z))] if system.multipliers else []


def constraint_slopes(system: System, z: Any) -> list[Any]:
    """The gradients of `constraints` at symbols z, in its order; each as a state, shape (size,)."""
    return [system.state(refilled(z, chain_rule.gradient(f, entries(z)))) for f in constraints(system, z)]


Turned = Callable[[Any], Any]


class Along:
    """The shortest moves along the slopes of laws that make up for what these miss, to first order.

    By the factors L D L^T of the products of the slopes, without what a law says that those before it say, too. Made
    once at a state, they serve near it as well, where what is missed shrinks by the size of what was moved.
    turned: the direction of a slope, by a symmetric matrix, such as squares of the sizes by which moves are measured.
    at_rest: of the square of the last slope, that of the entropy, what is little beside the others, as next to an
    equilibrium.
    """

    def __init__(self, system: System, slopes: Sequence[Any], turned: Turned, at_rest: float = DEPENDENT) -> None:
        self.system, self.slopes = system, slopes
        self.weighed = [turned(slope) for slope in slopes]
        self.lower: list[dict[int, Symbol]] = []  # of each law the shares of earlier ones
        self.inverse: list[Symbol] = []
        for k, slope in enumerate(slopes):
            row: dict[int, Symbol] = {}
            for i in range(k):
                left = product(system, slope, self.weighed[i])
                for j, x in row.items():
                    if j in self.lower[i]:
                        left = left - x * self.lower[i][j]
                if not trace.is_const(left, 0.0):
                    row[i] = left
            whole = product(system, slope, self.weighed[k])
            self.lower.append({i: x * self.inverse[i] for i, x in row.items()})
            square = whole - sum((x * row[i] for i, x in self.lower[k].items()), const(0.0))
            least = (at_rest if k == len(slopes) - 1 else DEPENDENT) * whole + TINY
            self.inverse.append(square / (square * square + least * least))

    def before(self, here: Sequence[Any], moved: Any) -> list[Any]:
        """The laws before a state was moved by `moved`, from their values `here` after it, to first order."""
        return [f - product(self.system, slope, moved) for f, slope in zip(here, self.slopes, strict=True)]

    def move(self, misses: Sequence[Any], at_least: bool = False) -> Any:
        """The move, a state, that makes up for `misses` of the first laws, or of all. at_least : the last law, the
        entropy, is raised where it is too low and never lowered."""
        lacks: list[Any] = []
        for miss, row in zip(misses, self.lower, strict=False):
            lacks.append(miss - sum((x * lacks[i] for i, x in row.items()), const(0.0)))
        if at_least:
            lacks[-1] = trace.maximum(trace.lifted(lacks[-1]), const(0.0))
        along = [lack * inverse for lack, inverse in zip(lacks, self.inverse, strict=False)]
        for k in reversed(range(len(along))):
            for i, x in self.lower[k].items():
                along[i] = along[i] - x * along[k]
        return sum(direction * a for direction, a in zip(self.weighed, along, strict=False))


def by_variable(system: System, x: Any, y: Any) -> Any:
    """For each number of a state the product x . y over its whole variable, which is the same in turned axes; shape
    (size,)."""
    products = [[v] * len(entries(a)) for v, a in zip(_products(system, x, y), blocks_of(system, x), strict=True)]
    return refilled(x, [v for alike in products for v in alike])


def product(system: System, x: Any, y: Any) -> Any:
    """The number x . y of a covector x and a rate y, shape (size,) each, summed variable by variable."""
    return sum(_products(system, x, y), const(0.0))


def _products(system: System, x: Any, y: Any) -> list[Symbol]:
    return [trace.lifted(np.sum(a * b)) for a, b in zip(blocks_of(system, x), blocks_of(system, y), strict=True)]


def missed(now: Floats, first: Floats, entropy: float, allowed: Floats) -> float:
    """The largest miss of a law over what it may miss, dimensionless: of the energy and the invariants of `first`, and
    of an entropy that is no less than `entropy`. now, first: (E, S, invariants...)."""
    most: float = (entropy - now[ENTROPY]) / allowed[ENTROPY]
    for i in range(len(allowed)):
        if i != ENTROPY:
            most = max(most, abs(now[i] - first[i]) / allowed[i])
    return most


@cached
def mending_kernels(system: System) -> tuple[Any, Any, Any, list[Symbol]]:
    """(start, mend, hold, constants) for the marches of systems of one structure, by their `System.symbolic`, or of one
    kind, by `by_arrays`.

    start(z) -> target: z, E, S, what S may miss, what E may miss, then each invariant and what it may miss.
    mend(target; given) -> z moved to the energy and the invariants, S of the z that was given, its margin: the least of
    what must be positive in it, and of what each law may miss less what it does. hold: the same, S as it is in the
    target, too. given: `constant_values`, then the constants of the list.
    """
    with trace.tracing():
        z = system.unknowns("x")
        told = trace.variables("law", INVARIANTS + 2 * (len(system.invariant_names) + len(constraints(system, z))))
        start, *moves = _moves(system, z, told)
        constants = system.hoisted(moves, [z, told])
        mend, hold = (system.compiled([z, told], move, constants, len(entries(z))) for move in moves)
        return system.compiled([z], start), mend, hold, constants


def _moves(system: Any, z: Any, told: Any) -> list[list[Any]]:
    """The outputs of the kernels start, mend and hold (`mending_kernels`), each a state and then numbers."""
    held = constraints(system, z)
    energy, *others, entropy = [trace.lifted(v) for v in laws(system, z)]
    first, *further, last = gradients(system, z)
    values, slopes = [energy, *others, *held, entropy], [first, *further, *constraint_slopes(system, z), last]
    behind, half = 1 + len(others), len(held) // 2
    # each constraint and its rate first: of chains they have few neighbours; the entropy last: it leaves all alone
    order = [behind + i for k in range(half) for i in (k, k + half)] + [*range(behind), len(values) - 1]
    least = system.magnitudes_of(z)
    noises = [ROUND_OFF * round_off(f, entries(z), entries(least)) + TINY for f in values]
    start = [z, values[0], values[-1], noises[-1], noises[0]]
    for pair in zip([*others, *(const(0.0) for _ in held)], noises[1:-1], strict=True):
        start += pair
    targets = [told[GIVEN_ENERGY], *told[INVARIANTS::2], told[LEAST_ENTROPY]]
    allowed = [told[ENERGY_MISS], *told[INVARIANTS + 1 :: 2], told[ENTROPY_MISS]]
    misses = [target - f for target, f in zip(targets, values, strict=True)]
    own = [ROUND_OFF / 2 * abs(slope * z).sum() for slope in slopes]  # of z's own rounding
    margins = [a + b - abs(m) for a, b, m in zip(allowed[:-1], own, misses, strict=False)]
    positive = map(trace.lifted, [*margins, *entries(system.temperatures(z), system.shapes(z))])
    good = reduce(trace.minimum, (total("min", x, x.space) for x in positive))
    good = trace.guarded(good, values)  # of what is not a number the least is lost
    weights = least * least + by_variable(system, z, z)
    along = Along(system, [slopes[i] for i in order], lambda slope: weights * slope)
    ordered = [misses[i] for i in order]
    mend = [z + along.move(ordered[:-1]), values[-1], good]
    enough = trace.minimum(good, allowed[-1] + own[-1] - misses[-1])
    return [start, mend, [z + along.move(ordered), values[-1], enough]]


@rare
def mended(to_mend: Address, to_hold: Address, target: Floats, given: Floats, found: Floats) -> bool:
    """Move the state that `target` begins with onto the laws behind it, in place; False: none is near, or admissible.

    The entropy there is the least that the next one may have. found: room for size + 2 numbers.
    """
    size = len(found) - 2
    laws, entropy = target[size:], found[size + FOUND_ENTROPY :]
    good = onto(to_mend, target, given, found)
    if good and entropy[0] < laws[LEAST_ENTROPY] - laws[ENTROPY_MISS]:
        good = onto(to_hold, target, given, found)
    if good:
        laws[LEAST_ENTROPY] = max(entropy[0], laws[LEAST_ENTROPY])
    return good


@rare
def onto(to: Address, target: Floats, given: Floats, found: Floats) -> bool:
    """Moves of one of the two kernels, until its margin is positive."""
    size = len(found) - 2
    for _ in range(MOST_MOVES):
        call(to, target, given, found)
        if found[size + MARGIN] > 0.0:
            return float(abs(found[size + FOUND_ENTROPY])) < math.inf
        if not abs(found[size + FOUND_ENTROPY]) < math.inf:
            return False
        for i in range(size):
            target[i] = found[i]
    return False
