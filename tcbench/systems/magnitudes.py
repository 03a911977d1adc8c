"""Typical magnitudes of the variables, of energy, entropy and invariants: the absolute scales of a run's tolerances.

Rules take them where a number itself may be 0. A magnitude is 1 unless the unit of a scenario makes the variable small
or large: then it is as far as the energy at hand moves the variable, and of a law how much that changes it. Magnitudes
are powers of two, so that a scenario in units that differ by such powers runs alike, to round-off.
"""

from __future__ import annotations

import math
from functools import cache, reduce
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from ..compiler import derivatives as trace
from ..compiler.array_kernels import ArrayKernel
from ..compiler.array_states import entries, refilled
from ..compiler.arrays import total
from ..compiler.caches import cached, cached_property
from ..compiler.kernels import Kernel
from ..compiler.round_off import round_off
from .over_spaces import OverSpaces
from .state import blocks_of, fixed
from .traced import OF_LAWS

if TYPE_CHECKING:
    from .system import System

Floats = NDArray[np.float64]
NO_SCALE = 1e-6  # |E0| below this part of its terms: E is counted from anywhere, and says nothing of its scale
SMALL, LARGE = 2.0**-8, 2.0**12  # a magnitude between them is taken for 1: scenarios are written in units of their own
SMALL_ENERGY = 2.0**-6  # SMALL of energies, whose errors show sooner
SHORT = 2.0**-12  # length of the first move
STEP = 32.0  # from one length of a move to the next
LONGER = STEP ** np.arange(1.0, 25.0)  # lengths that are tried where a short move shows nothing
LITTLE = 2.0**-4  # of the energy at hand: the largest change from which a magnitude is extrapolated
HALVINGS = 40  # of the interval of such a move, whose ends are STEP apart
SEEN = 2.0**-36  # of the energy at hand: the smallest change that shows a magnitude, well above round-off
NOISE = 2.0**-48  # round-off of a difference of two values, over a value
CURVED = 2.0**-44  # of a slope: the smallest change of it that shows a curvature
REST = 1e-10  # of the energy: what is below is round-off of the slopes, which are all but 0 at rest and next to it
SHARE = 2.0**-8  # of its magnitude, by which each variable is moved to measure laws
ELSEWHERE = 64.0  # E over what its slopes say; it is 2.6 at most in every scenario that ships and in 30 random ones
CANCELLED = 2.0**-10  # a value below this part of its terms says nothing of its magnitude
TINY = 1e-100  # length of a move below which there is no magnitude
E = 0  # place of the energy among laws


def exergy_at(model: System, z0: Floats) -> float:
    """The exergy V(z0), in the unit of energy. Without a reference temperature |E0 + offset|, or the sum of |z dE/dz|/2
    where that is much larger, as it is of an energy that is counted from anywhere."""
    exergy = float(model.exergy(z0))
    if model.reference_temperature:
        return exergy
    terms = float(np.abs(z0 * model.gradient(z0)).sum()) / 2
    return abs(exergy) if abs(exergy) >= NO_SCALE * terms else terms


def magnitudes_at(model: System, z0: Floats | None, horizon: float = math.inf) -> tuple[Floats, Floats]:
    """Magnitudes of each variable, of energy and entropy, shape (n_variables + 2,); and of the laws, shape (2 +
    n_invariants,): energy, entropy, invariants. All are 1 where no start is known.

    z0 : shape (size,), the start of runs that take the time `horizon`.
    """
    count, n_laws = len(model.variables), 2 + len(model.invariant_names)
    if z0 is None:
        return np.ones(count + OF_LAWS), np.ones(n_laws)
    energy = exergy_at(model, z0)
    far = _moved(model, z0, energy)
    usual = _usual(far).all() and energy >= SMALL_ENERGY
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
    laws = np.where((laws < [SMALL_ENERGY] + [SMALL] * (n_laws - 1)) | cancelled, laws, 1.0)
    laws = _power_of_two(laws, SMALL_ENERGY)
    return fixed(np.concatenate([_power_of_two(far), laws[:2]])), fixed(laws)


