"""The arrays of consistent collocation (`collocate`): one stretch of memory, and what stands where in it."""

from __future__ import annotations

from collections import namedtuple
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcbench.compiler.jit import compiled
from tcbench.compiler.kernels import WIDTH

from .formulas import POINTS, Coefficients, Given, given

# columns of `plan` (int64): addresses of the kernels, those on vectors last (0: none), then sizes
START, MOTION, SLOPES, FORCES, MEND, ITERATE, FINER, STIFF, EXTRAPOLATE, CLOSE = range(10)
N_Q, N_E, STAGES = range(10, 13)


class Work(NamedTuple):
    """The arrays of one step; k stages, n positions, e elements, m = n + e rates, M quadrature points.

    All are views of one array, because to hand a tuple of fifty to compiled code costs as much as several steps.
    Row i of `found` holds variable i at WIDTH nodes, of which k are used: U, N and V are views of it.
    """

    c: Any  # the time step, the constants of the system, and what depends on them only
    inverse_mass: Any  # (n,)
    given: Any  # what `gauss_kernels.iteration` reads: see `gauss_kernels.Given`, and the views of it below
    found: Any  # and what it writes
    U: Any  # (m, WIDTH) the iterate
    N: Any  # (m, WIDTH) the rates that it gives
    V: Any  # (n, WIDTH) velocities
    state0: Any  # (2 n + 2 e,) q, p, pi and s at the start of the step
    block: Any  # (k WIDTH,): of the conduction, by columns
    columns: Any  # (k, WIDTH): the same
    u: Any  # (e,) left and right of the conduction
    v: Any
    scale: Any  # (2,) of forces and of heat in a residual
    stiff: Any  # (2,): h, lambda
    rates: Any  # N, then V
    ratio: Any  # (1,) this step over the last
    sums: Any  # what `gauss_kernels.closing` writes
    start: Any  # what the first kernel gives at the start of the step
    end: Any  # and at its end
    laws: Any  # (2 n + e + 2 + invariants,): a state, its energy, the energy and the invariants that it should have
    run: Any  # (1,) the energy at the start of the run
    mended: Any  # what the fifth kernel makes of them
    seen: Any  # (2,) the contraction of the last solve, and the quadrature that it took
    at_nodes: Any  # (k, 2 n + 2 e) velocities, positions, stresses, temperatures
    drift: Any  # (k, 2 e) rates of shapes and entropies
    at_points: Any  # (M, 2 e) shapes and entropies
    slopes: Any  # (M, 2 e) stresses and temperatures
    FG: Any  # (m,)
    rho: Any  # (k,)
    left: Any  # (k, k)
    J: Any  # (k m, k m) of Newton's method
    rhs: Any  # (k m,)
    base: Any  # (k m,)
    x0: Any  # (2 e,) shapes and entropies at the start
    dz: Any  # (2 n + e,)
    z1: Any  # (2 n + e,)
    z: Any  # (2 n + e,) of a run: where it is
    carry: Any  # and what rounding dropped on the way
    here: Any  # (2 n + e,) of a march: where it is
    dropped: Any  # and what rounding dropped on the way


# the order in memory: arrays, then the numbers of the method; then where the views of `given` begin
STORED = (
    "c", "inverse_mass", "given", "found", "stiff", "ratio", "sums", "start", "end", "laws", "run", "mended",
    "seen", "at_nodes", "drift", "at_points", "slopes", "FG", "rho", "left", "J", "rhs", "base", "x0", "dz", "z1", "z",
    "carry", "here", "dropped",
)  # fmt: skip
_NAMES = [*STORED, *Coefficients._fields, "stop", *(f"given_{x}" for x in Given._fields)]
PLACE: Any = namedtuple("PLACE", _NAMES)(*range(len(_NAMES)))  # type: ignore[misc]


