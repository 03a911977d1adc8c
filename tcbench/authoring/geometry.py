"""What a GENERIC system is beyond the two laws, of a general system: conditions far from the start, a Poisson bracket,
Onsager's relations, temperatures. Only a broken identity fails; the laws do not need the rest, which is told.

The formulas are differenced: a rate that is affine in a covector has its matrix as exact differences; derivatives of
the matrix by the state are central differences.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..analysis.structure import constant, rates_of, relative, state_in_words, written
from ..analysis.theorems import SEED, admissible_states
from ..systems.element_system import ElementSystem
from ..systems.scenario import Scenario
from ..systems.system import System
from .check_line import FAIL, NONE, OK, Line

Floats = NDArray[np.float64]
LARGE = 80  # numbers of a state from which on its matrices are not made
FAR, FAR_STATES = 8.0, 100  # times the spread of the random states, and how many
BROKEN = 1e-9  # of an identity: far states have terms of sizes far apart, whose round-off is above that of their sum
STATES = 20  # for what is differenced
CHANGE = 0.4  # of an entry of a covector, relative: two such changes leave its sign
EXACT = 1e-9  # of differences of affine functions
STEP = 1e-5  # of central differences, relative; their error is STEP**2, and round-off / STEP
NO_BRACKET = 1e-5


def of_general(test: Callable[[Scenario], Line]) -> Callable[[Scenario], Line | list[Line]]:
    """No line for elements: what they owe is asked of each of their formulas."""
    return lambda scenario: [] if isinstance(scenario.model, ElementSystem) else test(scenario)


def far(scenario: Scenario) -> Line:
    """The conditions at states up to eight times as far out as those on which the lines above are measured."""
    model = scenario.model
    if _violated(scenario, 1.0):
        return Line("far out", NONE, "not looked at: a condition does not hold near the start")
    if not (violation := _violated(scenario, FAR)):
        return Line("far out", OK, f"the conditions hold {FAR:g} times as far from the start")
    formula, defect, z = violation
    where = f"at {state_in_words(model, z)}"
    if defect:
        said = f"{written(model, formula)}: an identity that holds near the start is violated by {defect:.1e} {where}"
        return Line("far out", FAIL, said, "Identities hold at every state. Is there a branch in disguise?")
    remedy = "If such a state cannot be, let measures(z) say what must stay positive."
    return Line("far out", NONE, f"{written(model, formula)}: the entropy falls {where}", remedy)


def _violated(scenario: Scenario, reach: float) -> tuple[str, float, Any] | None:
    """A condition that does not hold at states so far out: whose it is, the defect (0: the entropy falls), where."""
    model, fallen = scenario.model, None
    for z in islice(admissible_states(scenario, np.random.default_rng(SEED), reach), FAR_STATES):
        dE, dS = np.asarray(model.gradient(z)), np.asarray(model.entropy_gradient(z))
        reversible, irreversible = rates_of(model, z, dE, dS)
        for name, rate, covector in (
            ("reversible", reversible, dE), ("reversible", reversible, dS), ("irreversible", irreversible, dE)
        ):  # fmt: skip
            if (defect := relative(covector, rate)) > BROKEN:
                return name, defect, z
        if dS @ irreversible < -BROKEN * (np.abs(dS) @ np.abs(irreversible)):
            fallen = "irreversible", 0.0, z
    return fallen


def bracket(scenario: Scenario) -> Line:
    """reversible(z, dE, dS) is L(z) dE, and the bracket a . L b satisfies Jacobi's identity."""
    model = scenario.model
    if reason := _beyond(model):
        return Line("bracket", NONE, reason)
    seen, where = _Differenced(scenario, "reversible", "dE"), written(model, "reversible")
    which, remedy = np.flatnonzero(~seen.constant), "Both laws hold without it; a Hamiltonian system has it."
    if not any(seen.rate(z).any() for z in seen.states):
        return Line("bracket", NONE, "nothing is reversible")
    if not seen.affine(which):
        return Line("bracket", NONE, f"{where}: not linear in dE, so it is no bracket L(z)", remedy)
    if not all(np.allclose(seen.skew(z, which) @ seen.true(z), seen.rate(z), atol=1e-9) for z in seen.states):
        if seen.constant.any():
            return Line("bracket", NONE, "not looked at: where dE is constant L cannot be seen")
        return Line("bracket", NONE, f"{where}: a part of the rates is without dE, so it is no bracket L(z)", remedy)
    worst = max(_jacobi(seen, z, which) for z in seen.states)
    if worst > NO_BRACKET:
        return Line("bracket", NONE, f"{where}: Jacobi's identity is violated by {worst:.1e}, relative", remedy)
    return Line("bracket", OK, "linear in dE, and Jacobi's identity holds")


