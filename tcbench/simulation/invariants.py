"""Which declared invariants the steps of a method change, by how much, and for which of two causes.

A step of L DE + M DS changes J by h DJ . (L DE + M DS), DJ a discrete gradient of J. At the true gradients that is 0
where the equations conserve J. It is not 0 of itself where

- J is not quadratic: DJ is then not the gradient of J at the midpoint, at which L and M are taken; or
- the discrete gradient of E is not as invariant as E: of E written in coordinates (of F, of angles) the quotients are
  not those that a symmetry leaves alone. Of E written in invariants (F^T F, dot products) they are.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..systems.system import System
from .trajectory import Trajectory

KEPT = 1e-11  # change of an invariant in a step, over its terms, that is round-off of a solved step
OF_A_RUN = 1e-10  # the same in a run
AT_GRADIENTS = 1e-9  # the same of its rate by the equations themselves
CURE = "tc_invariant keeps it, whatever it is"


@dataclass(frozen=True, eq=False)
class Lost:
    """An invariant that steps of a method change: by how much, over its terms, and why."""

    name: str
    change: float
    why: str
    within: str = "in a step"

    @property
    def sentence(self) -> str:
        return f"{self.name.replace('_', ' ')} changes by {self.change:.1e} of its terms {self.within}: {self.why}"


def lost_by(pairs: Any, model: System) -> list[Lost]:
    """The declared invariants that change by more than round-off between the ends of steps.

    pairs : of states (size,), the two ends of each step. `Lost.change` is dimensionless, over the invariant's terms.
    """
    worst: dict[str, tuple[float, Any, Any]] = {}
    for z0, z1 in pairs:
        before, after = (np.asarray(model.momenta(np.asarray(z))) for z in (z0, z1))
        shares = abs(after - before) / term_sizes(model, z0, z1)
        for name, share in zip(model.invariant_names, shares, strict=True):
            if share > max(KEPT, worst.get(name, (0.0,))[0]):
                worst[name] = float(share), z0, z1
    return [Lost(name, share, cause(model, name, z0, z1)) for name, (share, z0, z1) in worst.items()]


def lost_in(run: Trajectory) -> list[Lost]:
    """The invariants that a run of a method that claims momenta changes by more than round-off."""
    model, losses = run.scenario.model, []
    if "angular_momentum" not in run.integrator.claims or run.steps < 1 or not model.invariant_names:
        return []
    sizes = term_sizes(model, run.z[0])
    for name, size in zip(model.invariant_names, sizes, strict=True):
        change = run.summary.invariant_error_max[name] / size
        if change > OF_A_RUN:
            k = int(np.argmax(np.abs(np.diff(run.invariants[name]))))
            losses.append(Lost(name, float(change), cause(model, name, run.z[k], run.z[k + 1]), "in the run"))
    return losses


def term_sizes(system: System, z0: Any, z1: Any = None) -> Any:
    """Size of the terms of each invariant, shape (n_invariants,): |J| + |dJ/dz| . size of the variables."""
    ends = np.abs([z0, z0 if z1 is None else z1]).max(axis=0)
    scale = 1e-3 * np.asarray(system.state_magnitudes)
    for a, b, _ in system.layout.values():
        scale[a:b] = np.maximum(scale[a:b], ends[a:b].max(initial=0.0))
    slopes = gradients(system, z0, 1e-6 * scale)
    with np.errstate(all="ignore"):
        return np.abs(np.asarray(system.momenta(np.asarray(z0)))) + np.abs(slopes) @ scale + 1e-300


def gradients(system: System, z: Any, step: Any) -> Any:
    """Gradients of the invariants by central differences of the steps `step` (size,), shape (n_invariants, size)."""
    moves = np.diag(step)
    up, down = (np.asarray(system.momenta(np.asarray(z) + sign * moves)) for sign in (1, -1))
    return ((up - down) / (2 * step)[:, None]).T


def cause(system: System, name: str, z0: Any, z1: Any) -> str:
    """Why a step from z0 to z1 changed the invariant, and what to do."""
    z0, z1 = np.asarray(z0), np.asarray(z1)
    k, mid, dz = system.invariant_names.index(name), (z0 + z1) / 2, z1 - z0
    step = 1e-5 * (np.abs(mid) + 1e-2)
    slope = gradients(system, mid, step)[k]
    change = float(system.momenta(z1)[k] - system.momenta(z0)[k])
    size = float(term_sizes(system, z0, z1)[k])
    rate = system.free_rate(mid) if system.multipliers else system.vector_field(mid)
    own = float(abs(slope @ np.asarray(rate)) / (np.abs(slope) @ np.abs(np.asarray(rate)) + 1e-300))
    if own > 1e3 * AT_GRADIENTS:
        return (
            f"the equations themselves change it (rate {own:.0e} of its terms): is a term of the rates or of it wrong?"
        )
    curved = not is_quadratic(system, k, z0, size)
    turned = abs(slope @ dz) > 0.05 * abs(change)
    causes = []
    if curved:
        causes.append(
            "it is not quadratic, and its gradient at the midpoint is not its difference (no change of variables in "
            "the energy helps; a J that is quadratic in other variables would)"
        )
    if turned or not curved:
        causes.append(
            "the equations keep it, but the discrete gradient of the energy is not as invariant as the energy: write "
            "energy() in invariants (of F in C = F^T F, of places in dot products, of angles in directors), or take "
            "midpoint_entropy, which keeps it and not the energy"
        )
    return f"{' and '.join(causes)}. {CURE}"


def is_quadratic(system: System, k: int, z: Any, size: float) -> bool:
    """Is invariant k at most quadratic? Its third differences along random lines, as long as the state, are then 0."""
    rng, length = np.random.default_rng(0), 0.2 * (np.abs(z) + 0.05 * np.abs(z).max())
    worst = 0.0
    for _ in range(8):
        way = length * rng.standard_normal(len(z))
        with np.errstate(all="ignore"):
            a, b, c, d = (float(system.momenta(np.asarray(z) + t * way)[k]) for t in (-1.5, -0.5, 0.5, 1.5))
        third = abs(d - 3 * c + 3 * b - a) / (abs(a) + abs(b) + abs(c) + abs(d) + size)
        worst = max(worst, third) if math.isfinite(third) else worst
    return worst < 1e-12
