"""The exact relative equilibrium of the double thermoelastic pendulum, and the gaps of a trajectory to it.

A relative equilibrium is a rigid rotation at rate w with one temperature: the masses lie on a line through
the origin at r1 and r1 + r2, and (PHYSICS section 5, from the balance of momenta of Romero (2009), section 4)

    f_b = m2 w^2 (r1 + r2)      f_a - f_b = m1 w^2 r1      (m1 r1^2 + m2 (r1 + r2)^2) w = J      energy = E

It is the state of largest entropy at given energy and angular momentum, so it is computed twice: from these
four equations, and by maximising S. The two must agree, or no equilibrium is reported.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..reference.precision import LONG

Floats = NDArray[np.float64]

# S is flat at its top: its values fix the strains only to about the square root of round-off.
AGREEMENT = 1e-6
LOWEST_STRAIN = -8.0  # springs shorter than e^-8 natural lengths are collapsed, not in equilibrium
FAR = np.log(100.0)  # an equilibrium with a spring of more than 100 natural lengths is called distant


@dataclass(frozen=True, eq=False)
class RelativeEquilibrium:
    """The relative equilibrium of largest entropy at one energy and angular momentum, or the finding that
    there is none.

    exists : False if none was found; then the numbers are NaN and `note` says why.
    distant : True where a spring is longer than 100 natural lengths. Logarithmic springs always pull back in
        the end, so an equilibrium exists even for the paper's data; but there strains grow like ln t, and a
        horizon shows nothing of it.
    strains : (2,) logarithmic strains.  temperature, rate : of the rigid rotation (the sign of `rate` is
        that of J).
    entropy : S, the largest at this E and J.  residual : largest relative defect of the four equations.
    maximum_gap : distance to the independent maximisation of S (strains, and temperature relative).
    """

    exists: bool
    distant: bool
    strains: Floats
    temperature: float
    rate: float
    entropy: float
    residual: float
    maximum_gap: float
    note: str


def relative_equilibrium(constants: Mapping[str, Any], E: float, J: float) -> RelativeEquilibrium:
    """Exact relative equilibrium of energy E and angular momentum J.

    constants : masses (2,), stiffness (2,), natural_lengths (2,), reference_temperature, coupling,
        heat_capacity.
    """
    c = _Constants(constants)
    best = _maximise_entropy(c, E, J)
    if best is None:
        return _none(
            f"S has no maximum at E = {E:.6g}, J = {J:.6g} inside the admissible strains: the energy does "
            "not suffice for a positive temperature, or a spring collapses."
        )
    theta_best = float(c.temperature(best, E, J))
    x, residual = _solve(c, E, J, np.append(best, [theta_best, J / float(c.inertia(best))]))
    strains, theta, rate = x[:2], float(x[2]), float(x[3])
    distance = max(float(np.max(np.abs(strains - best))), abs(theta_best / theta - 1))
    if not residual < 1e-10 or not distance < AGREEMENT or theta <= 0:
        return _none(
            f"The balance equations (defect {residual:.1e}) and the maximum of S do not agree "
            f"(distance {distance:.1e}); no relative equilibrium is claimed."
        )
    entropy = float(np.sum(c.coupling * strains + c.capacity * np.log(theta / c.reference)))
    distant = bool(np.max(strains) > FAR)
    note = f"Balance equations hold to {residual:.1e}; the maximum of S lies within {distance:.1e}."
    if distant:
        a, b = np.exp(strains)
        note += f" Springs would be {a:.3g} and {b:.3g} natural lengths long; expect growth, not convergence."
    return RelativeEquilibrium(True, distant, strains, theta, rate, entropy, residual, distance, note)


def _none(note: str) -> RelativeEquilibrium:
    nan = float("nan")
    return RelativeEquilibrium(False, False, np.full(2, nan), nan, nan, nan, nan, nan, note)


class _Constants:
    """The pendulum's numbers and the few functions of strains L (2,) that both computations share."""

    def __init__(self, constants: Mapping[str, Any]) -> None:
        self.m1, self.m2 = (float(x) for x in constants["masses"])
        self.C = np.asarray(constants["stiffness"], float)
        self.natural = np.asarray(constants["natural_lengths"], float)
        self.reference = float(constants["reference_temperature"])
        self.coupling = float(constants["coupling"])
        self.capacity = float(constants["heat_capacity"])

    def inertia(self, L: Any) -> Any:
        """m1 r1^2 + m2 (r1 + r2)^2 of collinear springs with strains L (2, ...)."""
        r1, r2 = self.natural[0] * np.exp(L[0]), self.natural[1] * np.exp(L[1])
        return self.m1 * r1**2 + self.m2 * (r1 + r2) ** 2

    def elastic(self, L: Any) -> Any:
        """Part of the energy (43) that does not depend on temperature."""
        well = [self.C[i] / 2 * L[i] ** 2 + self.coupling * self.reference * L[i] for i in range(2)]
        return well[0] + well[1]

    def temperature(self, L: Any, E: float, J: float) -> Any:
        """Temperature that gives energy E in rigid rotation at strains L; <= 0 where E does not suffice."""
        heat = E - J**2 / (2 * self.inertia(L)) - self.elastic(L)
        return self.reference + heat / (2 * self.capacity)

    def entropy(self, L: Any, E: float, J: float) -> Any:
        """Largest S at strains L (2, ...), E, J: rigid rotation, one temperature; -inf if E is too low."""
        theta = self.temperature(L, E, J)
        warm = theta > 0
        S = self.coupling * (L[0] + L[1]) + 2 * self.capacity * np.log(np.where(warm, theta, 1) / self.reference)
        return np.where(warm, S, -np.inf)

    def largest_strains(self, E: float) -> Floats:
        """(2,) strains beyond which elastic energy takes E and all heat, whatever the other spring gives."""
        b = self.coupling * self.reference
        free = (
            max(E, 0.0) + 2 * self.capacity * self.reference + np.sum(b**2 / (2 * self.C))
        )  # deepest wells lie at -b/C
        return np.sqrt(2 * free / self.C) - b / self.C


