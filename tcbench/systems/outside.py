"""Open systems: loads and reservoirs as variables of the outside, so that both laws hold of the whole.

`clock` is the time, `work` the energy that the loads still have: E = H(..., clock) + work, and the rates

    clock' = dE/dwork = 1        work' = -dE/dclock - f . dE/dp        p' = -dE/dq + f dE/dwork

are skew for any covectors, of a force f that depends on the state as of a load in H. A reservoir is an entropy `heat`
at a given temperature, E = ... + theta . heat, that conducts with dE.heat. Source: Lanczos (1949), VI.1 (the time as
a variable); docs/solids.md.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import TcbenchError

if TYPE_CHECKING:
    from ..simulation.trajectory import Trajectory
    from .system import System

OUTSIDE: dict[str, tuple[Any, ...]] = {"clock": (), "work": ()}  # variables = {...} | OUTSIDE


def driven(dE: Any, rates: dict[str, Any], **forces: Any) -> dict[str, Any]:
    """Rates by name with those of the outside, and with forces by the name of the momentum that they act on.

    A force has the shape of its momentum, or is one number for all of it; what power it has it takes from `work`.
    Loads that have a potential need no force: they are terms of the energy with z.clock in them, as prescribed places
    are. TcbenchError for a force on what has no rate.
    """
    rates = dict(rates)
    power: Any = 0.0
    for name, force in forces.items():
        if name not in rates:
            raise TcbenchError(
                f"driven() has a force on {name!r}, which has no rate: give it by the name of its momentum, one of "
                f"{', '.join(rates)}."
            )
        stacked = np.stack(force) if isinstance(force, list | tuple) else force
        terms = stacked * getattr(dE, name)
        power = power + (terms.sum() if hasattr(terms, "sum") else terms)  # of a single number it is one term
        rates[name] = rates[name] + stacked * dE.work
    return rates | {"clock": dE.work, "work": -dE.clock - power}


def is_open(model: System) -> bool:
    """Has it loads and reservoirs among its variables?"""
    return OUTSIDE.keys() <= model.variables.keys()


def supplied(run: Trajectory) -> dict[str, NDArray[np.float64]]:
    """What the outside has given by each recorded time: "work" and, of reservoirs, "heat"; each of shape (m,).

    In the unit of the energy. Energy inside grows by their sum, exactly for methods that conserve E. The heat is that
    of the temperatures at each record: of reservoirs whose temperature is constant all of it. TcbenchError for systems
    without an outside.
    """
    model = run.scenario.model
    z = model.state(run.z)
    if not is_open(model):
        raise TcbenchError(f"{model.name!r} has no outside: its variables have no 'clock' and 'work' (docs/solids.md).")
    energies = {"work": z.work[0] - z.work}
    if "heat" in model.variables:
        theta = model.state(model.gradient(run.z)).heat
        energies["heat"] = ((z.heat[0] - z.heat) * theta).reshape(len(run.t), -1).sum(axis=1)
    return energies
