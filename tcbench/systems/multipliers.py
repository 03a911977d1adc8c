"""Multipliers at a state, in numbers: {g, dg/dt} lam = -grad(dg/dt) . f0 by one sparse solve, for systems of any size.

They give the ODE under the constraints, the nearest consistent start, and tell which constraints are redundant.
-{g, dg/dt} is G M^-1 G^T of mechanics, symmetric and positive definite where constraints are independent.
"""

from __future__ import annotations

import contextlib
import math
from typing import Any

import numpy as np

from ..compiler.caches import cached_property
from ..errors import TcbenchError
from .constrained import check_positions
from .sparse_jacobian import sparse_slopes
from .system import System

REDUNDANT = 1e-10  # of a diagonal entry: a smaller pivot is round-off
HELD = 1e-25  # G M^-1 G^T of a constraint that a force can hold; less is round-off of a start that is 1e-9 off
KEPT = 1e-9  # residual of a constraint that a start may have, over 1 + the size of the state
FAILED = 0.05  # independence (see `apart`) below which a run has failed for it
TAKES_PART = 0.05  # share in the vanishing direction, over the largest, of constraints that a sentence names
MOST_LOOKED_AT, MOST_STATES = 60, 2000  # constraints, and states of a run, up to which dependence is looked for
FLAT = 0.6  # independence on both sides of a flat position together, at most
SHARP = 0.25  # of this, by which the lines through both sides may miss 0 between them
SHOWN = 30  # numbers that a sentence writes out
CORRECTIONS = 50  # of a start, by Newton's method
CLOSE = 1e-15  # the last correction, over the size of the state


def values(system: Any, z: Any) -> Any:
    return system.constraint_values(z)


def speeds(system: Any, z: Any) -> Any:
    return system.constraint_speeds(z)


def reversible(system: Any, z: Any, covector: Any) -> Any:
    """L(z) covector, shape (size,): the force of a constraint of this slope."""
    return system.state(system.reversible(z, covector, system.state(system.entropy_gradient(z))))


