"""V0, the scale of energy errors, and the part of an error that is round-off.

V0 is the exergy at the start, E - theta_ref S + offset. Without a reference temperature, or next to rest, it is the
energy that moves: the largest amount that has gone from some numbers of the state into others along the exact motion,

    max over t of  1/2 sum_i |W_i(t)|,   W_i(t) = integral of dE/dz_i dz_i,   whose sum over i is 0.

It depends neither on the constant of the energy nor on what never moves: of an oscillator that rubs against a bath it
is the energy of the oscillator, however large the bath. Open systems always take it: what their loads and reservoirs
still hold does not count.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import TcbenchError
from .magnitudes import REST, energy_terms, exergy_at
from .outside import is_open

if TYPE_CHECKING:
    from .system import System

ULPS = 4.0  # round-off of E in units of the last place of its terms; exact laws leave at most 1.4 in all that ship
STEPS, TOLERANCE = 400, 1e-6  # of the solver on whose path the moving energy is measured
PIECES = 100  # no step of it is longer than t_end / PIECES
DIGITS = 2  # of the moving energy that V0 keeps: the rest depends on the solver
DENSE = 200  # length of a state up to which LSODA's dense Jacobian is affordable
HIDDEN = 0.01  # of V0: larger round-off hides what a method does to the energy


def energy_scale(model: System, z0: NDArray[np.float64], t_end: float) -> float:
    """V0 of a start; where nothing moves, the energy itself, or its magnitude."""
    magnitude, exergy = float(model.energy_magnitude), exergy_at(model, z0)
    rest = REST * max(magnitude, abs(float(model.energy(z0))))
    if model.reference_temperature and exergy > rest and not is_open(model):  # whose exergy is also that of the outside
        return exergy
    moved = energy_moved(model, z0, t_end)
    if moved > REST * magnitude:
        return float(f"{moved:.{DIGITS}g}")
    return exergy if exergy > rest else magnitude


def energy_moved(model: System, z0: NDArray[np.float64], t_end: float) -> float:
    """The energy that moves on the first STEPS steps of a solver, in the unit of energy; 0 where it takes none."""
    from scipy.integrate import LSODA, RK45

    from .right_hand_side import Field

    rate = Field(model).rate if model.multipliers else lambda t, z: np.asarray(model.vector_field(z))
    kind = LSODA if len(z0) <= DENSE else RK45
    work, moved = np.zeros(len(z0)), 0.0
    with np.errstate(all="ignore"):
        try:
            solver = kind(
                rate, 0.0, np.array(z0), t_end, rtol=TOLERANCE,
                atol=TOLERANCE * np.asarray(model.state_magnitudes), max_step=t_end / PIECES,
            )  # fmt: skip
            z, slope = np.array(z0), np.asarray(model.gradient(z0))
            for _ in range(STEPS):
                if solver.status != "running":
                    break
                solver.step()
                after = np.asarray(model.gradient(solver.y))
                work += (slope + after) / 2 * (solver.y - z)
                if not np.isfinite(work).all():
                    break
                moved, z, slope = max(moved, float(np.abs(work).sum()) / 2), solver.y.copy(), after
        except (TcbenchError, ArithmeticError, ValueError):
            return moved
        stuck = solver.t < t_end / PIECES  # as at a kink, where it turns to and fro: what moves later is not known
    return 0.0 if stuck else moved


def energy_round_off(model: System, z0: NDArray[np.float64]) -> float:
    """ULPS units in the last place of the terms that E is the sum of: smaller errors of E are invisible."""
    terms = abs(float(model.energy(z0))) if model.large else energy_terms(model, z0)
    return ULPS * float(np.finfo(float).eps) * terms
