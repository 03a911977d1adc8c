"""By what the numbers of a run are measured at least: its variables, its energy, entropy and invariants.

Rules that need an absolute size, as where a number may be 0, take these. They are 1, but for what the unit of a
scenario makes small or large: as far as the energy at hand moves a variable, and by how much a law then changes. They
are powers of two: a scenario in units that are such powers of others does the same, to round-off.
"""

from __future__ import annotations

import math
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..compiler import derivatives as trace
from ..compiler.array_kernels import ArrayKernel
from ..compiler.array_states import entries
from ..compiler.caches import cached
from ..compiler.kernels import Kernel
from ..compiler.round_off import round_off
from .state import fixed
from .traced import OF_LAWS

if TYPE_CHECKING:
    from .system import System

Floats = NDArray[np.float64]
NO_SCALE = 1e-6  # an energy at the start as small beside its terms says nothing of how large energies are
SMALL, LARGE = 2.0**-8, 2.0**12  # a size between them is taken for 1: scenarios are written in units of their own
SHORT = 2.0**-12  # a move
FEW = 2.0**-6  # the same of an energy: an error of it is seen sooner
STEP = 32.0  # from one length of a move to the next
LONGER = STEP ** np.arange(1.0, 25.0)  # moves where a short one shows nothing
LITTLE = 2.0**-4  # of the energy at hand: a change from which it can be told how far all of it moves a variable
HALVINGS = 40  # of the interval of such a move, whose ends are STEP apart
SEEN = 2.0**-36  # of the energy at hand: a change that shows a size, well above round-off
NOISE = 2.0**-48  # of a value: what its differences may be
CURVED = 2.0**-44  # of a slope: a change of it that shows a curvature
REST = 1e-10  # of the energy: less is round-off of the slopes, which are all but 0 at rest, and next to it
SHARE = 2.0**-8  # of its size, by which each variable is moved to see the sizes of laws
ELSEWHERE = 64.0  # times what its slopes say: 2.6 at most in every scenario that ships and 30 random ones
CANCELLED = 2.0**-10  # a value as small beside its terms says nothing of its size
TINY = 1e-100  # of a move: beyond, there is no size
E = 0  # place of the energy among laws


def exergy_at(model: System, z0: Floats) -> float:
    """V(z0); |E0 + offset| of a system without reference temperature, and where that is next to nothing beside the sum
    of |z dE/dz|/2, as an energy that is counted from anywhere may be, that sum."""
    exergy = float(model.exergy(z0))
    if model.reference_temperature:
        return exergy
    terms = float(np.abs(z0 * model.gradient(z0)).sum()) / 2
    return abs(exergy) if abs(exergy) >= NO_SCALE * terms else terms


def measured(model: System, z0: Floats | None, horizon: float = math.inf) -> tuple[Floats, Floats]:
    """Of each variable, of energy and entropy; and of energy, entropy and each invariant. 1 where no start is known."""
    count, n_laws = len(model.variables), 2 + len(model.invariant_names)
    if z0 is None:
        return np.ones(count + OF_LAWS), np.ones(n_laws)
    energy = exergy_at(model, z0)
    far = _moved(model, z0, energy)
    usual = _usual(far).all() and energy >= FEW
    at_hand = 0.0 if usual and model.reference_temperature else _at_hand(model, z0, far)
    if 0.0 < at_hand * ELSEWHERE < energy:  # it is counted from anywhere, and moves nothing so far
        at_hand = max(at_hand, REST * energy)  # or this is next to rest, where slopes are what is left of larger ones
        far = _moved(model, z0, at_hand, unusual=True)
    elif not usual:  # is the energy small, or next to rest?
        energy = max(energy, energy_terms(model, z0))
        far = _moved(model, z0, energy, unusual=True)
    if (far > LARGE).any():  # where the energy is flat, or the hill that stops a motion is far away
        far = np.where(far > LARGE, np.minimum(far, _reached(model, z0, far, horizon)), far)
    values, laws = _laws(model, z0, far, n_laws)
    laws[E] = energy
    cancelled = np.abs(values) < CANCELLED * laws
    laws = np.where((laws < [FEW] + [SMALL] * (n_laws - 1)) | cancelled, laws, 1.0)
    laws = _power_of_two(laws, FEW)
    return fixed(np.concatenate([_power_of_two(far), laws[:2]])), fixed(laws)