def _at_hand(model: System, z0: Floats, far: Floats) -> float:
    """The energy that the slopes show, wherever E is counted from: z dE/dz / 2, which is right for z^2, or the square
    of the slope over twice the curvature, which is right for e^z at z = 0.

    far : shape (n_variables,), how far the energy moves each variable.
    """
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
    """Is a magnitude as good as 1, of each entry? So is one that is 0 or not known."""
    return ~(size > 0.0) | ~(size < np.inf) | ((size >= small) & (size <= LARGE))


def _power_of_two(size: Floats, small: float = SMALL) -> Floats:
    """The nearest power of two, and 1 where the size is usual."""
    usual = _usual(size, small)
    return np.ones(len(size)) if usual.all() else np.exp2(np.round(np.log2(np.where(usual, 1.0, size))))


def energy_terms(model: System, z0: Floats, law: str = "energy") -> float:
    """The size of the terms of the energy, or of the entropy, at z0 (size,): what they are before they cancel."""
    terms = terms_of(model.by_arrays if model.large else model.symbolic, law)
    measure = terms.kernel(model.mesh) if isinstance(terms, ArrayKernel) else terms
    return float(measure(np.array(z0), model.declared_values)[0])


@cached
def terms_of(system: Any, law: str) -> Kernel | ArrayKernel:
    """The kernel of `energy_terms`, shared by all systems of one structure."""
    with trace.tracing():
        z = system.unknowns("z")
        size = round_off(trace.lifted(getattr(system, law)(z)), entries(z))
        terms: Kernel | ArrayKernel = system.compiled([z], [size])
        return terms


def entropy_size(model: System) -> float:
    """The scale of a fall of S: 1, less in units that make S small, and the size of its terms where these cancel."""
    magnitude = float(model.entropy_magnitude)
    if magnitude <= 1.0 or model.begins is None:
        return min(magnitude, 1.0)
    return max(1.0, energy_terms(model, model.begins, "entropy"))


