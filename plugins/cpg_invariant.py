"""Continuous Petrov-Galerkin in time, projected onto the energy and every declared invariant: all laws at order 2k.

A step of `cpg` with k stages ends in z~: S has not fallen, E and each J have errors O(h^(2k+1)). z~ is then moved as in
`tc_invariant`, along discrete gradients, onto the energy and the invariants, with the entropy of z~. The move is as
small as these errors, so that the order stays 2k. Andrews and Farrell keep as many laws by auxiliary
variables inside the step; here the equations of a step and those of the laws are solved one after the other.
"""

from tcbench import Flow, Integrator, family, hookimpl
from tcbench.solver.invariance import independent_invariants

from .cpg import projected_gradients
from .tc_invariant import projection


def every_invariant(system):
    return (independent_invariants(system),)  # without invariants the energy is corrected all the same


def cpg_invariant(k="2"):
    return Integrator(
        name="cpg_invariant",
        order=2 * int(k),
        claims={"energy", "entropy", "angular_momentum"},
        source="Andrews and Farrell (2025), arXiv 2511.23266; Gonzalez (1996)",
        # a projected gradient keeps no invariant by itself
        flows=[Flow(projected_gradients(int(k)), stages=int(k)), projection(every_invariant)],
        tags={"projected"},
        by_default=False,
    )


@hookimpl
def tcbench_integrators():
    return [family(cpg_invariant, k=(2, 1, 3))]
