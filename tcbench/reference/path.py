"""The exact motion at any time, to compare runs with: SciPy's LSODA at a tight tolerance.

Its states are not certified as those of `lookup` are: they show errors of 1e-8 and more, and ranges of quantities.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..compiler.caches import cached
from ..errors import TcbenchError
from ..systems.scenario import Scenario
from ..systems.system import System

Floats = NDArray[np.float64]
TOLERANCE = 1e-10  # relative, of the solver: its error at t = 25 is some 1e-8
MOST_STEPS, MOST_S = 50_000, 5.0  # steps and seconds; later times are not compared
DENSE = 200  # length of a state up to which LSODA's dense Jacobian is affordable


@dataclass(frozen=True, eq=False)
class Path:
    """times : of the solver's steps, shape (steps + 1,); lowest, highest : of each temperature and measure up to each
    of them, shape (steps + 1, watched); moves : the solver's step behind each polynomial, shape (steps,); terms : its
    coefficients in powers of (t - end of the step) / move, shape (steps, size, orders + 1)."""

    times: Floats
    lowest: Floats
    highest: Floats
    moves: Floats
    terms: Floats

    @property
    def end(self) -> float:
        return float(self.times[-1])

    def __call__(self, t: float) -> Floats:
        """The state, shape (size,), at a time up to `end`."""
        k = max(0, int(np.searchsorted(self.times, t)) - 1)
        powers = ((t - self.times[k + 1]) / self.moves[k]) ** np.arange(self.terms.shape[2])
        return np.asarray(self.terms[k] @ powers)

    def ranges(self, t: float) -> tuple[Floats, Floats]:
        """Lowest and highest value, (watched,) each, of each temperature and measure up to a time."""
        k = min(int(np.searchsorted(self.times, t)), len(self.times) - 1)
        return self.lowest[k], self.highest[k]


def watched(model: System, z: Floats) -> Floats:
    """Temperatures and measures of one state (n,) or several (m, n), shape (watched,) or (m, watched)."""
    return np.concatenate([np.asarray(model.temperatures(z)), np.asarray(model.shapes(z))], axis=-1)


def path_of(scenario: Scenario, t_end: float) -> Path | None:
    """The motion from a scenario's start up to t_end, or as far as the solver comes; None of large systems."""
    model = scenario.model
    if model.size > DENSE or model.multipliers:
        return None
    return _path(model.symbolic, _Start(model, scenario.z0), float(t_end))


class _Start:
    """A system and a state, equal where their numbers are."""

    def __init__(self, model: System, z0: Floats) -> None:
        self.model, self.z0 = model, z0
        self.key = model.constant_values.tobytes(), z0.tobytes()

    def __hash__(self) -> int:
        return hash(self.key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Start) and self.key == other.key


@cached
def _path(symbolic: System, start: _Start, t_end: float) -> Path | None:
    from scipy.integrate import LSODA

    model, began = start.model, time.thread_time()
    times, pieces, rows = [0.0], [], [np.array(start.z0)]
    with np.errstate(all="ignore"):
        try:
            solver = LSODA(
                lambda t, z: np.asarray(model.vector_field(z)), 0.0, np.array(start.z0), t_end, rtol=TOLERANCE,
                atol=TOLERANCE * np.asarray(model.state_magnitudes),
            )  # fmt: skip
            while solver.status == "running" and len(times) < MOST_STEPS and time.thread_time() - began < MOST_S:
                solver.step()
                if solver.status == "failed" or not np.isfinite(solver.y).all():
                    break
                times.append(float(solver.t))
                pieces.append(solver.dense_output())
                rows.append(solver.y.copy())
        except (TcbenchError, ArithmeticError, ValueError):
            pass
        if not pieces:
            return None
        values = watched(model, np.array(rows))
    terms = np.zeros((len(pieces), model.size, max(len(piece.p) for piece in pieces)))
    for row, piece in zip(terms, pieces, strict=True):
        row[:, : len(piece.p)] = piece.yh
    lowest, highest = np.minimum.accumulate(values), np.maximum.accumulate(values)
    return Path(np.array(times), lowest, highest, np.array([float(piece.h) for piece in pieces]), terms)
