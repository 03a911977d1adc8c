"""References by two Taylor series in double-double arithmetic, of many scenarios at once: state, certificate and floor.

Each scenario is run three times from the same doubles: finely, a hundred times more coarsely, and coarsely from a start
that is shifted a little. Four times the gap of the first two is the certificate of the first, which is far better than
that; the third shows how the solution magnifies errors, such as the rounding of any run in doubles (the floor).
The recurrences, which all share, are compared with the compiled equations on the way.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiler.language import PLAIN
from ..errors import TcbenchError
from ..systems.system import System
from .double_double import two_sum
from .tape import FIELDS, LANES, PAIR, tape
from .taylor import LIBRARY, Work

ORDER, WIDE = 40, 22  # of the series; orders below which coefficients are double-doubles
FINE, COARSE = 1e-26, 1e-24  # tolerances of the two series that are compared
SAFETY = 4.0  # of the certificate, over the gap of the two
SHIFT = 1e-20  # relative shift of the start of the third run: it shows a growth of up to 1e16
DEFECT = 1e-7  # relative residual of the series in the compiled equations, which a right series has not
MAX_STEPS, MAX_OPERATIONS = 150_000, 80_000_000  # of a run; the tape's operations take seconds, then others are better
LARGEST = 2**24  # doubles of a workspace: states of some thousand numbers
RUNS = 3  # of a scenario: fine, coarse, shifted
SOURCE = f"Taylor series of order {ORDER} in double-double arithmetic at {FINE:g} against {COARSE:g}"
CHANCE = 10 * FINE  # floor of the gap per unit of growth: both errors may be alike by chance (2 of 500)
LINEAR = 1e-4  # a larger gap no longer grows linearly, and certifies nothing: chaos has taken all digits


class Pair(NamedTuple):
    """States at each time, shape (m, n); their certificate and the growth of a change of the start, shape (m,).

    The latter are max |difference| / max(magnitude, |z|), dimensionless (`System.magnitudes`).
    """

    states: NDArray[np.float64]
    low: NDArray[np.float64]  # low parts of the states
    certificate: NDArray[np.float64]
    growth: NDArray[np.float64]
    steps: int


def solve(systems: Sequence[System], starts: Sequence[Any], times: Any, text: str = "") -> list[Pair | None]:
    """The `Pair` of each scenario, None where the series fail: too stiff, too large, no series, a blow-up.

    starts : shape (scenarios, n). times : shape (scenarios, m), or (m,) for all. text : of the vector field of all,
    where it is known. Systems of one structure run side by side.
    """
    ends = np.broadcast_to(np.asarray(times, float), (len(systems), np.shape(times)[-1]))
    groups: dict[Any, list[int]] = {}
    for i, system in enumerate(systems):
        groups.setdefault(system.structure, []).append(i)
    pair_of: dict[int, Pair | None] = {}
    for group in groups.values():
        pairs = _solve([systems[i] for i in group], [starts[i] for i in group], ends[group], text)
        pair_of |= dict(zip(group, pairs, strict=True))
    return [pair_of[i] for i in range(len(systems))]


def _solve(
    systems: Sequence[System], starts: Sequence[Any], times: NDArray[np.float64], text: str
) -> list[Pair | None]:
    system, n = systems[0], systems[0].size
    text = text or system.formula("vector_field")[0]
    try:
        plan = tape(text, n, system.n_constant_values, ORDER)
    except TcbenchError:
        return [None] * len(systems)
    size, most = plan.size + PAIR * (ORDER + 1), MAX_OPERATIONS * FIELDS // max(len(plan.code), 1)
    if size > LARGEST or PLAIN:  # thousands of times slower
        return [None] * len(systems)
    ends, runs = times.shape[1], RUNS * len(systems)
    states = np.full((runs, (ends + 1) * 2 * n), math.nan)
    signs = np.where(np.random.Generator(np.random.PCG64(n)).integers(0, 2, n), 1.0, -1.0)
    each = np.array([x.state_magnitudes for x in systems])
    for i, z in enumerate(starts):
        states[RUNS * i : RUNS * (i + 1), : 2 * n] = np.append(z, np.zeros(n))
        shift = SHIFT * signs * np.maximum(each[i], np.abs(z))
        states[RUNS * i + 2, : 2 * n] = np.append(*two_sum(np.asarray(z), shift))
    constants = np.repeat([x.constant_values for x in systems], RUNS, axis=0)
    values = np.repeat([plan.values(x.constant_values) for x in systems], RUNS, axis=0)
    work = Work(
        order=ORDER, wide=WIDE, variables=n, inputs=len(plan.inputs), length=len(plan.setup), steps=len(plan.code),
        size=size, runs=runs, ends=ends, constants=constants.shape[1], most=min(MAX_STEPS, most),
        rate=system.kernel("vector_field")[0].address, setup=plan.setup, code=plan.code, memory=memory(size),
        rates=plan.rates, moving=plan.moving, places=plan.inputs, times=np.repeat(times, RUNS, axis=0), values=values,
        system_constants=constants, tolerances=np.tile([FINE, COARSE, COARSE], len(systems)), states=states,
        magnitudes=np.repeat(each, RUNS, axis=0),
    )  # fmt: skip
    LIBRARY.march(work)
    ends_of_runs = work.states.reshape(len(systems), RUNS, ends + 1, 2, n)
    taken, defects = work.taken.reshape(-1, RUNS), work.defects.reshape(-1, RUNS)
    pairs = [
        _pair(ends_of_runs[i, :, 1:], int(taken[i].sum()), each[i])
        if (taken[i] > 0).all() and (defects[i] <= DEFECT).all() else None
        for i in range(len(systems))
    ]  # fmt: skip
    if not plan.has_kinks:
        return pairs
    return [pair if pair is None or (pair.certificate < LINEAR).all() else None for pair in pairs]


def memory(size: int) -> NDArray[np.float64]:
    """A workspace of `size` doubles, aligned to cache lines for vectors, with 1/k for each order k at its end."""
    room = np.zeros(size + LANES)
    first = -room.ctypes.data // 8 % LANES
    workspace = room[first : first + size]
    inverse = workspace[size - PAIR * (ORDER + 1) :].reshape(-1, 2, LANES)
    for k in range(1, ORDER + 1):
        inverse[k, 0] = 1.0 / k
        inverse[k, 1] = float(Fraction(1, k) - Fraction(1.0 / k))
    return workspace


def _pair(states: NDArray[np.float64], steps: int, magnitudes: NDArray[np.float64]) -> Pair:
    """The `Pair` of the states of three runs, shape (run, time, high or low part, n). magnitudes : shape (n,)."""
    fine, coarse, shifted = states
    size = np.maximum(magnitudes, np.abs(fine[:, 0]))
    gap = np.max(np.abs(difference(fine, coarse)) / size, axis=1)
    apart = np.max(np.abs(difference(shifted, coarse)) / size, axis=1)
    growth = apart / SHIFT
    certificate = np.where(gap < LINEAR, SAFETY * gap + CHANCE * (1.0 + growth), math.inf)
    return Pair(fine[:, 0], fine[:, 1], certificate, growth, steps)


def difference(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """a - b of double-doubles (time, part, number) that are near each other: the high parts' difference is exact."""
    return (a[:, 0] - b[:, 0]) + (a[:, 1] - b[:, 1])