def layout(n: int, e: int, numbers: Coefficients, constants: int, ends: int, invariants: int) -> NDArray[np.int64]:
    """Where in memory each array begins and the last ends; then where each field of `gauss_kernels.Given` begins."""
    k, m, points = len(numbers.nodes), n + e, POINTS[-1]
    place = given(n, e, k)
    sizes = {
        "c": constants, "inverse_mass": n, "given": place.scale.stop, "found": WIDTH * (2 * m + n) + 1, "stiff": 2,
        "ratio": 1, "sums": n + 3 * m, "start": ends, "end": ends, "laws": n + m + 2 + invariants, "run": 1,
        "mended": n + 1 + invariants, "seen": 2, "at_nodes": k * 2 * m, "drift": k * 2 * e,
        "at_points": points * 2 * e, "slopes": points * 2 * e, "FG": m, "rho": k, "left": k * k,
        "J": (k * m) ** 2, "rhs": k * m, "base": k * m, "x0": 2 * e, "dz": n + m, "z1": n + m,
        "z": n + m, "carry": n + m, "here": n + m, "dropped": n + m,
    } | {name: np.size(x) for name, x in numbers._asdict().items()}  # fmt: skip
    at = np.cumsum([0, *(sizes[name] for name in _NAMES[: PLACE.stop])])
    views = [*(x.start for x in place), place.scale.stop]
    return np.array([*at, *(at[PLACE.given] + x for x in views)], dtype=np.int64)


@compiled
def part(memory, at, i):  # type: ignore[no-untyped-def]
    return memory[at[i] : at[i + 1]]


@compiled
def unpack(plan, memory, at):  # type: ignore[no-untyped-def]
    """(Coefficients, Work) as views of the memory, which begin where `at` says (see `layout`)."""
    k, n, e = plan[STAGES], plan[N_Q], plan[N_E]
    m, points = n + e, POINTS[-1]
    found = part(memory, at, PLACE.found)
    rows = found[: len(found) - 1].reshape(2 * m + n, WIDTH)
    w = Work(
        c=part(memory, at, PLACE.c),
        inverse_mass=part(memory, at, PLACE.inverse_mass),
        given=part(memory, at, PLACE.given),
        found=found,
        U=rows[:m],
        N=rows[m : 2 * m],
        V=rows[2 * m :],
        state0=memory[at[PLACE.given_q] : at[PLACE.given_block]],
        block=part(memory, at, PLACE.given_block),
        columns=part(memory, at, PLACE.given_block).reshape(k, WIDTH),
        u=part(memory, at, PLACE.given_u),
        v=part(memory, at, PLACE.given_v),
        scale=part(memory, at, PLACE.given_scale),
        stiff=part(memory, at, PLACE.stiff),
        rates=found[WIDTH * m : len(found) - 1],
        ratio=part(memory, at, PLACE.ratio),
        sums=part(memory, at, PLACE.sums),
        start=part(memory, at, PLACE.start),
        end=part(memory, at, PLACE.end),
        laws=part(memory, at, PLACE.laws),
        run=part(memory, at, PLACE.run),
        mended=part(memory, at, PLACE.mended),
        seen=part(memory, at, PLACE.seen),
        at_nodes=part(memory, at, PLACE.at_nodes).reshape(k, 2 * m),
        drift=part(memory, at, PLACE.drift).reshape(k, 2 * e),
        at_points=part(memory, at, PLACE.at_points).reshape(points, 2 * e),
        slopes=part(memory, at, PLACE.slopes).reshape(points, 2 * e),
        FG=part(memory, at, PLACE.FG),
        rho=part(memory, at, PLACE.rho),
        left=part(memory, at, PLACE.left).reshape(k, k),
        J=part(memory, at, PLACE.J).reshape(k * m, k * m),
        rhs=part(memory, at, PLACE.rhs),
        base=part(memory, at, PLACE.base),
        x0=part(memory, at, PLACE.x0),
        dz=part(memory, at, PLACE.dz),
        z1=part(memory, at, PLACE.z1),
        z=part(memory, at, PLACE.z),
        carry=part(memory, at, PLACE.carry),
        here=part(memory, at, PLACE.here),
        dropped=part(memory, at, PLACE.dropped),
    )
    numbers = Coefficients(
        nodes=part(memory, at, PLACE.nodes),
        barycentric=part(memory, at, PLACE.barycentric),
        at_start=part(memory, at, PLACE.at_start),
        at_end=part(memory, at, PLACE.at_end),
        A=part(memory, at, PLACE.A).reshape(k, k),
        A_squared=part(memory, at, PLACE.A_squared).reshape(k, k),
        b=part(memory, at, PLACE.b),
        Ahats=part(memory, at, PLACE.Ahats).reshape(len(POINTS), points, k),
        Ws=part(memory, at, PLACE.Ws).reshape(len(POINTS), k, points),
    )
    return numbers, w
