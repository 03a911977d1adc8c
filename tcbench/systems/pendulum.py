"""The double thermoelastic pendulum of Romero (2009), sections 4 and 6. Everything is dimensionless.

Two masses in the plane; spring a from the origin to mass 1, spring b from mass 1 to mass 2; no gravity.
z = (q1x, q1y, q2x, q2y, p1x, p1y, p2x, p2y, s_a, s_b).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .element_system import ElementSystem

NOT_ZERO = 1e-100  # added to kappa t, so that no conduction at all is not 0/0; it changes no other number


class Springs(ElementSystem):
    """Masses in the plane, joined by thermoelastic springs; subclasses say which, and how heat is conducted."""

    positive = ("masses", "natural_lengths", "reference_temperature", "heat_capacity")
    non_negative = ("stiffness", "conductivity")

    def inertia(self) -> Any:
        return np.repeat(self.masses, 2)

    def element_energy(self, pi: Any, s: Any) -> Any:
        """Internal energies, eq. (43)."""
        c0, theta_ref = self.heat_capacity, self.reference_temperature
        L = self.log_strain(pi)
        heat = np.exp((s - self.coupling * L) / c0) - 1.0
        return self.stiffness / 2 * L**2 + self.coupling * theta_ref * L + c0 * theta_ref * heat

    def entropies(self, q: Any, theta: Any) -> Any:
        """s = beta L + c0 ln(theta/theta_ref), from theta = de/ds."""
        L = self.log_strain(self.shape(q))
        return self.coupling * L + self.heat_capacity * np.log(theta / self.reference_temperature)

    def log_strain(self, pi: Any) -> Any:
        """L = ln(lambda/lambda0), with pi = lambda^2."""
        return 0.5 * np.log(pi) - np.log(self.natural_lengths)

    def entropy_scale(self) -> Any:
        return self.heat_capacity


class Pendulum(Springs):
    """Masses in the plane, joined by thermoelastic springs; subclasses say which, and how heat is conducted.

    The state is z = (q, p, s), for the two springs of the paper shape (10,), dimensionless.

    Parameters
    ----------
    **values : number or array
        A value for each constant, of the shape that the class declares for it, such as shape (n_elements,).

    Raises
    ------
    TcbenchError
        As of `System`.

    References
    ----------
    Romero (2009), section 4, eqs. (22) and (43); docs/physics.md.
    """

    name = "pendulum"
    n_positions = 4
    n_elements = 2
    constants = {
        "masses": (2,),
        "stiffness": (2,),
        "natural_lengths": (2,),
        "conductivity": (),
        "reference_temperature": (),
        "coupling": (),
        "heat_capacity": (),
    }

    def shape(self, q: Any) -> Any:
        """pi = lambda^2, the squared lengths of the springs."""
        r_a, r_b = q[:2], q[2:] - q[:2]
        return np.array([r_a @ r_a, r_b @ r_b])

    def conduction(self, theta: Any) -> Any:
        """M DS as one vector, eq. (22): written with a difference of temperatures it keeps its digits."""
        a, b = theta
        return self.conductivity * np.array([(b - a) / a, (a - b) / b])

    def conduction_flow(self, theta: Any, t: Any) -> tuple[Any, Any]:
        """theta_a + theta_b stays, theta_a - theta_b decays as exp(-2 kappa t/c0): both springs have c0."""
        a, b = theta
        x = 2.0 * self.conductivity * t / self.heat_capacity + NOT_ZERO
        half, decayed = 0.5 * (a - b), np.expm1(-x)
        moved = half * decayed
        mean = half * (-decayed / x)
        increments = self.heat_capacity * np.log1p(np.array([moved / a, -moved / b]))
        return increments, np.array([0.5 * (a + b) + mean, 0.5 * (a + b) - mean])

    def invariants(self, q: Any, p: Any) -> dict[str, Any]:  # type: ignore[override]
        """Angular momentum q1 x p1 + q2 x p2."""
        return {"angular_momentum": q[0] * p[1] - q[1] * p[0] + q[2] * p[3] - q[3] * p[2]}