def _moved(model: System, z0: Floats, energy: float, unusual: bool = False) -> Floats:
    """How far the energy moves each variable, shape (n_variables,); its largest entry where that cannot be seen.

    unusual : a move that is short in units of 1 may be too short for the curvature to show; then the longest move whose
    change is LITTLE is taken.
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
    """A length between two, one of which shows nothing and one too much; its first and its second change."""
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
    """How far each variable may come in the run, shape (n_variables,): by its rate at the start, and by its rate where
    one of the others is moved by its magnitude."""
    places = [(a, b) for a, b, _ in model.layout.values()]
    moves = far[:, None] * _ways(tuple(places))
    with np.errstate(all="ignore"):
        at_start = np.abs(model.vector_field(z0))
        rates = [np.abs(model.vector_field(z0 + move)) for move in moves]
    reach = []
    for i, (a, b) in enumerate(places):
        others = [at_start, *(rate for j, rate in enumerate(rates) if j != i)]
        fastest = max((x for rate in others for x in rate[a:b] if x < np.inf), default=0.0)
        reach.append(horizon * fastest if fastest > 0.0 else np.inf)
    return np.array(reach)


def _changes(model: System, z0: Floats, length: Floats, ways: Floats) -> tuple[Floats, Floats]:
    """First and second differences, shape (m,), by moves of these lengths (m,) along `ways` (m, size), to and fro: the
    larger of those of E and of theta_ref S. NaN where there is no energy."""
    seen = _observed(model, np.concatenate([z0[None], z0 + length[:, None] * ways, z0 - length[:, None] * ways]))
    weights = (1.0, model.reference_temperature)
    at_start, up, down = seen[0, :2], *np.split(seen[1:, :2], 2)
    with np.errstate(invalid="ignore"):
        first = (np.maximum(np.abs(up - down) / 2 - NOISE * np.abs(at_start), 0.0) * weights).max(axis=1)
        second = (np.maximum(np.abs(up + down - 2 * at_start) - NOISE * np.abs(at_start), 0.0) * weights).max(axis=1)
    return first, second


def _laws(model: System, z0: Floats, far: Floats, count: int) -> tuple[Floats, Floats]:
    """Values of the laws, shape (count,), and how much they change, (count,), as all variables move by `far`."""
    ways = _ways(tuple((a, b) for a, b, _ in model.layout.values()))
    move = SHARE * (far[:, None] * ways).sum(axis=0)
    at_start, up, down = _observed(model, np.array([z0, z0 + move, z0 - move]))[:, :count]
    with np.errstate(invalid="ignore"):
        change = np.fmax(np.abs(up - down) / (2 * SHARE), np.abs(up + down - 2 * at_start) / SHARE**2)
    return at_start, np.where(np.isfinite(change), change, np.abs(at_start))


def _observed(model: System, rows: Floats) -> Floats:
    """The laws at each of the states, shape (m, n_observed)."""
    from ..compiler.library import ROWS  # LLVM is loaded when something runs, not when plugins are listed

    observe, count = model.observer
    seen = np.empty((len(rows), count))
    ROWS.evaluate_rows(observe.address, np.ascontiguousarray(rows), model.declared_values, seen)
    return seen


@cache
def _ways(places: tuple[tuple[int, int], ...]) -> Floats:
    """For each variable, which stands at these places, the direction of its moves: shape (n_variables, size)."""
    at = np.arange(places[-1][1])
    return fixed(np.array([np.where((at >= a) & (at < b), np.cos(1.7 * at + 0.4), 0.0) for a, b in places]))


class Magnitudes(OverSpaces):
    """A system that knows where its runs begin, and so the magnitudes of its numbers."""

    begins: Floats | None = None  # z0 of the scenario of an instance
    horizon: float = np.inf  # t_end of that scenario

    def begin(self, z0: Floats, horizon: float = np.inf) -> None:
        """Declare that runs begin at z0 (size,) and take the time `horizon`; magnitudes are then measured anew."""
        for name in ("magnitudes", "_magnitudes", "state_magnitudes", "unit_sizes", "constant_values"):
            self.__dict__.pop(name, None)
        self.__dict__["begins"], self.__dict__["horizon"] = z0, horizon

    @cached_property
    def _magnitudes(self) -> tuple[Floats, Floats]:
        return magnitudes_at(cast("System", self), self.begins, self.horizon)

    @cached_property
    def magnitudes(self) -> Any:
        """Of each variable, of energy and entropy, shape (n_variables + 2,), each in its own unit."""
        return self._magnitudes[0]

    @property
    def law_magnitudes(self) -> Floats:
        """Of energy, entropy and each invariant, shape (2 + n_invariants,)."""
        return self._magnitudes[1]

    @property
    def energy_magnitude(self) -> Any:
        return self.magnitudes[-2]

    @property
    def entropy_magnitude(self) -> Any:
        return self.magnitudes[-1]

    @cached_property
    def state_magnitudes(self) -> Floats:
        """For each number of a state the magnitude of its variable, shape (size,)."""
        return fixed(np.repeat(self.magnitudes[:-OF_LAWS], [int(np.prod(shape)) for shape in self.variables.values()]))

    @cached_property
    def unit_sizes(self) -> Floats | None:
        """`state_magnitudes`, for solvers with one scale for all numbers; None where all are 1."""
        return None if np.all(self.state_magnitudes == 1.0) else self.state_magnitudes

    def absolute(self, tolerance: float) -> Any:
        """The absolute tolerance for a solver: a number, or shape (size,) where magnitudes differ from 1."""
        return tolerance if self.unit_sizes is None else tolerance * self.unit_sizes

    def magnitudes_of(self, z: Any) -> Any:
        """`state_magnitudes` as a state like z, of symbols or of arrays."""
        blocks = zip(self.magnitudes, blocks_of(cast("System", self), z), strict=False)
        return refilled(z, [size for size, block in blocks for _ in entries(block)])

    def sizes(self, z: Any) -> list[Any]:
        """The scales of increments at z, variable by variable: its largest entry, but at least its magnitude."""
        blocks = []
        for block, magnitude in zip(blocks_of(cast("System", self), z), self.magnitudes, strict=False):
            largest = (total("max", abs(x), x.space) for x in entries(block))
            blocks.append(refilled(block, [reduce(trace.maximum, largest, magnitude)] * len(entries(block))))
        return blocks