def _at_hand(model: System, z0: Floats, far: Floats) -> float:
    """How large the energy is as its slopes tell it, wherever it is counted from: of z^2 half of z dE/dz, of e^z, whose
    z may be 0, the square of the slope over twice the curvature. far: how far so much energy moves each variable."""
    slope, sum_of = model.gradient(z0), 0.0
    places = tuple((a, b) for a, b, _ in model.layout.values())
    for (a, b), way, longest in zip(places, _ways(places), far, strict=True):
        for length in (np.abs(z0[a:b]).max(initial=0.0), longest):  # where z is all but 0 the first shows nothing
            move = SHORT * max(length, TINY) * way
            curved = abs((model.gradient(z0 + move) - model.gradient(z0 - move)) @ move) / 2
            if curved > CURVED * np.abs(slope * move).sum():
                break
        by_curve = (slope @ move) ** 2 / (2 * curved) if curved > 0.0 else 0.0
        by_terms = np.abs(z0 * slope)[a:b].sum() / 2
        sum_of += max(x for x in (by_terms, by_curve, 0.0) if x < np.inf)
    return float(sum_of)


def _usual(size: Floats, small: float = SMALL) -> Any:
    """Is it no unit's doing? What is nothing, or not known, is as good as 1."""
    return ~(size > 0.0) | ~(size < np.inf) | ((size >= small) & (size <= LARGE))


def _power_of_two(size: Floats, small: float = SMALL) -> Floats:
    """1 where it is usual."""
    usual = _usual(size, small)
    return np.ones(len(size)) if usual.all() else np.exp2(np.round(np.log2(np.where(usual, 1.0, size))))


def energy_terms(model: System, z0: Floats, law: str = "energy") -> float:
    """How large the terms of the energy, or of the entropy, are."""
    terms = terms_of(model.by_arrays if model.large else model.symbolic, law)
    measure = terms.kernel(model.mesh) if isinstance(terms, ArrayKernel) else terms
    return float(measure(np.array(z0), model.declared_values)[0])


@cached
def terms_of(system: Any, law: str) -> Kernel | ArrayKernel:
    """How large they are at a state, of all systems of one structure or kind."""
    with trace.tracing():
        z = system.unknowns("z")
        size = round_off(trace.lifted(getattr(system, law)(z)), entries(z))
        terms: Kernel | ArrayKernel = system.compiled([z], [size])
        return terms


def entropy_size(model: System) -> float:
    """Beside which a fall of S is measured at least: 1, less in units that make S small, its terms at the start where
    these cancel."""
    least = float(model.least_entropy)
    if least <= 1.0 or model.begins is None:
        return min(least, 1.0)
    return max(1.0, energy_terms(model, model.begins, "entropy"))


def _moved(model: System, z0: Floats, energy: float, unusual: bool = False) -> Floats:
    """How far so much energy moves each variable; the largest entry where that cannot be seen.

    unusual : a move that is short in units of 1 may be too short for the curvature to show; then the longest is taken
    that is LITTLE.
    """
    places = tuple((a, b) for a, b, _ in model.layout.values())
    ways, largest = _ways(places), np.array([np.abs(z0[a:b]).max(initial=0.0) for a, b in places])
    if not energy > 0.0:
        return largest
    length, slopes = np.full(len(ways), SHORT), np.abs(ways @ model.gradient(z0))
    with np.errstate(divide="ignore"):  # periods of a crystal's potential are skipped where the slope is not looked at
        shorter = np.ceil(np.log(length * slopes / (LITTLE * energy)) / math.log(STEP))
    length /= STEP ** np.clip(np.nan_to_num(shorter), 0.0, 60.0)
    first, second = _changes(model, z0, length, ways)
    while (far := ~(np.maximum(first, second) <= LITTLE * energy) & (length > TINY)).any():
        length[far] /= STEP
        first, second = _changes(model, z0, length, ways)
    for i in np.flatnonzero(unusual | (np.maximum(first, second) < SEEN * energy)):  # a longer one tells more
        longer = length[i] * LONGER
        firsts, seconds = _changes(model, z0, longer, np.repeat(ways[i : i + 1], len(longer), axis=0))
        most = np.maximum(firsts, seconds)  # NaN, beyond an edge, is not little and not seen
        little = int(np.logical_and.accumulate(most <= LITTLE * energy).sum()) if unusual else 0
        seen = np.flatnonzero(most >= SEEN * energy)
        best = max(little - 1, seen[0]) if len(seen) else -1
        if best >= 0 and (little or max(first[i], second[i]) < SEEN * energy):
            length[i], first[i], second[i] = longer[best], firsts[best], seconds[best]
            if best > 0 and not most[best] <= energy:  # of an exponential that was nothing before
                length[i], first[i], second[i] = _between(
                    model, z0, energy, ways[i : i + 1], longer[best - 1 : best + 1]
                )
    with np.errstate(divide="ignore"):
        far = np.minimum(length * (energy / first), length * np.sqrt(energy / second))
    return np.where(np.maximum(first, second) >= SEEN * energy, far, largest)