class Multipliers:
    """The multipliers of a system with m constraints and states of n numbers."""

    def __init__(self, system: System) -> None:
        self.system = system
        self._bend = sparse_slopes(system, speeds)  # (m, n)
        self._slopes = sparse_slopes(system, values)  # (m, n)
        self._bracket = sparse_slopes(system, reversible, 2)  # (n, n)

    @cached_property
    def names(self) -> list[str]:
        """The name of each constraint's multiplier, m of them."""
        return [name for name, size in sizes(self.system).items() for _ in range(size)]

    def named(self, k: int) -> str:
        """Constraint k in words: 'lam', or 'number 2 of 3 of lam'."""
        name = self.names[k]
        of = self.names.count(name)
        return name if of == 1 else f"number {k - self.names.index(name) + 1} of {of} of {name}"

    def at(self, z: Any) -> tuple[Any, Any, Any, Any]:
        """Slopes of g, of dg/dt, L Dg^T and -{g, dg/dt} at a state, sparse: (m, n), (m, n), (n, m), (m, m)."""
        z = np.asarray(z, dtype=float)
        G, B = self._slopes(z), self._bend(z)
        force = self._bracket(z, np.zeros(len(z))) @ G.T
        return G, B, force, (-(B @ force)).tocsc()

    def factors(self, inertia: Any) -> Any:
        """LU factors (SuperLU) of -{g, dg/dt}, sparse (m, m); TcbenchError where it is not finite."""
        from scipy.sparse import diags
        from scipy.sparse.linalg import splu

        if not np.isfinite(inertia.data).all():
            raise TcbenchError(f"System {self.system.name!r}: slopes of constraints(z) are not finite at this state.")
        shift = REDUNDANT**1.5 * (np.abs(inertia.diagonal()) + 1e-300)  # so that a redundant one has a pivot
        return splu((inertia + diags(shift)).tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0,
                    options={"SymmetricMode": True})  # fmt: skip

    def values(self, z: Any) -> Any:
        """lam at a state z (n,), shape (m,)."""
        _, B, _, inertia = self.at(z)
        return self.factors(inertia).solve(B @ np.asarray(self.system.free_rate(z)))

    def rate(self, z: Any) -> Any:
        """dz/dt under the constraints at z (n,), shape (n,)."""
        free = np.asarray(self.system.free_rate(z))
        _, B, force, inertia = self.at(z)
        return free + force @ self.factors(inertia).solve(B @ free)

    def evaluated(self, address: int, z: Any, constants: Any, out: Any) -> None:
        """`rate`, called as a compiled kernel is."""
        out[:] = self.rate(z)

    def redundant(self, inertia: Any) -> list[int]:
        """Numbers of the constraints that follow from those before them. inertia : -{g, dg/dt}, sparse (m, m)."""
        factors = self.factors(inertia)
        own = np.abs(inertia.diagonal())[np.argsort(factors.perm_c)]
        pivots = np.abs(factors.U.diagonal())
        return sorted(np.argsort(factors.perm_c)[~(pivots > REDUNDANT * own)].tolist())

    def apart(self, z: Any) -> tuple[float, list[int]]:
        """Independence of the directions of constraints at z (n,), their smallest singular value: 1 where all are at
        right angles, 0 where they depend on each other; and the numbers of those that take part."""
        inertia = self.at(z)[3].toarray()
        sizes = np.sqrt(np.abs(np.diag(inertia)) + 1e-300)
        if not np.isfinite(inertia).all():
            return 1.0, [0]
        values, ways = np.linalg.eigh((inertia + inertia.T) / 2 / np.outer(sizes, sizes))
        parts = np.abs(ways[:, 0])
        return math.sqrt(max(values[0], 0.0)), np.flatnonzero(parts > TAKES_PART * parts.max()).tolist()

    def group(self, numbers: list[int]) -> str:
        """Several constraints in words."""
        *first, last = map(self.named, numbers)
        return f"{', '.join(first)} and {last}" if first else last

    def consistent(self, z: Any) -> Any:
        """The nearest state (n,) with g = 0 and dg/dt = 0: positions move along M^-1 Dg^T until g is round-off, then
        momenta change least in kinetic energy."""
        z = np.array(z, dtype=float)
        last = math.inf
        for _ in range(CORRECTIONS):
            G, B, _, inertia = self.at(z)
            weighed = self._bracket(z, np.zeros(len(z))) @ B.T
            weighed = weighed.multiply((np.abs(G).sum(axis=0) > 0).reshape(-1, 1)).tocsr()  # only what g reads moves
            move = -(weighed @ self.factors((G @ weighed).tocsc()).solve(np.asarray(self.system.constraint_values(z))))
            z += move
            size = float(np.abs(move).max(initial=0.0))
            if not CLOSE * np.abs(z).max() < size < last:
                break
            last = size
        _, _, force, inertia = self.at(z)
        for _ in range(2):
            z += force @ self.factors(inertia).solve(np.asarray(self.system.constraint_speeds(z)))
        return z


def sizes(system: System) -> dict[str, int]:
    """The number of constraints of each multiplier."""
    z = np.ones(system.size)
    with np.errstate(all="ignore"):
        values = system.constraints(system.state(z))
    return {name: len(np.ravel(np.asarray(values[name]))) for name in system.multipliers}


def multipliers(system: System) -> Multipliers | None:
    """The `Multipliers` of a system; None of one without constraints."""
    return Multipliers(system) if system.multipliers else None


def consistent_start(scenario: Any) -> Any:
    """The scenario from the nearest consistent state; the scenario itself where there are no constraints."""
    solved, model = multipliers(scenario.model), scenario.model
    return scenario if solved is None else scenario.replace(**model.initial_of(solved.consistent(scenario.z0)))