def _jacobi(seen: _Differenced, z: Floats, which: Any) -> float:
    """a . (L b . grad) L c and its cyclic permutations, their sum over the sum of their terms' sizes."""
    L, total, size = seen.skew(z, which), 0.0, 0.0
    covectors = seen.rng.standard_normal((3, len(z))) / seen.sizes
    for a, b, c in (covectors, covectors[[1, 2, 0]], covectors[[2, 0, 1]]):
        along = L @ b
        h = STEP / (np.abs(along) / seen.spread).max() if along.any() else 0.0
        slope = (seen.skew(z + h * along, which) - seen.skew(z - h * along, which)) / (2 * h) if h else 0.0 * L
        total, size = total + float(a @ slope @ c), size + float(np.abs(a) @ np.abs(slope) @ np.abs(c))
    floor = 1e-3 * float(
        np.abs(covectors[0]) @ np.abs(L) @ np.abs(covectors[1])
    )  # where L is constant all is round-off
    return abs(total) / max(size, floor, 1e-300)


def onsager(scenario: Scenario) -> Line:
    """Where the irreversible rates are linear, their matrices are symmetric: friction by dE where grad S is 0, mobility
    by dS where it changes."""
    model = scenario.model
    if reason := _beyond(model):
        return Line("Onsager", NONE, reason)
    looked = []
    for by in ("dE", "dS"):
        seen = _Differenced(scenario, "irreversible", by)
        which = np.flatnonzero(seen.still if by == "dE" else ~seen.constant)
        if len(which) < 2 or not seen.affine(which, which):
            continue
        for z in seen.states:
            A = seen.matrix(z, which)[which]
            gap = np.abs(A - A.T)
            if gap.max() > EXACT * np.abs(A).max():
                i, j = np.unravel_index(gap.argmax(), gap.shape)
                one, other = (model.component_names[which[k]] for k in (i, j))
                text = (
                    f"{written(model, 'irreversible')}: the rate of {one} changes with {by} of {other} by "
                    f"{A[i, j]:.3g}, that of {other} with {by} of {one} by {A[j, i]:.3g}"
                )
                remedy = "Both laws hold without it; a symmetric M(z) has it. What only turns is reversible."
                return Line("Onsager", NONE, text, remedy)
            if A.any() and by not in looked:
                looked.append(by)
    if not looked:
        return Line("Onsager", NONE, "nothing to be seen: one rate, or not linear")
    return Line("Onsager", OK, f"rates by {' and by '.join(looked)} are symmetric")


class _Differenced:
    """A rate of a system as a function of one of its covectors, on random states."""

    def __init__(self, scenario: Scenario, name: str, by: str) -> None:
        self.model, self.name, self.by = scenario.model, name, by
        self.rng = np.random.default_rng(SEED)
        self.states = [np.asarray(z) for z in islice(admissible_states(scenario, self.rng), STATES)]
        slopes = np.array([self.true(z) for z in self.states])
        entropies = np.array([np.asarray(self.model.entropy_gradient(z)) for z in self.states])
        self.constant, self.still = constant(slopes), (entropies == 0).all(axis=0)
        sizes = np.abs(slopes).max(axis=0)
        self.sizes = np.where(sizes > 0, sizes, 1.0)
        self.spread = np.ptp(self.states, axis=0)

    def true(self, z: Any) -> Floats:
        """The gradient whose place is varied."""
        return np.asarray(self.model.gradient(z) if self.by == "dE" else self.model.entropy_gradient(z))

    def rate(self, z: Any, covectors: Any = None) -> Floats:
        """The rates with covectors (m, size), or the true one."""
        dE, dS = np.asarray(self.model.gradient(z)), np.asarray(self.model.entropy_gradient(z))
        if covectors is not None:
            dE, dS = (covectors, dS) if self.by == "dE" else (dE, covectors)
        z, dE, dS = np.broadcast_arrays(np.asarray(z), dE, dS)
        rates: Floats = np.asarray(getattr(self.model, self.name)(z, dE, dS))
        return rates

    def moves(self, z: Any) -> Floats:
        """How far each entry of the covector may be changed; what is a temperature stays positive."""
        changes: Floats = CHANGE * np.where(self.still, self.sizes, np.abs(self.true(z)))
        return changes

    def affine(self, which: Any, rows: Any = slice(None)) -> bool:
        """Are these rates affine in these entries?"""
        for z in self.states:
            x, y = np.zeros((2, self.model.size))
            x[which], y[which] = self.rng.uniform(-1, 1, (2, len(which))) * self.moves(z)[which]
            both, one, other, none = self.rate(z, self.true(z) + np.array([x + y, x, y, 0 * x]))[:, rows]
            size = np.abs([both, one, other, none]).max()
            if not np.abs(both - one - other + none).max() <= EXACT * size:
                return False
        return True

    def matrix(self, z: Any, which: Any) -> Floats:
        """d rate / d covector of affine rates, shape (size, len(which))."""
        moves = np.diag(self.moves(z))[which]
        rates = self.rate(z, self.true(z) + moves) - self.rate(z, self.true(z) - moves)
        matrix: Floats = rates.T / (2 * self.moves(z)[which])
        return matrix

    def skew(self, z: Any, which: Any) -> Floats:
        """L(z), whose columns where dE is constant are those that make it skew."""
        L = np.zeros((len(z), len(z)))
        L[:, which] = self.matrix(z, which)
        others = np.setdiff1d(np.arange(len(z)), which)
        L[np.ix_(which, others)] = -L[np.ix_(others, which)].T
        return L