def _maximise_entropy(c: _Constants, E: float, J: float) -> Floats | None:
    """Strains (2,) of the largest S at fixed E and J, from values of S alone; None if there is no inner
    maximum.

    At fixed strains S is largest for rigid collinear rotation at one temperature (least kinetic energy at
    given J, no heat flow), so two unknowns remain. A grid over all admissible strains finds the right hill,
    Nelder-Mead climbs it.
    """
    from scipy.optimize import minimize

    axes = [np.linspace(LOWEST_STRAIN, top, 401) for top in c.largest_strains(E)]
    grid = c.entropy(np.meshgrid(*axes, indexing="ij"), E, J)
    if not np.any(np.isfinite(grid)):
        return None
    i, j = np.unravel_index(int(np.argmax(grid)), grid.shape)
    x = np.array([axes[0][i], axes[1][j]])

    def below(L: Floats) -> float:
        # In extended precision and relative to the top so far: plain doubles would blur the strains to 1e-7.
        L = L.astype(LONG)
        return float(top - c.entropy(L, E, J))

    for size in (0.2, 1e-3, 1e-5):  # restarts keep the simplex from collapsing before the top
        top = c.entropy(x.astype(LONG), E, J)
        simplex = x + size * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
        options: Any = {"xatol": 1e-11, "fatol": 0.0, "maxiter": 400, "initial_simplex": simplex}
        x = minimize(below, x, method="Nelder-Mead", options=options).x
    ends = np.array([[a[1], a[-2]] for a in axes])
    return x if np.all((ends[:, 0] < x) & (x < ends[:, 1])) else None