def check_start(system: System, z0: Any) -> None:
    """TcbenchError where constraints are redundant, or g or dg/dt is not 0 at the start z0 (n,)."""
    if (solved := multipliers(system)) is None:
        return
    check_positions(system)
    allowed = KEPT * (1.0 + float(np.abs(z0).max()))
    for rate in (False, True):
        residual = np.asarray(system.constraint_speeds(z0) if rate else system.constraint_values(z0))
        k = int(np.argmax(np.where(np.isnan(residual), np.inf, np.abs(residual))))
        if not abs(residual[k]) <= allowed:
            raise TcbenchError(
                f"System {system.name!r}: at the start {'the rate of constraints(z)' if rate else 'constraints(z)'} is "
                f"{residual[k]:.2g}, not 0 ({solved.named(k)}): {_cure(system, solved, z0)}"
            )
    inertia = solved.at(z0)[3]
    own = np.abs(inertia.diagonal())
    if not own.min() > HELD:
        raise TcbenchError(
            f"System {system.name!r}: at the start no force holds {solved.named(int(np.argmin(own)))}: constraints(z) "
            "is constant there (a square has no slope where it is 0: write what is squared), or of what has no inertia."
        )
    if redundant := solved.redundant(inertia):
        m = len(solved.names)
        group = solved.apart(z0)[1] if m <= MOST_LOOKED_AT else []
        among = [k for k in group if k != redundant[0]]
        raise TcbenchError(
            f"System {system.name!r}: of its {m} constraints {m - len(redundant)} are independent at the start; "
            f"{solved.named(redundant[0])} says nothing that {solved.group(among) if among else 'the others'} do not, "
            "so that the multipliers are not unique: leave it out, or start where its direction differs from theirs (a "
            "linkage that lies flat: beside the line)."
        )


def dependent(system: System, rows: Any, times: Any, failed: bool = False) -> str:
    """A sentence where constraints come to depend on each other in a run, as those of a linkage that passes its flat
    position, or at the last state of a run that failed; else "".

    rows : states, shape (m, n). times : shape (m,). A flat position is passed where the lines through `apart` on both
    sides meet at 0. Up to MOST_LOOKED_AT constraints.
    """
    solved = multipliers(system)
    if solved is None or len(solved.names) > MOST_LOOKED_AT or not len(rows):
        return ""
    some = np.unique(np.linspace(0, len(rows) - 1, min(len(rows), MOST_STATES)).astype(int))
    apart = np.array([solved.apart(rows[k])[0] for k in some])
    left, right = 2 * apart[1:-3] - apart[:-4], 2 * apart[3:-1] - apart[4:]  # lines through two states on each side
    sides = apart[1:-3] + apart[3:-1]
    passed = np.flatnonzero((left + right < SHARP * sides) & (apart[2:-2] < sides / 2) & (sides < FLAT)) + 2
    near = passed[0] if len(passed) else len(apart) - 1 if failed and apart[-1] < FAILED else None
    if near is None:
        return ""
    group = solved.group(solved.apart(rows[some[near]])[1])
    return (
        f"near t = {times[some[near]]:.4g} the constraints {group} come to depend on each other, as those of a linkage "
        "that lies flat: more than one motion leads on from there, and which is taken depends on step and method; "
        "write constraints that hold the wanted one, or keep the motion away from there"
    )


def _cure(system: System, solved: Multipliers, z0: Any) -> str:
    """The end of a sentence: the nearest consistent start."""
    z = None
    with np.errstate(all="ignore"), contextlib.suppress(TcbenchError, RuntimeError):
        z, start = solved.consistent(z0), np.asarray(z0)
    if (
        z is None
        or not np.all(np.isfinite(z))
        or np.abs(system.constraint_values(z)).max() > KEPT * (1.0 + np.abs(z).max())
    ):
        return "there is no state near it that satisfies them; do they contradict each other?"
    state, moved = system.state(z), np.abs(z - start) > KEPT * (1.0 + np.abs(z))
    names = [name for name, (first, end, _) in system.layout.items() if moved[first:end].any()]
    advice = "the nearest start that is consistent is scenario.consistent()"
    if sum(np.size(getattr(state, name)) for name in names) > SHOWN:
        return f"{advice}, which moves {' and '.join(names)} by at most {np.abs(z - start).max():.2g}."
    return f"{advice}, {', '.join(f'{n} = {np.round(getattr(state, n), 12).tolist()}' for n in names)}."