def _between(model: System, z0: Floats, energy: float, way: Floats, lengths: Floats) -> tuple[float, float, float]:
    """A move between these two, of which one shows nothing and one too much, and its changes of the energy."""
    low, high = lengths
    for _ in range(HALVINGS):
        length = math.sqrt(low * high)
        first, second = (float(change[0]) for change in _changes(model, z0, np.array([length]), way))
        most = max(first, second)
        if SEEN * energy <= most <= LITTLE * energy:
            break
        low, high = (length, high) if most < SEEN * energy else (low, length)
    return length, first, second


def _reached(model: System, z0: Floats, far: Floats, horizon: float) -> Floats:
    """How far each variable may come in the run, by its rate at the start and with each other one moved by its size."""
    places = [(a, b) for a, b, _ in model.layout.values()]
    moves = far[:, None] * _ways(tuple(places))
    with np.errstate(all="ignore"):
        here = np.abs(model.vector_field(z0))
        rates = [np.abs(model.vector_field(z0 + move)) for move in moves]
    reach = []
    for i, (a, b) in enumerate(places):
        others = [here, *(rate for j, rate in enumerate(rates) if j != i)]
        fastest = max((x for rate in others for x in rate[a:b] if x < np.inf), default=0.0)
        reach.append(horizon * fastest if fastest > 0.0 else np.inf)
    return np.array(reach)


def _changes(model: System, z0: Floats, length: Floats, ways: Floats) -> tuple[Floats, Floats]:
    """First and second differences of the energy, or of the entropy's, by moves of these lengths both ways; NaN where
    there is no energy."""
    seen = _observed(model, np.concatenate([z0[None], z0 + length[:, None] * ways, z0 - length[:, None] * ways]))
    weights = (1.0, model.reference_temperature)
    here, up, down = seen[0, :2], *np.split(seen[1:, :2], 2)
    with np.errstate(invalid="ignore"):
        first = (np.maximum(np.abs(up - down) / 2 - NOISE * np.abs(here), 0.0) * weights).max(axis=1)
        second = (np.maximum(np.abs(up + down - 2 * here) - NOISE * np.abs(here), 0.0) * weights).max(axis=1)
    return first, second


def _laws(model: System, z0: Floats, far: Floats, count: int) -> tuple[Floats, Floats]:
    """Values of energy, entropy and invariants, and how much they change as all variables move so far."""
    ways = _ways(tuple((a, b) for a, b, _ in model.layout.values()))
    move = SHARE * (far[:, None] * ways).sum(axis=0)
    here, up, down = _observed(model, np.array([z0, z0 + move, z0 - move]))[:, :count]
    with np.errstate(invalid="ignore"):
        change = np.fmax(np.abs(up - down) / (2 * SHARE), np.abs(up + down - 2 * here) / SHARE**2)
    return here, np.where(np.isfinite(change), change, np.abs(here))


def _observed(model: System, rows: Floats) -> Floats:
    from ..compiler.library import ROWS  # LLVM is loaded when something runs, not when plugins are listed

    observe, count = model.observer
    seen = np.empty((len(rows), count))
    ROWS.evaluate_rows(observe.address, np.ascontiguousarray(rows), model.declared_values, seen)
    return seen


@cache
def _ways(places: tuple[tuple[int, int], ...]) -> Floats:
    """A move of each variable, which stand at these places: shape (variables, size of z)."""
    at = np.arange(places[-1][1])
    return fixed(np.array([np.where((at >= a) & (at < b), np.cos(1.7 * at + 0.4), 0.0) for a, b in places]))
