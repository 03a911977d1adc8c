"""The paper's monolithic method, which keeps every invariant that a system declares, whatever it is and however the
energy is written.

v = L DE + M DS keeps DE . v = 0 and DS . v >= 0, but J(z1) - J(z0) = h DJ . v is 0 only where J is quadratic and the
discrete gradient of E is as invariant as E. To v is added the shortest move c with

    DE . c = 0,   DS . c = 0,   DJ_k . (v + c) = 0,

DJ being discrete gradients, too: energy, entropy production and every J are exact. At the true gradients DJ . v = 0, so
c = O(h^2): order 2, and symmetric. Where the method keeps J already, c = 0. c is measured in units of the state, and
its part along what is left of DJ beside DE and DS (at an equilibrium nothing is) is damped: see
`mending.shortest_move`.
"""

from tcbench import Integrator, hookimpl
from tcbench.compiler.derivatives import const, lifted
from tcbench.solver.mending import by_variable, laws_product, shortest_move

NEXT_TO_REST = 1e-10  # of |DJ|^2, its part free of DE and DS: below it the entropy is not held, to keep J


def tc_invariant(z0, z1, h, system):
    DE, DS = system.discrete_gradients(z0, z1)
    mid = (z0 + z1) / 2
    v = system.reversible(mid, DE, DS) + system.irreversible(mid, DE, DS)
    DJ = system.momenta_discrete_gradients(z0, z1)
    if DJ:
        least, none = system.least_of(z0), const(0.0)
        weights = least * least + by_variable(system, mid, mid)
        v = v + shortest_move(
            system, [none, none, *lacks(system, DJ, v)], [DE, DS, *DJ], weights, dependent=NEXT_TO_REST
        )
        v = v + shortest_move(system, [none, *lacks(system, DJ, v)], [DE, *DJ], weights)
    return z1 - z0 - h * v


def lacks(system, DJ, v):
    return [-lifted(laws_product(system, slope, v)) for slope in DJ]


def refuses(system):
    return (
        "a system with constraints has its multipliers in DE, which this method projects" if system.multipliers else ""
    )


@hookimpl
def tcbench_integrators():
    return [
        Integrator(
            name="tc_invariant",
            order=2,
            claims={"energy", "entropy", "angular_momentum"},
            source="Romero (2009), eq. (6), projected onto the invariants (Gonzalez 1996; McLachlan, Quispel, "
            "Robidoux 1999)",
            flows=tc_invariant,
            refuses=refuses,
        )
    ]
