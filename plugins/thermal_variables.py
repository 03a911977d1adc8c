"""One monolithic method in three thermal variables: entropies (tc_monolithic), temperatures and energies of elements.

With y any of them, and slopes D of energies and entropies as functions of (pi, y), symmetrised as in (30)-(33):

    Theta = D_y e/D_y s,    sigma = D_pi e - Theta D_pi s,    D_pi s dpi + D_y s dy = h times the conduction at Theta,

and sigma, Theta in the place of the slopes of E. Energy and momenta are exact and entropy never falls, for the same
reason in each: sigma dpi + Theta ds = de. In the spirit of Conde Martin, Betsch and Garcia Orden (2016) and of Betsch
and Schiebl (2019), whose formulas may differ.
"""

import numpy as np

from tcbench import Integrator, hookimpl
from tcbench.compiler.array_states import each
from tcbench.compiler.divided_differences import rectangle, symmetrised_slopes


def monolithic(variables):
    def residual(y0, y1, h, system):
        y0, y1 = system.named(y0, "s"), system.named(y1, "s")  # y by the name of entropies, whatever it is
        mid, dy = (y0 + y1) / 2, y1 - y0
        system.check_shape(mid.q)
        slope = system.shape_gradient(mid.q)
        dpi = slope @ dy.q
        corners = each(rectangle, system.shape(y0.q), dpi, y0.s, dy.s, count=2)
        energies, entropies = system.by_thermal_variable(variables, *corners)
        (e_pi, e_y), (s_pi, s_y) = (each(symmetrised_slopes, x, count=2) for x in (energies, entropies))
        theta = e_y / s_y
        stress = e_pi - theta * s_pi
        DE, DS = system.assemble(stress @ slope, mid.p, theta), system.entropy_gradient(y0)
        dz = np.concatenate([dy.q, dy.p, s_pi * dpi + s_y * dy.s])
        return dz - h * (system.reversible(mid, DE, DS) + system.irreversible(mid, DE, DS))

    return residual


@hookimpl
def tcbench_integrators():
    return [
        Integrator(
            name=f"tc_{variables}",
            order=2,
            claims={"energy", "entropy", "angular_momentum"},
            source=f"eq. (6) in {words}; docs/thermal-variables.md",
            flows=monolithic(variables),
            variables=variables,
            by_default=False,
        )
        for variables, words in (("temperature", "temperatures"), ("energy", "energies"))
    ]
