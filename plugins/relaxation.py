"""Relaxation Runge-Kutta: explicit steps whose length in time is chosen so that the energy is right.

A step of the underlying method from z0 over tau ends in z0 + tau d(tau). The relaxed one ends in z0 + gamma tau d(tau),
with the gamma that keeps the energy, and stands for the time gamma tau (Ketcheson 2019), so the order stays. Here
gamma tau is the step h that is asked for, and tau solves E(z0 + h d(tau)) = E(z0), one scalar equation, by a fixed
number of secant steps from tau = h. Where every tau is a solution, at rest or where all energy is heat, it stays h.
Where there is none, as beyond the stability of the underlying method, the step is NaN and the run ends.
"""

import numpy as np

from tcbench import Integrator, family, hookimpl
from tcbench.compiler import derivatives as trace
from tcbench.compiler.array_states import each

TABLEAUX = {  # Hairer, Norsett & Wanner, Solving ODEs I, II.1: Runge's, Kutta's of order three, the classical one
    2: ([[], [1 / 2]], [0, 1]),
    3: ([[], [1 / 2], [-1, 2]], [1 / 6, 2 / 3, 1 / 6]),
    4: ([[], [1 / 2], [0, 1 / 2], [0, 0, 1]], [1 / 6, 1 / 3, 1 / 3, 1 / 6]),
}
SECANTS = 6
EPS = np.finfo(float).eps  # round-off of the energy, over the size of its terms
UNSEEN = 1e3  # units of round-off: where tau changes the energy by less, every tau is a solution
LEFT = 1e-12  # residual of the energy, over the size of its terms, above which there was no tau
NOT_ZERO = 1e-300  # added to a square by which is divided


def relaxed(order):
    A, b = TABLEAUX[order]

    def direction(z0, tau, system):
        """sum b_i f_i, and the sum of the sizes of its terms, component by component."""
        rates = []
        for row in A:
            inner = [a * f for a, f in zip(row, rates, strict=True) if a]
            rates.append(system.vector_field(system.state(z0 + tau * sum(inner[1:], inner[0])) if inner else z0))
        parts = [w * f for w, f in zip(b, rates, strict=True) if w]
        return sum(parts[1:], parts[0]), sum(abs(part) for part in parts)

    def residual(z0, z1, h, system):
        def tried(tau):
            """(direction at tau, gain of energy as DE . dz, which keeps its digits, sum of the sizes of its terms)."""
            d, size = direction(z0, tau, system)
            DE = system.discrete_gradient(z0, system.state(z0 + h * d))
            return d, DE @ (h * d), abs(DE) @ (h * size)

        d, g, size = tried(h)
        slope = -(system.gradient(system.state(z0 + h * d)) @ d)  # to leading order
        unseen = UNSEEN * EPS * size / h
        tau, step = h, -g * slope / (slope * slope + unseen * unseen + NOT_ZERO)
        for _ in range(SECANTS):
            tau, before = tau + step, g
            d, g, size = tried(tau)
            change, noise = g - before, EPS * size
            step = -g * step * change / (change * change + noise * noise + NOT_ZERO)
        room = trace.maximum(LEFT * size + EPS * abs(system.energy(z0)) + NOT_ZERO - abs(g), trace.const(0.0))
        return z1 - z0 - each(lambda x: trace.guarded(h * x, [1.0 / room]), d)

    return residual


def relaxation(order="4"):
    return Integrator(
        name="relaxation",
        order=int(order),
        claims={"energy"},
        source="Ketcheson (2019), SIAM J. Numer. Anal. 57: 2850-2870",
        flows=relaxed(int(order)),
        tags={"explicit"},
        by_default=False,
    )


@hookimpl
def tcbench_integrators():
    return [family(relaxation, order=(4, 2, 3))]
