"""Continuous Petrov-Galerkin in time with projected gradients: both laws at order 2k, for any GENERIC system.

z is a polynomial of degree k on the step. At Gauss nodes c_j, weights b_j, Lagrange polynomials l_j,

    z'(c_j) = L(z_j) DE_j + M(z_j) DS_j,    DE_j = 1/b_j integral l_j grad E(z(x)) dx,    DS_j likewise:

sum b_j DE_j . z'_j is E1 - E0, and every term of it is 0. The integrals are by Gauss's rule with POINTS points: the
energy is exact up to that, and not claimed; likewise a nonlinear S. Gradients are projected in all coordinates, which
loses the angular momentum; tc_gauss, which projects stress and temperature only, keeps it.
"""

import numpy as np

from tcbench import Flow, Integrator, family, hookimpl
from tcbench.reference.quadrature import gauss, integrals, lagrange

POINTS = 8


def combined(weights, values):
    """Their sum with weights."""
    return sum(w * x for w, x in zip(weights, values, strict=True))


def projected_gradients(k):
    def residual(z0, z1, h, system, stages):
        (c, b), (x, w) = gauss(k), gauss(POINTS)
        A, path = integrals(c, c).astype(float), integrals(c, x).astype(float)
        weight = (w[:, None] * lagrange(c, x) / b).T.astype(float)
        into, b = np.linalg.inv(A), b.astype(float)
        moved = [z - z0 for z in stages]
        hF = [combined(row, moved) for row in into]
        along = [system.state(z0 + combined(row, hF)) for row in path]
        slopes = [(system.gradient(z), system.entropy_gradient(z)) for z in along]
        rates = []
        for z, W in zip(stages, weight, strict=True):
            DE, DS = (system.state(combined(W, [s[i] for s in slopes])) for i in (0, 1))
            rates.append(system.reversible(z, DE, DS) + system.irreversible(z, DE, DS))
        ends = [change - h * combined(row, rates) for row, change in zip(A, moved, strict=True)]
        return np.concatenate([z1 - z0 - h * combined(b, rates), *ends])

    return residual


def cpg(k="2"):
    return Integrator(
        name="cpg",
        order=2 * int(k),
        claims={"entropy"},
        source="Giesselmann, Karsai and Tscherpel (2024); Andrews and Farrell (2025)",
        flows=Flow(projected_gradients(int(k)), stages=int(k)),
        by_default=False,
    )


@hookimpl
def tcbench_integrators():
    return [family(cpg, k=(2, 1, 3))]
