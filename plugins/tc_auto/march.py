"""One run by two methods: which one steps, and how a state goes from one to the other."""

from __future__ import annotations

import math

from tcbench.compiler.language import Floats, Matrix, call, copy_into
from tcbench.compiler.library import Library

from ..tc_gauss import march as gauss
from ..tc_gauss.memory import Work as Gauss
from ..tc_taylor import march as taylor
from ..tc_taylor.march import Work as Taylor

# Explicit steps are measured in decay times of the conduction.
STABLE, STABLE_OF_ORDER = 2.0, 0.3  # those of order p that conduction bounds: about so many, and so many p
STIFF = 0.7  # of these: from here on conduction bounds a step
PATIENCE, MORE = 8, 10  # stiff steps in a row before the other method is tried, and so many times as many each time
LONGER = 4.0  # the first implicit step, over the last explicit one
COST, COST_OF_ORDER = 0.33, 0.062  # an explicit step of order p takes the time of so many iterations, and of so many p
OWED = 3.0  # iterations that the implicit method may take beyond what explicit steps would, before it is left


def steps(
    e: Taylor, g: Gauss, z: Floats, times: Floats, tolerance: float, defect: float, residual: float, states: Matrix
) -> int:
    """States (q, p, s) at `times` from z on; how many rows were reached."""
    taylor.begin(e, z)
    gauss.begin(g, z)
    copy_into(states[0], z)
    stable = STABLE + STABLE_OF_ORDER * e.order
    row, t, h, patience, explicit, given_up = 1, times[0], 0.0, PATIENCE, True, False
    while row < len(times):
        rate = gauss.decay_rate(g)
        if explicit:
            row, t, h = taylor.advance(e, times, tolerance, states, row, t, STIFF * stable / rate, patience)
            call(e.to_z, e.mended, e.given, g.here)
            gauss.go_to(g, g.here)
            patience *= MORE
        else:
            g.budget[0] = (COST + COST_OF_ORDER * e.order) * rate / stable
            g.budget[1] = math.inf if given_up else OWED
            row, t, h = gauss.advance(g, times, defect, residual, states, row, t, LONGER * h)
            keep_laws(e, g)
        if h == 0.0 and given_up:
            return row
        given_up = h == 0.0
        explicit = not explicit
    return row


def keep_laws(e: Taylor, g: Gauss) -> None:
    """The explicit method on from the other's state, to the energy and invariants of the start of the run."""
    taylor.start_from(e, g.z)
    e.target[e.size] = g.run[0]
    for i in range(e.size + 2, len(e.target)):
        e.target[i] = g.laws[i]


LOOPS = Library("auto", steps)
