"""The thermal equilibrium of any system: the state of largest entropy among those with its energy and invariants.

Newton's method on that surface climbs S along tangents, with the second derivatives of S - sum of multipliers times
constraints, returns to the surface after each step, and never lowers S. Gradients and second derivatives are those of
the formulas. States that differ by a rotation or a free position at one entropy are one equilibrium.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiler import derivatives as trace
from ..compiler.caches import cached
from ..compiler.kernels import Kernel, kernel, placed
from ..systems.state import fixed
from ..systems.system import System

Floats = NDArray[np.float64]
MAX_NUMBERS = 80  # length of a state up to which second derivatives are traced entry by entry
STEPS = 300  # of one climb
NEAR_TOP, AT_TOP = 1e-9, 1e-14  # relative gain of S that a step predicts: near a maximum, or in a valley; at it
LONGEST = 0.5  # the longest step, over the size of the state
STARTS = 8  # of climbs near the best maximum, for S may have several, and as many at each of the REACHES
REACHES = (1.0, 2.0)  # distances of such starts, over the size of each number
FLAT, FLATTEST = 1e-9, 1e-15  # floor of curvatures, relative to the largest: at first, and after steps
FAR = 100.0  # distance, over the size of the start, within which equilibria are sought
HELD = 1e-13  # relative residual of the constraints
ADMISSIBLE = 0.0  # temperatures and measures are larger


CACHED_MAXIMA = 100
_MAXIMA: dict[Any, Equilibrium] = {}  # of this process, by all that they depend on: methods share scenarios


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """exists : if not, `note` says why. entropy : the largest. z : a state with it, (n,). temperatures : its own."""

    exists: bool
    z: Floats
    entropy: float
    temperatures: Floats
    note: str = ""


def maximum_entropy(system: System, z0: Any, within: float = FAR) -> Equilibrium:
    """The equilibrium at the energy and the invariants of z0 (n,): the highest that is reached uphill from there and
    from random states.

    within : the largest size of a state on the way, over that of z0.
    """
    if system.size > MAX_NUMBERS:
        return _none(system, f"a state of {system.size} numbers is too long for matrices of second derivatives")
    z0 = np.array(z0, float)
    key = system.structure, system.constant_values.tobytes(), z0.tobytes(), within
    state = _MAXIMA.get(key)
    if state is None:
        state = _highest(_Surface(system, z0), within)
        if len(_MAXIMA) >= CACHED_MAXIMA:
            _MAXIMA.clear()  # another thread may be about to read
        _MAXIMA[key] = state
    return state


def _highest(surface: _Surface, within: float) -> Equilibrium:
    """The highest maximum reached from the start of a surface and from random states on it."""
    rng = np.random.default_rng(0)
    best = _top(surface, surface.start, within, rng)
    size = np.maximum(surface.magnitudes, np.abs(surface.start))
    for k in range(1, STARTS * (1 + len(REACHES)) if best.exists else 0):
        with np.errstate(all="ignore"):
            if k < STARTS:
                begin = np.asarray(surface.system.nearby(surface.start, rng))
            else:
                begin = surface.start + REACHES[k // STARTS - 1] * size * rng.standard_normal(len(size))
            other = surface.back(begin)
        maximum = best if other is None else _top(surface, other, within, rng)
        higher = NEAR_TOP * (surface.system.entropy_magnitude + abs(best.entropy))
        best = maximum if maximum.entropy > best.entropy + higher else best
    return best


def _top(surface: _Surface, z: Floats, within: float, rng: np.random.Generator) -> Equilibrium:
    """The maximum reached from z (n,)."""
    system, before, flat = surface.system, np.inf, FLAT
    magnitudes, entropy_scale = surface.magnitudes, system.entropy_magnitude
    far = within * (1.0 + float(np.linalg.norm(surface.start / magnitudes)))
    for _ in range(STEPS):
        step, gain, saddle = surface.uphill(z, flat)
        S = float(system.entropy(z))
        near, lowest = gain <= NEAR_TOP * (entropy_scale + abs(S)), S
        if near and saddle is not None:
            step, lowest = 1e-3 * (1.0 + np.linalg.norm(z / magnitudes)) * saddle * rng.choice((-1.0, 1.0)), -np.inf
        higher, share = surface.climbed(z, step, lowest)
        if gain <= AT_TOP * (entropy_scale + abs(S)) and saddle is None:
            return _at(system, z if higher is None else higher)
        if higher is None:
            return _none(system, "the entropy rises to where a temperature or a measure is no longer positive")
        whole = share == 1.0 and np.linalg.norm(step / np.maximum(magnitudes, np.abs(z))) < LONGEST
        flat = FLAT if gain < 0.1 * before else max(FLATTEST, 0.1 * flat) if whole else min(FLAT, 10.0 * flat)
        z, before = higher, gain
        if np.linalg.norm(z / magnitudes) > far:
            return _none(
                system, f"the entropy still rises where the state is {within:g} times as large as at the start"
            )
    return (
        _at(system, z)
        if near and saddle is None
        else _none(system, f"{STEPS} steps uphill did not lead to a largest entropy")
    )


def _at(system: System, z: Floats) -> Equilibrium:
    z = fixed(np.array(z))
    return Equilibrium(True, z, float(system.entropy(z)), fixed(np.array(system.temperatures(z))))


def _none(system: System, why: str) -> Equilibrium:
    nothing = np.full(system.size, np.nan)
    return Equilibrium(False, nothing, np.nan, np.full(system.n_temperatures, np.nan), f"No equilibrium: {why}.")


class _Surface:
    """The states with the energy and the invariants of `start`."""

    def __init__(self, system: System, start: Floats) -> None:
        self.system, self.start, self.count = system, start, 1 + len(system.invariant_names)
        self.kernel = _derivatives(system.symbolic)
        values = self.at(start)[0]
        self.magnitudes, laws = system.state_magnitudes, np.delete(system.law_magnitudes, 1)
        self.target, self.scale = values[1:], np.maximum(laws, np.abs(values[1:]))

    def at(self, z: Floats) -> tuple[Floats, Floats, Floats]:
        """Values (m,), gradients (m, n) and second derivatives (m, n, n) of S, E and invariants at z."""
        m, n = 1 + self.count, len(z)
        outputs = self.kernel(np.ascontiguousarray(z), self.system.constant_values)
        values, slopes, curves = np.split(outputs, [m, m + m * n])
        return values, slopes.reshape(m, n), curves.reshape(m, n, n)

    def uphill(self, z: Floats, flat: float) -> tuple[Floats, float, Floats | None]:
        """A step (n,) along the tangents, its predicted gain of S, and a direction in which S curves up, or None."""
        _, slopes, curves = self.at(z)
        size = np.maximum(self.magnitudes, np.abs(z))
        rise, held = slopes[0] * size, slopes[1:] * size
        weights, *_ = np.linalg.lstsq(held.T, rise, rcond=1e-12)
        _, singular, rows = np.linalg.svd(held)
        tangent = rows[int((singular > 1e-12 * singular.max(initial=0.0)).sum()) :].T
        along = tangent.T @ rise
        curve = (curves[0] - np.tensordot(weights, curves[1:], 1)) * np.outer(size, size)
        if not len(along):
            return np.zeros_like(z), 0.0, None
        bend, axes = np.linalg.eigh(tangent.T @ curve @ tangent)
        largest = max(1e-300, float(np.abs(bend).max()))
        steepest = max(flat * largest, 1e-21 * self.system.entropy_magnitude)
        step = tangent @ (axes @ ((axes.T @ along) / np.maximum(np.abs(bend), steepest)))
        length = float(np.linalg.norm(step))
        step *= LONGEST / length if length > LONGEST else 1.0
        upward = size * (tangent @ axes[:, -1]) if bend[-1] > 1e3 * FLAT * largest else None
        return size * step, float(rise @ step), upward

    def climbed(self, z: Floats, step: Floats, lowest: float) -> tuple[Floats | None, float]:
        """The state after the longest part, of halvings of a step, that is admissible and has S >= `lowest`; and that
        part. None where there is none."""
        for halvings in range(50):
            point = self.back(z + 0.5**halvings * step)
            lower = 1e-15 * (self.system.entropy_magnitude + abs(lowest))
            if point is not None and self.system.entropy(point) >= lowest - lower:
                return point, 0.5**halvings
        return None, 0.0

    def back(self, z: Floats) -> Floats | None:
        """The nearest state of the surface, by Gauss and Newton; None where it is not admissible."""
        with np.errstate(all="ignore"):
            for _ in range(30):
                values, slopes, _ = self.at(z)
                off = values[1:] - self.target
                if not np.all(np.isfinite(values)):
                    return None
                if np.all(np.abs(off) <= HELD * self.scale):
                    return z if self._admissible(z) else None
                size = np.maximum(self.magnitudes, np.abs(z))
                z = z - size * np.linalg.lstsq(slopes[1:] * size, off, rcond=1e-12)[0]
            return z if np.all(np.abs(off) <= 1e-10 * self.scale) and self._admissible(z) else None

    def _admissible(self, z: Floats) -> bool:
        watched = np.concatenate([np.asarray(self.system.temperatures(z)), np.asarray(self.system.shapes(z))])
        return bool(np.all(watched > ADMISSIBLE))


@cached
def _derivatives(symbolic: System) -> Kernel:
    """z -> values, gradients, second derivatives of S, E and the invariants, for all systems of one structure."""
    with trace.tracing():
        z = trace.variables("z", symbolic.size)
        values = [trace.lifted(x) for x in (symbolic.entropy(z), symbolic.energy(z), *symbolic.momenta(z))]
        slopes = trace.jacobian(values, list(z))
        curves = [x for row in slopes for x in trace.jacobian(list(row), list(z)).ravel()]
        return kernel(placed("a", z) | symbolic.constant_symbols(), [*values, *slopes.ravel(), *curves])