def _solve(c: _Constants, E: float, J: float, guess: Floats) -> tuple[Floats, float]:
    """Roots (L_a, L_b, theta, w) of the four equations and their largest relative defect.

    The unknowns are divided by their size, the equations by the size of their terms, so that 1e-14 means the
    same in each.
    """
    from scipy.optimize import root

    size = np.array([1.0, 1.0, c.reference, abs(guess[3]) or 1.0])

    def defects(y: Floats) -> Floats:
        L, theta, w = y[:2], y[2] * size[2], y[3] * size[3]
        length = c.natural * np.exp(L)
        r1, r2 = length
        heat = c.coupling * (theta - c.reference)
        fa, fb = (c.C * L - heat) / length
        terms = (np.abs(c.C * L) + abs(heat)) / length
        kinetic = c.inertia(L) * w**2 / 2
        stored = c.elastic(L) + 2 * c.capacity * (theta - c.reference)
        spin = c.m2 * w**2 * (r1 + r2)
        return np.array(
            [
                (fb - spin) / (terms[1] + spin + 1e-300),
                (fa - fb - c.m1 * w**2 * r1) / (terms[0] + terms[1] + spin + 1e-300),
                (c.inertia(L) * w - J) / max(abs(J), 1e-300),
                (kinetic + stored - E) / max(abs(E), abs(kinetic), 1e-300),
            ]
        )

    y = root(defects, guess / size, tol=1e-14).x
    for _ in range(4):  # polish: full Newton steps with a central-difference Jacobian, kept only while they help
        jacobian = np.column_stack([(defects(y + d) - defects(y - d)) / 2e-6 for d in 1e-6 * np.eye(4)])
        try:
            trial = y - np.linalg.solve(jacobian, defects(y))
        except np.linalg.LinAlgError:
            break
        if not np.max(np.abs(defects(trial))) < np.max(np.abs(defects(y))):
            break
        y = trial
    return y * size, float(np.max(np.abs(defects(y))))


def gaps(z: ArrayLike, equilibrium: RelativeEquilibrium, constants: Mapping[str, Any]) -> dict[str, Floats]:
    """Distance of the states z (n, 10) from the equilibrium, four arrays (n,), NaN if there is no
    equilibrium.

    entropy_gap : S_eq - S, >= 0 on a trajectory of the same E and J.
    strain_gap : max over the springs of |L - L_eq|.  temperature_gap : max over the springs of |theta -
        theta_eq|.
    rotation_gap : |w - w_eq| with the mean rate w = J/(m1 |q1|^2 + m2 |q2|^2) at the state's own J.
    """
    state = measures(z, constants)
    return {
        "entropy_gap": equilibrium.entropy - state["entropy"],
        "strain_gap": np.max(np.abs(state["strains"] - equilibrium.strains), axis=1),
        "temperature_gap": np.max(np.abs(state["temperatures"] - equilibrium.temperature), axis=1),
        "rotation_gap": np.abs(state["rate"] - equilibrium.rate),
    }


def measures(z: ArrayLike, constants: Mapping[str, Any]) -> dict[str, Floats]:
    """entropy (n,), strains (n, 2), temperatures (n, 2), rate (n,) of states z (n, 10): what `gaps` compares.

    Use it alone to show growth where no bounded equilibrium exists.
    """
    c = _Constants(constants)
    z = np.atleast_2d(np.asarray(z, float))
    q1, q2, p1, p2, s = z[:, 0:2], z[:, 2:4], z[:, 4:6], z[:, 6:8], z[:, 8:10]
    lengths = np.column_stack([np.hypot(*q1.T), np.hypot(*(q2 - q1).T)])
    strains = np.log(lengths / c.natural)
    temperatures = c.reference * np.exp((s - c.coupling * strains) / c.capacity)
    J = q1[:, 0] * p1[:, 1] - q1[:, 1] * p1[:, 0] + q2[:, 0] * p2[:, 1] - q2[:, 1] * p2[:, 0]
    inertia = c.m1 * (q1**2).sum(axis=1) + c.m2 * (q2**2).sum(axis=1)
    return {"entropy": s.sum(axis=1), "strains": strains, "temperatures": temperatures, "rate": J / inertia}