def temperatures(scenario: Scenario) -> Line:
    """Each is a quotient dE / dS of a component, and rises with it."""
    model = scenario.model
    if not model.n_temperatures:
        return Line("temperatures", NONE, "none")
    states = [np.asarray(z) for z in islice(admissible_states(scenario, np.random.default_rng(SEED)), STATES)]
    theta = np.array([np.asarray(model.temperatures(z)) for z in states])
    dE = np.array([np.asarray(model.gradient(z)) for z in states])
    dS = np.array([np.asarray(model.entropy_gradient(z)) for z in states])
    quotients = np.divide(dE, dS, out=np.full_like(dE, np.nan), where=dS != 0)
    matches = (np.abs(theta[:, :, None] - quotients[:, None, :]) < EXACT * theta[:, :, None]).all(axis=0)
    for k in np.flatnonzero(~matches.any(axis=1))[:1]:
        which = f"number {k} " if theta.shape[1] > 1 else ""
        text = f"{written(model, 'temperature')}: {which}is no dE / dS of a variable"
        finite = np.isfinite(quotients)
        bounds = [of(quotients, axis=1, where=finite, initial=end) for of, end in ((np.min, np.inf), (np.max, -np.inf))]
        outside = (theta[:, k] < bounds[0] * (1 - EXACT)) | (theta[:, k] > bounds[1] * (1 + EXACT))
        if not (outside.all() and theta.shape[1] <= finite.all(axis=0).sum()):
            return Line("temperatures", NONE, text, "If it is a mean of several, this is all right.")
        lowest, most = (of[0] for of in bounds)
        those = f"{lowest:.4g}" if lowest == most else f"{lowest:.4g} to {most:.4g}"
        text += f", nor between them: {theta[0, k]:.4g} for {those} at {state_in_words(model, states[0])}"
        return Line("temperatures", FAIL, text, "It is dE by dS: dE.s where S = s, 1 / dS.u where E = u.")
    return _stable(model, matches, states) or Line("temperatures", OK, "each is dE / dS of a variable")


def _beyond(model: System) -> str:
    """Why matrices are not looked at; empty if they are."""
    return "not looked at: the state is large" if model.size > LARGE else ""


def _stable(model: System, matches: Any, states: Any) -> Line | None:
    """The line where a temperature falls as its variable takes up energy: a heat capacity below 0."""
    spread = np.ptp(states, axis=0)
    for k, i in zip(*np.nonzero(matches), strict=True):
        for z in states:
            more = STEP * spread * (np.arange(len(z)) == i) * np.sign(model.gradient(z))
            here, after = (float(np.asarray(model.temperatures(state))[k]) for state in (z, z + more))
            if after < here * (1 - STEP**2):
                name = model.component_names[i]
                where = f"at {state_in_words(model, z)}"
                text = f"{written(model, 'energy')}: the temperature falls as {name} takes up energy, {where}"
                return Line("temperatures", NONE, text, "A heat capacity below 0 is unstable. Is it meant?")
    return None


TESTS = tuple(
    (name, of_general(test))
    for name, test in (("far out", far), ("bracket", bracket), ("Onsager", onsager), ("temperatures", temperatures))
)
