"""Static solutions: the minimum of the energy over one variable, loads and all else as at the start."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import TcbenchError, unknown_name
from .over_spaces import space_of
from .sparse_jacobian import sparse_slopes

if TYPE_CHECKING:
    from .scenario import Scenario

CORRECTIONS, HALVINGS = 60, 30  # of Newton's method, and of a correction that would raise the energy
STILL = 1e-13  # of the size of a variable: the correction that is the last
SINGULAR = 1e-12  # smallest pivot over the largest, below which some motion meets no resistance


def gradient(system: Any, z: Any) -> Any:
    return system.gradient(z)


def at_rest(scenario: Scenario, variable: str = "q", held: Any = None) -> Scenario:
    """The scenario that begins in static equilibrium: dE/dq = 0 where q is not held, all else as it is.

    variable : the name of the places. held : of its shape or that of its first axis, True where a number is to stay,
    as at a clamped face. Loads are terms of the energy (docs/solids.md); a clock stands at its start. Newton's method
    with the sparse exact second derivatives, shortened until the energy falls.

    TcbenchError for an unknown variable, where something moves freely (hold it), and where there is no least energy
    near: then go there by parts of the load. Source: Bonet and Wood (2008), Nonlinear Continuum Mechanics, ch. 9.
    """
    from scipy.sparse.linalg import splu

    model = scenario.model
    if variable not in model.variables:
        raise unknown_name(f"variable of {model.name!r}", variable, model.variables)
    z = np.array(scenario.z0, dtype=float)
    free = np.flatnonzero(_free(model, variable, held))
    if not len(free):
        return scenario
    slopes, size = sparse_slopes(model, gradient), max(1.0, float(np.abs(z[free]).max(initial=0.0)))
    for _ in range(CORRECTIONS):
        g, K = np.asarray(model.gradient(z))[free], slopes(z)[free][:, free].tocsc()
        try:
            factors = splu(K, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        except RuntimeError:
            raise _moves_freely(model, variable) from None
        pivots = factors.U.diagonal()
        if not np.abs(pivots).min() > SINGULAR * np.abs(pivots).max():
            raise _moves_freely(model, variable)
        move = np.zeros(len(z))
        move[free] = factors.solve(-g)
        if pivots.min() < 0.0 or not g @ move[free] <= 0.0:
            break
        part = _lowering(model, z, move, float(g @ move[free]))
        z = z + part * move
        if np.abs(move).max(initial=0.0) <= STILL * size:
            return scenario.replace(**model.initial_of(z))
        if not part:
            break
    raise TcbenchError(
        f"There is no least energy of {scenario.name!r} near its start: begin nearer to it, from the solution of a "
        "part of the load, say."
    )


def _free(model: Any, variable: str, held: Any) -> Any:
    """Which numbers of z are free to move, booleans (size,); TcbenchError for `held` of another shape."""
    first, end, shape = model.layout[variable]
    mask, own = np.zeros(model.size, dtype=bool), np.ones(shape, dtype=bool)
    if held is not None:
        mask_held = np.asarray(held)
        if mask_held.dtype != bool or not mask_held.ndim or mask_held.shape != shape[: mask_held.ndim]:
            raise TcbenchError(
                f"held is True or False for each number of {variable!r}, shape {shape}, or for each entry of its first "
                f"axis; it has shape {np.shape(held)}."
            )
        own &= ~mask_held.reshape(*mask_held.shape, *(1,) * (len(shape) - mask_held.ndim))
    mask[first:end] = own.ravel()
    return mask


def _lowering(model: Any, z: Any, move: Any, slope: float) -> float:
    """The part of a move (size,) that lowers the energy, round-off aside; 0 where none does."""
    energy, part = float(model.energy(z)), 1.0
    allowed = 1e-14 * (model.energy_magnitude + abs(energy))
    for _ in range(HALVINGS):
        with np.errstate(all="ignore"):
            new = float(model.energy(z + part * move))
        if new <= energy + 1e-4 * part * slope + allowed:
            return part
        part /= 2
    return 0.0


def _moves_freely(model: Any, variable: str) -> TcbenchError:
    where = f", one for each {space}" if (space := space_of(type(model).declared_variables()[variable])) else ""
    return TcbenchError(
        f"The energy of {model.name!r} does not resist some motion of {variable!r}: hold what is clamped, held = an "
        f"array of True and False{where}."
    )
