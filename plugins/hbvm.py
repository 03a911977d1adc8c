"""HBVM(k, s): a Hamiltonian boundary value method, collocation with more points of quadrature than stages.

z is a polynomial of degree s on the step, with z' = sum_i P_i(c) gamma_i over the first s shifted Legendre polynomials
P_i (orthonormal on [0, 1]) and gamma_i = sum_g w_g P_i(c_g) f(z(c_g)) over k >= s Gauss points. Order 2s. With k = s it
is Gauss collocation. Where nothing dissipates, L is constant and H a polynomial of degree 2k/s or less, the energy is
exact. With k > s quadratic invariants are lost; of heat and entropy it knows nothing: no claims.
"""

import numpy as np

from tcbench import Flow, Integrator, family, hookimpl


def boundary_value(k, s):
    def combined(weights, values):
        return sum(w * x for w, x in zip(weights, values, strict=True))

    def residual(z0, z1, h, system, stages=()):
        x, w = np.polynomial.legendre.leggauss(k)
        c, w = (x + 1) / 2, w / 2
        P = [np.sqrt(2 * i + 1) * np.polynomial.Legendre.basis(i, domain=[0, 1]) for i in range(s)]
        basis = np.array([p(c) for p in P])
        path = np.array([p.integ(lbnd=0)(c) for p in P])
        gamma = [z - z0 for z in (z1, *stages)]  # times h; P_0 is 1, so the first is the whole step
        f = [system.vector_field(system.state(z0 + combined(column, gamma))) for column in path.T]
        return np.concatenate([g - h * combined(row, f) for g, row in zip(gamma, basis * w, strict=True)])

    return residual


def hbvm(k="4", s="2"):
    return Integrator(
        name="hbvm",
        order=2 * int(s),
        source="Brugnano, Iavernaro and Trigiante (2010)",
        flows=Flow(boundary_value(int(k), int(s)), stages=int(s) - 1),
        by_default=False,
    )


@hookimpl
def tcbench_integrators():
    return [family(hbvm, k=(4, 6), s=(2, 1, 3))]
