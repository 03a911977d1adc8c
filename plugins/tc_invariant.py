"""The paper's monolithic method, corrected to keep every declared invariant, whatever it is and however the energy is
written.

A step of L DE + M DS from z to z~ keeps E, and S does not fall; J changes where it is not quadratic, or where the
discrete gradient of E is not as invariant as E. Then z~ is moved along slopes D_k there, W being squares of units,

    z1 = z~ + W (sum_k a_k D_k + b DS),   D_k of E, of every J, and of constraints,

by simplified Newton to the energy and the invariants of the run, and to the entropy of z~. The errors of z~ are O(h^3),
so that the order is 2. Of dependent invariants (Kepler's momentum, energy and Runge-Lenz vector) some are enough. Where
a step keeps every J between any two states, nothing is moved.

Next to an equilibrium DS is a combination of DE and DJ: the smaller its free part, the more is b damped. Energy and
invariants stay exact, and S may fall by round-off.
"""

from tcbench import Flow, Integrator, hookimpl
from tcbench.compiler.derivatives import lifted, maximum
from tcbench.solver.invariance import to_hold
from tcbench.solver.mending import Along, position_slopes, positions

from .tc_monolithic import tc_monolithic

AT_REST = 1e-12  # part of |DS|^2 that is free of the others, below which corrections along it are damped
ROUNDED = 1e-15  # fall of S, over its magnitude and size, that is not corrected: round-off
MAX_SLOPES = 10  # corrections of a step, each with new slopes


def onto_invariants(z0, z1, h, system, start, first, moved, chosen):
    """The residual of the correction `moved` of a step's end, now z1, along slopes at z0, to the constraints and to the
    energy and the invariants of `first`, the start of the run; all (n,). The entropy stays, or is raised to that of
    `start`, where the step began.

    chosen : (names,) of the invariants to hold; () where a step changes none: then nothing is corrected.
    """
    if not chosen:
        return z1 - z0
    held = [system.invariant_names.index(name) for name in chosen[0]]

    def laws(z):
        momenta = system.momenta(z)
        return [*positions(system, z), system.energy(z), *(momenta[k] for k in held), system.entropy(z)]

    momenta = system.momenta_gradients(z0)
    slopes = [system.gradient(z0), *(momenta[k] for k in held), system.entropy_gradient(z0)]
    weights, slopes = system.magnitudes_of(z0) ** 2, [*position_slopes(system, z0), *slopes]
    along = Along(system, slopes, lambda slope: weights * slope, AT_REST)
    before = system.entropy(start)
    least = before - ROUNDED * (system.entropy_magnitude + abs(before))
    values = along.before(laws(z1), moved)
    wanted = [*laws(first)[:-1], maximum(lifted(values[-1]), lifted(least))]
    return moved - along.move([target - f for target, f in zip(wanted, values, strict=True)])


def those_that_move(system):
    names = to_hold(system)
    return (names,) if names else ()


def projection(chosen):
    return Flow(onto_invariants, of_step=True, most=MAX_SLOPES, chosen=chosen)


@hookimpl
def tcbench_integrators():
    return [
        Integrator(
            name="tc_invariant",
            order=2,
            claims={"energy", "entropy", "angular_momentum"},
            source="Romero (2009), eq. (6), onto invariants (Gonzalez 1996; McLachlan, Quispel, Robidoux 1999)",
            flows=[tc_monolithic, projection(those_that_move)],
            tags={"constraints"},
            uses="tc_monolithic",
        )
    ]
